"""Errors that a caller can act on: each message says what is wrong, where, and what to do."""

from collections.abc import Iterable

IDS_NAMED = 8  # most ids in a message


def list_ids(ids: Iterable[object], most: int = IDS_NAMED) -> str:
    """Return ids for a message, a long list shortened."""
    listed = [str(item) for item in ids]
    return ", ".join(listed[:most]) + (f" … ({len(listed)} in all)" if len(listed) > most else "")


class HrsiError(Exception):
    """Base of every error that HRSI raises on purpose; ``exit_code`` is the command line's."""

    exit_code = 1


class InputError(HrsiError):
    """A file, layer, field, point or option is missing, unreadable or contradictory."""

    exit_code = 2


class SolveError(HrsiError):
    """The input was read, but the problem has no (unique) solution."""


class OutputError(HrsiError):
    """A result could not be written, or did not read back as it was written."""


class Cancelled(HrsiError):
    """The caller's progress callback answered False."""

    exit_code = 130
