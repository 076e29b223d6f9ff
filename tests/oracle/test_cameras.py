"""`rpc-info`, `project`, `localize`, `crop`, `fit-rpc`, `write-rpc`: every number by the RPC's own formula."""

import math
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from independent_formulas import Camera, compare, layer, metres, moved, numbers, to_satellite
from osgeo import gdal

from hrsi.processing_algorithms import run

HEIGHT_M = 250.0


def grid(samples: int, lines: int, step: int = 20) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(0.0, samples, step), np.arange(0.0, lines, step)), -1).reshape(-1, 2)


def dem_height(path: str, plan: np.ndarray) -> np.ndarray:
    """Return bilinear heights of a DEM of WGS84 or UTM, whose values are those of the pixels' middles."""
    from osgeo import osr

    dataset = gdal.Open(path)
    values, (x0, dx, _, y0, _, dy) = dataset.ReadAsArray().astype(float), dataset.GetGeoTransform()
    crs = osr.SpatialReference(dataset.GetProjection())
    from pyproj import CRS, Transformer

    to_map = Transformer.from_crs(4326, CRS.from_wkt(crs.ExportToWkt()), always_xy=True)
    x, y = to_map.transform(*plan.T)
    column, row = (np.array(x) - x0) / dx - 0.5, (np.array(y) - y0) / dy - 0.5
    c, r = np.floor(column).astype(int), np.floor(row).astype(int)
    u, v = column - c, row - r
    return (
        values[r, c] * (1 - u) * (1 - v) + values[r, c + 1] * u * (1 - v) + values[r + 1, c] * (1 - u) * v
        + values[r + 1, c + 1] * u * v
    )  # fmt: skip


@pytest.mark.thorough
def test_rpc_info(scene: SimpleNamespace, tmp_path) -> None:
    """Sizes, pixel sizes, view and footprint of each image, geometry of each pair: report and layers."""
    report = run("rpc-info", images=scene.images, height=HEIGHT_M, output_dir=str(tmp_path / "out"))
    expected, areas = {}, {}
    for name, camera in scene.cameras.items():
        own, middle = f"images.{name}", np.array([79.5, 79.5])
        lon, lat, _ = camera.localize(middle, HEIGHT_M)[0]
        east, north, up = to_satellite(camera, middle, HEIGHT_M)[0]
        ends = [camera.localize([middle - step, middle + step], HEIGHT_M) for step in ([0.5, 0.0], [0.0, 0.5])]
        gsd = [float(np.hypot(*metres(b, a)[0, :2])) for a, b in ends]
        expected |= {
            f"{own}.samples": (160, 0), f"{own}.lines": (160, 0), f"{own}.lon": (lon, 1e-9), f"{own}.lat": (lat, 1e-9),
            f"{own}.height_m": (HEIGHT_M, 1e-9), f"{own}.gsd_sample_m": (gsd[0], 1e-4),
            f"{own}.gsd_line_m": (gsd[1], 1e-4), f"{own}.incidence_deg": (math.degrees(math.acos(up)), 1e-3),
            f"{own}.azimuth_deg": (math.degrees(math.atan2(east, north)) % 360.0, 5e-3),
            f"{own}.rpc_height_min_m": (camera.offset[2] - camera.scale[2], 1e-6),
            f"{own}.rpc_height_max_m": (camera.offset[2] + camera.scale[2], 1e-6),
            f"{own}.err_bias_m": (camera.err_bias, 1e-9),
        }  # fmt: skip
        ring = np.array(report["images"][name]["footprint"])
        back = camera.project(np.column_stack([ring, np.full(len(ring), HEIGHT_M)]))
        assert np.min(np.abs(np.column_stack([back + 0.5, back - 159.5])), axis=1).max() < 1e-3  # px, outer edges
        assert np.ptp(back, axis=0) == pytest.approx([160.0, 160.0], abs=1e-3)
        areas[name] = back
    for index, (one, other) in enumerate(combinations(scene.cameras, 2)):
        rays = [to_satellite(scene.cameras[name], [79.5, 79.5], HEIGHT_M)[0] for name in (one, other)]
        base = rays[0][:2] / rays[0][2] - rays[1][:2] / rays[1][2]
        expected |= {
            f"pairs[{index}].convergence_deg": (math.degrees(math.acos(rays[0] @ rays[1])), 0.01),
            f"pairs[{index}].base_to_height": (math.hypot(*base), 3e-4),
        }  # fmt: skip
        for key, first, second in (("overlap_first", one, other), ("overlap_second", other, one)):
            xy = grid(160, 160, 1)
            seen = scene.cameras[second].project(scene.cameras[first].localize(xy, HEIGHT_M))
            inside = np.mean(np.all((seen > -0.5) & (seen < 159.5), axis=1))
            expected[f"pairs[{index}].{key}"] = float(inside), 6e-3  # counted by whole pixels
    compare(report, expected, {r".*\.footprint\[.*": "each corner is compared above"})
    for row in layer(tmp_path / "out" / "rpc_info.gpkg", "images"):
        told = report["images"][row["id"]]
        for key in ("samples", "lines", "lon", "lat", "height_m", "gsd_sample_m", "gsd_line_m", "incidence_deg",
                    "azimuth_deg", "rpc_height_min_m", "rpc_height_max_m", "err_bias_m"):  # fmt: skip
            assert row[key] == pytest.approx(told[key], rel=1e-12), key
        np.testing.assert_allclose(np.array(row["geometry"]["coordinates"][0])[:-1], told["footprint"][: len(
            row["geometry"]["coordinates"][0]) - 1], atol=1e-9)  # fmt: skip
    for row, told in zip(layer(tmp_path / "out" / "rpc_info.gpkg", "pairs"), report["pairs"], strict=True):
        for key in ("overlap_first", "overlap_second", "convergence_deg", "base_to_height"):
            assert row[key] == pytest.approx(told[key], rel=1e-12), key


def test_project(scene: SimpleNamespace, tmp_path) -> None:
    out = tmp_path / "out"
    report = run("project", images=scene.images, points=scene.gcps, height_datum="ellipsoidal", output_dir=str(out))
    rows = layer(out / "points.gpkg", "image_points")
    assert report["count"] == len(rows) == 3 * len(scene.places)
    for row in rows:
        place = scene.places[row["id"]]
        xy = scene.cameras[row["image"]].project(place)[0]
        assert [row["sample"], row["line"]] == pytest.approx(xy, abs=1e-6)
        assert row["inside"] == bool(np.all((xy > -0.5) & (xy < 159.5)))
        assert [row["lon"], row["lat"], row["height"]] == pytest.approx(place, abs=1e-9)


def test_localize_on_a_dem(scene: SimpleNamespace, tmp_path) -> None:
    """Each position projects to its image point, and lies on the DEM."""
    out = tmp_path / "out"
    run(
        "localize", images=scene.images, points=scene.image_points, dem=scene.dem, height_datum="ellipsoidal",
        output_dir=str(out),
    )  # fmt: skip
    rows = layer(out / "points.gpkg", "ground_points")
    assert len(rows) == sum(map(len, scene.measured.values()))
    ground = np.array([[row["lon"], row["lat"], row["height"]] for row in rows])
    for row, place in zip(rows, ground, strict=True):
        xy = scene.measured[row["id"]][row["image"]]
        assert [row["sample"], row["line"]] == pytest.approx(xy, abs=1e-9)
        assert scene.cameras[row["image"]].project(place)[0] == pytest.approx(xy, abs=2e-3)
        assert row["geometry"]["coordinates"][:2] == pytest.approx(place[:2], abs=1e-9)
    np.testing.assert_allclose(ground[:, 2], dem_height(scene.dem, ground[:, :2]), atol=5e-3)


def test_localize_at_a_height(scene: SimpleNamespace, tmp_path) -> None:
    out = tmp_path / "out"
    run("localize", images=scene.images, points=scene.image_points, height=HEIGHT_M, output_dir=str(out))
    for row in layer(out / "points.gpkg", "ground_points"):
        place = scene.cameras[row["image"]].localize(scene.measured[row["id"]][row["image"]], HEIGHT_M)[0]
        assert np.abs(metres([row["lon"], row["lat"], row["height"]], place)).max() < 1e-3


@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_crop(scene: SimpleNamespace, tmp_path, factor: float) -> None:
    """A crop is the same camera: its pixel (0, 0) of step s covers s x s pixels from the window's first one."""
    out, window = tmp_path / "out", (20, 30, 100, 80)
    options = {} if factor == 1.0 else {"factor": factor}
    report = run("crop", images=scene.images[:1], window=",".join(map(str, window)), output_dir=str(out), **options)
    crop, scale = Camera(out / "image_1_crop.tif"), 1.0 / factor
    assert crop.size == (int(100 * factor), int(80 * factor))
    own = "images.image_1"
    compare(report, {
        **{f"{own}.window[{k}]": (value, 0) for k, value in enumerate(window)},
        f"{own}.samples": (crop.size[0], 0), f"{own}.lines": (crop.size[1], 0),
        f"{own}.step_sample_px": (scale, 1e-12), f"{own}.step_line_px": (scale, 1e-12),
        f"{own}.max_difference_px": (0.0, 1e-6),
    }, {})  # fmt: skip
    ground = scene.cameras["image_1"].localize(grid(160, 160), HEIGHT_M)
    corner = scene.cameras["image_1"].project(ground) + 0.5 - window[:2]  # from the window's corner, in its pixels
    np.testing.assert_allclose(crop.project(ground), corner / scale - 0.5, atol=1e-6)
    whole = gdal.Open(scene.images[0]).ReadAsArray()
    if factor == 0.5:  # cubic resampling is near the mean of 2 x 2 pixels
        mean = whole[30:110, 20:120].astype(float).reshape(40, 2, 50, 2).mean(axis=(1, 3))
        half = gdal.Open(str(out / "image_1_crop.tif")).ReadAsArray().astype(float)
        assert np.corrcoef(half.ravel(), mean.ravel())[0, 1] > 0.98 and abs(np.mean(half - mean)) < 1.0
    else:
        np.testing.assert_array_equal(gdal.Open(str(out / "image_1_crop.tif")).ReadAsArray(), whole[30:110, 20:120])


def test_fit_rpc(scene: SimpleNamespace, tmp_path) -> None:
    """An RPC from the correspondences of another one projects as that does."""
    rows = ["id,lon,lat,height,sample,line"]
    camera = scene.cameras["image_2"]
    for height in (200.0, 230.0, 260.0, 290.0, 320.0):
        xy = grid(160, 160, 26)
        for number, (ground, place) in enumerate(zip(camera.localize(xy, height), xy, strict=True)):
            rows.append(f"P{height:.0f}_{number},{','.join(map(repr, [*ground.tolist(), *place.tolist()]))}")
    (tmp_path / "grid.csv").write_text("\n".join(rows) + "\n")
    out = tmp_path / "out"
    run("fit-rpc", points=str(tmp_path / "grid.csv"), height_datum="ellipsoidal", id="fitted", output_dir=str(out))
    fitted = Camera(next(out.glob("fitted_RPC.TXT")))
    ground = camera.localize(grid(160, 160, 13), 270.0)
    np.testing.assert_allclose(fitted.project(ground), camera.project(ground), atol=0.01)
    # Offsets and scales take the correspondences to -1 … 1, the domain for which RPCs are defined
    values = np.array([[float(value) for value in row.split(",")[1:]] for row in rows[1:]])
    for column, name in enumerate(("LONG", "LAT", "HEIGHT", "SAMP", "LINE")):
        low, high = values[:, column].min(), values[:, column].max()
        found = [float(fitted.value[f"{name}_{word}"]) for word in ("OFF", "SCALE")]
        assert found == pytest.approx([(low + high) / 2.0, (high - low) / 2.0], rel=1e-9), name


def test_write_rpc(scene: SimpleNamespace, adjusted: SimpleNamespace, tmp_path) -> None:
    """The image gets the other RPC, its pixels stay."""
    out = tmp_path / "out"
    run("write-rpc", images=scene.images[:1], rpc=str(adjusted.folder / "image_1.tif"), output_dir=str(out))
    written, other = Camera(out / "image_1.tif"), adjusted.refined["image_1"]
    ground = other.localize(grid(160, 160), HEIGHT_M)
    np.testing.assert_allclose(written.project(ground), other.project(ground), atol=1e-9)
    assert (written.err_bias, written.err_rand) == (other.err_bias, other.err_rand)


def test_the_formulas_against_gdal(scene: SimpleNamespace) -> None:
    """The oracle's own RPC, its inverse and its metres, against GDAL's transformer."""
    transformer = gdal.Transformer(gdal.Open(scene.images[0]), None, ["METHOD=RPC", "RPC_PIXEL_ERROR_THRESHOLD=1e-6"])
    camera = scene.cameras["image_1"]
    for xy in grid(160, 160, 50):
        ground = camera.localize(xy, HEIGHT_M)[0]
        _, (x, y, _) = transformer.TransformPoint(1, *ground.tolist())
        assert [x - 0.5, y - 0.5] == pytest.approx(xy, abs=1e-5)
        assert metres(moved(ground, [3.0, -2.0, 1.0]), ground)[0] == pytest.approx([3.0, -2.0, 1.0], abs=1e-6)
    assert numbers({"a": "1.5", "b": "2"}, "b", "a") == pytest.approx([2.0, 1.5])
