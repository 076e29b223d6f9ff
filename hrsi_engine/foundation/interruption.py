"""How a program ends on SIGINT or SIGTERM: one line, the exit code of the signal, no traceback.

There are two modes. While modules are loaded no file is open, and a half-loaded library could turn an exception into
another one or print a traceback: the program ends at once (`quit_on_signals`). During the work, the signal raises an
exception, so that files are cleaned up (`signals_as_exceptions`). If Python or GDAL swallow the exception, as in
callbacks, it is raised again. If library code does not return to Python, a thread ends the program without cleaning
up; the next run cleans up, as after SIGKILL. This is only for programs of HRSI, in their main thread; other callers
keep their handlers. While several files are replaced together, signals are deferred in any program (`holding_signals`).
"""

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from .thresholds import threshold, thresholds

_ENDINGS = {signal.SIGINT: (130, "interrupted"), signal.SIGTERM: (143, "terminated")}


@thresholds
class PATIENCE:
    """Times for repeating and merging signals that end a program."""

    again_s: float = threshold(
        0.1, "s", "time until something that did not succeed is tried again, or a line drawn again"
    )
    same_signal_s: float = threshold(2.0, "s", "time in which further signals count as the same one")
    blocked_s: float = threshold(10.0, "s", "time that library code may continue before the program is ended")


class TerminationRequest(KeyboardInterrupt):
    """Exception raised on SIGTERM; the program cleans up as after an interruption by the user."""


class _State:
    """The signal received, and the time its exception was raised; None while it is still to be raised."""

    arrived = threading.Event()  # set when a Python handler has run
    number: int | None = None
    raised_at: float | None = None


def quit_on_signals() -> None:
    """End the process at once on SIGINT and SIGTERM; for a program that is starting or has finished its work."""
    if threading.current_thread() is threading.main_thread():
        for number in _ENDINGS:
            if signal.getsignal(number) is not signal.SIG_IGN:  # shells start background jobs with SIGINT ignored
                signal.signal(number, _quit)


@contextmanager
def quitting_on_signals() -> Iterator[None]:
    """End the process at once inside this context, if `signals_as_exceptions` is active: for loading modules."""
    is_main = threading.current_thread() is threading.main_thread()
    ours = [number for number in _ENDINGS if is_main and signal.getsignal(number) is _raise]
    for number in ours:
        signal.signal(number, _quit)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, _raise)


@contextmanager
def signals_as_exceptions() -> Iterator[None]:
    """Raise KeyboardInterrupt or `TerminationRequest` in the main thread on signals; finally restore the handlers."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _State.number = _State.raised_at = None
    _State.arrived.clear()
    previous = {number: signal.getsignal(number) for number in _ENDINGS}
    hooks = sys.unraisablehook, sys.excepthook
    previous = {number: handler for number, handler in previous.items() if handler not in (signal.SIG_IGN, None)}

    def as_before() -> None:
        sys.unraisablehook, sys.excepthook = hooks
        for number, handler in previous.items():
            signal.signal(number, handler)

    try:
        for number in previous:
            signal.signal(number, _raise)
        sys.unraisablehook = lambda told: _raise_again() if _is_ours(told.exc_value) else hooks[0](told)
        sys.excepthook = lambda kind, error, trace: _raise_again() if _is_ours(error) else hooks[1](kind, error, trace)
        with _ending_blocked_work():
            yield
    finally:
        try:
            as_before()
        except KeyboardInterrupt:  # the signal arrives during the restoration: it is raised only once, so repeat
            as_before()
            raise


@contextmanager
def _ending_blocked_work() -> Iterator[None]:
    """End the process if its main thread remains in library code for `PATIENCE.blocked_s` after a signal."""
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    previous = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)

    def watch() -> None:
        with receiver:
            while number := receiver.recv(1):  # empty when the sender is closed
                if number[0] in _ENDINGS and not _State.arrived.wait(PATIENCE.blocked_s):
                    _quit(number[0], None)

    threading.Thread(target=watch, name="hrsi-signals", daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(previous)
        sender.close()


@contextmanager
def holding_signals() -> Iterator[None]:
    """Defer signals until this context ends: an exception between two steps could leave files that do not match."""
    if threading.current_thread() is not threading.main_thread():  # signals reach the main thread only
        yield
        return
    came: list[int] = []

    def hold(number: int, _frame: FrameType | None) -> None:
        came.append(number)
        _State.arrived.set()

    previous = {number: signal.getsignal(number) for number in _ENDINGS}
    previous = {
        number: handler for number, handler in previous.items() if handler is not None
    }  # None: not set by Python
    for number in previous:
        signal.signal(number, hold)
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


def ending() -> tuple[int, str] | None:
    """Return the exit code and the message for the signal received during the work; None if there was none."""
    if _State.number is None:
        return None
    code, word = _ENDINGS[signal.Signals(_State.number)]
    return code, f"{word}; no half-written file is left"


def _is_ours(error: BaseException | None) -> bool:
    return _State.number is not None and isinstance(error, KeyboardInterrupt)


def _raise(number: int, _frame: FrameType | None) -> None:
    _State.arrived.set()
    if _State.raised_at is None:
        _State.number, _State.raised_at = number, time.monotonic()
        raise TerminationRequest if number == signal.SIGTERM else KeyboardInterrupt
    if time.monotonic() > _State.raised_at + PATIENCE.same_signal_s:  # the user repeats the signal: end at once
        _quit(number, _frame)


def _raise_again() -> None:
    """Raise the lost exception of the signal again in the main thread, after `PATIENCE.again_s`."""
    _State.raised_at = None
    repeated = threading.Timer(PATIENCE.again_s, signal.raise_signal, [_State.number])
    repeated.daemon = True
    repeated.start()


def _quit(number: int, _frame: FrameType | None) -> None:
    _State.number = number
    message = ending()
    code, line = message if message is not None else (1, "")
    with suppress(OSError):
        os.write(2, f"ERROR: {line}\n".encode())
    os._exit(code)
