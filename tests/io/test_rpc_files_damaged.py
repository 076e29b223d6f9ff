"""Readers on input that nobody wrote: arbitrary and mutated bytes end in an `InputError`, values come back exactly."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from long_tests import mark_beyond
from rpc_samples import sample_rpc

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.opening.budgets import RPC_BUDGETS, RPC_RANGES
from hrsi.hrsi_engine.io.rpc_files import RPC_READERS, read_rpc, text_formats, write_rpc_text
from hrsi.hrsi_engine.io.rpc_files.fields import SCALARS, gdal_metadata, rpc_from_entries

WITHIN = [
    st.floats(-RPC_RANGES[name][1], RPC_RANGES[name][1]).filter(
        lambda value, name=name: abs(value) >= RPC_RANGES[name][0]
    )
    for name in SCALARS
]
COEFFICIENT = st.floats(-RPC_BUDGETS.coefficient, RPC_BUDGETS.coefficient)
COEFFICIENTS = st.lists(COEFFICIENT, min_size=20, max_size=20)
DENOMINATOR = st.tuples(st.floats(1e-3, 1e3), st.lists(st.floats(-1.0, 1.0), min_size=19, max_size=19)).map(
    lambda parts: [parts[0], *parts[1]]
)
ACCURACY = st.none() | st.floats(min_value=0.0, allow_nan=False, allow_infinity=False)
ANY_RPC = st.builds(
    RPC, *WITHIN[:5], *WITHIN[5:], COEFFICIENTS, DENOMINATOR, COEFFICIENTS,
    DENOMINATOR, ACCURACY, ACCURACY,
)  # fmt: skip
NAMES = {"rpb": "x.rpb", "isd": "x.xml", "rpc-txt": "x_rpc.txt", "dimap": "rpc_x.xml", "kompsat": "x.rpc",
         "geom": "x.geom", "rpcm-json": "x.json",
         "orthority": "x.yaml", "alos": "rpc-x.txt"}  # fmt: skip
PIECES = st.sampled_from(
    ["LINE_OFF: 1\n", "lineOffset = 1;", "lineNumCoef = (1,", "BEGIN_GROUP = IMAGE", "<isd><RPB>", "<Dimap_Document>",
     "Rational_Function_Model", "</", ">", '{"rpc":', '"row_offset": 1', "}", "[", "line_off: 1\n", "1e999", "nan",
     "\x00"]
)  # fmt: skip


LOOKALIKES = st.lists(PIECES | st.text(max_size=8), max_size=30).map(lambda p: "".join(p).encode(errors="replace"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damaged")


@pytest.mark.parametrize(("numerator", "denominator"), [(1e9, 1e-310), (-1e9, 1e-305), (0.5, 1.0), (0.0, 1e-310)])
@pytest.mark.parametrize("axis", ["line", "samp"])
def test_the_middle_has_a_place_in_the_image(axis: str, numerator: float, denominator: float, folder: Path) -> None:
    """A file is refused if, and only if, its RPC projects the middle of its area to no finite place."""
    rpc = replace(sample_rpc(1), **{
        f"{axis}_num": np.r_[numerator, np.full(19, 0.25)], f"{axis}_den": np.r_[denominator, np.zeros(19)],
    })  # fmt: skip
    path = folder / "middle_RPC.TXT"
    path.write_text(text_formats.rpc_txt_text(rpc))
    with np.errstate(all="ignore"):
        there = np.isfinite(rpc.project(np.array([[rpc.long_off, rpc.lat_off, rpc.height_off]]))).all()
    if there:
        assert read_rpc(str(path)).rpc == rpc
    else:
        with pytest.raises(InputError, match="centre of its area"):
            read_rpc(str(path))


@pytest.mark.parametrize(("field", "value"), [("long_off", 1100.0), ("height_off", -6.4e6), ("lat_scale", 1e-9)])
def test_places_and_areas_that_no_image_has(field: str, value: float, folder: Path) -> None:
    """Three times around the Earth, in its centre, and a tenth of a millimetre."""
    path, rpc = folder / "nowhere_RPC.TXT", sample_rpc(1)
    path.write_text(text_formats.rpc_txt_text(rpc))
    assert read_rpc(str(path)).rpc == rpc
    path.write_text(text_formats.rpc_txt_text(replace(rpc, **{field: value})))
    with pytest.raises(InputError, match=f"{field.upper()} is .* not possible"):
        read_rpc(str(path))


@pytest.mark.fuzz
@given(rpc=ANY_RPC)
def test_text_formats_keep_every_double(rpc: RPC, folder: Path) -> None:
    write_rpc_text(str(folder / "x_RPC.TXT"), rpc)
    assert read_rpc(str(folder / "x_RPC.TXT")).rpc == rpc
    write_rpc_text(str(folder / "x.RPB"), rpc, kind="rpb")
    assert read_rpc(str(folder / "x.RPB")).rpc == rpc
    assert rpc_from_entries("metadata", gdal_metadata(rpc)) == rpc


@pytest.mark.fuzz
@pytest.mark.parametrize("key", RPC_READERS)
@given(content=st.binary(max_size=2000) | LOOKALIKES)
def test_any_bytes(key: str, content: bytes, folder: Path) -> None:
    file = folder / NAMES[key]
    file.write_bytes(content)
    try:
        rpc = RPC_READERS[key].read(str(file)).rpc
        assert np.isfinite(rpc.line_num).all()
    except InputError as error:
        assert NAMES[key] in str(error)  # noqa: PT017 - both ends are right
        assert "\n" not in str(error)  # noqa: PT017


@pytest.mark.parametrize("key", RPC_READERS)
@pytest.mark.parametrize(
    "piece",
    mark_beyond(2, "wrong_inputs", [b"\n", b" ", b"a", b"=", b"a=(", b"<a>", b"[", b"LINE_OFF:", b"1", b"<a b='"]),
)
def test_no_reader_hangs_on_long_runs(key: str, piece: bytes, folder: Path) -> None:
    """3 MB of one piece: quadratic time would take minutes."""
    file = folder / NAMES[key]
    file.write_bytes(piece * (3_000_000 // len(piece)))
    with pytest.raises(InputError):
        RPC_READERS[key].read(str(file))


@pytest.mark.parametrize("key", ["rpb", "rpc-txt", "geom"])
@pytest.mark.parametrize("first", [True, False])
def test_a_number_that_stands_there_twice(key: str, first: bool, folder: Path) -> None:
    """Nothing tells which of two is right; the same number once more does no harm."""
    title, file = {
        "rpb": ("lineOffset = {};", text_formats.rpb_text),
        "rpc-txt": ("LINE_OFF: {} pixels", text_formats.rpc_txt_text),
        "geom": ("line_off: {}", text_formats.geom_text),
    }[key]  # fmt: skip
    path, rpc = folder / "twice", sample_rpc(3)

    def read(value: float) -> RPC:
        lines = file(rpc).splitlines()
        lines.insert(1 if first else len(lines) - 1, title.format(value))
        path.write_text("\n".join(lines) + "\n")
        return RPC_READERS[key].read(str(path)).rpc

    assert read(rpc.line_off) == rpc
    with pytest.raises(InputError, match=r"(?i)line_?off(set)? occurs twice"):
        read(rpc.line_off + 1.0)
