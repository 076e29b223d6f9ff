"""Fields of the layer of GCPs are chosen in the dialog: what the engine reads is what the chosen fields hold."""

import csv
from pathlib import Path

import pytest
from qgis.core import (
    QgsApplication,
    QgsFeature,
    QgsGeometry,
    QgsPoint,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingParameterField,
    QgsProject,
    QgsVectorFileWriter,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QEvent

from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.plugin.help import help_url
from hrsi.plugin.parameters import ADVANCED, OPTIONAL
from hrsi.plugin.provider import PluginAlgorithm
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.interface.declare import Kind

HOBART = Path(__file__).resolve().parents[2] / "examples" / "hobart"
CHOOSERS = ("GCPS_ID", "GCPS_HEIGHT", "GCPS_SIGMA_H", "GCPS_SIGMA_EAST", "GCPS_SIGMA_NORTH")
CHOSEN = dict(zip(CHOOSERS, ("nr", "hoehe", "sH", "sE", "sN"), strict=True))
READS_GCPS = [
    name for name, one in REGISTRY.items() if any(p.key == "gcps" and p.kind is Kind.POINTS for p in one.params)
]
POINTS = (("P7", 12.5, 0.1, 0.02, 0.05), ("P8", 13.25, 0.2, 0.03, 0.06))


@pytest.fixture
def memory(qgis_new_project) -> QgsVectorLayer:
    """Two points in memory with fields of other names, added to the project."""
    fields = "&".join(["field=nr:string", *(f"field={name}:double" for name in ("hoehe", "sH", "sE", "sN"))])
    layer = QgsVectorLayer(f"Point?crs=EPSG:4326&{fields}", "Survey", "memory")
    features = []
    for row, point in enumerate(POINTS):
        feature = QgsFeature(layer.fields())
        feature.setAttributes(list(point))
        feature.setGeometry(QgsGeometry(QgsPoint(147.3 + row, -42.9)))
        features.append(feature)
    assert layer.dataProvider().addFeatures(features)[0]
    QgsProject.instance().addMapLayer(layer)
    return layer


def as_layer(memory: QgsVectorLayer, kind: str, folder: Path) -> QgsVectorLayer:
    """Return the points as a layer of the project that is kept in a file of some kind."""
    if kind == "memory":
        return memory
    if kind.startswith("csv"):
        path = folder / "survey.csv"
        rows = [[*point, 147.3 + row, -42.9] for row, point in enumerate(POINTS)]
        with path.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([["nr", "hoehe", "sH", "sE", "sN", "lon", "lat"], *rows])
        geometry = "xField=lon&yField=lat&crs=EPSG:4326" if kind == "csv with geometry" else "geomType=none"
        uri, provider = (str(path), "ogr") if kind == "csv" else (f"file://{path}?type=csv&{geometry}", "delimitedtext")
        layer = QgsVectorLayer(uri, "survey", provider)
    else:
        options = QgsVectorFileWriter.SaveVectorOptions()
        options.driverName = {"gpkg": "GPKG", "shp": "ESRI Shapefile"}[kind]
        path = folder / f"survey.{kind}"
        QgsVectorFileWriter.writeAsVectorFormatV3(memory, str(path), QgsProject.instance().transformContext(), options)
        layer = QgsVectorLayer(str(path), "survey", "ogr")
    assert layer.isValid()
    QgsProject.instance().addMapLayer(layer)
    return layer


def require_points(spec: str) -> None:
    ground = read_points(spec, height_datum="ellipsoidal").ground
    found = [
        (name, round(xyz[2], 9), *(round(covariance[axis, axis] ** 0.5, 9) for axis in (2, 0, 1)))
        for name, xyz, covariance in zip(ground.ids.tolist(), ground.ground, ground.covariance_m2, strict=True)
    ]
    assert tuple(found) == POINTS


@pytest.mark.parametrize("kind", ["memory", "gpkg", "shp", "csv", "csv table", "csv with geometry"])
def test_layer_of_the_project(run_tiny, memory, tmp_path: Path, kind: str) -> None:
    require_points(run_tiny(GCPS=as_layer(memory, kind, tmp_path).id(), **CHOSEN)["gcps"])


def test_path_of_a_file(run_tiny, memory, tmp_path: Path) -> None:
    """As qgis_process and models name it; what is named behind the file stays."""
    path = as_layer(memory, "gpkg", tmp_path).source()
    require_points(run_tiny(GCPS=path, **CHOSEN)["gcps"])
    height = {name: field for name, field in CHOSEN.items() if name != "GCPS_ID"}
    require_points(run_tiny(GCPS=f"{path}|columns=id=nr", **height)["gcps"])
    assert run_tiny(GCPS=path)["gcps"] == path


def test_feature_id_as_id(run_tiny, memory, tmp_path: Path) -> None:
    """QGIS lists it among the fields of a GeoPackage."""
    layer = as_layer(memory, "gpkg", tmp_path)
    assert layer.fields().names()[0] == "fid"
    spec = run_tiny(GCPS=layer.id(), **CHOSEN | {"GCPS_ID": "fid"})["gcps"]
    assert read_points(spec, height_datum="ellipsoidal").ground.ids.tolist() == ["1", "2"]


def test_algorithms_that_read_gcps_have_choosers() -> None:
    assert READS_GCPS == ["triangulate", "adjust", "refine-rpc", "evaluate"]
    for name, declaration in REGISTRY.items():
        algorithm = PluginAlgorithm(declaration).create()
        found = {
            one.name(): one for one in algorithm.parameterDefinitions() if isinstance(one, QgsProcessingParameterField)
        }
        assert tuple(found) == (CHOOSERS if name in READS_GCPS else ())
        for one in found.values():
            assert one.parentLayerParameterName() == "GCPS" and one.flags() & OPTIONAL and one.flags() & ADVANCED
    page = Path(help_url(REGISTRY["adjust"]).removeprefix("file://")).read_text(encoding="utf-8")
    assert all(f"<td>{name}</td>" in page for name in CHOOSERS)


def test_dialog_lists_the_fields_of_the_layer(tiny_provider, memory, monkeypatch) -> None:
    """The choosers follow the layer, stand in one group, and hand on what is chosen."""
    from processing.gui import ParametersPanel

    from hrsi.plugin.dialog import GroupedDialog

    monkeypatch.setattr(ParametersPanel, "iface", None)  # the mock has no browser model
    dialog = GroupedDialog(tiny_provider.algorithms()[0].create())
    dialog.setParameters({"IMAGES": ["/data/a_RPC.TXT"]})
    wrappers = dialog.mainWidget().wrappers
    boxes = {name: wrappers[name].wrappedWidget() for name in CHOOSERS}
    assert {box.count() for box in boxes.values()} <= {0, 1}
    assert not set(CHOOSERS) & {name for name, value in dialog.createProcessingParameters().items() if value}
    wrappers["GCPS"].setParameterValue(memory.id(), QgsProcessingContext())
    for name, box in boxes.items():
        assert [box.itemText(k) for k in range(box.count())] == ["", "nr", "hoehe", "sH", "sE", "sN"]
        box.setCurrentText(CHOSEN[name])
    groups = {wrappers[name].wrappedWidget().parent().title() for name in CHOOSERS}
    assert groups == {"Fields of the GCPs"}
    given = dialog.createProcessingParameters()
    assert {name: given[name] for name in CHOOSERS} == CHOSEN
    dialog.deleteLater()
    QgsApplication.sendPostedEvents(dialog, QEvent.Type.DeferredDelete)  # before its algorithm goes


def test_run_and_its_message(qgis_processing, qgis_new_project, tmp_path: Path) -> None:
    """An adjustment with a chosen id, and the message of a field that the layer does not have."""
    table = (HOBART / "hobart_ground_points.csv").read_text(encoding="utf-8").replace("id,", "Punkt,", 1)
    path = tmp_path / "survey.csv"
    path.write_text(table, encoding="utf-8")
    layer = QgsVectorLayer(str(path), "survey", "ogr")
    QgsProject.instance().addMapLayer(layer)
    given = {
        "IMAGES": sorted(map(str, HOBART.glob("*_RPC.TXT"))), "GCPS": layer.id(), "HEIGHT_DATUM": "ellipsoidal",
        "IMAGE_POINTS": str(HOBART / "hobart_image_points.csv"), "GCP_IDS": "H003,H022,H024,H035,H048,H058",
        "OUTPUT_DIR": str(tmp_path / "out"), "REPORT": False,
    }  # fmt: skip
    algorithm, context = PluginAlgorithm(REGISTRY["adjust"]).create(), QgsProcessingContext()
    context.setProject(QgsProject.instance())
    feedback = QgsProcessingFeedback()
    made, ok = algorithm.run(given | {"GCPS_ID": "Punkt"}, context, feedback)
    assert ok and made["VERDICT"] in ("ok", "doubtful"), feedback.textLog()
    _made, ok = algorithm.create().run(given | {"GCPS_ID": "nummer", "OVERWRITE": True}, context, feedback)
    assert not ok and "survey.csv: has no field 'nummer'; its fields are Punkt, feature, lon" in feedback.textLog()
