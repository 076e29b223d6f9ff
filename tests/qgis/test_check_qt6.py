"""The static check for Qt 6, which `make lint` runs over the plugin, finds what it is there for."""

import subprocess
import sys
from pathlib import Path

from hrsi.tests.qgis.profile import REPOSITORY

CHECK = REPOSITORY / "scripts" / "check_qt6.py"


def check(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(CHECK), str(folder)], capture_output=True, text=True, check=False)


def test_unscoped_values_are_found(tmp_path: Path) -> None:
    (tmp_path / "old.py").write_text(
        "from qgis.core import QgsTask\nfrom qgis.PyQt.QtCore import Qt\n"
        "a, b = Qt.DisplayRole, QgsTask.CanCancel\nc, d = Qt.ItemDataRole.DisplayRole, QgsTask.Flag.CanCancel\n",
        encoding="utf-8",
    )
    finished = check(tmp_path)
    assert finished.returncode == 1
    assert [line.split(": ")[1] for line in finished.stdout.splitlines()] == ["Qt.DisplayRole", "QgsTask.CanCancel"]
