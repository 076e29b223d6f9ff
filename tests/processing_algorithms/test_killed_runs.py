"""Runs that are ended at any moment leave nothing half-written; `killed_runs.py` does it to all that writes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from killed_runs import writers
from long_tests import mark_beyond

from hrsi.processing_algorithms import REGISTRY

ROOT = Path(__file__).resolve().parents[2]


def test_every_algorithm_is_among_the_writers() -> None:
    named = {writer.algorithm for writer in writers()}
    assert named == set(REGISTRY)
    assert {writer.how for writer in writers() if writer.algorithm == "adjust"} >= {
        "copy",
        "in-place",
        "vrt",
        "sidecar",
    }


@pytest.mark.skipif(sys.platform == "win32", reason="forks")
@pytest.mark.parametrize(
    ("kills", "names"),
    mark_beyond(0, "killed", [(9, ["fit-rpc"]), (9, ["adjust in-place", "fit-rpc", "orthorectify"])]),
)
def test_ended_at_any_moment(kills: int, names: list[str]) -> None:
    """A process of its own, because it forks: what writes in place, one that appears at once, one of separate files."""
    command = [sys.executable, str(ROOT / "tests" / "killed_runs.py"), str(kills), "5", *names]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")  # a process that forks has no others
    done = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False, env=os.environ | threads)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "runs ended, 0 with any fault" in done.stdout
    assert all(word in done.stdout for word in ("SIGKILL -9", "SIGTERM 143", "SIGINT 130"))
