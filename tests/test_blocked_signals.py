"""A signal ends the program though its main thread stays in a library's code, and is an exception where it does not."""

import signal
import subprocess
import sys
import time

import pytest

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
