"""Progress in GDAL's manner: ``progress(fraction, message) -> bool``; False asks to stop."""

from collections.abc import Callable

from .errors import Cancelled

Progress = Callable[[float, str], bool]


def silent(fraction: float, message: str = "") -> bool:
    """Say nothing and never cancel.

    fraction : share of the work that is done; message : what is being done
    Result: always True: go on.
    """
    return True


def advance(progress: Progress, fraction: float, message: str = "") -> None:
    """Report progress; raise `Cancelled` when the callback answers False.

    progress : the callback; fraction : share of the work that is done; message : what is being done
    Raises `Cancelled`: the callback answers False.
    """
    if progress(fraction, message) is False:
        raise Cancelled("cancelled; nothing was written")


def stage(progress: Progress, start: float, end: float) -> Progress:
    """Return a callback whose 0..1 is the part ``start``..``end`` of ``progress``.

    progress : the callback of the whole
    start, end : where the part begins and ends in the whole, between 0 and 1
    Result: the callback of the part.
    """

    def report_part(fraction: float, message: str = "") -> bool:
        return progress(start + (end - start) * fraction, message)

    return report_part
