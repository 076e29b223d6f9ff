"""Results appear whole or not at all: they are written into a hidden folder and moved into place at the end.

A folder of GDAL's virtual file systems (``/vsis3/…``, ``/vsimem/…``) gets them as copies, one by one, the report last.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from osgeo import gdal

from ..foundation.errors import InputError, OutputError
from .datasets import gdal_messages
from .layers import remove_old_journal
from .replacing import COPY_BYTES

RESULT_FILES = ("report.json", "block.gpkg")  # their presence makes a folder a result
VIRTUAL = "/vsi"


def check_output_dir(path: str, overwrite: bool) -> None:
    """Raise `InputError` when the folder cannot be used: it is a file, or holds a result that may not be replaced."""
    if path.startswith(VIRTUAL):
        found = [name for name in RESULT_FILES if gdal.VSIStatL(f"{path.rstrip('/')}/{name}") is not None]
    else:
        folder = Path(path)
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{path} is a file: give --output-dir a directory")
        found = [name for name in RESULT_FILES if (folder / name).exists()]
    if found and not overwrite:
        raise InputError(
            f"{path} already holds a result ({', '.join(found)}): add --overwrite or choose another directory"
        )


def earlier_rpcs(path: str, protected: list[str]) -> list[Path]:
    """Return the files with refined RPCs that the report of an earlier run names in its folder, without the inputs.

    Beside a new report that withholds its RPCs they would pass for the new ones.
    """
    folder = Path(path)
    try:
        images = json.loads((folder / RESULT_FILES[0]).read_text(encoding="utf-8"))["images"].values()
        names = [Path(image["output"]).name for image in images if image["output"]]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):  # none, or not ours
        return []
    inputs = {os.path.realpath(name) for name in protected if name}
    found = [folder / name for name in names]
    return [file for file in found if file.is_file() and os.path.realpath(file) not in inputs]


def remove_files(files: list[Path]) -> None:
    """Remove files; those that cannot be removed stay."""
    for file in files:
        with contextlib.suppress(OSError):
            file.unlink()


@contextmanager
def stage_folder(path: str, protected: list[str]) -> Iterator[Path]:
    """Yield a temporary folder whose files move into ``path`` when the block ends without an exception.

    ``protected`` files (the inputs) are never replaced: `InputError` when a result would take the place of one.
    """
    if path.startswith(VIRTUAL):
        with tempfile.TemporaryDirectory(prefix="hrsi-unfinished-") as local:
            yield Path(local)
            _copy_to_virtual(Path(local), path.rstrip("/"), protected)
        return
    folder = Path(path)
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".hrsi-unfinished-", dir=folder))
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): choose another --output-dir") from error
    try:
        yield temporary
        _move_into_place(temporary, folder, protected)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        if made and not any(folder.iterdir()):
            folder.rmdir()
        raise
    shutil.rmtree(temporary, ignore_errors=True)


def _move_into_place(temporary: Path, folder: Path, protected: list[str]) -> None:
    inputs = {os.path.realpath(name) for name in protected if name}
    files = _report_last(temporary)
    for file in files:
        if os.path.realpath(folder / file.name) in inputs:
            raise InputError(f"{folder / file.name} is an input and would be replaced: choose another --output-dir")
    for file in files:
        if file.suffix == ".gpkg":
            remove_old_journal(str(folder / file.name))
        os.replace(file, folder / file.name)


def _report_last(folder: Path) -> list[Path]:
    return sorted(folder.iterdir(), key=lambda file: file.name == RESULT_FILES[0])


def _copy_to_virtual(local: Path, folder: str, protected: list[str]) -> None:
    for file in _report_last(local):
        if f"{folder}/{file.name}" in protected:
            raise InputError(f"{folder}/{file.name} is an input and would be replaced: choose another --output-dir")
    for file in _report_last(local):
        _copy_file(file, f"{folder}/{file.name}")


def _copy_file(file: Path, target: str) -> None:
    """Copy a file into a virtual file system; raise `OutputError` where that takes no files."""
    written = False
    with gdal_messages() as messages, open(file, "rb") as source:
        handle = gdal.VSIFOpenL(target, "wb")
        if handle is not None:
            parts = iter(lambda: source.read(COPY_BYTES), b"")
            written = all(gdal.VSIFWriteL(part, 1, len(part), handle) == len(part) for part in parts)
            written &= gdal.VSIFCloseL(handle) == 0
    if not written:
        reason = messages[-1] if messages else "it takes no new files"
        raise OutputError(f"{target}: cannot be written ({reason}): choose another --output-dir")
