"""Make the models that the QGIS plugin brings: ``python scripts/make_models.py [FOLDER]``, by default plugin/models.

A model is a file of QGIS; it is made here, so that it names the algorithms and options that there are.
"""

import os
import sys
from pathlib import Path

os.environ["QT_HASH_SEED"] = "0"  # the same model is the same file; Qt reads it when it is loaded

from qgis.core import (
    QgsApplication,
    QgsProcessing,
    QgsProcessingModelAlgorithm,
    QgsProcessingModelChildAlgorithm,
    QgsProcessingModelChildParameterSource,
    QgsProcessingModelOutput,
    QgsProcessingModelParameter,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterRasterLayer,
)
from qgis.PyQt.QtCore import QPointF

ROOT = Path(__file__).resolve().parents[1]
NAME = "triangulate_to_orthoimages"
HELP = (
    "Triangulates a block, makes its surface model, true orthoimages and a mosaic on it, and measures how well the "
    "orthoimages fit one another. The DEM is used for tie points, and as the start of the surface model. Open it in "
    "the model designer to see and change the chain."
)
FOLDER = "FOLDER"  # of each step, as qgis_process names it: --triangulate:FOLDER=DIR
DATUMS = ["layer", "ellipsoidal", "egm96", "egm2008"]
Source = QgsProcessingModelChildParameterSource


def triangulate_to_orthoimages() -> QgsProcessingModelAlgorithm:
    """Return the chain from images to a surface model, checked orthoimages and a mosaic."""
    model = QgsProcessingModelAlgorithm("Triangulate, orthorectify, check", "Models")
    model.setName("triangulatetoorthoimages")  # the id; the plugin has a title for people
    inputs: list[QgsProcessingParameterDefinition] = [
        QgsProcessingParameterMultipleLayers("IMAGES", "Images with RPC", QgsProcessing.TypeRaster),
        QgsProcessingParameterFeatureSource("GCPS", "Ground points", [QgsProcessing.TypeVector], optional=True),
        QgsProcessingParameterFeatureSource("IMAGE_POINTS", "Image points", [QgsProcessing.TypeVector], optional=True),
        QgsProcessingParameterRasterLayer("DEM", "DEM"),
        QgsProcessingParameterEnum(
            "DEM_DATUM", "Heights of the DEM refer to", DATUMS, defaultValue="layer", usesStaticStrings=True
        ),
    ]
    for number, param in enumerate(inputs):
        place = QgsProcessingModelParameter(param.name())
        place.setPosition(QPointF(120.0, 60.0 + 90.0 * number))
        model.addModelParameter(param, place)
    model.setParameterOrder([param.name() for param in inputs])
    asked = {name: Source.fromModelParameter(name) for name in ("IMAGES", "GCPS", "IMAGE_POINTS", "DEM", "DEM_DATUM")}
    terrain = {"DEM": asked["DEM"], "DEM_DATUM": asked["DEM_DATUM"]}
    _add_step(model, "triangulate", asked, "Folder of the triangulation")
    refined = Source.fromChildOutput("triangulate", "IMAGES_MADE")
    adjusted = Source.fromChildOutput("triangulate", "OUTPUT_DIR")
    _add_step(model, "surfacemodel", {"RESULT": adjusted, **terrain}, "Folder of the surface model")
    surface = Source.fromChildOutput("surfacemodel", "MAP")
    products = {name: Source.fromStaticValue(True) for name in ("VISIBILITY", "MOSAIC")}
    datum = Source.fromStaticValue("ellipsoidal")
    on_surface = {"IMAGES": refined, "DEM": surface, "DEM_DATUM": datum, "FILL_GAPS": Source.fromStaticValue(20)}
    _add_step(model, "orthorectify", on_surface | products, "Folder of the orthoimages")
    made = Source.fromChildOutput("orthorectify", "IMAGES_MADE")
    _add_step(model, "orthocheck", {"IMAGES": made}, "Folder of the check of the orthoimages")
    model.setHelpContent({"ALG_DESC": HELP})
    return model


def _add_step(model: QgsProcessingModelAlgorithm, name: str, sources: dict[str, Source], title: str) -> None:
    """Add an algorithm of HRSI as a step; its output folder, by default a temporary one, is one of the model's."""
    step = QgsProcessingModelChildAlgorithm(f"hrsi:{name}")
    step.setChildId(name)
    step.setDescription(title)
    step.setPosition(QPointF(420.0 + 220.0 * len(model.childAlgorithms()), 160.0 + 60.0 * len(model.childAlgorithms())))
    for key, source in sources.items():
        step.addParameterSources(key, [source])
    output = QgsProcessingModelOutput(FOLDER, title)
    output.setChildId(name)
    output.setChildOutputName("OUTPUT_DIR")
    output.setDefaultValue(QgsProcessing.TEMPORARY_OUTPUT)
    step.setModelOutputs({FOLDER: output})
    model.addChildAlgorithm(step)


def main() -> int:
    """Write the models; return the exit code."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "plugin" / "models"
    folder.mkdir(parents=True, exist_ok=True)
    application = QgsApplication([], False)
    application.initQgis()
    sys.path.insert(0, str(Path(application.pkgDataPath()) / "python" / "plugins"))
    from hrsi.plugin.provider import HrsiProvider

    provider = HrsiProvider()
    application.processingRegistry().addProvider(provider)
    written = triangulate_to_orthoimages().toFile(str(folder / f"{NAME}.model3"))
    application.processingRegistry().removeProvider(provider)
    return 0 if written else 1


if __name__ == "__main__":
    sys.exit(main())
