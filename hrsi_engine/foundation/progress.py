"""Progress callbacks as in GDAL: ``progress(fraction, message) -> bool``; False requests cancellation."""

from collections.abc import Callable

from .errors import Cancelled

Progress = Callable[[float, str], bool]


def silent(fraction: float, message: str = "") -> bool:
    """Ignore the progress and never cancel.

    fraction : share of the work that is done; message : what is being done
    Result: always True: continue.
    """
    return True


def advance(progress: Progress, fraction: float, message: str = "") -> None:
    """Report progress; raise `Cancelled` if the callback returns False.

    progress : the callback; fraction : share of the work that is done; message : what is being done
    Raises `Cancelled`: the callback returned False.
    """
    if progress(fraction, message) is False:
        raise Cancelled("cancelled; nothing was written")


def stage(progress: Progress, start: float, end: float) -> Progress:
    """Return a callback for a part of the work: its 0..1 is reported as ``start``..``end`` of ``progress``.

    progress : the callback of the complete work
    start, end : fractions of the complete work at which the part begins and ends, between 0 and 1
    Result: the callback of the part.
    """

    def report_part(fraction: float, message: str = "") -> bool:
        return progress(start + (end - start) * fraction, message)

    return report_part
