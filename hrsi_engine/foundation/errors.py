"""Errors that a caller can act on: each message states what is wrong, where, and what to do."""

from collections.abc import Iterable

IDS_NAMED = 8  # most ids in a message


def list_ids(ids: Iterable[object], largest: int = IDS_NAMED) -> str:
    """Join ids to a text for a message: the first ``largest`` of them and, if there are more, their total number."""
    names = [str(item) for item in ids]
    return ", ".join(names[:largest]) + (f" … ({len(names)} in all)" if len(names) > largest else "")


class HrsiError(Exception):
    """Base class of all errors that HRSI raises on purpose; ``exit_code`` is the exit code of the command line."""

    exit_code = 1


class InputError(HrsiError):
    """A file, layer, field, point or option is missing, unreadable or contradictory."""

    exit_code = 2


class MissingPackageError(InputError):
    """A Python package that this work needs cannot be imported.

    The class and its attribute are stable: the QGIS plugin offers to install ``package``. The message has the command
    for other programs.

    Parameters
    ----------
    message : str
        One line: what needs the package, and the command that installs it.
    package : str
        pip's name of the package, ``opencv-python-headless``.
    """

    def __init__(self, message: str, package: str = "") -> None:
        super().__init__(message)
        self.package = package


class SolveError(HrsiError):
    """The input was read, but the problem has no (unique) solution."""


class OutputError(HrsiError):
    """A result could not be written, or the file read back differs from what was written."""


class Cancelled(HrsiError):
    """The caller's progress callback returned False."""

    exit_code = 130
