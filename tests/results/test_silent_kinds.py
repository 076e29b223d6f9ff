"""Wrong inputs that did harm without a word, on seeds that tuned nothing: each is told now."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from long_tests import mark_beyond

from hrsi.benchmarks.true_errors import run_for_harm
from hrsi.benchmarks.wrong_inputs import Inputs, clean
from hrsi.benchmarks.wrong_kinds import TRUE_KINDS
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.plausibility.places import find_placement_reasons, find_reordered_rpcs

KINDS = (
    ("one of 2 heights", "spot5", "control-misfit"),
    ("crops of all images (1000, 700 px), no", "ikonos", "rpc-placement"),
    ("coefficients in the order", "spot5", "rpc-order"),
    ("laser points moved by 500 m", "worldview-2", "laser-few"),
)  # fmt: skip


@pytest.mark.parametrize(("name", "sensor", "code"), mark_beyond(1, "wrong_inputs", KINDS))
def test_a_silent_kind_is_told(name: str, sensor: str, code: str) -> None:
    kind = next(kind for kind in TRUE_KINDS if kind.name.startswith(name))
    right = clean(sensor, 341, kind.images, kind.gcps, kind.relief_m, kind.checks)
    assert code not in run_for_harm(right).codes
    assert code in run_for_harm(kind.spoil(right, np.random.default_rng([341, len(kind.name)]))).codes


def _with_rpc(inputs: Inputs, **changed) -> list:
    images = [replace(image, rpc=replace(image.rpc, **changed)) for image in inputs.images]
    return find_placement_reasons(assemble(images, [], [inputs.measured.select(~inputs.of_gcps)]))


@pytest.mark.parametrize("margin", [0.0, 0.02, 0.1])
def test_an_rpc_larger_than_its_image_on_both_sides_is_of_no_crop(margin: float) -> None:
    right = clean("pleiades", 341)
    samples, lines = right.images[0].known_size
    half = {"samp_scale": samples * (0.5 + margin), "line_scale": lines * (0.5 + margin)}
    assert not _with_rpc(right, samp_off=samples / 2.0, line_off=lines / 2.0, **half)
    # an RPC that begins exactly with its image states its size: edges of 1 % are noticed
    assert bool(_with_rpc(right, samp_off=half["samp_scale"], line_off=half["line_scale"], **half)) == (margin > 0.01)


def _in_order_of_rpc00a(coefficients: np.ndarray) -> np.ndarray:
    """STDI-0002, tables of RPC00A and RPC00B: the powers of line, sample and height of each term."""
    a = ["", "L", "P", "H", "LP", "LH", "PH", "LPH", "LL", "PP", "HH", "LLL", "LLP", "LLH", "LPP", "PPP", "PPH", "LHH",
         "PHH", "HHH"]  # fmt: skip
    b = ["", "L", "P", "H", "LP", "LH", "PH", "LL", "PP", "HH", "LPH", "LLL", "LPP", "LHH", "LLP", "PPP", "PHH", "LLH",
         "PPH", "HHH"]  # fmt: skip
    return coefficients[[b.index(term) for term in a]]


def _has_order_reason(rpc: RPC) -> bool:
    images = [replace(clean("pleiades", 341).images[0], rpc=rpc)]
    return bool(find_reordered_rpcs(assemble(images, [], [])))


@pytest.mark.parametrize(
    "name", ["formats/rpb/07JAN27.RPB", "formats/rpc_txt/rpc_IKONOS.txt", "spot7_tiepoints/RPC_1A.xml",
             "formats/wv_isd_xml/rpc_WV2.xml", "zy3_stereo_gcp/zy301a_bwd_381_6138_rpc.txt", "qb2_gcp/qb2_basic1b.tif"],
)  # fmt: skip
def test_vendors_rpcs_are_told_from_those_in_the_order_of_rpc00a(real_data: Path, name: str) -> None:
    rpc = open_image(str(real_data / name)).rpc
    fields = ("line_num", "line_den", "samp_num", "samp_den")
    assert not _has_order_reason(rpc)
    assert _has_order_reason(replace(rpc, **{field: _in_order_of_rpc00a(getattr(rpc, field)) for field in fields}))


def test_a_product_with_its_coefficients_in_the_old_order_is_told(real_data: Path) -> None:
    """An IKONOS NITF that says RPC00B has its terms converted from RPC00A twice: its rays are bent by 0.3 px."""
    folder = real_data / "formats" / "nitf_ichipb"
    assert _has_order_reason(open_image(str(next(folder.glob("*noICHIPB.nitf")))).rpc)
