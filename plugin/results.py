"""Results of an algorithm for QGIS: its files, the layers for the map, and the verdict.

What to do with the layers of an adjustment: images before and after it in turn, and a print layout.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from itertools import count
from pathlib import Path
from textwrap import shorten
from typing import Any

from qgis.core import (
    Qgis,
    QgsLayerTreeLayer,
    QgsLayerTreeNode,
    QgsLayoutFrame,
    QgsLayoutItemAttributeTable,
    QgsLayoutItemLabel,
    QgsLayoutItemLegend,
    QgsLayoutItemMap,
    QgsLayoutItemScaleBar,
    QgsLayoutPoint,
    QgsLayoutSize,
    QgsMapLayer,
    QgsPrintLayout,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingLayerPostProcessorInterface,
    QgsProcessingOutputDefinition,
    QgsProcessingOutputFile,
    QgsProcessingOutputHtml,
    QgsProcessingOutputMultipleLayers,
    QgsProcessingOutputRasterLayer,
    QgsProcessingOutputString,
    QgsProcessingOutputVectorLayer,
    QgsProcessingUtils,
    QgsProject,
    QgsVectorLayer,
    QgsWkbTypes,
)
from qgis.PyQt import sip
from qgis.PyQt.QtCore import QObject, QTimer
from qgis.utils import iface

from ..hrsi_engine.foundation.json_values import json_text
from ..hrsi_engine.foundation.reasons import Level
from ..processing_algorithms.interface.declare import QUICK_LOOKS, STATES, Algorithm, Kind, Report
from .help import as_rich_text
from .translation import tr

BATCH_LISTS_REPORTS = 32800  #: version of QGIS since which a batch can list reports; QGIS 3.22 raises a TypeError
TEMPORARY = "OUTPUT_DIR"  #: name of a temporary folder in QGIS: that of the parameter
LOWEST = "hrsi/lowest"  #: property of a layer below all others of its group
REPORT, REPORT_HTML, VERDICT, IMAGES_MADE = "REPORT", "REPORT_HTML", "VERDICT", "IMAGES_MADE"
MAP = "MAP"  #: the mosaic, or the only raster that an algorithm makes: input of another step of a model


def output_definitions(declaration: Algorithm) -> list[QgsProcessingOutputDefinition]:
    """Return the outputs in addition to the output folder, which its parameter declares itself."""
    outputs: list[QgsProcessingOutputDefinition] = [QgsProcessingOutputFile(REPORT, tr("Report (JSON)"))]
    if any(param.kind is Kind.OUTPUT_DIR for param in declaration.params):
        outputs.append(QgsProcessingOutputHtml(REPORT_HTML, tr("Report (HTML)")))
    if any(param.key == "force_write" for param in declaration.params):
        outputs.append(QgsProcessingOutputString(VERDICT, tr("Verdict: ok, doubtful or unusable")))
    if declaration.images_made:
        outputs.append(QgsProcessingOutputMultipleLayers(IMAGES_MADE, tr(declaration.images_made)))
    if declaration.are_maps:
        outputs.append(QgsProcessingOutputRasterLayer(MAP, tr("Map of the complete area")))
    outputs += [QgsProcessingOutputVectorLayer(name.upper(), name) for name in map(layer_name, declaration.layers)]
    return outputs


def collect_results(declaration: Algorithm, options: dict[str, Any], report: Report) -> dict[str, Any]:
    """Return the result dictionary of a finished run.

    The report of an algorithm without output folder is written into QGIS's temporary folder.
    """
    made: dict[str, Any] = {IMAGES_MADE: list_written_images(report)} if declaration.images_made else {}
    if declaration.are_maps and (maps := _list_mosaics(report) or made[IMAGES_MADE])[1:] == []:
        made |= {MAP: maps[0]} if maps else {}
    folder = Path(options["output_dir"]) if options.get("output_dir") else None
    if folder is None or not (folder / "report.json").exists():
        path = Path(QgsProcessingUtils.generateTempFilename("report.json"))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json_text(report, indent=1), encoding="utf-8")
        return made | {REPORT: str(path)} | ({"OUTPUT_DIR": str(folder)} if folder else {})
    files = {REPORT: folder / "report.json", REPORT_HTML: folder / "report.html"}
    layers = {layer_name(source).upper(): source for source in _list_layers(declaration, options)}
    verdict = {VERDICT: report["verdict"]["level"]} if "verdict" in report else {}
    written = {name: str(path) for name, path in files.items() if path.exists()}
    return {"OUTPUT_DIR": str(folder), **layers, **verdict, **made} | written


def drop_unlistable_outputs(made: dict[str, Any], feedback: QgsProcessingFeedback) -> dict[str, Any]:
    """Return the results that the dialog can list: the batch dialog of an old QGIS fails for HTML reports."""
    fails = Qgis.QGIS_VERSION_INT < BATCH_LISTS_REPORTS and type(feedback).__name__ == "BatchFeedback"
    return {name: value for name, value in made.items() if not (fails and name == REPORT_HTML)}


def list_written_images(report: Report) -> list[str]:
    """Return the images that a run has written."""
    entries = images.values() if isinstance(images := report.get("images"), dict) else ()
    return [entry["output"] for entry in entries if isinstance(entry, dict) and entry.get("output")]


def _list_mosaics(report: Report) -> list[str]:
    return [report["mosaic"]["output"]] if "mosaic" in report else []


def layer_name(source: str) -> str:
    """Return the name of a layer of the result: ``residuals_utm``."""
    return source.partition("|layername=")[2] or Path(source).stem


def _list_layers(declaration: Algorithm, options: dict[str, Any]) -> list[str]:
    """Return the sources of those declared layers that this run has written; some may not be requested.

    OGR is asked: a layer of QGIS must not be made in this thread (`background_task`).
    """
    from ..processing_algorithms.files.result_folder import list_written_layers  # loads the engine

    return list_written_layers(options["output_dir"], declaration.layers)


def show_layers(declaration: Algorithm, options: dict[str, Any], report: Report, context: QgsProcessingContext) -> None:
    """Schedule loading of the layers of a run into the project, if there is one: in a group, images at the bottom.

    Images without map coordinates are not loaded: they would be far from all other layers.
    """
    if context.project() is None or not options.get("output_dir"):
        return
    folder, mosaics = Path(options["output_dir"]), _list_mosaics(report)
    group = f"HRSI {tr(declaration.title)}" + (f": {folder.name}" if folder.name != TEMPORARY else "")
    # Quick-looks after the adjustment come last, which are above the others
    looks = map(str, (folder / QUICK_LOOKS).glob("*.tif"))
    looks_in_order = sorted(looks, key=lambda path: path.endswith(f"_{STATE_AFTER}.tif"))
    rasters = list_written_images(report) if declaration.are_maps else looks_in_order
    load_sources([*rasters, *mosaics, *_list_layers(declaration, options)], group, context, lowest=mosaics)


def write_folder_layers(report: Report) -> list[str]:
    """Write layers of what a folder contains, before anything is adjusted, and return the sources for the map."""
    from ..processing_algorithms.files.result_folder import write_folder_map  # loads the engine

    place = Path(QgsProcessingUtils.generateTempFilename("map"))
    place.mkdir(parents=True, exist_ok=True)
    return write_folder_map(report["map"], str(place))


def load_sources(sources: Sequence[str], group: str, context: QgsProcessingContext, lowest: Sequence[str] = ()) -> None:
    """Schedule loading of files and layers into a group of the project, ``lowest`` below all others."""
    for source in sources:
        name = layer_name(source)
        details = QgsProcessingContext.LayerDetails(name, context.project(), name)
        # A post-processor that exists until its owner, the Processing context, deletes it
        processor = Placement(group, source in lowest)
        sip.transferto(processor, None)
        _ALIVE[:] = [other for other in _ALIVE if not sip.isdeleted(other)] + [processor]
        details.setPostProcessor(processor)
        context.addLayerToLoadOnCompletion(source, details)


class Placement(QgsProcessingLayerPostProcessorInterface):
    """Moves a loaded layer to the top of the run's group, and loads the style from its GeoPackage."""

    def __init__(self, group: str, is_lowest: bool) -> None:
        super().__init__()
        self._group, self._is_lowest = group, is_lowest

    def postProcessLayer(
        self, layer: QgsMapLayer, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> None:
        if isinstance(layer, QgsVectorLayer):
            layer.loadDefaultStyle()
        if self._is_lowest:
            layer.setCustomProperty(LOWEST, True)
        root = context.project().layerTreeRoot()
        group = root.findGroup(self._group) or root.insertGroup(0, self._group)
        node = root.findLayer(layer.id())
        if node is not None:  # at any place in the layer tree
            # Order: points above footprints above images, the latest of a kind on top; quick-looks "before" last
            nodes = group.children()
            below = (place for place, other in enumerate(nodes) if other is not node and _rank(other) >= _rank(node))
            group.insertChildNode(next(below, len(nodes)), node.clone())  # first: a layer goes with its last node
            node.parent().removeChildNode(node)
        layer.triggerRepaint()


def _rank(node: QgsLayerTreeNode) -> int:
    layer = node.layer() if isinstance(node, QgsLayerTreeLayer) else None
    if layer is not None and layer.customProperty(LOWEST):
        return 4
    if not isinstance(layer, QgsVectorLayer):
        return 3 if node.name().endswith(f"_{STATE_BEFORE}") else 2
    return int(layer.geometryType() == QgsWkbTypes.GeometryType.PolygonGeometry)


_ALIVE: list[Placement] = []  # QGIS keeps only the C++ half of a post-processor: the Python half is kept here


VERDICT_LETTERS = 140  # of a verdict in the message bar, which cuts longer texts
#: Level and duration (s) of the message by the level of a verdict; 0: until it is closed.
SIGNAL = {
    Level.OK.label: (Qgis.MessageLevel.Success, 8),
    Level.DOUBTFUL.label: (Qgis.MessageLevel.Warning, 20),
    Level.UNUSABLE.label: (Qgis.MessageLevel.Critical, 0),
}


def headline(verdict: dict[str, Any]) -> str:
    """Return the verdict with its worst reason, on one line."""
    reasons = verdict["reasons"]
    worst = f"{reasons[0]['message']}; {reasons[0]['advice']}" if reasons else verdict["sentence"]
    more = " " + tr("({} more in the report)").format(len(reasons) - 1) if len(reasons) > 1 else ""
    return f"{tr('Verdict')}: {tr(verdict['level'])}. {worst}{more}"


def show_in_message_bar(verdict: dict[str, Any], title: str, spell: Callable[[str], str]) -> None:
    """Show the verdict in the message bar, if there is a desktop, in one line with all reasons behind *Show more*.

    To be called in the main thread. ``spell`` replaces arguments by labels. The bar interprets texts as HTML, and ids
    of points may contain any characters: they are escaped.
    """
    if iface is None:
        return
    reasons = [f"{one['level']}: {one['message']} [{one['code']}]\n{one['advice']}" for one in verdict["reasons"]]
    worst = verdict["reasons"][0]["message"] if reasons else verdict["sentence"]
    line, more = f"{tr('Verdict')}: {tr(verdict['level'])}. {worst}", "\n\n".join([verdict["sentence"], *reasons])
    short = escape(shorten(spell(line), VERDICT_LETTERS, placeholder=" …"), quote=False)
    iface.messageBar().pushMessage(title, short, as_rich_text(spell(more)), *SIGNAL[verdict["level"]])


STATE_BEFORE, STATE_AFTER = STATES
FLICKER_MS = 800
#: Fields of the table of points, and their headings.
TABLE_FIELDS = {
    "id": "point",
    "role": "role",
    "residual_east_m": "dE m",
    "residual_north_m": "dN m",
    "residual_height_m": "dH m",
}
TITLE_PT, MAP_MM = 18, (180.0, 165.0)
TABLE_ROWS = 18  # of points, the first control and check points


class Comparison(QObject):
    """Shows the images before and after an adjustment in turn, as long as it is switched on."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.shown = STATE_AFTER
        self._timer = QTimer(self)
        self._timer.setInterval(FLICKER_MS)
        self._timer.timeout.connect(self.swap)

    def switch(self, is_on: bool) -> None:
        """Begin or end; at the end the images after the adjustment are shown."""
        self.shown = STATE_BEFORE
        (self._timer.start if is_on else self._timer.stop)()
        self.swap()

    def swap(self) -> None:
        """Show the quick-looks of the other state."""
        self.shown = STATE_AFTER if self.shown == STATE_BEFORE else STATE_BEFORE
        for node in QgsProject.instance().layerTreeRoot().findLayers():
            path = Path(node.layer().source() if node.layer() is not None else "")
            if path.parent.name == QUICK_LOOKS:
                node.setItemVisibilityChecked(path.stem.endswith(f"_{self.shown}"))


def make_print_layout(canvas: Any) -> QgsPrintLayout:
    """Add a layout to the project, A4: title, map as on the screen, legend, scale bar, and a table of the points."""
    project = QgsProject.instance()
    layout = QgsPrintLayout(project)
    layout.initializeDefaults()  # A4, landscape
    taken = {one.name() for one in project.layoutManager().layouts()}
    layout.setName(next(name for name in (f"HRSI {k}" for k in count(1)) if name not in taken))
    title = QgsLayoutItemLabel(layout)
    title.setText(f"{tr('Block adjustment')}: {Path(project.fileName()).stem or 'HRSI'}")
    font = title.font()
    font.setPointSize(TITLE_PT)
    title.setFont(font)
    _place(title, 10.0, 8.0, 190.0, 12.0)
    drawn = QgsLayoutItemMap(layout)
    _place(drawn, 10.0, 22.0, *MAP_MM)
    drawn.setLayers(canvas.layers())
    drawn.setExtent(canvas.extent())  # which changes the size; an item without extent cannot be zoomed
    drawn.attemptResize(QgsLayoutSize(*MAP_MM))
    drawn.zoomToExtent(canvas.extent())
    drawn.setFrameEnabled(True)
    scale_bar = QgsLayoutItemScaleBar(layout)
    scale_bar.setLinkedMap(drawn)
    scale_bar.applyDefaultSize()
    _place(scale_bar, 10.0, 190.0, 80.0, 12.0)
    layers = [one for one in project.mapLayers().values() if isinstance(one, QgsVectorLayer)]
    points = next((one for one in layers if set(TABLE_FIELDS) <= set(one.fields().names())), None)
    _place(_make_legend(drawn, points), 195.0, 20.0, 90.0, 70.0)
    if points is not None:
        _place(_make_table(layout, points), 195.0, 98.0, 92.0, 102.0)
    project.layoutManager().addLayout(layout)
    return layout


def _place(item: Any, x: float, y: float, width: float, height: float) -> None:
    """Add an item to its layout, at a position in mm from the upper left corner."""
    item.layout().addLayoutItem(item)
    item.attemptMove(QgsLayoutPoint(x, y))
    item.attemptResize(QgsLayoutSize(width, height))


def _make_legend(drawn: QgsLayoutItemMap, points: QgsVectorLayer | None) -> QgsLayoutItemLegend:
    """Return a legend of the points' layer and the footprints: other layers have the same symbols, images none."""
    legend = QgsLayoutItemLegend(drawn.layout())
    legend.setLinkedMap(drawn)
    legend.setAutoUpdateModel(False)
    polygons = QgsWkbTypes.GeometryType.PolygonGeometry
    for node in legend.model().rootGroup().findLayers():
        layer = node.layer()
        if layer is not points and not (isinstance(layer, QgsVectorLayer) and layer.geometryType() == polygons):
            node.parent().removeChildNode(node)
    return legend


def _make_table(layout: QgsPrintLayout, points: QgsVectorLayer) -> QgsLayoutFrame:
    """Return the frame of a table with the control and check points and their residuals."""
    table = QgsLayoutItemAttributeTable.create(layout)
    layout.addMultiFrame(table)
    table.setVectorLayer(points)
    table.setDisplayedFields(list(TABLE_FIELDS))
    columns = table.columns()
    for column, (field, heading) in zip(columns, TABLE_FIELDS.items(), strict=True):
        column.setHeading(heading)
        if field.endswith("_m"):
            column.setAttribute(f'format_number("{field}", 2)')
    table.setColumns(columns)
    table.setFeatureFilter("\"role\" IN ('gcp', 'check') AND \"residual_east_m\" IS NOT NULL")
    table.setFilterFeatures(True)
    table.setMaximumNumberOfFeatures(TABLE_ROWS)
    frame = QgsLayoutFrame(layout, table)
    table.addFrame(frame)
    return frame
