"""A signal ends the program though its main thread stays in a library's code, and is an exception where it does not."""

import signal
import subprocess
import sys
import time
from threading import Event
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from hrsi.hrsi_engine.foundation import interruption

PROGRAM = """
import hashlib, sys, time
from hrsi.hrsi_engine.foundation import interruption
from hrsi.hrsi_engine.foundation.interruption import holding_signals, signals_as_exceptions
object.__setattr__(interruption.PATIENCE, "blocked_s", 1.0)
with signals_as_exceptions():
    print("ready", flush=True)
    if sys.argv[1] == "in C":
        hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)  # minutes, without Python's lock
    elif sys.argv[1] == "held":
        with holding_signals():
            for _ in range(30):
                time.sleep(0.1)
        time.sleep(60)
    else:
        try:
            time.sleep(60)
        finally:
            time.sleep(2)
            print("cleaned", flush=True)
"""


@pytest.mark.parametrize(("work", "said"), [("in C", ""), ("held", ""), ("in Python", "cleaned")])
def test_a_signal_ends_what_is_under_way(work: str, said: str) -> None:
    program = subprocess.Popen([sys.executable, "-c", PROGRAM, work], text=True, stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE)  # fmt: skip
    assert program.stdout is not None and program.stdout.readline() == "ready\n"
    time.sleep(0.3)
    began = time.monotonic()
    program.send_signal(signal.SIGTERM)
    out, errors = program.communicate(timeout=50)
    assert time.monotonic() - began < 40.0
    assert out.strip() == said
    assert ("terminated; no half-written file is left" in errors) == (work == "in C")
    assert (program.returncode == 143) == (work == "in C")  # elsewhere the exception comes out of this program


@pytest.mark.parametrize(("later_s", "ends"), [(0.5, False), (10.0, True)])
def test_a_signal_that_comes_twice_is_one_and_a_repeated_one_ends_the_program(later_s, ends, monkeypatch) -> None:
    """A terminal and the parent process both send it; at once, the second would cut the cleaning off."""
    state = SimpleNamespace(arrived=Event(), number=signal.SIGINT, raised_at=time.monotonic() - later_s)
    monkeypatch.setattr(interruption, "_State", state)
    monkeypatch.setattr(interruption, "_quit", ending := Mock())
    interruption._raise(signal.SIGINT, None)
    assert ending.called is ends
