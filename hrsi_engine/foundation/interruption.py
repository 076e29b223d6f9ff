"""How a program ends when it is asked to (SIGINT, SIGTERM): one line, the exit code of that signal, no traceback.

Two ways, one after the other. While modules are loaded nothing is open, and an exception could come out of any half
loaded library as another one, or as a traceback: the program ends at once (`quit_on_signals`). While it works, the
signal is an exception that cleans up on its way (`signals_as_exceptions`). Where Python or GDAL swallow that exception,
as in callbacks, it is raised again; where a library's code does not come back to Python, a thread ends the program
without cleaning up, which the next run does, as after SIGKILL. Programs only, in their main thread: what is called from
elsewhere keeps its ways. While several files change together, signals wait, in any program (`holding_signals`).
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
    """How signals that end a program are repeated and held together."""

    again_s: float = threshold(0.05, "s", "time until an exception that was swallowed is raised again")
    same_signal_s: float = threshold(2.0, "s", "time in which further signals count as the same one")
    blocked_s: float = threshold(10.0, "s", "time that library code may continue before the program is ended at once")


class TerminationRequest(KeyboardInterrupt):
    """The process was asked to end (SIGTERM): it cleans up as it does when the user interrupts it."""


class _State:
    """Which signal has come, and when its exception was raised; None while it is still to be raised."""

    arrived = threading.Event()  # in Python: a handler has run
    number: int | None = None
    raised_at: float | None = None


def quit_on_signals() -> None:
    """End the process at once on these signals; for a program that starts or has done its work."""
    if threading.current_thread() is threading.main_thread():
        for number in _ENDINGS:
            if signal.getsignal(number) is not signal.SIG_IGN:  # a job in the background of a shell ignores SIGINT
                signal.signal(number, _quit)


@contextmanager
def quitting_on_signals() -> Iterator[None]:
    """End at once while this lasts, where `signals_as_exceptions` is in force: for loading modules."""
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
    """Raise KeyboardInterrupt or `TerminationRequest` in the main thread on these signals; as before when this ends."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _State.number = _State.raised_at = None
    _State.arrived.clear()
    before = {number: signal.getsignal(number) for number in _ENDINGS}
    hooks = sys.unraisablehook, sys.excepthook
    before = {number: handler for number, handler in before.items() if handler not in (signal.SIG_IGN, None)}

    def as_before() -> None:
        sys.unraisablehook, sys.excepthook = hooks
        for number, handler in before.items():
            signal.signal(number, handler)

    try:
        for number in before:
            signal.signal(number, _raise)
        sys.unraisablehook = lambda told: _raise_again() if _is_ours(told.exc_value) else hooks[0](told)
        sys.excepthook = lambda kind, error, trace: _raise_again() if _is_ours(error) else hooks[1](kind, error, trace)
        with _ending_blocked_work():
            yield
    finally:
        try:
            as_before()
        except KeyboardInterrupt:  # the signal comes now: it is raised once, so that this goes through
            as_before()
            raise


@contextmanager
def _ending_blocked_work() -> Iterator[None]:
    """End the process where its main thread stays in a library's code after a signal."""
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    before = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)

    def watch() -> None:
        with receiver:
            while number := receiver.recv(1):  # nothing when the sender is closed
                if number[0] in _ENDINGS and not _State.arrived.wait(PATIENCE.blocked_s):
                    _quit(number[0], None)

    threading.Thread(target=watch, name="hrsi-signals", daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        sender.close()


@contextmanager
def holding_signals() -> Iterator[None]:
    """Let signals wait until this ends: an exception between two steps would tear apart what belongs together."""
    if threading.current_thread() is not threading.main_thread():  # signals reach the main thread only
        yield
        return
    came: list[int] = []

    def hold(number: int, _frame: FrameType | None) -> None:
        came.append(number)
        _State.arrived.set()

    before = {number: signal.getsignal(number) for number in _ENDINGS}
    before = {number: handler for number, handler in before.items() if handler is not None}  # None: not Python's
    for number in before:
        signal.signal(number, hold)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


def ending() -> tuple[int, str] | None:
    """Return exit code and line of the signal that has come since work began; None where none has."""
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
    if time.monotonic() > _State.raised_at + PATIENCE.same_signal_s:  # what cleans up takes too long for the user
        _quit(number, _frame)


def _raise_again() -> None:
    """Raise the exception of the signal again, soon, in the main thread, from where it was lost."""
    _State.raised_at = None
    again = threading.Timer(PATIENCE.again_s, signal.raise_signal, [_State.number])
    again.daemon = True
    again.start()


def _quit(number: int, _frame: FrameType | None) -> None:
    _State.number = number
    told = ending()
    code, line = told if told is not None else (1, "")
    with suppress(OSError):
        os.write(2, f"ERROR: {line}\n".encode())
    os._exit(code)
