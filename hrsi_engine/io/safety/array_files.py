"""Files of arrays by name (``.npz``), which `numpy.load` reads: uncompressed, and without pickled objects.

`PartStore` stores results of finished parts of a long run, one file each, so that a stopped run continues.
"""

import io
import os
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..opening.datasets import VIRTUAL, list_virtual, read_virtual, write_virtual
from ..opening.files import require_size
from .replacing import replacing, sweep
from .transactions import make_folder

#: Errors that reading a damaged file raises.
DAMAGED = (KeyError, ValueError, OSError, MemoryError, EOFError, zipfile.BadZipFile, NotImplementedError)


def write_arrays(path: str, arrays: Mapping[str, Any]) -> None:
    """Write arrays by name, in one step; equal arrays give equal bytes, unlike `numpy.savez`, which writes the time."""
    with replacing(path) as temporary:
        _pack(temporary, arrays)


def _pack(file: str | BinaryIO, arrays: Mapping[str, Any]) -> None:
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.asanyarray(array), allow_pickle=False)


def read_arrays(file: str | BinaryIO) -> dict[str, np.ndarray]:
    """Return the arrays of a file; raise one of `DAMAGED` if they cannot be read.

    Memory must not exceed the size of the file, so compressed arrays are refused.
    """
    with zipfile.ZipFile(file) as archive:
        if any(part.compress_type != zipfile.ZIP_STORED for part in archive.infolist()):
            raise ValueError("it is compressed")
    if not isinstance(file, str):
        file.seek(0)
    with np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


class PartStore:
    """A folder of finished parts, created with the first: ``KEY.npz`` each. A file is written completely or not at all.

    It is on the disk, or in a writable virtual file system of GDAL (``/vsis3/bucket/run``).
    """

    def __init__(self, folder: str) -> None:
        self.is_virtual = folder.startswith(VIRTUAL)
        self.folder = Path(folder)
        if not self.is_virtual:
            sweep(folder)

    def __len__(self) -> int:
        try:
            names = list_virtual(str(self.folder)) if self.is_virtual else os.listdir(self.folder)
        except OSError:  # not created yet, or not possible: `save` reports
            return 0
        return sum(name.endswith(".npz") for name in names)

    def load(self, key: str) -> dict[str, np.ndarray] | None:
        """Return the stored result of a key; None if the file is missing or damaged."""
        path = str(self._path(key))
        try:
            require_size(path, "result")
            return read_arrays(io.BytesIO(read_virtual(path) or b"") if self.is_virtual else path)
        except Exception:  # any error of zipfile, NumPy and the decoders for damaged bytes
            return None

    def save(self, key: str, result: dict[str, np.ndarray]) -> None:
        """Store a result under a key; raise `InputError` or `OutputError` if the folder takes no files."""
        if self.is_virtual:
            content = io.BytesIO()
            _pack(content, result)
            write_virtual(str(self._path(key)), [content.getvalue()])
            return
        make_folder(str(self.folder))
        write_arrays(str(self._path(key)), result)

    def _path(self, key: str) -> Path:
        if not re.fullmatch(r"[A-Za-z0-9_.-]+", key):
            raise ValueError(f"{key!r} is no key")
        return (self.folder if self.is_virtual else Path(os.path.realpath(self.folder))) / f"{key}.npz"
