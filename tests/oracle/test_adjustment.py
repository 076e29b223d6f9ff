"""`adjust`: every number of report.json, of the layers, of the images' tags and of the STAC items."""

import json
import math
from itertools import combinations
from types import SimpleNamespace

import dense_affine_block as dense
import independent_formulas as formulas
import numpy as np
import pytest
from osgeo import gdal
from pyproj import Transformer

AXES = ("east", "north", "height")
PARAMETERS = ("sample_0", "sample_s", "sample_l", "line_0", "line_s", "line_l")
FIT_PX = 2e-3  # the refined RPC is a fit of its correction, and 1e-6 px here; residuals of both solvers' last step


@pytest.fixture(scope="module")
def solution(scene: SimpleNamespace) -> SimpleNamespace:
    return dense.solve(scene)


@pytest.fixture(scope="module")
def away(scene: SimpleNamespace, adjusted: SimpleNamespace) -> SimpleNamespace:
    """What remains with the refined RPCs: positions, residuals on the ground and in the images, before and after."""
    position, ground, pixels, before = {}, {}, {}, {}
    for point, seen in scene.measured.items():
        rays = [(adjusted.refined[name], xy) for name, xy in seen.items()]
        near = scene.places.get(point, next(iter(scene.places.values())))
        position[point] = formulas.intersect(rays, near)
        at = scene.places.get(point, position[point])
        if point in scene.places:
            ground[point] = formulas.metres(scene.places[point], position[point])[0]
        own = scene.places.get(point)
        start = (
            own
            if own is not None
            else formulas.intersect([(scene.cameras[name], xy) for name, xy in seen.items()], near)
        )
        for name, xy in seen.items():
            pixels[point, name] = xy - adjusted.refined[name].project(at)[0]
            before[point, name] = xy - scene.cameras[name].project(start)[0]
    return SimpleNamespace(position=position, ground=ground, pixels=pixels, before=before)


def quantile_90(covariances: np.ndarray, weights: np.ndarray | None = None) -> tuple[float, float]:
    """Return CE90 and LE90 of normal errors with covariances ``(k, 3, 3)``, integrated over all directions."""
    angles = (np.arange(360) + 0.5) * np.pi / 180.0
    weights = np.ones(len(covariances)) if weights is None else weights
    inverse = np.linalg.inv(covariances[:, :2, :2])
    direction = np.array([np.cos(angles), np.sin(angles)])
    # density in polar coordinates: the share beyond r is the mean over directions of exp(-r² q / 2) / (q sqrt(det))
    q = np.einsum("ia,kij,ja->ka", direction, inverse, direction)
    root = np.sqrt(np.linalg.det(covariances[:, :2, :2]))[:, None]
    sigma = np.sqrt(covariances[:, 2, 2])

    def find(beyond, high):
        low = 0.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if np.average(beyond(middle), weights=weights) > 0.1 else (low, middle)
        return low

    circle = find(lambda r: np.mean(np.exp(-0.5 * r**2 * q) / (q * root), axis=1), 100.0)
    band = find(lambda r: np.array([math.erfc(r / s / math.sqrt(2.0)) for s in sigma]), 100.0)
    return circle, band


def test_every_number_of_the_report(scene, adjusted, solution, away):
    report, names = adjusted.report, solution.names
    expected: dict[str, tuple[float, float]] = {}
    kinds = {kind: [p for p in scene.measured if p.startswith(kind)] for kind in "GCT"}
    place = np.array([report["place"][key] for key in ("lon", "lat", "height_m")])
    middle = np.mean([away.position[point] for point in solution.ids], axis=0)
    box = np.array([away.position[point] for point in scene.measured])
    box = 0.5 * (box.min(axis=0) + box.max(axis=0))
    assert np.abs(formulas.metres(place, middle)[0]).max() < 60.0  # the middle in some sense of a block of 112 m
    assert np.abs(formulas.metres(place, box)[0]).max() < 60.0
    expected |= {
        "sigma0": (solution.sigma0, 2e-3), "observations": (solution.observations, 0),
        "unknowns": (solution.unknowns, 0), "redundancy": (solution.redundancy, 0.02), "outlier_count": (0, 0),
        "rejected.blunders": (0, 0), "rejected.doubtful": (0, 0),
    }  # fmt: skip
    for name in names:
        camera, own = scene.cameras[name], f"images.{name}"
        known = [point for point in scene.places if (point, name) in away.pixels]
        for axis, column in (("sample", 0), ("line", 1)):
            expected[f"{own}.rmse_{axis}_px"] = formulas.rms([away.pixels[p, name][column] for p in known]), FIT_PX
            expected[f"{own}.before_rmse_{axis}_px"] = (
                formulas.rms([away.before[p, name][column] for p in known]),
                FIT_PX,
            )
        # check points are measured in the image, too
        expected[f"{own}.observations"] = len(scene.measured), 0
        expected[f"{own}.tie_points"] = len(kinds["T"]), 0
        for key, of in (("tie_before_rmse_px", away.before), ("tie_rmse_px", away.pixels)):
            expected[f"{own}.{key}"] = formulas.rms([np.hypot(*of[p, name]) for p in kinds["T"]]), 5e-3  # weak priors
        first = solution.of_image[name]
        for index, key in enumerate(PARAMETERS):
            sigma = math.sqrt(solution.covariance[first + index, first + index])
            value = solution.parameters[name][index]
            expected[f"{own}.parameters.{key}.value"] = value, 2e-3 * sigma
            expected[f"{own}.parameters.{key}.sigma"] = sigma, 2e-3 * sigma
        bias, rand = stated_errors(camera, solution, name, place[2])
        expected[f"{own}.err_bias_m"], expected[f"{own}.err_rand_m"] = (bias, 2e-3 * bias), (rand, 2e-3 * rand)
        expected[f"{own}.pointing.sigma_m"] = camera.err_bias, 1e-5
        expected |= {f"{own}.{key}": value for key, value in view(camera, place[2]).items()}
        expected |= {
            f"{own}.correction.{key}": v for key, v in correction(camera, adjusted.refined[name], place[2]).items()
        }
        cells = {tuple((scene.measured[p][name] + 0.5) // 32) for p in kinds["T"]}
        expected[f"tie_coverage.{name}"] = len(cells) / 25.0, 1e-9
    expected |= known_points(scene, solution, away, kinds)
    ties = {"points": 40, "observations": 120}
    for own in ("ties", "ties.by_rays.3"):
        expected |= {f"{own}.{key}": (value, 0) for key, value in ties.items()}
        for key, of in (("before_rmse_px", away.before), ("rmse_px", away.pixels)):
            expected[f"{own}.{key}"] = (
                formulas.rms([np.hypot(*of[p, name]) for p in kinds["T"] for name in names]),
                5e-3,
            )
    expected["ties.images"] = 3, 0
    for own in ("held_out", "held_out.ties"):
        expected |= {f"{own}.{key}": (0, 0) for key in ("points", "observations", "wrong")}
    expected["held_out.tracks"] = 0, 0
    expected |= predicted_area(solution, kinds["T"])
    expected |= pairs(scene, adjusted, away, report["pairs"], kinds["T"], place[2])
    gsd = max(math.sqrt(pixel["gsd_sample_m"][0] * pixel["gsd_line_m"][0])
              for pixel in (view(camera, place[2]) for camera in scene.cameras.values()))  # fmt: skip
    ratio = max(value for path, (value, _) in expected.items() if path.endswith(".base_to_height"))
    expected["parts[0].gsd_m"] = gsd, 5e-3 * gsd  # at another height
    expected["parts[0].base_to_height"] = ratio, 5e-3
    formulas.compare(report, expected, {
        r"iterations|solves|history\[.*": "how the solver came there; its end is compared",
        r"images\..*\.rpc_fit_max_px": "compared with the tags below",
        r"images\..*\.pointing\.drift": "a published figure of the sensor, not of the block",
        r"place\..*": "the middle in some sense, compared above; all else is computed at its height",
        r"crs_operations.*": "zeros: nothing is transformed",
        r"normalised_residuals.*": "compared with the layers below",
        r"accuracy\..*points_required|.*\.leave_one_out": "constants of the standards; no factor here",
    })  # fmt: skip
    assert all(value == 0 for path, value in formulas.leaves(report["crs_operations"]) if not path.endswith(".points"))
    assert report["sigma0"] > 2.0  # or a figure without it would be right, too
    # 8 check points are fewer than any standard asks for
    assert not report["accuracy"]["asprs"]["enough_points"] and not report["accuracy"]["nssda"]["enough_points"]
    assert report["document"] == {"title": "A title", "client": "Client", "place": "Somewhere"}
    page = (adjusted.folder / "report.html").read_text(encoding="utf-8")
    assert "asks for at least 30 check points; this test used only 8" in page


def stated_errors(camera: formulas.Camera, solution: SimpleNamespace, name: str, height: float) -> tuple[float, float]:
    """Return ERR_BIAS and ERR_RAND: common and varying error of the image's points at a height, per axis."""
    first, size = solution.of_image[name], camera.size
    covariance = solution.covariance[first : first + 6, first : first + 6]
    axes = [np.linspace(0.0, n - 1.0, 5) for n in size]
    xy = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    on_ground = []
    for ground in camera.localize(xy, height):
        _, by_values, by_ground = dense.corrected(camera, solution.middle[name], solution.parameters[name], ground)
        on_ground.append(np.linalg.solve(by_ground[:, :2], by_values))
    on_ground = np.array(on_ground)
    shared = 0.5 * np.trace(on_ground.mean(axis=0) @ covariance @ on_ground.mean(axis=0).T)
    total = 0.5 * np.mean([np.trace(one @ covariance @ one.T) for one in on_ground])
    return math.sqrt(shared), math.sqrt(total - shared)


def view(camera: formulas.Camera, height: float) -> dict[str, tuple[float, float]]:
    """Return pixel size, incidence and azimuth in the middle of an image, seen from the ground."""
    middle = (np.array(camera.size) - 1.0) / 2.0
    ground = camera.localize(middle, height)[0]
    found = {}
    for axis, step in (("sample", [0.5, 0.0]), ("line", [0.0, 0.5])):
        ends = camera.localize([middle - step, middle + step], height)
        found[f"gsd_{axis}_m"] = float(np.hypot(*formulas.metres(ends[1], ends[0])[0, :2])), 1e-4
    east, north, up = formulas.to_satellite(camera, middle, height)[0]
    found["incidence_deg"] = math.degrees(math.acos(up)), 2e-3
    found["azimuth_deg"] = math.degrees(math.atan2(east, north)) % 360.0, 0.01
    assert ground[2] == height
    return found


def correction(vendor: formulas.Camera, refined: formulas.Camera, height: float) -> dict[str, tuple[float, float]]:
    """Return by how much the correction moves image points, and where pixels lie on the ground, over the image."""
    axes = [np.linspace(0.0, n - 1.0, 9) for n in vendor.size]
    xy = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    after = refined.localize(xy, height)
    pixels = xy - vendor.project(after)
    plan = formulas.metres(after, vendor.localize(xy, height))[:, :2]
    return {
        "mean_sample_px": (pixels[:, 0].mean(), 2e-3), "mean_line_px": (pixels[:, 1].mean(), 2e-3),
        "mean_east_m": (plan[:, 0].mean(), 2e-3), "mean_north_m": (plan[:, 1].mean(), 2e-3),
        "rms_px": (formulas.rms(np.hypot(*pixels.T)), 2e-3), "rms_m": (formulas.rms(np.hypot(*plan.T)), 2e-3),
    }  # fmt: skip


def known_points(scene, solution, away, kinds) -> dict[str, tuple[float, float]]:
    """Return the figures of GCPs and check points, of the standards, and the lists of both."""
    expected: dict[str, tuple[float, float]] = {}
    for entry, kind in (("control", "G"), ("check", "C")):
        ids = kinds[kind]
        error = np.array([away.ground[p] for p in ids])
        pixels = np.array([xy for (p, _), xy in away.pixels.items() if p in ids])
        expected[f"{entry}.points"] = len(ids), 0
        sigma = np.array([sigma_of_survey(scene, solution, away, p) for p in ids])
        order = np.argsort(-np.sum(error**2, axis=1), kind="stable")
        for column, axis in enumerate(AXES):
            expected[f"{entry}.rmse_{axis}_m"] = formulas.rms(error[:, column]), 1e-3
            expected[f"{entry}.sigma_survey_{axis}_m"] = dense.SURVEY_M[column], 1e-9
            for place, row in enumerate(order):
                expected[f"{entry}_points[{place}].{axis}_m"] = error[row, column], 2e-3
                expected[f"{entry}_points[{place}].sigma_{axis}_m"] = sigma[row, column], 4e-3 * sigma[row, column]
        for column, axis in enumerate(("sample", "line")):
            expected[f"{entry}.rmse_{axis}_px"] = formulas.rms(pixels[:, column]), FIT_PX
    east, north, up = np.array([away.ground[p] for p in kinds["C"]]).T
    radial = math.hypot(formulas.rms(east), formulas.rms(north))
    expected["check.ce90_m"] = formulas.CE90_OF_RADIAL * radial, 2e-3
    expected["check.le90_m"] = formulas.LE90 * formulas.rms(up), 2e-3
    survey = np.diag((solution.factor * dense.SURVEY_M) ** 2)
    covariances = np.array([
        dense.covariance_of_rays(solution, scene, p, away.position[p]) + survey for p in kinds["C"]
    ])  # fmt: skip
    for column, axis in enumerate(AXES):
        value = math.sqrt(covariances[:, column, column].mean())
        expected[f"check.predicted.rmse_{axis}_m"] = value, 3e-3 * value
    for key, value in zip(("ce90_m", "le90_m"), quantile_90(covariances), strict=True):
        expected[f"check.predicted.{key}"] = value, 5e-3 * value
    # ASPRS 2023 with the survey's own error; NSSDA 1998
    survey_h, survey_v = math.hypot(*dense.SURVEY_M[:2]), dense.SURVEY_M[2]
    plan, height = math.hypot(radial, survey_h), math.hypot(formulas.rms(up), survey_v)
    asprs = {
        "rmse_h_m": plan, "rmse_v_m": height, "rmse_3d_m": math.hypot(plan, height), "found_rmse_h_m": radial,
        "found_rmse_v_m": formulas.rms(up), "survey_rmse_h_m": survey_h, "survey_rmse_v_m": survey_v,
    }  # fmt: skip
    expected |= {f"accuracy.asprs.{key}": (value, 2e-3) for key, value in asprs.items()}
    expected["accuracy.nssda.vertical_m"] = 1.96 * formulas.rms(up), 4e-3
    if min(formulas.rms(east), formulas.rms(north)) >= 0.6 * max(formulas.rms(east), formulas.rms(north)):
        expected["accuracy.nssda.horizontal_m"] = 2.4477 * 0.5 * (formulas.rms(east) + formulas.rms(north)), 4e-3
    for axis, values in zip(AXES, (east, north, up), strict=True):
        expected[f"accuracy.mean_{axis}_m"] = values.mean(), 1e-3
    return expected | {"accuracy.points_in_plan": (8, 0), "accuracy.points_in_height": (8, 0)}


def sigma_of_survey(scene, solution, away, point: str) -> np.ndarray:
    """Return what survey - computed is judged by: of a GCP its survey and its rays, of a check point all but the survey
    predicted."""
    if point.startswith("C"):
        covariance = dense.covariance_of_rays(solution, scene, point, away.position[point])
        return np.sqrt(covariance.diagonal() + (solution.factor * dense.SURVEY_M) ** 2)
    by = np.concatenate([
        dense.corrected(scene.cameras[n], solution.middle[n], solution.parameters[n], scene.places[point])[2]
        for n in scene.measured[point]
    ])  # fmt: skip
    rays = dense.IMAGE_PX**2 * np.linalg.inv(by.T @ by)
    return solution.factor * np.sqrt(rays.diagonal() + dense.SURVEY_M**2)


def predicted_area(solution: SimpleNamespace, ties: list[str]) -> dict[str, tuple[float, float]]:
    """Return the accuracy over the block: tie points, those in one of 20 x 20 cells share its weight."""
    own = [solution.of_point[p] for p in ties]
    covariances = np.array([solution.covariance[k : k + 3, k : k + 3] for k in own])
    plan = np.array([solution.position[p][:2] for p in ties])
    low, high = plan.min(axis=0), plan.max(axis=0)
    cells = [tuple(np.minimum((one - low) / (high - low) * 20.0, 19.0).astype(int)) for one in plan]
    weights = np.array([1.0 / cells.count(cell) for cell in cells])
    expected = {
        "parts[0].gcps": (10, 0), "parts[0].ties": (40, 0), "parts[0].points": (40, 0), "parts[0].image_count": (3, 0),
        "parts[0].parallel_points": (0, 0), "parts[0].by_priors": (solution.by_priors, 0.01),
    }  # fmt: skip
    for column, axis in enumerate(AXES):
        value = math.sqrt(np.average(covariances[:, column, column], weights=weights))
        expected[f"parts[0].sigma_{axis}_m"] = value, 2e-3 * value
    for key, value in zip(("ce90_m", "le90_m"), quantile_90(covariances, weights), strict=True):
        expected[f"parts[0].{key}"] = value, 5e-3 * value
    return expected


def pairs(scene, adjusted, away, told, ties, height) -> dict[str, tuple[float, float]]:
    """Return the figures of the image pairs; overlaps of the RPCs as delivered, by the pixels of one in the other."""
    expected: dict[str, tuple[float, float]] = {}
    assert [(pair["first"], pair["second"]) for pair in told] == list(combinations(scene.cameras, 2))
    for index, (one, other) in enumerate(combinations(scene.cameras, 2)):
        own = f"pairs[{index}]"
        values = [np.hypot(*away.pixels[p, name]) for p in ties for name in (one, other)]
        expected[f"{own}.tie_points"] = len(ties), 0
        expected[f"{own}.tie_rmse_px"] = formulas.rms(values), 5e-3
        middle = np.array([79.5, 79.5])
        rays = [formulas.to_satellite(scene.cameras[name], middle, height)[0] for name in (one, other)]
        expected[f"{own}.convergence_deg"] = math.degrees(math.acos(rays[0] @ rays[1])), 0.02
        expected[f"{own}.base_to_height"] = math.hypot(*(rays[0][:2] / rays[0][2] - rays[1][:2] / rays[1][2])), 5e-4
        for key, first, second in (("overlap_first", one, other), ("overlap_second", other, one)):
            expected[f"{own}.{key}"] = overlap(scene.cameras[first], scene.cameras[second], height), 0.01
    return expected


def overlap(one: formulas.Camera, other: formulas.Camera, height: float) -> float:
    """Return the share of an image's pixels that another one sees, at a height."""
    samples, lines = one.size
    xy = np.stack(np.meshgrid(np.arange(0.0, samples), np.arange(0.0, lines)), -1).reshape(-1, 2)
    seen = other.project(one.localize(xy, height))
    return float(np.mean(np.all((seen > -0.5) & (seen < np.array(other.size) - 0.5), axis=1)))


def test_layers_hold_the_positions_sigmas_and_residuals(scene, adjusted, solution, away):
    """ground_points, image_points, both residual layers, images: each numeric column."""
    for row in formulas.layer(adjusted.package, "ground_points"):
        point, place = row["id"], np.array(row["geometry"]["coordinates"])
        assert np.abs(formulas.metres(place, away.position[point])).max() < 2e-3 or point.startswith("G")
        assert row["height"] == pytest.approx(place[2], abs=1e-6)
        assert row["rays"] == len(scene.measured[point])
        if point in solution.of_point:
            k = solution.of_point[point]
            assert np.abs(formulas.metres(place, solution.position[point])).max() < 2e-3
            sigma = np.sqrt(solution.covariance.diagonal()[k : k + 3])
        else:
            sigma = np.sqrt(dense.covariance_of_rays(solution, scene, point, place).diagonal())
        assert [row[f"sigma_{axis}_m"] for axis in AXES] == pytest.approx(sigma, rel=3e-3)
        if point in scene.places:
            survey = [row["survey_lon"], row["survey_lat"], row["survey_height"]]
            assert np.abs(formulas.metres(survey, scene.places[point])).max() < 1e-6
            assert (row["sigma_xy"], row["sigma_h"]) == pytest.approx(
                (formulas.rms(dense.SURVEY_M[:2]), dense.SURVEY_M[2])
            )
    seen = {}
    for row in formulas.layer(adjusted.package, "image_points"):
        point, name = row["id"], row["image"]
        seen[point, name] = row
        assert [row["sample"], row["line"]] == pytest.approx(scene.measured[point][name], abs=1e-9)
        assert [row["residual_sample_px"], row["residual_line_px"]] == pytest.approx(
            away.pixels[point, name], abs=FIT_PX
        )
        assert (row["sigma_px"], row["quality"], row["weight"]) == pytest.approx((dense.IMAGE_PX, 1.0, 1.0))
    assert set(seen) == set(away.pixels)
    for name in ("residuals_wgs84", "residuals_utm"):
        rows = formulas.layer(adjusted.package, name)
        assert len(rows) == len(away.pixels) + len(away.ground)
        for row in rows:
            point = row["id"]
            if row["level"] == "ground":
                found = [row[f"residual_{axis}_m"] for axis in AXES]
                assert found == pytest.approx(away.ground[point], abs=2e-3)
                sigma = [row[f"sigma_{axis}_m"] for axis in AXES]
                assert sigma == pytest.approx(sigma_of_survey(scene, solution, away, point), rel=4e-3)
            else:
                found = [row["residual_sample_px"], row["residual_line_px"]]
                assert found == pytest.approx(away.pixels[point, row["image"]], abs=FIT_PX)
                own = seen[point, row["image"]]
                for axis in ("sample", "line"):
                    assert row[f"sigma_{axis}_px"] == own[f"sigma_{axis}_px"]
                sigma = sigma_on_image(solution, scene, point, row["image"])
                assert [own["sigma_sample_px"], own["sigma_line_px"]] == pytest.approx(sigma, rel=5e-3)
    values = np.array([normalise(solution, scene, point, name) for point, name in seen if not point.startswith("C")])
    for axis, of_axis in zip(("sample", "line"), values.T, strict=True):
        expected = {
            "count": len(of_axis), "mean": np.mean(of_axis), "std": np.std(of_axis),
            "beyond_3": np.mean(np.abs(of_axis) > 3.0),
        }  # fmt: skip
        assert adjusted.report["normalised_residuals"][axis] == pytest.approx(expected, abs=3e-3)
    for row in formulas.layer(adjusted.package, "images"):
        camera = adjusted.refined[row["id"]]
        assert (row["samples"], row["lines"], row["observations"]) == (160, 160, len(scene.measured))
        ring = np.array(row["geometry"]["coordinates"][0])[:, :2]
        back = camera.project(np.column_stack([ring, np.full(len(ring), row["footprint_height_m"])]))
        edge = np.min(np.abs(np.column_stack([back + 0.5, back - 159.5])), axis=1)
        assert edge.max() < 0.02  # px: the outline is that of the outer pixel edges
        assert np.ptp(back, axis=0) == pytest.approx([160.0, 160.0], abs=0.02)


def normalise(solution, scene, point, name) -> np.ndarray:
    """Return Baarda's w of a measurement: v over the root of its variance, sigma² - A Q A', by the stated sigmas."""
    computed, by_values, by_ground = dense.corrected(
        scene.cameras[name], solution.middle[name], solution.parameters[name], solution.position[point]
    )
    rows = np.r_[solution.of_image[name] + np.arange(6), solution.of_point[point] + np.arange(3)]
    cofactor = solution.covariance[np.ix_(rows, rows)] / solution.factor**2
    design = np.hstack([by_values, by_ground])
    variance = dense.IMAGE_PX**2 - (design @ cofactor @ design.T).diagonal()
    return (scene.measured[point][name] - computed) / np.sqrt(variance)


def sigma_on_image(solution, scene, point, name) -> list[float]:
    """Return the sigmas of a residual: of the measurement, and of known points survey and camera as seen in it."""
    if point not in scene.places:
        return [solution.factor * dense.IMAGE_PX] * 2
    _, by_values, by_ground = dense.corrected(
        scene.cameras[name], solution.middle[name], solution.parameters[name], scene.places[point]
    )
    variance = solution.factor**2 * (dense.IMAGE_PX**2 + by_ground**2 @ dense.SURVEY_M**2)
    if point.startswith("C"):
        first = solution.of_image[name]
        covariance = solution.covariance[first : first + 6, first : first + 6]
        variance = variance + (by_values @ covariance @ by_values.T).diagonal()
    return np.sqrt(variance).tolist()


def test_tags_and_stac_items(scene, adjusted, solution):
    """The refined images: RPC, ERR_BIAS, ERR_RAND, outline, view angles with their sense, pixel size, times."""
    report = adjusted.report
    for name, camera in adjusted.refined.items():
        told = report["images"][name]
        assert camera.err_bias == pytest.approx(told["err_bias_m"], rel=1e-6)
        assert camera.err_rand == pytest.approx(told["err_rand_m"], rel=1e-6)
        assert told["rpc_fit_max_px"] < 1e-3
        original, copy = (gdal.Open(str(f / f"{name}.tif")).ReadAsArray() for f in (scene.folder, adjusted.folder))
        np.testing.assert_array_equal(original, copy)
        # the RPC is the vendor's with the correction, everywhere in the image and in the height range
        for height in (220.0, 280.0):
            xy = np.stack(np.meshgrid([0.0, 80.0, 159.0], [0.0, 80.0, 159.0]), -1).reshape(-1, 2)
            ground = scene.cameras[name].localize(xy, height)
            by = [
                dense.corrected(scene.cameras[name], solution.middle[name], solution.parameters[name], one)[0]
                for one in ground
            ]
            np.testing.assert_allclose(camera.project(ground), by, atol=5e-3)
        item = json.loads((adjusted.folder / f"{name}_stac.json").read_text(encoding="utf-8"))
        had = item["properties"]
        east, north, up = formulas.to_satellite(camera, [79.5, 79.5], report["place"]["height_m"])[0]
        assert had["view:incidence_angle"] == pytest.approx(math.degrees(math.acos(up)), abs=5e-3)
        # STAC: from the satellite's nadir to the scene, clockwise from north
        sense = (had["view:azimuth"] - math.degrees(math.atan2(-east, -north)) + 180.0) % 360.0 - 180.0
        assert abs(sense) < 0.02
        pixel = view(camera, report["place"]["height_m"])
        mean = math.sqrt(pixel["gsd_sample_m"][0] * pixel["gsd_line_m"][0])
        assert had["gsd"] == pytest.approx(mean, rel=5e-3)  # in the middle of the RPC's heights, and rounded
        each = math.hypot(camera.err_bias, camera.err_rand)
        assert had["accuracy:geometric_x_stddev"] == pytest.approx(each, abs=1e-4)
        assert had["accuracy:geometric_y_stddev"] == pytest.approx(each, abs=1e-4)
        assert had["accuracy:geometric_rmse"] == pytest.approx(math.sqrt(2.0) * each, abs=2e-4)
        assert had["hrsi:ce90_m"] == pytest.approx(report["check"]["ce90_m"], abs=1e-4)
        assert had["hrsi:le90_m"] == pytest.approx(report["check"]["le90_m"], abs=1e-4)
        ring = np.array(item["geometry"]["coordinates"][0])[:, :2]
        assert item["bbox"] == pytest.approx([*ring.min(axis=0), *ring.max(axis=0)], abs=1e-9)
        turned = 0.5 * np.sum(ring[:-1, 0] * ring[1:, 1] - ring[1:, 0] * ring[:-1, 1])
        assert turned > 0.0  # GeoJSON: outer rings are counter-clockwise
        heights = np.linspace(180.0, 330.0, 31)
        misses = [
            np.ptp(camera.project(np.column_stack([ring, np.full(len(ring), h)])), axis=0) - 160.0 for h in heights
        ]
        assert np.min(np.abs(misses)) < 0.2  # px: the outline of the whole image at a height of its range
        assert had["datetime"] is None and had["end_datetime"] == had["created"] == report["date"]
        assert item["assets"]["image"]["proj:shape"] == [160, 160]
        assert item["assets"]["image"]["file:size"] == (adjusted.folder / f"{name}.tif").stat().st_size
        for key in ("line_off", "samp_off", "lat_off", "long_off", "height_off", "err_bias", "err_rand"):
            assert had[f"rpc:{key}"] == pytest.approx(float(camera.value[key.upper()]), rel=1e-9)


def test_the_oracle_sees_errors_of_the_true_size(scene, adjusted, away):
    """The truth of the simulation: refined positions of check points are as wrong as the prediction says."""
    truth = {name: np.array(place) for name, place in true_places(scene).items()}
    error = np.array([formulas.metres(away.position[p], truth[p])[0] for p in truth if p.startswith("C")])
    predicted = adjusted.report["check"]["predicted"]
    for column, axis in enumerate(AXES):
        # 8 points of a common solution: at least 2 degrees of freedom, 0.5 % beyond 3.3 sigma
        assert formulas.rms(error[:, column]) < 3.3 * predicted[f"rmse_{axis}_m"]
    # leaving each image out of three predicts the others: no error of the cameras' common datum
    left = np.concatenate([
        formulas.predict([(adjusted.refined[n], xy) for n, xy in scene.measured[p].items()], away.position[p])
        for p in list(scene.measured)[:6]
    ])  # fmt: skip
    assert formulas.rms(left) < 3.0  # px: measured with 0.3, predicted from two others of nearly opposite directions


def true_places(scene: SimpleNamespace) -> dict[str, np.ndarray]:
    """Return the true ground points, WGS84 degrees."""
    rows = formulas.layer(scene.folder / "truth.gpkg", "true_ground_points")
    return {row["id"]: np.array([row["lon"], row["lat"], row["height"]]) for row in rows}


def test_frames_of_the_oracle_are_those_of_proj() -> None:
    """East, north, up of a metre by the geocentric positions' difference: the pipeline is understood rightly."""
    to_earth = Transformer.from_crs(4979, 4978, always_xy=True)
    here, there = (5.45, 43.53, 250.0), (5.4501, 43.5302, 262.0)
    away = np.subtract(to_earth.transform(*there), to_earth.transform(*here))
    lon, lat = np.radians(here[:2])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    np.testing.assert_allclose(
        formulas.metres(there, here)[0], [away @ east, away @ np.cross(up, east), away @ up], atol=1e-6
    )
