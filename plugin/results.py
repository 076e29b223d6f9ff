"""What an algorithm gives back to QGIS: its files, and the layers that a map should show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from qgis.core import (
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingLayerPostProcessorInterface,
    QgsProcessingOutputDefinition,
    QgsProcessingOutputFile,
    QgsProcessingOutputHtml,
    QgsProcessingOutputString,
    QgsProcessingOutputVectorLayer,
    QgsProcessingUtils,
    QgsVectorLayer,
)
from qgis.PyQt import sip

from ..hrsi_engine.foundation.json_values import json_text
from ..processing_algorithms.interface.declare import Algorithm, Kind, Report

REPORT, REPORT_HTML, VERDICT = "REPORT", "REPORT_HTML", "VERDICT"


def output_definitions(declaration: Algorithm) -> list[QgsProcessingOutputDefinition]:
    """Return the outputs beside the output folder, which its parameter declares itself."""
    outputs: list[QgsProcessingOutputDefinition] = [QgsProcessingOutputFile(REPORT, "Report (JSON)")]
    if _writes_folder(declaration):
        outputs.append(QgsProcessingOutputHtml(REPORT_HTML, "Report (HTML)"))
    if any(param.key == "force_write" for param in declaration.params):
        outputs.append(QgsProcessingOutputString(VERDICT, "Verdict: ok, doubtful or unusable"))
    outputs += [QgsProcessingOutputVectorLayer(name.upper(), name) for name in map(layer_name, declaration.layers)]
    return outputs


def collect_results(declaration: Algorithm, options: dict[str, Any], report: Report) -> dict[str, Any]:
    """Return the result dictionary of a finished run.

    An algorithm that writes no report itself leaves it in QGIS's temporary folder.
    """
    folder = Path(options["output_dir"]) if options.get("output_dir") else None
    if folder is None or not (folder / "report.json").exists():
        path = Path(QgsProcessingUtils.generateTempFilename("report.json"))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json_text(report, indent=1), encoding="utf-8")
        return {REPORT: str(path)} | ({"OUTPUT_DIR": str(folder)} if folder else {})
    files = {REPORT: folder / "report.json", REPORT_HTML: folder / "report.html"}
    layers = {layer_name(source).upper(): source for source in _written_layers(declaration, options)}
    verdict = {VERDICT: report["verdict"]["level"]} if "verdict" in report else {}
    return {"OUTPUT_DIR": str(folder), **layers, **verdict} | {
        name: str(path) for name, path in files.items() if path.exists()
    }


def layer_name(source: str) -> str:
    """Return what a layer of the result is called: ``residuals_utm``."""
    return source.partition("|layername=")[2] or Path(source).stem


def _written_layers(declaration: Algorithm, options: dict[str, Any]) -> list[str]:
    """Return the sources of the declared layers that this run has written; it may have been asked for some only."""
    sources = [str(Path(options["output_dir"]) / layer) for layer in declaration.layers]
    return [source for source in sources if QgsVectorLayer(source, "", "ogr").isValid()]


def show_layers(declaration: Algorithm, options: dict[str, Any], context: QgsProcessingContext) -> None:
    """Ask QGIS to load the declared layers that this run has written, if there is a project to load them to."""
    if context.project() is None or not options.get("output_dir"):
        return
    for source in _written_layers(declaration, options):
        name = layer_name(source)
        details = QgsProcessingContext.LayerDetails(name, context.project(), name)
        details.setPostProcessor(_stored_style())
        context.addLayerToLoadOnCompletion(source, details)


class StoredStyle(QgsProcessingLayerPostProcessorInterface):
    """Draw a loaded layer with the style in its GeoPackage: Processing loads layers without it."""

    def postProcessLayer(
        self, layer: QgsVectorLayer, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> None:
        layer.loadDefaultStyle()
        layer.triggerRepaint()


_ALIVE: list[StoredStyle] = []  # QGIS keeps only the C++ half of a post-processor: the Python half is kept here


def _stored_style() -> StoredStyle:
    """Return a post-processor that lives until the Processing context, its owner, deletes it."""
    processor = StoredStyle()
    sip.transferto(processor, None)
    _ALIVE[:] = [other for other in _ALIVE if not sip.isdeleted(other)] + [processor]
    return processor


def _writes_folder(declaration: Algorithm) -> bool:
    return any(param.kind is Kind.OUTPUT_DIR for param in declaration.params)
