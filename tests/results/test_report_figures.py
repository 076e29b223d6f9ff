"""The report's figures, computed again by other code from the files and the truth of a simulated block.

Cameras are GDAL's RPC transformer, positions on the Earth are PROJ's, points are intersected by SciPy; standards are
written out by their formulas. Nothing of the engine takes part but the run that is judged.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyproj
import pytest
from osgeo import gdal, ogr
from scipy.optimize import least_squares

from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.refinement.models import MODELS
from hrsi.hrsi_engine.refinement.parameter_names import describe_parameter
from hrsi.hrsi_engine.results.image_facts import describe_acquisition
from hrsi.processing_algorithms import run

IMAGES = ("image_1", "image_2", "image_3")
EARTH_M, ALTITUDE_M = 6_371_000.0, 694_000.0  # mean radius; the orbit of the simulated sensor
TO_EARTH = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)


class Camera:
    """GDAL's transformer of the RPC in a file: pixel centres at whole numbers, as the report counts."""

    def __init__(self, path: str) -> None:
        self.dataset = gdal.Open(path)
        self.transformer = gdal.Transformer(self.dataset, None, ["METHOD=RPC", "RPC_PIXEL_ERROR_THRESHOLD=1e-6"])

    def project(self, lon: float, lat: float, height: float) -> np.ndarray:
        ok, (x, y, _) = self.transformer.TransformPoint(1, lon, lat, height)
        assert ok
        return np.array([x - 0.5, y - 0.5])

    def ground(self, sample: float, line: float, height: float) -> np.ndarray:
        ok, (lon, lat, _) = self.transformer.TransformPoint(0, sample + 0.5, line + 0.5, height)
        assert ok
        return np.array([lon, lat, height])


def east_north_up(ground: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Return a position in the local frame of another one, by PROJ."""
    frame = pyproj.Transformer.from_pipeline(
        f"+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 +lon_0={about[0]!r} "
        f"+lat_0={about[1]!r} +h_0={about[2]!r}"
    )
    return np.array(frame.transform(*ground))


def intersect(rays: list[tuple[Camera, np.ndarray]], near: np.ndarray) -> np.ndarray:
    """Return where the rays of image points meet: the least sum of squared image residuals."""
    unit = np.array([1e-5, 1e-5, 1.0])  # of about a metre

    def residuals(step: np.ndarray) -> np.ndarray:
        return np.concatenate([camera.project(*(near + step * unit)) - xy for camera, xy in rays])

    return near + least_squares(residuals, np.zeros(3), xtol=1e-12, ftol=1e-12).x * unit


class Result(NamedTuple):
    block: Path
    out: Path
    report: dict[str, Any]
    delivered: dict[str, Camera]
    refined: dict[str, Camera]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """Three images with known points and tie points: 12 check points, fewer than any standard asks for."""
    block, out = tmp_path_factory.mktemp("block") / "block", tmp_path_factory.mktemp("result") / "out"
    run("simulate", output_dir=str(block), size=300, images=3, gcps=9, checks=12, ties=40, seed=5)
    paths = [str(block / f"{name}.tif") for name in IMAGES]
    report = run(
        "triangulate", images=paths, output_dir=str(out), gcps=str(block / "ground_points.csv"),
        image_points=str(block / "image_points.csv"), tie_points="none", hold_out=0.0, title="A title", client="Client",
        place="Somewhere",
    )  # fmt: skip
    assert report["document"] == {"title": "A title", "client": "Client", "place": "Somewhere"}
    delivered = {name: Camera(path) for name, path in zip(IMAGES, paths, strict=True)}
    refined = {name: Camera(str(out / f"{name}.tif")) for name in IMAGES}
    return Result(block, out, json.loads((out / "report.json").read_text(encoding="utf-8")), delivered, refined)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def image_points(block: Path, kind: str) -> dict[str, list[tuple[str, np.ndarray]]]:
    """Return image and measured position of each point whose id begins with a letter."""
    found: dict[str, list[tuple[str, np.ndarray]]] = {}
    for row in table(block / "image_points.csv"):
        if row["id"].startswith(kind):
            xy = np.array([float(row["sample"]), float(row["line"])])
            found.setdefault(row["id"], []).append((row["image"], xy))
    return found


def middle(report: dict[str, Any]) -> np.ndarray:
    return np.array([report["place"][name] for name in ("lon", "lat", "height_m")])


def root_mean_square(values: Any) -> float:
    return math.sqrt(sum(value**2 for value in values) / len(values))


def test_accuracy_by_the_formulas_of_the_standards(result: Result) -> None:
    surveyed = {row["id"]: row for row in table(result.block / "ground_points.csv") if row["role"] == "check"}
    errors = []
    for name, rays in image_points(result.block, "C").items():
        survey = np.array([float(surveyed[name][column]) for column in ("lon", "lat", "height")])
        found = intersect([(result.refined[image], xy) for image, xy in rays], survey)
        errors.append(-east_north_up(found, survey))  # survey - computed
    east, north, up = np.array(errors).T
    sigma_xy, sigma_h = ([float(row[name]) for row in surveyed.values()] for name in ("sigma_xy", "sigma_h"))
    rmse_h1 = math.sqrt(np.mean(east**2) + np.mean(north**2))
    rmse_h2 = math.sqrt(np.mean(np.square(sigma_xy)) + np.mean(np.square(sigma_xy)))
    rmse_v1, rmse_v2 = root_mean_square(up), root_mean_square(sigma_h)
    asprs = {
        "rmse_h_m": math.sqrt(rmse_h1**2 + rmse_h2**2), "rmse_v_m": math.sqrt(rmse_v1**2 + rmse_v2**2),
        "rmse_3d_m": math.sqrt(rmse_h1**2 + rmse_h2**2 + rmse_v1**2 + rmse_v2**2),
        "found_rmse_h_m": rmse_h1, "found_rmse_v_m": rmse_v1, "survey_rmse_h_m": rmse_h2, "survey_rmse_v_m": rmse_v2,
    }  # fmt: skip
    told = result.report["accuracy"]
    for name, value in asprs.items():
        assert told["asprs"][name] == pytest.approx(value, abs=2e-3), name  # m: GDAL's own inverse is good to 1e-3
    x, y = root_mean_square(east), root_mean_square(north)
    assert told["nssda"]["vertical_m"] == pytest.approx(1.96 * rmse_v1, abs=4e-3)
    if min(x, y) >= 0.6 * max(x, y):
        assert told["nssda"]["horizontal_m"] == pytest.approx(2.4477 * 0.5 * (x + y), abs=4e-3)
    else:
        assert told["nssda"]["horizontal_m"] is None
    assert result.report["check"]["ce90_m"] == pytest.approx(1.5175 * rmse_h1, abs=4e-3)
    assert result.report["check"]["le90_m"] == pytest.approx(1.6449 * rmse_v1, abs=4e-3)
    for name, values in (("east", east), ("north", north), ("height", up)):
        assert told[f"mean_{name}_m"] == pytest.approx(values.mean(), abs=2e-3)
    assert (told["points_in_plan"], told["asprs"]["enough_points"], told["nssda"]["enough_points"]) == (
        12,
        False,
        False,
    )
    page = (result.out / "report.html").read_text(encoding="utf-8")
    assert "asks for at least 30 check points; this test used only 12" in page
    print(f"RMSE_H {told['asprs']['rmse_h_m']:.3f} m, by other code {asprs['rmse_h_m']:.3f} m")


def test_views(result: Result) -> None:
    """By GDAL's camera, and by the geometry of the orbit: sin(incidence) = (R + H) / R · sin(off-nadir angle)."""
    truth = json.loads((result.block / "truth.json").read_text(encoding="utf-8"))
    height = middle(result.report)[2]
    for name in IMAGES:
        told, camera = result.report["images"][name], result.delivered[name]
        centre = (149.5, 149.5)
        ground = camera.ground(*centre, height)
        for axis, step in (("sample", (1.0, 0.0)), ("line", (0.0, 1.0))):
            moved = east_north_up(camera.ground(centre[0] + 50 * step[0], centre[1] + 50 * step[1], height), ground)
            assert told[f"gsd_{axis}_m"] == pytest.approx(math.hypot(*moved[:2]) / 50, rel=1e-3)
        east, north, up = east_north_up(camera.ground(*centre, height + 200.0), ground)
        assert told["incidence_deg"] == pytest.approx(math.degrees(math.atan2(math.hypot(east, north), up)), abs=0.01)
        tilt = math.radians(truth["images"][name]["along_deg"])
        by_orbit = math.degrees(math.asin((EARTH_M + ALTITUDE_M) / EARTH_M * math.sin(abs(tilt))))
        assert told["incidence_deg"] == pytest.approx(by_orbit, abs=0.1)
        if by_orbit > 1.0:
            turned = told["azimuth_deg"] - math.degrees(math.atan2(east, north))
            assert abs((turned + 180.0) % 360.0 - 180.0) < 0.1


def test_corrections(result: Result) -> None:
    """By GDAL's cameras; and what was wrong with the delivered RPC by the truth, within its noise."""
    height = middle(result.report)[2]
    truth = ogr.Open(str(result.block / "truth.gpkg"))
    layer = truth.GetLayerByName("true_ground_points")
    places = {row["id"]: (row["lon"], row["lat"], row["height"]) for row in layer}
    for name in IMAGES:
        told = result.report["images"][name]["correction"]
        pixels, metres = [], []
        for sample in np.linspace(0.0, 299.0, 5):
            for line in np.linspace(0.0, 299.0, 5):
                after = result.refined[name].ground(sample, line, height)
                pixels.append(np.array([sample, line]) - result.delivered[name].project(*after))
                metres.append(east_north_up(after, result.delivered[name].ground(sample, line, height))[:2])
        mean_px, mean_m = np.mean(pixels, axis=0), np.mean(metres, axis=0)
        assert [told["mean_sample_px"], told["mean_line_px"]] == pytest.approx(mean_px, abs=2e-3)
        assert [told["mean_east_m"], told["mean_north_m"]] == pytest.approx(mean_m, abs=2e-3)
        assert told["rms_px"] == pytest.approx(root_mean_square(np.hypot(*np.array(pixels).T)), abs=2e-3)
        assert told["rms_m"] == pytest.approx(root_mean_square(np.hypot(*np.array(metres).T)), abs=2e-3)
        wrong = [
            np.array([row["sample"], row["line"]]) - result.delivered[name].project(*places[row["id"]])
            for row in truth.GetLayerByName("true_image_points") if row["image"] == name
        ]  # fmt: skip
        off = np.mean(wrong, axis=0) - mean_px
        assert np.abs(off).max() < 4.0 * math.hypot(0.3, 0.1 / 0.7) / math.sqrt(9)  # 9 GCPs of 0.3 px and 0.1 m
        print(f"{name}: correction {mean_px.round(2)} px, true {np.mean(wrong, axis=0).round(2)}")


def test_tie_points_by_image_and_pair(result: Result) -> None:
    """Residuals at intersections by other code, before and after, and pairs counted one by one."""
    height = middle(result.report)[2]
    ties = image_points(result.block, "T")
    before, after = (squares_of(ties, cameras, height) for cameras in (result.delivered, result.refined))
    rejected = {(row["id"], row["image"]) for row in result.report["rejected"]["measurements"]}
    assert not rejected, "the seed has no rejected measurement, so that every tie takes part"
    for name in IMAGES:
        told = result.report["images"][name]
        assert told["tie_points"] == sum(image == name for rays in ties.values() for image, _ in rays)
        for key, squares in (("tie_before_rmse_px", before), ("tie_rmse_px", after)):
            values = [value for (_, image), value in squares.items() if image == name]
            assert told[key] == pytest.approx(math.sqrt(np.mean(values)), abs=0.02), (name, key)  # priors, GDAL
    pairs = {(pair["first"], pair["second"]): pair for pair in result.report["pairs"]}
    assert set(pairs) == set(combinations(IMAGES, 2))
    for (first, second), pair in pairs.items():
        common = [name for name, rays in ties.items() if {first, second} <= {image for image, _ in rays}]
        assert pair["tie_points"] == len(common)
        values = [after[name, image] for name in common for image in (first, second)]
        assert pair["tie_rmse_px"] == pytest.approx(math.sqrt(np.mean(values)), abs=0.02)
        ways = [direction(result.delivered[name], height) for name in (first, second)]
        assert pair["convergence_deg"] == pytest.approx(math.degrees(math.acos(ways[0] @ ways[1])), abs=0.05)
        base = ways[0][:2] / ways[0][2] - ways[1][:2] / ways[1][2]
        assert pair["base_to_height"] == pytest.approx(math.hypot(*base), abs=0.002)


def squares_of(
    ties: dict[str, list[tuple[str, np.ndarray]]], cameras: dict[str, Camera], height: float
) -> dict[tuple[str, str], float]:
    """Return the squared residual of each measurement at the intersection of its point's rays."""
    found = {}
    for name, rays in ties.items():
        near = cameras[rays[0][0]].ground(*rays[0][1], height)
        ground = intersect([(cameras[image], xy) for image, xy in rays], near)
        found |= {(name, image): float(np.sum((cameras[image].project(*ground) - xy) ** 2)) for image, xy in rays}
    return found


def direction(camera: Camera, height: float) -> np.ndarray:
    low, high = camera.ground(149.5, 149.5, height), camera.ground(149.5, 149.5, height + 200.0)
    way = east_north_up(high, low)
    return way / np.linalg.norm(way)


def test_every_parameter_has_unit_and_meaning() -> None:
    for model in MODELS.values():
        for name in model.parameters:
            told = describe_parameter(name)
            assert told["unit"] in {"px", "px/px", "px/px²", "m", "rad"} and told["meaning"], name
    assert describe_parameter("sample_l") == {
        "unit": "px/px",
        "meaning": "correction of the sample, proportional to line",
    }
    assert describe_parameter("p_1") == {"unit": "", "meaning": ""}


@pytest.mark.parametrize(
    ("name", "sensor", "acquired"),
    [("IMG_PHR1B_P_201308051042194_SEN.tif", "Pleiades", "2013-08-05T10:42:19Z"), ("plain.tif", None, None)],
)
def test_acquisition_is_told_where_a_name_or_delivery_states_it(
    result: Result, tmp_path: Path, name: str, sensor: str | None, acquired: str | None
) -> None:
    path = tmp_path / name
    path.write_bytes((result.block / "image_1.tif").read_bytes())
    assert describe_acquisition(open_image(str(path))) == {"sensor": sensor, "acquired": acquired}


# ---- colours ---------------------------------------------------------------------------------------------------------

#: Simulation of colour blindness, for linear RGB (Machado, Oliveira and Fernandes 2009, severity 1).
BLINDNESS = {
    "none": np.eye(3),
    "protan": np.array([[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]]),
    "deutan": np.array([[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]]),
    "tritan": np.array([[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]]),
}  # fmt: skip


def lab(colour: str, seen_with: np.ndarray) -> np.ndarray:
    """Return CIE L*a*b* (D65) of a colour as seen."""
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    linear = np.clip(seen_with @ np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4), 0.0, 1.0)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x, y, z = to_xyz @ linear / [0.9505, 1.0, 1.089]
    f = [value ** (1 / 3) if value > 0.008856 else 7.787 * value + 16 / 116 for value in (x, y, z)]
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def palettes() -> Iterator[dict[str, str]]:
    css = Path(__file__).resolve().parents[2] / "hrsi_engine" / "io" / "pages" / "templates" / "page.css"
    for line in css.read_text(encoding="utf-8").splitlines():
        if "--gcp:" in line:
            parts = (part.split(":") for part in line.strip().rstrip(";").split(";"))
            yield {name.strip(): value.strip() for name, value in parts}


@pytest.mark.parametrize("kind", BLINDNESS)
def test_colours_of_points_differ_for_the_colour_blind(kind: str) -> None:
    """Two colours 20 apart in CIE 1976 are told apart at a glance (a just noticeable difference is 2.3)."""
    for palette in palettes():
        seen = {name: lab(palette[f"--{name}"], BLINDNESS[kind]) for name in ("gcp", "check", "tie", "outlier")}
        apart = {(a, b): np.linalg.norm(seen[a] - seen[b]) for a, b in combinations(seen, 2)}
        assert min(apart.values()) > 20.0, apart
