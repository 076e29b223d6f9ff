"""Viewing geometry against the tables of the test data's README, a sphere-free formula, and damaged RPCs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.block.imaging_geometry import PairGeometry, ViewDirection, compute_all_pairs, find_rpc_warnings
from hrsi.hrsi_engine.foundation.errors import SolveError
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.surface.grid_surface import ConstantHeight
from hrsi.tests.test_rpc import rpc_files, synthetic_rpc

# data/real/README.md, computed there with another RPC implementation: heights and, for each image, incidence and
# azimuth in degrees (rounded there) and GSD in m.
BLOCKS = {
    "s2p_triplet_phr": (
        206.0, {"img_01.tif": (6.9, 47, 0.50), "img_02.tif": (3.8, 114, 0.50), "img_03.tif": (8.0, 166, 0.50)},
    ),
    "kahramanmaras_phr4": (
        704.0,
        {
            "pre_event_img1.tif": (16.2, 333, 0.52), "pre_event_img2.tif": (11.8, 260, 0.52),
            "post_event_img1.tif": (13.7, 321, 0.52), "post_event_img2.tif": (13.5, 249, 0.52),
        },
    ),
    "ventoux_phr_pair": (537.0, {"left_image.tif": (8.8, 19, 0.51), "right_image.tif": (11.4, 190, 0.51)}),
    "qb2_gcp": (700.0, {"qb2_basic1b.tif": (15.2, 299, 6.5)}),
}  # fmt: skip
#: Convergence in degrees and overlap of the first and second image in percent, of pairs by their place in the block.
PAIRS = {
    "s2p_triplet_phr": {(0, 1): (6.5, 96, 95), (0, 2): (12.8, 91, 90), (1, 2): (6.4, 96, 95)},
    "kahramanmaras_phr4": {
        (0, 1): (17.0, 92, 97), (2, 3): (15.9, 95, 96), (0, 2): (4.1, 96, 100), (1, 3): (3.0, 100, 98),
        (1, 2): (13.0, 97, 95), (0, 3): (20.0, 92, 96),
    },
    "ventoux_phr_pair": {(0, 1): (20.1, 28, 28)},
}  # fmt: skip


def views(folder: Path, height_m: float, names: list[str]) -> list[ViewDirection]:
    return [ViewDirection(open_image(str(folder / name)), ConstantHeight(height_m)) for name in names]


@pytest.mark.parametrize("block", BLOCKS)
def test_views_of_real_images(real_data: Path, block: str) -> None:
    height, expected = BLOCKS[block]
    for view, (incidence, azimuth, gsd) in zip(
        views(real_data / block, height, list(expected)), expected.values(), strict=True
    ):
        geometry = view.geometry()
        assert geometry.incidence_deg == pytest.approx(incidence, abs=0.06)
        assert geometry.azimuth_deg == pytest.approx(azimuth, abs=0.6)
        assert (geometry.gsd_sample_m + geometry.gsd_line_m) / 2 == pytest.approx(gsd, rel=0.02)
        assert geometry.centre[2] == pytest.approx(height, abs=1e-3)


@pytest.mark.parametrize("block", PAIRS)
def test_pairs_of_real_images(real_data: Path, block: str) -> None:
    height, images = BLOCKS[block]
    opened = views(real_data / block, height, list(images))
    pairs = {(pair.first, pair.second): pair for pair in compute_all_pairs(opened)}
    for (i, j), (convergence, first, second) in PAIRS[block].items():
        pair = pairs[opened[i].image.id, opened[j].image.id]
        assert pair.convergence_deg == pytest.approx(convergence, abs=0.06)
        assert 100 * pair.overlap[0] == pytest.approx(first, abs=1.1)  # rounded there; two ways of counting
        assert 100 * pair.overlap[1] == pytest.approx(second, abs=1.1)


def test_scene_pairs_of_rpc_files_alone(real_data: Path) -> None:
    folder = real_data / "zy3_stereo_gcp"
    stereo = views(folder, 100.0, ["zy301a_fwd_381_6138_rpc.txt", "zy301a_bwd_381_6138_rpc.txt"])
    assert compute_all_pairs(stereo)[0].convergence_deg == pytest.approx(47.6, abs=0.06)
    forward = stereo[0].geometry()
    assert (forward.gsd_sample_m, forward.gsd_line_m) == pytest.approx((3.2, 3.5), rel=0.02)
    assert forward.incidence_deg == pytest.approx(23.5, abs=0.06)
    spot = views(real_data / "spot7_tiepoints", 1500.0, ["RPC_1A.xml", "RPC_1B.xml"])
    assert compute_all_pairs(spot)[0].convergence_deg == pytest.approx(39.4, abs=0.06)
    assert [view.geometry().incidence_deg for view in spot] == pytest.approx([20.6, 19.0], abs=0.06)


def test_overlap_depends_on_the_terrains_height(real_data: Path) -> None:
    """The wide-angle pair does not overlap at the RPCs' HEIGHT_OFF; then there are no angles either."""
    pair = compute_all_pairs(views(real_data / "ventoux_phr_pair", 1075.0, ["left_image.tif", "right_image.tif"]))[0]
    assert pair == PairGeometry("left_image", "right_image", (0.0, 0.0), None, None)


def test_footprint_is_the_outline_on_the_ground(real_data: Path) -> None:
    view = views(real_data / "qb2_gcp", 700.0, ["qb2_basic1b.tif"])[0]
    footprint = view.geometry().footprint
    # bounding box of data/real/README.md, to its 4 digits and some terrain
    np.testing.assert_allclose(footprint.min(axis=0), [24.3597, -33.7346], atol=2e-3)
    np.testing.assert_allclose(footprint.max(axis=0), [24.4202, -33.6484], atol=2e-3)


# ---- sanity ----------------------------------------------------------------------------------------------------


def test_sound_rpcs_raise_no_doubt(real_data: Path) -> None:
    doubtful = {path.name for path, _, _ in rpc_files(real_data) if find_rpc_warnings(open_image(str(path)))}
    assert doubtful == set()


def image_with(**changes: object) -> Image:
    return Image("scene", replace(synthetic_rpc(12.0, 48.0), **changes), (10800, 11000))


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (image_with(lat_off=147.0, long_off=-42.0), "swapped"),
        (image_with(samp_den=np.array([1.0, 1.4] + 18 * [0.0])), "sample denominator|no ground position"),
        (image_with(height_scale=-500.0), "HEIGHT_SCALE"),
        (image_with(height_off=30000.0), "no land"),
        (image_with(height_off=-11000.0), "no land"),  # the deepest sea
        (image_with(line_scale=0.0), "LINE_SCALE"),
    ],
)
def test_what_is_wrong_with_an_rpc_is_said(image: Image, message: str) -> None:
    assert any(part in text for text in find_rpc_warnings(image) for part in message.split("|"))


def test_exchanged_latitude_and_longitude_show_as_a_mirror() -> None:
    """Where both are below 90 degrees only the orientation tells."""
    rpc = synthetic_rpc(12.0, 48.0)
    order = [0, 2, 1, 3, 4, 6, 5, 8, 7, 9, 10, 15, 14, 16, 12, 11, 13, 18, 17, 19]
    exchanged = replace(
        rpc, lat_off=rpc.long_off, long_off=rpc.lat_off, lat_scale=rpc.long_scale, long_scale=rpc.lat_scale,
        **{name: getattr(rpc, name)[order] for name in ("line_num", "line_den", "samp_num", "samp_den")},
    )  # fmt: skip
    assert find_rpc_warnings(Image("scene", rpc, (10800, 11000))) == []
    assert "mirrored" in find_rpc_warnings(Image("scene", exchanged, (10800, 11000)))[0]


def test_terrain_beyond_the_rpcs_heights_is_said() -> None:
    assert "extrapolates" in find_rpc_warnings(image_with(), (-300.0, 200.0))[0]
    assert find_rpc_warnings(image_with(), (0.0, 600.0)) == []


def test_an_image_without_ground_is_an_error() -> None:
    broken = image_with(samp_num=np.zeros(20))
    with pytest.raises(SolveError, match="scene"):
        ViewDirection(broken, ConstantHeight(100.0)).geometry()
