"""The Processing provider ``hrsi``: one QGIS algorithm for every declared algorithm."""

from collections.abc import Mapping
from pathlib import Path

from qgis.core import Qgis, QgsMessageLog, QgsProcessingModelAlgorithm, QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from ..processing_algorithms.interface.declare import Algorithm
from .algorithm import PluginAlgorithm
from .dependencies import missing_package_message
from .icons import icon_path
from .translation import tr

CHAINS = Path(__file__).resolve().parent / "models"  #: chains of algorithms, made by ``scripts/make_models.py``


def title_of(path: Path) -> str:
    """Return the title of a chain, English."""
    return path.stem.replace("_", " ").capitalize()


class PackageModel(QgsProcessingModelAlgorithm):
    """A model with a title for people; its own name is its id."""

    def __init__(self, title: str) -> None:
        super().__init__()
        self._title = title

    def displayName(self) -> str:
        return tr(self._title)

    def icon(self) -> QIcon:
        return QIcon(str(icon_path()))


class HrsiProvider(QgsProcessingProvider):
    """Group *HRSI* of the Processing toolbox: the declared algorithms, and models that chain them.

    ``declarations`` are the algorithms to show by name; None takes HRSI's own registry.
    """

    def __init__(self, declarations: Mapping[str, Algorithm] | None = None) -> None:
        super().__init__()
        self._declarations = declarations

    def id(self) -> str:
        return "hrsi"

    def name(self) -> str:
        return "HRSI"

    def longName(self) -> str:
        return tr("HRSI: block adjustment of satellite images with RPCs")

    def icon(self) -> QIcon:
        return QIcon(self.svgIconPath())

    def svgIconPath(self) -> str:
        return str(icon_path())

    def loadAlgorithms(self) -> None:
        """Wrap every declaration; without NumPy there are none, and the log says what to install."""
        try:
            from ..processing_algorithms import REGISTRY
        except ImportError as error:
            QgsMessageLog.logMessage(missing_package_message(error) or str(error), "HRSI", Qgis.MessageLevel.Critical)
            return
        for declaration in (REGISTRY if self._declarations is None else self._declarations).values():
            self.addAlgorithm(PluginAlgorithm(declaration))
        if self._declarations is None:
            for path in sorted(CHAINS.glob("*.model3")):
                model = PackageModel(title_of(path))
                if model.fromFile(str(path)):
                    self.addAlgorithm(model)
