"""The plugin on Qt 6, in a process of its own (`qt6/exercise.py`); ``make qt6`` installs what it needs, and runs it."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.skipif(find_spec("PyQt6") is None, reason="PyQt6 (80 MB) is not installed: make qt6 installs and runs it")
def test_plugin_works_on_qt_6() -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:pytest_qgis", "tests/qt6/exercise.py"]
    environment = os.environ | {"QT_QPA_PLATFORM": "offscreen"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
