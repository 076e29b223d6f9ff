"""Objects laid down in files for workers on other machines: parts of a block, read again when a worker was lost."""

from __future__ import annotations

import hashlib
import os
import pickle  # nosec B403 - only what this run wrote is read, by its hash
from dataclasses import dataclass
from typing import Any

from ...foundation.errors import InputError
from ..opening.datasets import check_advice
from ..opening.virtual_files import VIRTUAL, read_fresh, write_virtual
from .replacing import replacing


class FileDeposit:
    """A folder of pickled objects that workers see under the same path; made with the first.

    Parameters
    ----------
    folder : str
        On a disk that all see, or in an object store (``/vsis3/…``).
    """

    def __init__(self, folder: str) -> None:
        self._folder = folder if folder.startswith(VIRTUAL) else os.path.abspath(folder)
        self._count = 0

    def put(self, name: str, value: Any) -> Deposited:
        """Keep an object.

        Parameters
        ----------
        name : str
            Begins the file's name; the file is a new one every time, as calls that need the old one may come again.
        value : object
            Anything that can be pickled.

        Returns
        -------
        Deposited
            Returns it in any process, from these very bytes only.
        """
        self._count += 1
        path = os.path.join(self._folder, f"{name}_{self._count}.pickle")
        data = pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)
        if path.startswith(VIRTUAL):
            write_virtual(path, [data])
            return Deposited(path, hashlib.sha256(data).hexdigest())
        try:
            os.makedirs(self._folder, mode=0o700, exist_ok=True)
        except OSError as error:
            raise InputError(f"{self._folder}: cannot be made ({error.strerror}): choose another directory") from error
        with replacing(path) as temporary, open(temporary, "wb") as file:
            file.write(data)
        return Deposited(path, hashlib.sha256(data).hexdigest())


@dataclass(frozen=True)
class Deposited:
    """Returns an object that was laid down."""

    path: str
    sha256: str

    def __call__(self) -> Any:
        """Read it; raise `InputError` where the file is not there, or is another one than was laid down."""
        data = read_fresh(self.path) if self.path.startswith(VIRTUAL) else _read(self.path)
        if data is None:
            raise InputError(f"{self.path}: part of the block cannot be read: {check_advice(self.path)}")
        if hashlib.sha256(data).hexdigest() != self.sha256:
            raise InputError(f"{self.path}: part of the block was changed by another program: run again")
        return pickle.loads(data)  # noqa: S301  # nosec B301 - the bytes that this run wrote


def _read(path: str) -> bytes:
    try:
        with open(path, "rb") as file:
            return file.read()
    except OSError as error:
        raise InputError(f"{path}: part of the block cannot be read ({error.strerror})") from None
