"""Results appear whole or not at all: they are written into a hidden folder and moved into place at the end."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import InputError
from .layers import remove_old_journal

RESULT_FILES = ("report.json", "block.gpkg")  # their presence makes a folder a result


def check_output_dir(path: str, overwrite: bool) -> None:
    """Raise `InputError` when the folder cannot be used: it is a file, or holds a result that may not be replaced."""
    folder = Path(path)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{path} is a file: give --output-dir a directory")
    found = [name for name in RESULT_FILES if (folder / name).exists()]
    if found and not overwrite:
        raise InputError(
            f"{path} already holds a result ({', '.join(found)}): add --overwrite or choose another directory"
        )


@contextmanager
def staged(path: str, protected: list[str]) -> Iterator[Path]:
    """Yield a temporary folder whose files move into ``path`` when the block ends without an exception.

    ``protected`` files (the inputs) are never replaced: `InputError` when a result would take the place of one.
    """
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
    files = sorted(temporary.iterdir(), key=lambda file: file.name == RESULT_FILES[0])  # the report comes last
    for file in files:
        if os.path.realpath(folder / file.name) in inputs:
            raise InputError(f"{folder / file.name} is an input and would be replaced: choose another --output-dir")
    for file in files:
        if file.suffix == ".gpkg":
            remove_old_journal(str(folder / file.name))
        os.replace(file, folder / file.name)
