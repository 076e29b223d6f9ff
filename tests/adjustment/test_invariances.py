"""What must not change a result: order, names, where on Earth, how often and in which system a thing is told.

Nothing here knows what a right result is; each property compares a run with another one of the same block, told
otherwise. Blocks are those of `simulated_blocks` at seeds that hypothesis chooses.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest
import simulated_blocks as blocks
from hypothesis import given, settings
from hypothesis import strategies as st
from long_tests import mark_beyond

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import Block, GroundPoints, ImagePoints
from hrsi.hrsi_engine.block.default_sigmas import DefaultSigmas
from hrsi.hrsi_engine.ground.geodesy import ground_difference_m, wrap_degrees
from hrsi.hrsi_engine.io.point_files import read_points

SEEDS = st.integers(0, 10_000)
FEW = settings(max_examples=8)  # an adjustment each, twice
SAME_M, SAME_PX, SAME_SHARE = 2e-5, 2e-5, 1e-3  # convergence: what the last step of an adjustment leaves
NAMES = st.text(st.characters(blacklist_categories=("Cs", "Cc", "Zs", "Zl", "Zp"), blacklist_characters=",;|\"'"),
                min_size=1, max_size=12)  # fmt: skip


def solved(block: Block, model: str = "affine") -> Adjustment:
    return adjust(block, AdjustOptions(test_sigmas=False, model=model))


def tables(block: Block) -> tuple[GroundPoints, ImagePoints]:
    """Return what a block was put together from."""
    known = block.points.select(block.known)
    rows = block.measurements
    images = np.array([image.id for image in block.images])
    return known, ImagePoints(block.points.ids[rows.point], images[rows.image], rows.xy, rows.sigma_px)


def put_together(block: Block, images: Sequence, known: GroundPoints, measured: Sequence[ImagePoints]) -> Block:
    return assemble(images, [known], measured, defaults=DefaultSigmas(0.3, 0.1, 0.1))


def require_same(first: Adjustment, second: Adjustment, names: dict[str, str] | None = None) -> None:
    """Compare ground points and cameras by name."""
    renamed = [(names or {}).get(str(name), str(name)) for name in first.block.points.ids]
    place = {str(name): row for row, name in enumerate(second.block.points.ids)}
    rows = [place[name] for name in renamed]
    assert np.abs(ground_difference_m(first.ground, second.ground[rows])).max() < SAME_M
    cameras = {image.id: k for k, image in enumerate(second.block.images)}
    here = [cameras[image.id] for image in first.block.images]
    assert np.abs((first.values - second.values[here]) / first.values_sigma).max() < SAME_SHARE
    assert first.sigma0 == pytest.approx(second.sigma0, rel=1e-6)


@FEW
@given(seed=SEEDS, order=st.randoms(use_true_random=False))
def test_the_order_of_images_points_and_rows(seed: int, order) -> None:
    block, _, _ = blocks.block(seed=seed)
    known, measured = tables(block)
    images = list(block.images)
    order.shuffle(images)
    ground_rows, image_rows = list(range(len(known))), list(range(len(measured)))
    order.shuffle(ground_rows)
    order.shuffle(image_rows)
    other = put_together(block, images, known.select(np.array(ground_rows)), [measured.select(np.array(image_rows))])
    require_same(solved(block), solved(other))


@FEW
@given(seed=SEEDS, data=st.data())
def test_the_names_of_points(seed: int, data: st.DataObject) -> None:
    """Any text is as good as another; letters of any script, digits that sort otherwise."""
    block, _, _ = blocks.block(seed=seed)
    known, measured = tables(block)
    ids = block.points.ids.tolist()
    given_names = data.draw(st.lists(NAMES, min_size=len(ids), max_size=len(ids), unique_by=str.casefold))
    names = dict(zip(ids, given_names, strict=True))
    other = put_together(
        block, block.images,
        replace(known, ids=np.array([names[name] for name in known.ids.tolist()])),
        [replace(measured, ids=np.array([names[name] for name in measured.ids.tolist()]))],
    )  # fmt: skip
    require_same(solved(block), solved(other), names)


@FEW
@given(seed=SEEDS, turned_deg=st.floats(-360.0, 360.0))
def test_the_earth_is_round(seed: int, turned_deg: float) -> None:
    """The block turned about the Earth's axis, over the date line and beyond 360 degrees: the same block elsewhere."""
    block, _, _ = blocks.block(seed=seed)
    known, measured = tables(block)
    middle = float(wrap_degrees(np.array(blocks.LON + turned_deg)))
    images = [replace(image, rpc=replace(image.rpc, long_off=middle)) for image in block.images]
    ground = known.ground.copy()
    ground[:, 0] = wrap_degrees(ground[:, 0] + turned_deg)
    other = solved(put_together(block, images, replace(known, ground=ground), [measured]))
    here = solved(block)
    back = other.ground.copy()
    back[:, 0] -= turned_deg
    assert np.abs(ground_difference_m(here.ground, back)).max() < SAME_M
    np.testing.assert_allclose(other.residual_px, here.residual_px, atol=SAME_PX)


@FEW
@given(seed=SEEDS, turns=st.sampled_from([-1, 1]))
def test_longitudes_a_turn_further(seed: int, turns: int) -> None:
    """Some files count from 0 to 360 degrees; GCPs and RPCs need not agree in that."""
    block, _, _ = blocks.block(seed=seed)
    known, measured = tables(block)
    ground = known.ground + [360.0 * turns, 0.0, 0.0]
    other = put_together(block, block.images, replace(known, ground=ground), [measured])
    require_same(solved(block), solved(other))


@FEW
@given(seed=SEEDS, factor=st.sampled_from([0.25, 0.5, 2.0, 8.0]))
def test_a_common_factor_of_all_sigmas(seed: int, factor: float) -> None:
    """Estimates depend on ratios of standard deviations; sigma0 tells the factor. Without priors on the cameras."""
    block, _, _ = blocks.block(seed=seed, gcps=15)
    options = AdjustOptions(
        test_sigmas=False, model="affine", reject_sigma=0.0, sigma_shift_px=1e6, sigma_drift=1e3
    )  # fmt: skip
    points = replace(block.points, sigma_m=block.points.sigma_m * factor)
    rows = replace(block.measurements, sigma_px=block.measurements.sigma_px * factor)
    here, there = adjust(block, options), adjust(replace(block, points=points, measurements=rows), options)
    assert np.abs(ground_difference_m(here.ground, there.ground)).max() < 10 * SAME_M
    assert there.sigma0 * factor == pytest.approx(here.sigma0, rel=1e-4)


@settings(max_examples=4)
@given(seed=SEEDS, twice=st.lists(st.integers(0, 100), min_size=1, max_size=9, unique=True))
def test_the_same_rows_told_twice(seed: int, twice: list[int]) -> None:
    """A file read a second time, or rows copied in it, are no further measurements."""
    block, _, _ = blocks.block(seed=seed)
    known, measured = tables(block)
    double = put_together(block, block.images, known, [measured, measured.select(np.array(twice))])
    require_same(solved(block), solved(double))


# ---- the same positions in other files -----------------------------------------------------------------------------

GROUND = st.lists(
    st.tuples(st.floats(6.01, 11.99), st.floats(0.01, 83.9), st.floats(-400.0, 8000.0)), min_size=1, max_size=8
)
#: Systems in which the same position can be told: heights are ellipsoidal in all of them.
SYSTEMS = ("EPSG:4979", "EPSG:4978", "EPSG:32632", "EPSG:3857", "EPSG:3395")


@settings(max_examples=30)
@given(
    ground=GROUND, crs=st.sampled_from(SYSTEMS), separator=st.sampled_from(",;\t"), turn=st.sampled_from([0, 360, -360])
)
def test_a_file_tells_the_same_in_every_system(
    ground: list[tuple[float, float, float]], crs: str, separator: str, turn: int
) -> None:
    """Degrees, metres of a map, geocentric metres; separators; longitudes a turn further: the same points."""
    given_points = np.array(ground)
    x, y, z = pyproj.Transformer.from_crs("EPSG:4979", crs, always_xy=True).transform(*given_points.T)
    if crs == "EPSG:4979":
        x = x + turn
    lines = [separator.join(("id", "x", "y", "z"))]
    lines += [
        separator.join((f"P{k}", *(repr(float(value)) for value in row)))
        for k, row in enumerate(zip(x, y, z, strict=True))
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "points.csv"
        path.write_text("\n".join(lines))
        found = read_points(str(path), ground_crs=crs, height_datum="layer").ground
    assert found.ids.tolist() == [f"P{k}" for k in range(len(ground))]
    assert np.abs(ground_difference_m(found.ground, given_points)).max() < 1e-3  # PROJ's own inverse to a millimetre


@settings(max_examples=30)
@given(ground=GROUND, order=st.randoms(use_true_random=False), blank=st.sampled_from(["", " ", "\n", "\r\n"]))
def test_a_file_tells_the_same_in_every_order(ground: list[tuple[float, float, float]], order, blank: str) -> None:
    """Order of rows and of columns, blanks, empty lines, further columns."""
    names, rows = ["id", "lon", "lat", "height", "remark"], []
    for k, point in enumerate(ground):
        rows.append([f"P{k}", *map(repr, point), "free text"])
    columns = list(range(len(names)))
    order.shuffle(columns)
    order.shuffle(rows)
    text = "\n".join(",".join(blank.strip("\r\n") + row[column] for column in columns) for row in [names, *rows])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "points.csv"
        path.write_text(text + blank)
        found = read_points(str(path), height_datum="ellipsoidal").ground
    place = {str(name): found.ground[row] for row, name in enumerate(found.ids)}
    assert {name: tuple(position) for name, position in place.items()} == {f"P{k}": p for k, p in enumerate(ground)}


@pytest.mark.parametrize("threads", mark_beyond(1, "thorough", [2, 5]))
def test_threads_change_no_bit(threads: int) -> None:
    block, _, _ = blocks.block(seed=5, ties=300)
    alone, together = (adjust(block, AdjustOptions(threads=count)) for count in (1, threads))
    for name in ("values", "values_sigma", "ground", "ground_sigma_m", "residual_px", "weight", "statistic"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(together, name))
