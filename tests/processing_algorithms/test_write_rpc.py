"""`write-rpc`: what is written where, what is refused before anything is written."""

import os
from pathlib import Path
from typing import Any

import pytest
from rpc_samples import sample_rpc, write_image

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.foundation.progress import silent
from hrsi.hrsi_engine.io.rpc_files import read_rpc, write_rpc_text
from hrsi.processing_algorithms.declarations.rpcs import OUTPUT_ENDINGS, WRITE_RPC
from hrsi.processing_algorithms.interface.declare import Context, Report
from hrsi.processing_algorithms.interface.options import check_options

OLD, NEW = sample_rpc(1), sample_rpc(2)


def run(*images: Path, **options: Any) -> Report:
    given = {"images": [str(image) for image in images]} | {
        key: str(value) if isinstance(value, Path) else value for key, value in options.items()
    }
    return WRITE_RPC.execute(check_options(WRITE_RPC, given), Context(silent, lambda message: None))


@pytest.fixture
def image(tmp_path: Path) -> Path:
    write_image(tmp_path / "image.tif", OLD)
    return tmp_path / "image.tif"


@pytest.fixture
def new(tmp_path: Path) -> Path:
    (tmp_path / "rpcs").mkdir()
    write_rpc_text(str(tmp_path / "rpcs" / "image_RPC.TXT"), NEW)
    return tmp_path / "rpcs" / "image_RPC.TXT"


@pytest.mark.parametrize("how", OUTPUT_ENDINGS)
@pytest.mark.parametrize("folder_of_rpcs", [False, True])
def test_each_way(how: str, folder_of_rpcs: bool, image: Path, new: Path, tmp_path: Path) -> None:
    rpc = new.parent if folder_of_rpcs else new
    report = run(image, rpc=rpc, write=how, output_dir=None if how == "in-place" else tmp_path / "out")
    entry = report["images"]["image"]
    assert read_rpc(entry["output"]).rpc == NEW
    assert entry["path"] == str(image)
    assert entry["max_difference_px"] <= 1e-7  # GDAL's 15 digits
    assert "image_RPC.TXT" in entry["source"]
    assert report["schema"] == 1
    assert "image" in WRITE_RPC.summarise(report)
    suffix = OUTPUT_ENDINGS[how]
    assert Path(entry["output"]) == (image if suffix is None else tmp_path / "out" / f"image{suffix}")


def test_restore(image: Path, new: Path) -> None:
    run(image, rpc=new, write="in-place")
    report = run(image, restore=True)
    assert read_rpc(str(image)).rpc == OLD
    assert "the original RPC is back" in report["warnings"][0]
    again = run(image, restore=True)
    assert read_rpc(str(image)).rpc == OLD and "keeps no original RPC" in again["warnings"][0]


def test_restoring_several_is_all_or_none(image: Path, new: Path, tmp_path: Path) -> None:
    """One that was never written in place: nothing changes; without it all come back, and once more is no error."""
    write_image(tmp_path / "other.tif", OLD)
    write_image(tmp_path / "third.tif", OLD)
    written = [image, tmp_path / "third.tif"]
    for one in written:
        run(one, rpc=new, write="in-place")
    with pytest.raises(InputError, match=r"other\.tif: keeps no original RPC.*nothing was changed"):
        run(written[0], tmp_path / "other.tif", written[1], restore=True)
    assert [read_rpc(str(one)).rpc for one in written] == [NEW, NEW]
    for _ in range(2):
        run(*written, restore=True)
        assert [read_rpc(str(one)).rpc for one in written] == [OLD, OLD]


def test_read_only_images_stay_and_modes_are_kept(image: Path, new: Path) -> None:
    image.chmod(0o640)
    run(image, rpc=new, write="in-place")
    assert image.stat().st_mode & 0o777 == 0o640
    image.chmod(0o444)
    before = image.read_bytes()
    for options in ({"restore": True}, {"rpc": new, "write": "in-place"}):
        with pytest.raises(InputError, match=r"image\.tif is read-only \(mode 444\)"):
            run(image, **options)
    assert image.read_bytes() == before and image.stat().st_mode & 0o777 == 0o444


def test_images_only_rpc_is_kept_whoever_wrote_it(tmp_path: Path, new: Path) -> None:
    """An image whose only RPC is a file that this program wrote: the file comes back from every way of writing."""
    write_image(tmp_path / "image.tif", None)
    write_rpc_text(str(tmp_path / "image_RPC.TXT"), OLD)
    for how in ("sidecar", "in-place", "sidecar"):
        run(tmp_path / "image.tif", rpc=new, write=how, overwrite=True)
        assert read_rpc(str(tmp_path / "image.tif")).rpc == NEW
        run(tmp_path / "image.tif", restore=True)
        assert read_rpc(str(tmp_path / "image.tif")).rpc == OLD
    run(tmp_path / "image_RPC.TXT", restore=True)  # keeps none, and is not removed
    assert read_rpc(str(tmp_path / "image_RPC.TXT")).rpc == OLD


def test_own_rpc_of_several_images(image: Path, tmp_path: Path) -> None:
    write_image(tmp_path / "second.tif", NEW)
    report = run(image, tmp_path / "second.tif", write="vrt", output_dir=tmp_path / "out")
    assert [read_rpc(entry["output"]).rpc for entry in report["images"].values()] == [OLD, NEW]


def test_image_without_pixels_becomes_a_sidecar(new: Path, tmp_path: Path) -> None:
    report = run(new, output_dir=tmp_path / "out")
    assert report["images"]["image"]["output"] == str(tmp_path / "out" / "image_RPC.TXT")


def test_refused_before_anything_is_written(image: Path, new: Path, tmp_path: Path) -> None:
    write_image(tmp_path / "second.tif", NEW)
    bare = tmp_path / "bare.tif"
    write_image(bare, None)
    refused = {
        "needs `output_dir`": lambda: run(image),
        "one image": lambda: run(image, tmp_path / "second.tif", rpc=new, output_dir=tmp_path / "out"),
        "no such file": lambda: run(image, rpc=tmp_path / "none.txt", output_dir=tmp_path / "out"),
        "has no RPC": lambda: run(image, bare, output_dir=tmp_path / "out"),
        "contains no RPC file for bare": lambda: run(image, bare, rpc=new.parent, output_dir=tmp_path / "out"),
        "same id": lambda: run(image, new, write="sidecar", output_dir=tmp_path / "out"),
        "exists already": lambda: run(image, write="copy", output_dir=tmp_path),
        "is an input": lambda: run(image, write="copy", output_dir=tmp_path, overwrite=True),
    }
    for message, call in refused.items():
        with pytest.raises(InputError, match=message):
            call()
        assert not os.path.exists(tmp_path / "out"), message
