"""The batch dialog: a row that fails is named, the others are written and loaded, each from its own folder."""

import gc
import sys
from pathlib import Path

from qgis.core import QgsApplication, QgsProcessingContext, QgsProject
from qgis.PyQt.QtCore import QEvent, Qt
from qgis.PyQt.QtTest import QTest
from qgis.PyQt.QtWidgets import QTextEdit

from hrsi.tests.qgis.profile import REPOSITORY

HOBART = REPOSITORY / "examples" / "hobart"
GIVEN = {
    "IMAGES": [str(HOBART / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)],
    "GCPS": str(HOBART / "hobart_ground_points.csv"),
    "IMAGE_POINTS": str(HOBART / "hobart_image_points.csv"),
}  # fmt: skip


class ProgressTask:
    """Stands for the task that shows the progress: QGIS 3.22 forgets to end it, and then cannot be left."""

    def __init__(self, title: str) -> None:
        self.title = title

    def setProgress(self, percent: float) -> None:
        assert 0.0 <= percent <= 100.0


def test_batch(qgis_app, qgis_new_project, hrsi_provider, monkeypatch, tmp_path: Path) -> None:
    from processing.gui.BatchAlgorithmDialog import BatchAlgorithmDialog

    monkeypatch.setattr(sys.modules[BatchAlgorithmDialog.__module__], "QgsScopedProxyProgressTask", ProgressTask)
    dialog = BatchAlgorithmDialog(hrsi_provider.algorithm("adjust").create())
    panel = dialog.mainWidget()
    panel.addRow(1)
    columns = {name: column for column, name in panel.column_to_parameter_definition.items()}
    folders = [tmp_path / "wrong", tmp_path / "right"]
    for row, (folder, given) in enumerate(zip(folders, (GIVEN | {"GCPS": "no_such.csv"}, GIVEN), strict=True)):
        for name, value in given.items():
            panel.wrappers[row][columns[name]].setParameterValue(value, QgsProcessingContext())
        panel.tblParameters.cellWidget(row + 1, columns["OUTPUT_DIR"]).setValue(str(folder))
    QTest.mouseClick(dialog.runButton(), Qt.MouseButton.LeftButton)
    log = "\n".join(text.toPlainText() for text in dialog.findChildren(QTextEdit))
    assert "no_such.csv" in log and "1 executions failed" in log
    assert not folders[0].exists() and (folders[1] / "report.html").is_file()
    assert {"residuals_utm", "images"} <= {layer.name() for layer in QgsProject.instance().mapLayers().values()}
    panel.wrappers.clear()  # a chooser of fields holds the layer that it read, which must go before QGIS does
    dialog.close()
    dialog.deleteLater()
    QgsApplication.sendPostedEvents(dialog, QEvent.Type.DeferredDelete)
    gc.collect()
