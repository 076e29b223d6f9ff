"""Results of finished parts of a long run, one file each, so that a run that was stopped continues."""

import io
import os
import re
import zipfile
from pathlib import Path

import numpy as np

from ...foundation.errors import InputError
from ..opening.budgets import require_size
from ..opening.virtual_files import VIRTUAL, list_virtual, read_virtual, write_virtual
from .leftovers import sweep
from .replacing import replacing

_KEY = re.compile(r"[A-Za-z0-9_.-]+")


class PartStore:
    """A folder of finished parts, made with the first: ``KEY.npz`` each. A file appears whole or not at all.

    It is on the disk, or in one of GDAL's virtual file systems that takes files (``/vsis3/bucket/run``).
    """

    def __init__(self, folder: str) -> None:
        self.is_virtual = folder.startswith(VIRTUAL)
        self.folder = Path(folder)
        if not self.is_virtual:
            sweep(folder)

    def __len__(self) -> int:
        try:
            names = list_virtual(str(self.folder)) if self.is_virtual else os.listdir(self.folder)
        except OSError:  # not there yet, or never: `save` tells
            return 0
        return sum(name.endswith(".npz") for name in names)

    def load(self, key: str) -> dict[str, np.ndarray] | None:
        """Return the stored result of a key; None where the file is missing or damaged."""
        path = str(self._path(key))
        try:
            require_size(path, "result")
            content = io.BytesIO(read_virtual(path) or b"") if self.is_virtual else path
            with np.load(content, allow_pickle=False) as file:
                if any(part.compress_type != zipfile.ZIP_STORED for part in file.zip.infolist()):
                    return None  # `save` compresses nothing, so that nothing can unfold
                return {name: file[name] for name in file.files}
        except Exception:  # whatever zipfile, NumPy and the decoders raise of bytes that nobody wrote
            return None

    def save(self, key: str, result: dict[str, np.ndarray]) -> None:
        """Keep a result under a key; raise `InputError` or `OutputError` where the folder takes no files."""
        content = io.BytesIO()  # zipfile would complain of a full disk in its own way
        np.savez(content, **result)
        if self.is_virtual:
            write_virtual(str(self._path(key)), [content.getvalue()])
            return
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be made ({error.strerror}): choose another directory") from error
        with replacing(str(self._path(key))) as temporary, open(temporary, "wb") as file:
            file.write(content.getbuffer())

    def _path(self, key: str) -> Path:
        if not _KEY.fullmatch(key):
            raise ValueError(f"{key!r} is no key")
        return (self.folder if self.is_virtual else Path(os.path.realpath(self.folder))) / f"{key}.npz"
