"""Kept results are told to be stale by contents: also where sizes and times of change were put back."""

import os
import shutil
import time
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal

from hrsi.hrsi_engine.io.safety import content_marks
from hrsi.hrsi_engine.io.safety.content_marks import content_mark


def write_image(path: Path, grey: np.ndarray, *options: str) -> None:
    """Write an image by GDAL, with the times that an earlier one had."""
    status = os.stat(path) if path.exists() else None
    dataset = gdal.GetDriverByName("GTiff").Create(str(path), *grey.shape[::-1], 1, gdal.GDT_UInt16, list(options))
    dataset.GetRasterBand(1).WriteArray(grey)
    del dataset
    if status is not None:
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
        assert os.stat(path).st_mtime_ns == status.st_mtime_ns


@pytest.fixture
def grey() -> np.ndarray:
    return np.random.default_rng(3).integers(0, 2000, (700, 900)).astype(np.uint16)


@pytest.mark.parametrize("options", [(), ("TILED=YES", "COMPRESS=DEFLATE")])
def test_one_pixel_is_seen_though_the_time_was_put_back(tmp_path: Path, grey: np.ndarray, options: tuple[str, ...]):
    path = tmp_path / "image.tif"
    write_image(path, grey, *options)
    before = content_mark(str(path))
    grey[321, 654] ^= 1
    write_image(path, grey, *options)
    assert content_mark(str(path)) != before
    grey[321, 654] ^= 1
    write_image(path, grey, *options)
    assert content_mark(str(path)) == before  # the content, not the history


def test_a_copy_has_the_same_content(tmp_path: Path, grey: np.ndarray):
    """Another folder, another time: what was found in one is true of the other."""
    write_image(tmp_path / "image.tif", grey)
    (tmp_path / "other").mkdir()
    shutil.copyfile(tmp_path / "image.tif", tmp_path / "other" / "image.tif")
    os.utime(tmp_path / "other" / "image.tif", (1e9, 1e9))
    assert content_mark(str(tmp_path / "other" / "image.tif")) == content_mark(str(tmp_path / "image.tif"))


def change_side_file(path: Path, folder: Path) -> Path:
    (folder / "image.tif.aux.xml").write_text("<PAMDataset><Metadata><MDI key='a'>b</MDI></Metadata></PAMDataset>")
    return path


def change_tags(path: Path, folder: Path) -> Path:
    dataset = gdal.Open(str(path), gdal.GA_Update)
    dataset.SetMetadataItem("TIFFTAG_IMAGEDESCRIPTION", "other")
    return path


def change_source_of_vrt(path: Path, folder: Path) -> Path:
    write_image(path, np.ones((700, 900), np.uint16))
    return folder / "image.vrt"


@pytest.mark.parametrize("change", [change_side_file, change_tags, change_source_of_vrt])
def test_what_belongs_to_an_image_is_seen(tmp_path: Path, grey: np.ndarray, change: Callable[[Path, Path], Path]):
    write_image(tmp_path / "image.tif", grey)
    gdal.Translate(str(tmp_path / "image.vrt"), str(tmp_path / "image.tif"), format="VRT")
    before = {name: content_mark(str(tmp_path / name)) for name in ("image.tif", "image.vrt")}
    changed = change(tmp_path / "image.tif", tmp_path)
    assert content_mark(str(changed)) != before[changed.name]


def test_large_files_are_sampled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """What is longer than the distance of two samples is seen by content, a single byte by the record's own time."""
    sampling = replace(content_marks.CONTENT_SAMPLING, whole_bytes=2**20, blocks=64)
    monkeypatch.setattr(content_marks, "CONTENT_SAMPLING", sampling)
    path, size = tmp_path / "large.bin", 16 * 2**20
    content = np.random.default_rng(4).integers(0, 256, size).astype(np.uint8)
    content.tofile(path)
    places = content_marks.places_of(size)
    starts = np.sort([start for start, _ in places])
    assert np.diff(starts).max() <= 2 * size / content_marks.CONTENT_SAMPLING.blocks
    monkeypatch.setattr(content_marks, "_change_times", lambda _file: b"")  # no time tells anything
    before = content_mark(str(path))
    for start in (0, 5_000_000, size - 600_000):
        with path.open("r+b") as file:
            file.seek(start)
            file.write(bytes(550_000))
        assert content_mark(str(path)) != before, start
        content.tofile(path)
        assert content_mark(str(path)) == before
    monkeypatch.undo()
    sampling = replace(content_marks.CONTENT_SAMPLING, whole_bytes=2**20)
    monkeypatch.setattr(content_marks, "CONTENT_SAMPLING", sampling)
    before, status = content_mark(str(path)), os.stat(path)
    with path.open("r+b") as file:
        file.seek(5_000_001)
        file.write(b"x")
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert content_mark(str(path)) != before


@pytest.mark.parametrize("name", ["missing.tif", "NITF_IM:0:missing.ntf", "/vsizip/missing.zip/a.tif", "/vsicurl/x://"])
def test_what_cannot_be_read_has_no_content(name: str):
    assert content_mark(name) == "0" * 32


@pytest.mark.parametrize("kind", ["/vsizip/", "/vsimem/"])
def test_virtual_files(tmp_path: Path, grey: np.ndarray, kind: str):
    """A pixel in an archive, the size of a file in memory."""
    marks = set()
    for value in (1, 2, 2):
        grey[600, 800] = value
        write_image(tmp_path / "image.tif", grey if kind == "/vsizip/" else grey[: 600 + value])
        if kind == "/vsizip/":
            path = f"/vsizip/{tmp_path}/images.zip/folder/image.tif"
            with zipfile.ZipFile(tmp_path / "images.zip", "w") as archive:
                archive.write(tmp_path / "image.tif", "folder/image.tif")
        else:
            path = "/vsimem/content_marks.tif"
            gdal.FileFromMemBuffer(path, (tmp_path / "image.tif").read_bytes())
        marks.add(content_mark(path))
    assert len(marks) >= 2 and "0" * 32 not in marks


def test_an_image_of_40000_x_40000_pixels_costs_a_blink(tmp_path: Path):
    """3.2 GB of a sparse file."""
    path = tmp_path / "large.img"
    with path.open("wb") as file:
        file.truncate(2 * 40_000**2)
    (tmp_path / "large.hdr").write_text(
        "ENVI\nsamples = 40000\nlines = 40000\nbands = 1\nheader offset = 0\nfile type = ENVI Standard\n"
        "data type = 12\ninterleave = bsq\nbyte order = 0\n"
    )
    started = time.process_time()
    before = content_mark(str(path))
    assert time.process_time() - started < 0.2
    status = os.stat(path)
    with path.open("r+b") as file:
        file.seek(1_600_000_001)
        file.write(b"x")
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert content_mark(str(path)) != before
