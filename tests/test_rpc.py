"""RPC evaluation against GDAL, rasterio and external software; closure of the inverse; special places on the globe."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st
from osgeo import gdal
from rasterio.transform import RPCTransformer

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.camera.rpc_terms import EVALUATION
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.ground.geodesy import LocalFrame
from hrsi.hrsi_engine.io.rpc_files import read_rpc

PROJECT_PX = 1e-6  # agreement with other software: far below any measurement, above the 15 digits of text formats
CLOSURE_PX = 1e-8  # project after localize; a unit in the last place of a longitude is up to 3e-9 px

#: A camera like IKONOS: 11 km wide, nearly affine with mild curvature; used where no vendor's RPC lies.
LINE_NUM = [1e-3, 0.02, -1.01, -0.02, 1e-4, 2e-5, 1e-5, 3e-4, -2e-4, 1e-6] + 10 * [1e-7]
SAMP_NUM = [-2e-3, 1.005, 0.015, 0.018, -2e-4, 1e-5, -3e-5, 2e-4, 1e-4, 2e-6] + 10 * [-1e-7]
DEN = [1.0, 1e-4, -2e-4, 3e-5] + 16 * [0.0]


def synthetic_rpc(lon_deg: float, lat_deg: float) -> RPC:
    """Return a camera over a 0.05 degree (lat) field anywhere on the globe."""
    long_scale = 0.05 / np.cos(np.radians(lat_deg))
    return RPC(
        line_off=5500, samp_off=5400, lat_off=lat_deg, long_off=lon_deg, height_off=300,
        line_scale=5500, samp_scale=5400, lat_scale=0.05, long_scale=long_scale, height_scale=400,
        line_num=np.array(LINE_NUM), line_den=np.array(DEN), samp_num=np.array(SAMP_NUM), samp_den=np.array(DEN),
    )  # fmt: skip


def rpc_files(root: Path) -> list[tuple[Path, RPC, tuple[int, int]]]:
    """Return every file of the pack that carries an RPC, with the image size (that of a scene where not stated)."""
    found = []
    for path in sorted(root.rglob("*")):
        if not path.is_file() or path.suffix.lower() not in (
            ".tif", ".txt", ".xml", ".rpb", ".geom", ".json", ".ntf", ".nitf"
        ):  # fmt: skip
            continue
        try:
            source = read_rpc(str(path))
        except InputError:
            continue
        found.append((path, source.rpc, source.size or (10000, 10000)))
    return found


def random_points(rpc: RPC, size: tuple[int, int], count: int = 5000) -> tuple[np.ndarray, np.ndarray]:
    """Return image points over the whole image and heights over the RPC's whole range, both ends included."""
    rng = np.random.default_rng(20)
    image = rng.uniform((0, 0), (size[0] - 1, size[1] - 1), (count, 2))
    heights = rng.uniform(*rpc.height_range, count)
    heights[:2] = rpc.height_range
    return image, heights


# ---- forward ---------------------------------------------------------------------------------------------------


def test_project_equals_the_formula_term_by_term() -> None:
    rpc = synthetic_rpc(12.0, 48.0)
    rng = np.random.default_rng(1)
    ground = rng.uniform((11.95, 47.95, 0.0), (12.05, 48.05, 700.0), (50, 3))
    for (lon, lat, height), (sample, line) in zip(ground, rpc.project(ground), strict=True):
        x, y, z = (lon - 12.0) / rpc.long_scale, (lat - 48.0) / rpc.lat_scale, (height - 300.0) / 400.0
        # STDI-0002 vol. 1, appendix E, table E-22: the order of the terms as printed there
        t = [1, x, y, z, x*y, x*z, y*z, x*x, y*y, z*z, x*y*z, x**3, x*y*y, x*z*z, x*x*y, y**3, y*z*z, x*x*z, y*y*z, z**3]  # fmt: skip # noqa: E501
        assert np.dot(SAMP_NUM, t) / np.dot(DEN, t) * 5400 + 5400 == pytest.approx(sample, abs=1e-9)
        assert np.dot(LINE_NUM, t) / np.dot(DEN, t) * 5500 + 5500 == pytest.approx(line, abs=1e-9)


@pytest.mark.parametrize("name", ["s2p_triplet_phr/img_01.tif", "qb2_gcp/qb2_basic1b.tif"])
def test_project_agrees_with_gdal_and_rasterio(real_data: Path, name: str) -> None:
    path = str(real_data / name)
    source = read_rpc(path)
    image, heights = random_points(source.rpc, source.size or (1000, 1000))
    ground, _ = source.rpc.localize(image, heights)
    computed = source.rpc.project(ground)

    transformer = gdal.Transformer(gdal.Open(path), None, ["METHOD=RPC"])
    by_gdal = np.array(transformer.TransformPoints(True, ground.tolist())[0])[:, :2] - 0.5
    np.testing.assert_allclose(computed, by_gdal, atol=PROJECT_PX, rtol=0)

    with rasterio.open(path) as dataset, RPCTransformer(dataset.rpcs) as rasterio_transformer:
        lines, samples = rasterio_transformer.rowcol(*ground.T, op=float)
    np.testing.assert_allclose(computed, np.column_stack([samples, lines]) - 0.5, atol=PROJECT_PX, rtol=0)


def test_jacobian_is_the_derivative_of_project() -> None:
    rpc = synthetic_rpc(12.0, 48.0)
    ground = np.random.default_rng(3).uniform((11.95, 47.95, 0.0), (12.05, 48.05, 700.0), (40, 3))
    image, jacobian = rpc.project_with_jacobian(ground)
    np.testing.assert_allclose(image, rpc.project(ground), rtol=0, atol=1e-9)
    for axis, step in enumerate((1e-6, 1e-6, 0.1)):
        forward, backward = ground.copy(), ground.copy()
        forward[:, axis] += step
        backward[:, axis] -= step
        numeric = (rpc.project(forward) - rpc.project(backward)) / (2 * step)
        # rounding of pixels (1e-12) over the step
        np.testing.assert_allclose(jacobian[:, :, axis], numeric, rtol=1e-6, atol=1e-5)


def test_metric_jacobian_is_pixels_per_metre() -> None:
    _, jacobian = synthetic_rpc(12.0, 48.0).project_with_metric_jacobian(np.array([[12.0, 48.0, 300.0]]))
    # half the field is 0.05 degree of latitude = 5560 m at 5500 lines; east alike by the scaled longitude
    np.testing.assert_allclose(np.abs(jacobian[0]), [[0.97, 0.015, 0.24], [0.02, 1.0, 0.27]], atol=0.03)


# ---- inverse ---------------------------------------------------------------------------------------------------


def test_localize_then_project_closes_for_every_rpc_of_the_pack(real_data: Path) -> None:
    files = rpc_files(real_data)
    assert len(files) >= 30
    worst = {}
    for path, rpc, size in files:
        image, heights = random_points(rpc, size)
        ground, converged = rpc.localize(image, heights)
        assert converged.all(), f"{path.name}: {np.count_nonzero(~converged)} points without ground position"
        np.testing.assert_array_equal(ground[:, 2], heights)
        worst[path.name] = np.abs(rpc.project(ground) - image).max()
    assert max(worst.values()) <= CLOSURE_PX, worst


def test_localize_reports_points_that_have_no_ground(real_data: Path) -> None:
    rpc = read_rpc(str(real_data / "s2p_triplet_phr" / "img_01.tif")).rpc
    image = np.array([[500.0, 500.0], [np.nan, 3.0], [1e12, -1e12], [2.0, 2.0]])
    ground, converged = rpc.localize(image, 200.0)
    np.testing.assert_array_equal(converged, [True, False, False, True])
    np.testing.assert_array_equal(np.isnan(ground).all(axis=1), ~converged)


def test_localize_survives_a_pole_of_the_denominator() -> None:
    rpc = synthetic_rpc(12.0, 48.0)
    wild = replace(rpc, samp_den=np.array([1.0, 0.0, 0.0, 1.8] + 16 * [0.0]))  # zero at H = -0.56
    ground, converged = wild.localize(np.array([[5000.0, 5000.0], [3000.0, 8000.0]]), 300.0)
    assert converged.all()
    np.testing.assert_allclose(wild.project(ground), [[5000.0, 5000.0], [3000.0, 8000.0]], atol=CLOSURE_PX)


@pytest.mark.parametrize("lon", [180.0, -180.0, 179.99, -179.99])
def test_the_180_degree_meridian_is_a_place_like_others(lon: float) -> None:
    rpc, elsewhere = synthetic_rpc(lon, 12.0), synthetic_rpc(20.0, 12.0)
    image = np.random.default_rng(5).uniform(0, 11000, (500, 2))
    ground, converged = rpc.localize(image, 250.0)
    assert converged.all()
    assert np.abs(ground[:, 0]).max() <= 180.0
    assert ground[:, 0].min() < 0.0 < ground[:, 0].max()
    np.testing.assert_allclose(rpc.project(ground), image, atol=CLOSURE_PX * 3, rtol=0)  # coarser longitudes
    there, _ = elsewhere.localize(image, 250.0)
    np.testing.assert_allclose((ground[:, 0] - lon + 180.0) % 360.0 - 180.0, there[:, 0] - 20.0, atol=1e-12)
    beyond = ground + [360.0, 0.0, 0.0]
    np.testing.assert_allclose(rpc.project(beyond), image, atol=1e-6, rtol=0)


@settings(max_examples=40, deadline=None)
@given(lon=st.floats(-180, 180), lat=st.floats(-89.5, 89.5), height=st.floats(-400, 9000))
def test_closure_anywhere_on_the_globe(lon: float, lat: float, height: float) -> None:
    rpc = synthetic_rpc(lon, lat)
    image = np.array([[0.0, 0.0], [10800.0, 0.0], [5400.0, 5500.0], [-2000.0, 13000.0]])
    ground, converged = rpc.localize(image, height)
    assert converged.all()
    # longitude steps of 3e-14 degree are 1e-8 px and more where the field spans many degrees
    np.testing.assert_allclose(rpc.project(ground), image, atol=3e-8, rtol=0)


# ---- rays, memory, value semantics -----------------------------------------------------------------------------


def test_rays_pass_through_the_ground_points_between() -> None:
    rpc = synthetic_rpc(12.0, 48.0)
    frame = LocalFrame(12.0, 48.0, 300.0)
    image = np.random.default_rng(6).uniform(0, 10000, (30, 2))
    rays, found = rpc.rays(image, frame)
    assert found.all()
    middle = frame.from_ground(rpc.localize(image, 300.0).ground)
    along = rays.origin[:, 2] - middle[:, 2]
    # the ray of an RPC bends by millimetres over its height range
    np.testing.assert_allclose(rays.origin + along[:, None] * rays.direction, middle, atol=0.05)


def test_memory_does_not_grow_beyond_the_result() -> None:
    rpc = synthetic_rpc(12.0, 48.0)

    def peak_beyond_result(count: int) -> int:
        image = np.random.default_rng(7).uniform(0, 10000, (count, 2))
        tracemalloc.start()
        ground, converged = rpc.localize(image, 300.0)
        back = rpc.project(ground)
        peak = tracemalloc.get_traced_memory()[1] - ground.nbytes - back.nbytes - converged.nbytes
        tracemalloc.stop()
        return peak

    one_buffer = peak_beyond_result(EVALUATION.chunk)
    for buffers in (20, 60, 120):
        assert peak_beyond_result(buffers * EVALUATION.chunk) <= 1.01 * one_buffer


def test_parts_do_not_matter() -> None:
    rpc = synthetic_rpc(12.0, 48.0)
    image = np.random.default_rng(8).uniform(0, 10000, (EVALUATION.chunk + 17, 2))
    whole = rpc.localize(image, 300.0).ground
    np.testing.assert_allclose(whole[-17:], rpc.localize(image[-17:], 300.0).ground, rtol=0, atol=1e-13)


def test_no_points_are_no_problem() -> None:
    rpc = synthetic_rpc(12.0, 48.0)
    assert rpc.project(np.empty((0, 3))).shape == (0, 2)
    assert rpc.localize(np.empty((0, 2)), 0.0).ground.shape == (0, 3)
    assert rpc.project_with_jacobian(np.empty((0, 3)))[1].shape == (0, 2, 3)


def test_wrong_shapes_are_named() -> None:
    with pytest.raises(ValueError, match=r"ground points have shape \(3,\)"):
        synthetic_rpc(0.0, 0.0).project(np.zeros(3))


def test_an_rpc_is_a_value() -> None:
    rpc = synthetic_rpc(12.0, 48.0)
    assert rpc == synthetic_rpc(12.0, 48.0)
    assert hash(rpc) == hash(synthetic_rpc(12.0, 48.0))
    moved = rpc.shift(3.0, -2.0)
    assert moved != rpc
    ground = np.array([[12.0, 48.0, 100.0]])
    np.testing.assert_allclose(moved.project(ground) - rpc.project(ground), [[3.0, -2.0]], atol=1e-11)
    with pytest.raises(ValueError):
        rpc.line_num[0] = 5.0
