"""`tie-points`, `match`, `interest-points`, `measure-targets`, `gcps-from-reference`, `refine-rpc`, `hand-over`,
`orthorectify`, `ortho-check`: what pixels were measured at, by the truth of the simulation or by known shifts.

The true RPC of an image is unknown to the oracle; the truth of a point is the position that the simulation projected.
"""

import json
import math
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from independent_formulas import (
    MAD_TO_SIGMA,
    Camera,
    intersect,
    layer,
    metres,
    moved,
    nmad,
    predict,
    rms,
    table,
    to_satellite,
)
from osgeo import gdal
from pyproj import Transformer

from hrsi.processing_algorithms import run

MEASURED_PX = 0.15  # a match of rendered images with noise: a few hundredths, with the terrain's relief in the window


@pytest.fixture(scope="module")
def true_cameras(scene: SimpleNamespace, adjusted: SimpleNamespace) -> SimpleNamespace:
    """What all true image points of an image say of its camera: the delivered RPC and an affine correction of it."""
    rows = layer(scene.folder / "truth.gpkg", "true_ground_points")
    ground = {row["id"]: np.array([row["lon"], row["lat"], row["height"]]) for row in rows}
    seen: dict[str, dict] = {}
    for row in layer(scene.folder / "truth.gpkg", "true_image_points"):
        seen.setdefault(row["image"], {})[row["id"]] = np.array([row["sample"], row["line"]])
    corrections = {}
    for name, camera in scene.cameras.items():
        ids = [p for p in seen[name] if p in ground]
        at = camera.project([ground[p] for p in ids])
        terms = np.column_stack([np.ones(len(at)), at])
        found, *_ = np.linalg.lstsq(terms, np.array([seen[name][p] for p in ids]) - at, rcond=None)
        left = np.array([seen[name][p] for p in ids]) - at - terms @ found
        assert np.abs(left).max() < 0.05  # px: an affine correction is all that the vendor's error is here
        corrections[name] = found

    def project(name: str, places) -> np.ndarray:
        at = scene.cameras[name].project(places)
        return at + np.column_stack([np.ones(len(at)), at]) @ corrections[name]

    def localize(name: str, xy, height: float) -> np.ndarray:
        xy = np.atleast_2d(xy)
        moved = xy.astype(float).copy()
        for _ in range(4):
            moved = xy - np.column_stack([np.ones(len(xy)), moved]) @ corrections[name]
        return scene.cameras[name].localize(moved, height)

    return SimpleNamespace(project=project, localize=localize, ground=ground, seen=seen)


def rays_miss(true_cameras, seen: dict[str, np.ndarray]) -> np.ndarray:
    """Return the residuals of a track at the intersection of its true rays."""

    class True_:
        def __init__(self, name):
            self.name = name

        def project(self, ground):
            return true_cameras.project(self.name, np.atleast_2d(ground))

    rays = [(True_(name), xy) for name, xy in seen.items()]
    at = intersect(rays, next(iter(true_cameras.ground.values())))
    return np.concatenate([xy - camera.project(at)[0] for camera, xy in rays])


@pytest.mark.thorough
def test_tie_points(scene, true_cameras, tmp_path) -> None:
    """Tracks are of one ground point: true rays meet; counts, views and positions follow from the rows."""
    out = tmp_path / "out"
    report = run("tie-points", images=scene.images, output_dir=str(out))
    rows = layer(out / "block.gpkg", "image_points")
    tracks: dict[str, dict] = {}
    for row in rows:
        tracks.setdefault(row["id"], {})[row["image"]] = np.array([row["sample"], row["line"]])
    misses = np.array([rms(rays_miss(true_cameras, seen)) for seen in tracks.values()])
    assert np.median(misses) < MEASURED_PX and np.mean(misses > 1.0) < 0.03
    views = Counter(map(len, tracks.values()))
    assert report["ties"]["points"] == len(tracks) > 100
    assert report["ties"]["observations"] == len(rows)
    assert report["ties"]["by_views"] == {str(k): n for k, n in sorted(views.items())}
    for name in scene.cameras:
        assert report["images"][name]["observations"] == sum(name in seen for seen in tracks.values())
    for pair in report["pairs"]:
        common = sum(pair["first"] in seen and pair["second"] in seen for seen in tracks.values())
        assert 0.8 * common <= pair["matches"] <= 1.5 * common + 5  # before and after joining to tracks
        # how far the delivered RPCs miss each other: at the middle, across and along, with the terrain's height
        seen = [t for t in tracks.values() if pair["first"] in t and pair["second"] in t]
        height = np.median([row["height"] for row in layer(out / "block.gpkg", "tie_points")])
        ground = scene.cameras[pair["first"]].localize([t[pair["first"]] for t in seen], height)
        away = np.median(
            np.array([t[pair["second"]] for t in seen]) - scene.cameras[pair["second"]].project(ground), axis=0
        )
        assert pair["offset_px"] == pytest.approx(np.hypot(*away), abs=1.5)  # relief of 60 m, convergence of 25 degrees
    for row in layer(out / "block.gpkg", "tie_points"):
        seen = tracks[row["id"]]
        place = np.array(row["geometry"]["coordinates"][:2] + [row["height"]])
        assert row["views"] == len(seen)
        own = [one for one in rows if one["id"] == row["id"]]
        assert row["sigma"] == pytest.approx(rms([one["sigma"] for one in own]), rel=1e-6)
        assert row["quality"] == pytest.approx(np.mean([one["quality"] for one in own]), rel=1e-6)
        near = intersect([(scene.cameras[n], xy) for n, xy in seen.items()], place)
        assert np.abs(metres(place, near)[0]).max() < 10.0  # m: held by weak priors of the RPCs' common error of 4 m


@pytest.mark.thorough
def test_match(scene, true_cameras, tmp_path) -> None:
    """Correspondences are of one ground point; affine map, rotation, scale and residuals follow from the rows."""
    out = tmp_path / "out"
    report = run("match", images=scene.images[:2], window_1="0,0,150,150", window_2="0,0,150,150", output_dir=str(out))
    rows = table(out / "correspondences.csv")
    first = np.array([[float(row["first_sample"]), float(row["first_line"])] for row in rows])
    second = np.array([[float(row["second_sample"]), float(row["second_line"])] for row in rows])
    misses = [
        rms(rays_miss(true_cameras, {"image_1": one, "image_2": other}))
        for one, other in zip(first, second, strict=True)
    ]
    assert np.median(misses) < MEASURED_PX
    assert report["correspondences"] == len(rows) > 40
    assert report["kinds"] == dict(Counter(row["kind"] for row in rows))
    # the affine map by least squares on all rows; blunders are few
    affine = np.array(report["affine"])
    terms = np.column_stack([first, np.ones(len(first))])
    fitted = np.linalg.lstsq(terms, second, rcond=None)[0].T
    centre = np.array([75.0, 75.0, 1.0])
    assert affine @ centre == pytest.approx(fitted @ centre, abs=1.0)  # robust there, all rows here; relief
    assert affine[:, :2] == pytest.approx(fitted[:, :2], abs=0.02)
    matrix = affine[:, :2]
    assert report["scale"] == pytest.approx(math.sqrt(abs(np.linalg.det(matrix))), abs=2e-3)
    turned = math.degrees(math.atan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1]))
    assert report["rotation_deg"] == pytest.approx(turned, abs=0.05)
    assert report["correlation"] == pytest.approx(np.median([float(row["quality"]) for row in rows]), abs=0.02)
    for row, told in zip(layer(out / "match.gpkg", "correspondences"), rows, strict=True):
        for key in ("first_sample", "first_line", "second_sample", "second_line", "sigma", "quality", "residual_px"):
            assert row[key] == pytest.approx(float(told[key]), abs=1e-6), key
    by = {(row["id"], row["image"]): row for row in layer(out / "match.gpkg", "matched_points")}
    for row, one, other in zip(rows, first, second, strict=True):
        for image, xy in (("image_1", one), ("image_2", other)):
            point = by[row["id"], image]
            assert [point["sample"], point["line"]] == pytest.approx(xy, abs=1e-6)
            assert point["sigma"] == pytest.approx(float(row["sigma"]) / math.sqrt(2.0), rel=1e-3)  # of one of the two


def test_interest_points(scene, tmp_path) -> None:
    """Counts of the report are those of the layer; positions on the ground project to those in the image."""
    out = tmp_path / "out"
    report = run(
        "interest-points", images=scene.images[:1], detector="all", height=250.0, output_dir=str(out),
    )  # fmt: skip
    rows, told = layer(out / "interest_points.gpkg", "interest_points"), report["images"]["image_1"]
    assert told["points"] == len(rows) > 30
    assert told["kinds"] == dict(Counter(row["kind"] for row in rows))
    quarters = Counter(
        f"{'upper' if row['line'] < 79.5 else 'lower'} {'left' if row['sample'] < 79.5 else 'right'}" for row in rows
    )
    assert told["quarters"] == dict(quarters)
    sizes = np.array([[row["length_px"], row["width_px"]] for row in rows if row["length_px"] is not None])
    assert np.all(sizes[:, 0] >= sizes[:, 1]) and np.mean(sizes[:, 0] / sizes[:, 1]) > 1.005  # not one of them twice
    for row in rows:
        place = [*row["geometry"]["coordinates"][:2], 250.0]
        xy = scene.cameras["image_1"].project(place)[0]
        assert [row["sample"], row["line"]] == pytest.approx(xy, abs=2e-3)


def test_measure_targets(scene, true_cameras, tmp_path) -> None:
    """Discs of known points: their measured centres are the projected true ones."""
    out = tmp_path / "out"
    report = run(
        "measure-targets", images=scene.images, points=scene.gcps, height_datum="ellipsoidal", output_dir=str(out)
    )
    rows = layer(out / "targets.gpkg", "targets")
    error = np.array([
        [row["sample"], row["line"]] - true_cameras.project(row["image"], true_cameras.ground[row["id"]][None])[0]
        for row in rows
    ])  # fmt: skip
    inside = sum(
        bool(np.all((xy > -0.5) & (xy < 159.5)))
        for name in scene.cameras for xy in scene.cameras[name].project(list(scene.places.values()))
    )  # fmt: skip
    assert report["measured"] == len(rows) >= 45 and inside - 6 <= report["measured"] + report["refused"] <= inside
    assert np.median(np.abs(error), axis=0).max() < 0.15
    assert np.abs(np.median(error, axis=0)).max() < 0.1  # half a pixel of the wrong origin would be seen
    for row, told in zip(rows, (t for t in report["targets"] if not t["refusal"]), strict=True):
        assert (row["id"], row["image"]) == (told["id"], told["image"])
        assert [row["sample"], row["line"], row["sigma"], row["rmse_px"], row["edge_points"], row["quality"]] == (
            pytest.approx([told[k] for k in ("sample", "line", "sigma_px", "rmse_px", "edge_points", "quality")])
        )
    # the stated sigma is that of five parameters from edge points of rmse_px: of the order of rmse / sqrt(n)
    ratio = [row["sigma"] * math.sqrt(row["edge_points"]) / row["rmse_px"] for row in rows]
    assert 0.9 < np.median(ratio) < 2.5


@pytest.mark.thorough
def test_gcps_from_reference(scene, true_cameras, tmp_path) -> None:
    """Each GCP's survey is the place of its image point, by the true camera; its residuals are of the corrected RPC."""
    out = tmp_path / "out"
    report = run(
        "gcps-from-reference", images=scene.images, reference=str(scene.folder / "orthophoto.tif"), dem=scene.dem,
        height_datum="ellipsoidal", output_dir=str(out),
    )  # fmt: skip
    rows = layer(out / "gcps.gpkg", "gcps")
    error = np.array([
        [row["sample"], row["line"]] - true_cameras.project(
            row["image"], np.array([[row["survey_lon"], row["survey_lat"], row["survey_height"]]]))[0]
        for row in rows
    ])  # fmt: skip
    places = np.array([[row["sample"], row["line"]] for row in rows])
    assert places.min() > 20.0 and places.max() < 159.0 - 20.0  # windows of 41 px are whole
    assert report["measurements"] == len(rows) and report["points"] == len({row["id"] for row in rows})
    assert np.abs(np.median(error, axis=0)).max() < 0.2 and np.median(np.hypot(*error.T)) < 0.4
    for name, camera in scene.cameras.items():
        own = [row for row in rows if row["image"] == name]
        told = report["reference"]["images"][name]
        surveys = np.array([[row["survey_lon"], row["survey_lat"], row["survey_height"]] for row in own])
        away = np.array([[row["sample"], row["line"]] for row in own]) - camera.project(surveys)
        assert told["used"] == len(own)
        assert [told["bias_sample_px"], told["bias_line_px"]] == pytest.approx(np.median(away, axis=0), abs=0.15)
        # the ground by the RPC less the same ground in the reference
        rpc, reference = camera.localize([[79.5, 79.5], np.array([79.5, 79.5]) - np.median(away, axis=0)], 250.0)
        assert [told["east_m"], told["north_m"]] == pytest.approx(metres(rpc, reference)[0, :2], abs=0.15)


def test_refine_rpc(scene, tmp_path) -> None:
    """One image, a shift: the weighted mean of its GCPs' residuals, its sigma, and the errors that are left."""
    out = tmp_path / "out"
    report = run(
        "refine-rpc", images=scene.images[:1], gcps=scene.gcps, image_points=scene.image_points,
        height_datum="ellipsoidal", model="shift", report=False, output_dir=str(out),
    )  # fmt: skip
    told, camera = report["images"]["image_1"], scene.cameras["image_1"]
    known = [p for p in scene.places if p.startswith("G")]
    assert report["observations"] == 2 * len(known)  # a sample and a line of each GCP
    assert report["redundancy"] == pytest.approx(2 * len(known) - 2, abs=1e-3)
    away = {p: scene.measured[p]["image_1"] - camera.project(scene.places[p])[0] for p in scene.places}
    gcps = np.array([xy for p, xy in away.items() if p.startswith("G")])
    assert [told["parameters"][f"{axis}_0"]["value"] for axis in ("sample", "line")] == pytest.approx(
        gcps.mean(axis=0), abs=5e-3
    )  # surveys weigh nearly alike in one image
    assert [told["before_rmse_sample_px"], told["before_rmse_line_px"]] == pytest.approx(
        np.sqrt(np.mean(np.square(list(away.values())), axis=0)), abs=1e-3
    )
    # sigma0: of the image points, and of the surveys as the image shows them
    squares = 0.0
    for name, xy in zip(known, gcps, strict=True):
        row, metre = scene.surveyed[name], np.eye(3)
        ends = [camera.project(moved(scene.places[name], sign * metre)) for sign in (1.0, -1.0)]
        by_metre = 0.5 * (ends[0] - ends[1]).T
        survey = np.diag([float(row["sigma_xy"]), float(row["sigma_xy"]), float(row["sigma_h"])]) ** 2
        v = xy - gcps.mean(axis=0)
        squares += v @ np.linalg.solve(0.3**2 * np.eye(2) + by_metre @ survey @ by_metre.T, v)
    assert report["sigma0"] == pytest.approx(math.sqrt(squares / (2 * len(known) - 2)), rel=1e-5)
    left = np.array(list(away.values())) - gcps.mean(axis=0)
    assert [told["rmse_sample_px"], told["rmse_line_px"]] == pytest.approx(np.sqrt(np.mean(left**2, axis=0)), abs=5e-3)
    refined = Camera(out / "image_1.tif")
    at = np.array([scene.places[p] for p in scene.places])
    np.testing.assert_allclose(
        refined.project(at) - camera.project(at), np.tile(gcps.mean(axis=0), (len(at), 1)), atol=5e-3
    )
    check = np.array([
        metres(scene.places[p], refined.localize(scene.measured[p]["image_1"], scene.places[p][2]))[0, :2]
        for p in scene.places if p.startswith("C")
    ])  # fmt: skip
    assert [report["check"]["rmse_east_m"], report["check"]["rmse_north_m"]] == pytest.approx(
        np.sqrt(np.mean(check**2, axis=0)), abs=5e-3
    )


def test_orthorectify(scene, adjusted, tmp_path) -> None:
    """A pixel of the orthoimage is the image at the DEM's place of its middle, by bicubic or bilinear interpolation."""
    out, level = tmp_path / "out", 250.0
    report = run(
        "orthorectify", images=[str(adjusted.folder / "image_1.tif")], dem=flat_dem(scene, tmp_path, level),
        height_datum="ellipsoidal", resampling="near", report=False, output_dir=str(out),
    )  # fmt: skip
    dataset = gdal.Open(str(out / "image_1_ortho.tif"))
    values, transform = dataset.ReadAsArray(), dataset.GetGeoTransform()
    told = report["images"]["image_1"]
    assert (told["columns"], told["rows"]) == (dataset.RasterXSize, dataset.RasterYSize)
    corners = [transform[0], transform[3] + values.shape[0] * transform[5],
               transform[0] + values.shape[1] * transform[1], transform[3]]  # fmt: skip
    assert told["bounds"] == pytest.approx(corners, abs=1e-6)
    assert told["nodata"] == dataset.GetRasterBand(1).GetNoDataValue()
    to_wgs = Transformer.from_crs(dataset.GetProjection(), 4326, always_xy=True)
    column, row = np.meshgrid(np.arange(values.shape[1]), np.arange(values.shape[0]))
    x, y = transform[0] + (column + 0.5) * transform[1], transform[3] + (row + 0.5) * transform[5]
    lon, lat = to_wgs.transform(x.ravel(), y.ravel())
    xy = adjusted.refined["image_1"].project(np.column_stack([lon, lat, np.full(lon.size, level)]))
    image = gdal.Open(scene.images[0]).ReadAsArray()
    inside = np.all((xy > 0.5) & (xy < 158.5), axis=1)
    near = np.round(xy[inside]).astype(int)
    clear = np.abs(xy[inside] - np.round(xy[inside])).max(axis=1) < 0.4  # no edge between two pixels
    found = values.ravel()[inside]
    np.testing.assert_array_equal(found[clear], image[near[clear, 1], near[clear, 0]])
    assert told["shown_pixels"] == int(np.count_nonzero(values != told["nodata"]))
    assert told["gsd_m"] == pytest.approx(0.715, abs=0.02)


def flat_dem(scene: SimpleNamespace, folder, level: float) -> str:
    path = str(folder / "flat.tif")
    dem = gdal.Translate(path, scene.dem)
    dem.GetRasterBand(1).WriteArray(np.full((dem.RasterYSize, dem.RasterXSize), level))
    del dem
    return path


def test_ortho_check(scene, tmp_path) -> None:
    """Two orthoimages whose parts are moved by known pixels: shifts, their signs, medians, NMAD, 90th percentiles."""
    whole = gdal.Open(str(scene.folder / "orthophoto.tif"))
    data, transform = whole.ReadAsArray(), whole.GetGeoTransform()
    data = data[0] if data.ndim == 3 else data
    top, left, size = (data.shape[0] - 320) // 2, (data.shape[1] - 320) // 2, 320
    one = data[top : top + size, left : left + size]
    moved = one.copy()
    first = 230  # columns that are moved by (2, -1), the others by (5, 3): dx along rows, dy down
    moved[:, :first] = data[top + 1 : top + 1 + size, left - 2 : left - 2 + first]
    moved[:, first:] = data[top - 3 : top - 3 + size, left - 5 + first : left - 5 + size]
    across, down = transform[1], transform[5]  # degrees, that of lines below 0
    west, north = transform[0] + left * across, transform[3] + top * down
    # the pixel's sides in metres, by PROJ
    sides = metres([[west + across, north, 250.0], [west, north + down, 250.0]], [west, north, 250.0])
    wide, high = float(sides[0, 0]), float(-sides[1, 1])
    paths = []
    for name, values in (("a_ortho", one), ("b_ortho", moved)):
        path = str(tmp_path / f"{name}.tif")
        made = gdal.GetDriverByName("GTiff").Create(path, size, size, 1, gdal.GDT_UInt16)
        made.SetGeoTransform((west, across, 0.0, north, 0.0, down))
        made.SetProjection(whole.GetProjection())
        made.GetRasterBand(1).WriteArray(values.astype(np.uint16))
        del made
        paths.append(path)
    out = tmp_path / "out"
    report = run("ortho-check", images=paths, report=False, output_dir=str(out))
    rows = layer(out / "misregistration.gpkg", "misregistration_wgs84")
    matched = [row for row in rows if row["outcome"] == "matched"]
    seen = {"left": 0, "right": 0}
    for row in matched:
        column = (row["geometry"]["coordinates"][0] - west) / across
        expected = (2.0, -1.0) if column < first - 40 else (5.0, 3.0) if column > first + 40 else None
        if expected is None:
            continue
        seen["left" if column < first else "right"] += 1
        assert [row["dx_px"], row["dy_px"]] == pytest.approx(expected, abs=0.1)
        assert [row["east_m"], row["north_m"]] == pytest.approx([expected[0] * wide, -expected[1] * high], abs=0.08)
        assert row["shift_px"] == pytest.approx(np.hypot(row["dx_px"], row["dy_px"]), abs=1e-6)
    assert min(seen.values()) > 3
    told = report["pairs"][0]["after"]
    shift = np.array([[row["dx_px"], row["dy_px"]] for row in matched])
    length = np.sort(np.hypot(*shift.T))
    place = 0.9 * (len(length) - 1)
    p90 = length[int(place)] + (place % 1.0) * (length[min(int(place) + 1, len(length) - 1)] - length[int(place)])
    assert told["windows"] == told["matched"] == len(matched) and told["tried"] == len(rows)
    assert told["outcomes"] == {key: sum(row["outcome"] == key for row in rows) for key in told["outcomes"]}
    expected = {
        "median_dx_px": np.median(shift[:, 0]), "median_dy_px": np.median(shift[:, 1]), "nmad_dx_px": nmad(shift[:, 0]),
        "nmad_dy_px": nmad(shift[:, 1]), "median_px": np.median(length), "p90_px": p90,
        "median_m": np.median(length) * 0.5 * (wide + high), "p90_m": p90 * 0.5 * (wide + high),
    }  # fmt: skip
    for key, value in expected.items():
        assert told[key] == pytest.approx(value, rel=0.01, abs=1e-6), key  # pixels of 0.700 by 0.700 m
        assert report["all"]["after"][key] == pytest.approx(told[key], abs=1e-6), key
    assert report["pairs"][0]["pixel_m"] == pytest.approx(0.5 * (wide + high), rel=5e-3)
    assert p90 > 1.5 * np.median(length) and MAD_TO_SIGMA > 1.0


def test_hand_over(scene, adjusted, tmp_path) -> None:
    """Pairs, their geometry and the expected accuracy follow from the refined RPCs and the adjustment's report."""
    out = tmp_path / "out"
    report = run("hand-over", result=str(adjusted.folder), to="s2p", output_dir=str(out))
    height = adjusted.report["place"]["height_m"]
    sigma_px = adjusted.report["ties"]["rmse_px"]
    for pair in report["pairs"]:
        rays = [to_satellite(adjusted.refined[pair[side]], [79.5, 79.5], height)[0] for side in ("left", "right")]
        base = rays[0][:2] / rays[0][2] - rays[1][:2] / rays[1][2]
        assert pair["convergence_deg"] == pytest.approx(math.degrees(math.acos(rays[0] @ rays[1])), abs=0.05)
        assert pair["base_to_height"] == pytest.approx(math.hypot(*base), abs=1e-3)
        assert pair["similarity"] == 1.0  # all tie points are on all images
        # a parallax of the ties' size, over base and height
        assert pair["sigma_height_m"] == pytest.approx(sigma_px * 0.71 / math.hypot(*base), rel=0.5)
    best = max(report["pairs"], key=lambda pair: pair["base_to_height"])
    assert report["accuracy"]["relative_height_m"] == pytest.approx(best["sigma_height_m"], rel=1e-9)
    assert report["accuracy"]["tie_rmse_px"] == pytest.approx(sigma_px, abs=1e-9)
    for key in ("ce90_m", "le90_m"):
        assert report["accuracy"][key] == max(part[key] for part in adjusted.report["parts"]) > 0.0
    finest = min(entry["gsd_sample_m"] + entry["gsd_line_m"] for entry in adjusted.report["images"].values())
    assert report["gsd_m"] == pytest.approx(0.5 * finest, rel=0.03)
    west, south, east, north = report["area"]
    corners = [(west, south), (east, south), (east, north), (west, north)]
    for name in scene.cameras:  # the region is on the images of the best pair
        copy, camera = Camera(out / f"{name}.tif"), adjusted.refined[name]
        ground = camera.localize([[10.0, 20.0], [150.0, 130.0]], height)
        np.testing.assert_allclose(copy.project(ground), camera.project(ground), atol=1e-6)
    xy = adjusted.refined[report["pairs"][0]["left"]].project([[lon, lat, height] for lon, lat in corners])
    assert np.all((xy > -30.0) & (xy < 190.0))
    # the initial DEM is a surface through the adjusted points: 60 m of relief, some metres between points
    rows = [row for row in layer(adjusted.package, "ground_points") if row["role"] != "check"]
    plan = np.array([row["geometry"]["coordinates"][:2] for row in rows])
    dem, (x0, dx, _, y0, _, dy) = gdal.Open(str(out / "dem.tif")), gdal.Open(str(out / "dem.tif")).GetGeoTransform()
    x, y = Transformer.from_crs(4326, dem.GetProjection(), always_xy=True).transform(*plan.T)
    column, line = np.floor((x - x0) / dx).astype(int), np.floor((y - y0) / dy).astype(int)
    heights = dem.ReadAsArray()[line, column]
    away = heights - [row["height"] for row in rows]
    assert np.median(np.abs(away)) < 1.5 and np.ptp([row["height"] for row in rows]) > 15.0
    config = json.loads((out / "s2p.json").read_text(encoding="utf-8"))
    assert config["images"][0]["img"] == f"{report['pairs'][0]['left']}.tif"
    assert config["out_crs"] == f"epsg:{report['epsg']}" == "epsg:32631"


def test_predictions_of_the_oracle(scene) -> None:
    """The oracle's own leave-one-out of exact rays is zero."""
    place = next(iter(scene.places.values()))
    rays = [(camera, camera.project(place)[0]) for camera in scene.cameras.values()]
    assert np.abs(predict(rays, place + [1e-5, -1e-5, 5.0])).max() < 1e-6
