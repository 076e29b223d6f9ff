"""Files of arrays by name (``.npz``), which `numpy.load` reads: uncompressed, and nothing in them is executed."""

import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from .safety.replacing import replacing

#: What reading a damaged file raises.
DAMAGED = (KeyError, ValueError, OSError, MemoryError, EOFError, zipfile.BadZipFile, NotImplementedError)


def write_arrays(path: str, arrays: Mapping[str, Any]) -> None:
    """Write arrays by name, in one step."""
    with replacing(path) as temporary:
        np.savez(temporary, **arrays)


def read_arrays(path: str) -> dict[str, np.ndarray]:
    """Return the arrays of a file; one of `DAMAGED` where they cannot be read.

    Nothing may take more memory than the file has bytes, so compressed ones are refused.
    """
    with zipfile.ZipFile(path) as archive:
        if any(part.compress_type != zipfile.ZIP_STORED for part in archive.infolist()):
            raise ValueError("it is compressed")
    with np.load(path, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}
