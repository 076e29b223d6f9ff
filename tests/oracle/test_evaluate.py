"""`evaluate`: every number of its report and layers, by intersections of NumPy, one point after the other.

Two sets of RPCs that no adjustment made: those of the images, and the same moved by pixels that are known.
"""

import math
from itertools import combinations
from types import SimpleNamespace

import independent_formulas as formulas
import numpy as np
import pytest
from osgeo import gdal

from hrsi.processing_algorithms import run

AXES = ("east", "north", "height")
SHIFT_PX = {"image_1": (1.5, -2.5), "image_2": (-2.0, 1.0), "image_3": (0.5, 3.0)}
LEVEL_M = 240.0  # of the DEM: a plane, so that no interpolation takes part


@pytest.fixture(scope="module")
def evaluated(scene: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    folder = tmp_path_factory.mktemp("oracle_evaluate")
    (folder / "moved").mkdir()
    sets = {"own": scene.cameras, "moved": {}}
    for name, camera in scene.cameras.items():
        lines = []
        for key, value in camera.value.items():
            if key.endswith("_COEFF"):
                lines += [f"{key}_{k}: {one}" for k, one in enumerate(value.split(), 1)]
            elif key.split("_")[-1] in ("OFF", "SCALE"):
                number = float(value)
                number += SHIFT_PX[name][0] if key == "SAMP_OFF" else SHIFT_PX[name][1] if key == "LINE_OFF" else 0.0
                lines.append(f"{key}: {number!r}")
        path = folder / "moved" / f"{name}_RPC.TXT"
        path.write_text("\n".join(lines) + "\n")
        sets["moved"][name] = formulas.Camera(path)
    dem = gdal.Translate(str(folder / "dem.tif"), scene.dem)
    dem.GetRasterBand(1).WriteArray(np.full((dem.RasterYSize, dem.RasterXSize), LEVEL_M))
    del dem
    report = run(
        "evaluate", images=scene.images, rpcs=[f"moved={folder / 'moved'}"], tracks=scene.image_points,
        gcps=scene.gcps, image_points=scene.image_points, dem=str(folder / "dem.tif"), height_datum="ellipsoidal",
        reject=0.0, output_dir=str(folder / "out"),
    )  # fmt: skip
    fits = fit_all(scene, sets)
    return SimpleNamespace(report=report, package=folder / "out" / "evaluation.gpkg", fits=fits)


def fit_all(scene: SimpleNamespace, sets: dict[str, dict[str, formulas.Camera]]) -> dict[str, SimpleNamespace]:
    """Return each set's intersections, residuals and predictions."""
    fits = {}
    near = next(iter(scene.places.values()))
    for key, cameras in sets.items():
        rays = {p: [(cameras[n], xy) for n, xy in seen.items()] for p, seen in scene.measured.items()}
        ground = {p: formulas.intersect(rays[p], scene.places.get(p, near)) for p in rays}
        told = {p: formulas.predict(rays[p], ground[p]) for p in rays if p.startswith("T")}
        left = {
            p: {n: xy - cameras[n].project(ground[p])[0] for n, xy in seen.items()}
            for p, seen in scene.measured.items()
        }
        fits[key] = SimpleNamespace(cameras=cameras, ground=ground, predicted=told, left=left)
    return fits


def enlargement(rays: list[tuple[formulas.Camera, np.ndarray]], ground: np.ndarray) -> list[float]:
    """Return by how much predictions from the other images are noisier than a measurement, per coordinate."""
    B = [formulas.jacobian(camera, ground)[0] for camera, _ in rays]
    found = []
    for index, own in enumerate(B):
        others = np.vstack(B[:index] + B[index + 1 :])
        covariance = np.eye(2) + own @ np.linalg.inv(others.T @ others) @ own.T
        found.append(math.sqrt(0.5 * np.trace(covariance)))
    return found


def across(
    one: formulas.Camera, other: formulas.Camera, first: np.ndarray, second: np.ndarray, near: np.ndarray
) -> float:
    """Return how two rays miss each other, as one residual of all four coordinates (without its sign)."""
    position = formulas.intersect([(one, first), (other, second)], near)
    residual = np.concatenate([first - one.project(position)[0], second - other.project(position)[0]])
    return float(np.linalg.norm(residual))  # what least squares leaves is the null direction's part


@pytest.mark.thorough
def test_every_number_of_the_report(scene: SimpleNamespace, evaluated: SimpleNamespace) -> None:
    ties = [p for p in scene.measured if p.startswith("T")]
    names = list(scene.cameras)
    expected = {
        "tracks.points": (40, 0), "tracks.observations": (120, 0), "tracks.wrong": (0, 0),
        "tracks.without_position": (0, 0), "tracks.by_views.3": (40, 0), "tracks.made_rpcs": (0, 0),
        "tracks.held_out": (0, 0),
    }  # fmt: skip
    for key, fit in evaluated.fits.items():
        own = f"sets.{key}"
        told = np.concatenate([fit.predicted[p] for p in ties])
        length = np.sort(np.hypot(*told.T))
        rays = {p: [(fit.cameras[n], scene.measured[p][n]) for n in names] for p in ties}
        larger = [value for p in ties for value in enlargement(rays[p], fit.ground[p])]
        left = np.array([np.hypot(*xy) for p in ties for xy in fit.left[p].values()])
        above = np.array([fit.ground[p][2] - LEVEL_M for p in ties])
        # the quantile of n sorted values at (n - 1) q, linear between two
        place = 0.9 * (len(length) - 1)
        p90 = length[int(place)] + (place % 1.0) * (length[int(place) + 1] - length[int(place)])
        high, where = np.sort(np.abs(above)), 0.9 * (len(above) - 1)
        expected |= {
            f"{own}.predictions": (120, 0), f"{own}.predicted_rmse_px": (formulas.rms(length), 2e-3),
            f"{own}.predicted_median_px": (0.5 * (length[59] + length[60]), 2e-3),
            f"{own}.predicted_p90_px": (p90, 2e-3),
            f"{own}.noise_enlargement": (formulas.rms(larger), 1e-3), f"{own}.fit_rmse_px": (formulas.rms(left), 1e-3),
            f"{own}.fit_by_views.3": (formulas.rms(left), 1e-3), f"{own}.dem.points": (40, 0),
            f"{own}.dem.median_m": (float(np.median(above)), 2e-3), f"{own}.dem.nmad_m": (formulas.nmad(above), 2e-3),
            f"{own}.dem.p90_m": (high[int(where)] + (where % 1.0) * (high[int(where) + 1] - high[int(where)]), 2e-3),
        }  # fmt: skip
        assert p90 > 1.2 * np.median(length)  # or one could stand for the other
        for column, name in enumerate(names):
            rows = np.array([fit.predicted[p][column] for p in ties])
            expected |= {
                f"{own}.images.{name}.observations": (40, 0), f"{own}.images.{name}.predictions": (40, 0),
                f"{own}.images.{name}.fit_rmse_px": (formulas.rms([np.hypot(*fit.left[p][name]) for p in ties]), 1e-3),
                f"{own}.images.{name}.predicted_rmse_px": (formulas.rms(np.hypot(*rows.T)), 2e-3),
                f"{own}.images.{name}.predicted_mean_sample_px": (rows[:, 0].mean(), 2e-3),
                f"{own}.images.{name}.predicted_mean_line_px": (rows[:, 1].mean(), 2e-3),
            }  # fmt: skip
        for index, (one, other) in enumerate(combinations(names, 2)):
            pair = evaluated.report["sets"][key]["pairs"][index]
            assert (pair["first"], pair["second"], pair["points"]) == (one, other, 40)
            miss = [
                across(fit.cameras[one], fit.cameras[other], scene.measured[p][one], scene.measured[p][other],
                       fit.ground[p]) for p in ties
            ]  # fmt: skip
            expected |= {
                f"{own}.pairs[{index}].points": (40, 0),
                f"{own}.pairs[{index}].rmse_px": (formulas.rms(miss), 2e-3),
            }
        for entry, kind in (("control", "G"), ("check", "C")):
            ids = [p for p in scene.places if p.startswith(kind)]
            error = np.array([formulas.metres(scene.places[p], fit.ground[p])[0] for p in ids])
            pixels = np.array([
                scene.measured[p][n] - fit.cameras[n].project(scene.places[p])[0] for p in ids for n in names
            ])  # fmt: skip
            here = f"{own}.{entry}"
            expected[f"{here}.points"] = len(ids), 0
            for column, axis in enumerate(AXES):
                expected[f"{here}.rmse_{axis}_m"] = formulas.rms(error[:, column]), 2e-3
                expected[f"{here}.mean_{axis}_m"] = error[:, column].mean(), 2e-3
            east, north = formulas.rms(error[:, 0]), formulas.rms(error[:, 1])
            expected[f"{here}.ce90_m"] = formulas.CE90_OF_RADIAL * math.hypot(east, north), 4e-3
            expected[f"{here}.le90_m"] = formulas.LE90 * formulas.rms(error[:, 2]), 4e-3
            assert abs(east - north) > 0.02  # or CE90 from one of them twice would do
            expected[f"{here}.rmse_sample_px"] = formulas.rms(pixels[:, 0]), 1e-3
            expected[f"{here}.rmse_line_px"] = formulas.rms(pixels[:, 1]), 1e-3
    formulas.compare(evaluated.report, expected, {
        r"sets\..*\.pairs\[\d\]\.(bias|nmad)_px": "with the sign of a direction that is free; compared below",
        r"sets\..*\.scatter_px": "compared below",
        r"crs_operations.*": "zeros: nothing is transformed",
    })  # fmt: skip


def test_pairs_bias_and_scatter(scene: SimpleNamespace, evaluated: SimpleNamespace) -> None:
    """Median and NMAD of the residuals across the epipolar lines; their scatter about an affine trend is the noise."""
    ties = [p for p in scene.measured if p.startswith("T")]
    for key, fit in evaluated.fits.items():
        for pair in evaluated.report["sets"][key]["pairs"]:
            one, other = (fit.cameras[pair[name]] for name in ("first", "second"))
            values = []
            for p in ties:
                first, second = (scene.measured[p][pair[name]] for name in ("first", "second"))
                B = np.vstack([formulas.jacobian(camera, fit.ground[p])[0] for camera in (one, other)])
                null = np.linalg.svd(B.T)[2][-1]
                null *= np.sign(null[0] if abs(null[0]) > abs(null[1]) else null[1])
                residual = np.concatenate([
                    first - one.project(fit.ground[p])[0], second - other.project(fit.ground[p])[0]
                ])  # fmt: skip
                values.append(null @ residual)
            assert pair["bias_px"] == pytest.approx(np.median(values), abs=2e-3)
            assert pair["nmad_px"] == pytest.approx(formulas.nmad(values), abs=3e-3)
        scatter = evaluated.report["sets"][key]["scatter_px"]
        # 3 x 40 residuals of 0.3 px without three parameters each: 7 % standard deviation, and 1 - 3/40 of the variance
        assert scatter == pytest.approx(0.3 * math.sqrt(37.0 / 40.0), rel=0.25)


def test_layers(scene: SimpleNamespace, evaluated: SimpleNamespace) -> None:
    names = list(scene.cameras)
    for key, fit in evaluated.fits.items():
        rows = formulas.layer(evaluated.package, f"residuals_{key}")
        assert len(rows) == 120 + 18 * 3 + 18
        for row in rows:
            point = row["id"]
            if row["level"] == "ground":
                error = formulas.metres(scene.places[point], fit.ground[point])[0]
                assert [row[f"residual_{axis}_m"] for axis in AXES] == pytest.approx(error, abs=2e-3)
                continue
            found = [row["residual_sample_px"], row["residual_line_px"]]
            if point.startswith("T"):
                assert found == pytest.approx(fit.predicted[point][names.index(row["image"])], abs=4e-3)
            else:
                seen = fit.cameras[row["image"]].project(scene.places[point])[0]
                assert found == pytest.approx(scene.measured[point][row["image"]] - seen, abs=1e-3)
    told = evaluated.report["sets"]
    own = evaluated.fits["own"]  # the set of the images draws the footprints, at the points' median height
    ties = [place[2] for point, place in own.ground.items() if point.startswith("T")]
    height = float(np.median([*ties, *(place[2] for place in scene.places.values())]))
    for row in formulas.layer(evaluated.package, "images"):
        width, lines = scene.cameras[row["id"]].size
        ring = np.array(row["geometry"]["coordinates"][0])[:, :2]
        corners = own.cameras[row["id"]].project(np.column_stack([ring, np.full(len(ring), height)]))
        to_border = np.abs(np.concatenate([corners + 0.5, corners - [width - 0.5, lines - 0.5]], axis=1)).min(axis=1)
        np.testing.assert_allclose(to_border, 0.0, atol=2e-3)
        assert np.ptp(corners, axis=0) == pytest.approx([width, lines], abs=4e-3)
        for key in told:
            for figure in ("predicted_rmse", "fit_rmse"):
                assert row[f"{figure}_{key}"] == pytest.approx(told[key]["images"][row["id"]][f"{figure}_px"], abs=1e-9)
    pairs = [(key, pair) for key in told for pair in told[key]["pairs"]]
    for row, (key, pair) in zip(formulas.layer(evaluated.package, "pairs"), pairs, strict=True):
        assert row["set"] == key
        for name in ("first", "second", "points", "bias_px", "nmad_px", "rmse_px"):
            assert row[name] == (pair[name] if isinstance(pair[name], str) else pytest.approx(pair[name]))
