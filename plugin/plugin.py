"""Entry point of the QGIS plugin: adds the Processing provider and the panel, and removes them."""

from functools import partial
from typing import Any

from qgis.core import Qgis, QgsApplication, QgsMessageLog
from qgis.PyQt.QtCore import QCoreApplication, Qt
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QAction

from .background_task import keep_threads
from .dependencies import MENU_ENTRY, missing_package_message, package_folder, use_packages
from .icons import icon_path
from .provider import HrsiProvider
from .results import Comparison, make_print_layout
from .translation import install_translator, tr


class HrsiPlugin:
    """The plugin object of QGIS; ``iface`` is None in ``qgis_process``."""

    def __init__(self, iface: Any) -> None:
        self.iface = iface
        self.provider: HrsiProvider | None = None
        self.dock: Any = None
        self._action: Any = None
        self._exit_guard: Any = None
        self._steps: Any = None
        self._recovery: Any = None
        self._actions: list[QAction] = []  # of the menu, without that of the panel
        self._translator = install_translator()

    def initProcessing(self) -> None:
        """Register the provider; ``qgis_process`` calls only this."""
        use_packages(package_folder(QgsApplication.qgisSettingsDirPath()))
        self.provider = HrsiProvider()
        QgsApplication.processingRegistry().addProvider(self.provider)
        self.provider.refreshAlgorithms()  # models can only be loaded when the algorithms of their steps are registered

    def initGui(self) -> None:
        """Register the provider in the desktop, and add the panel, which is hidden at first."""
        self.initProcessing()
        keep_threads()
        try:
            from .first_steps import FirstSteps, is_tour_wanted
            from .package_offer import PackageOffer, compile_in_background
            from .points_panel.dock import PointsDock
            from .points_panel.guards import ExitGuard, RecoveryOffer
        except ImportError as error:  # the provider has reported what is missing
            QgsMessageLog.logMessage(missing_package_message(error) or str(error), "HRSI", Qgis.MessageLevel.Critical)
            return
        self.dock = PointsDock(self.iface.mainWindow(), self.iface.mapCanvas())
        self.iface.addDockWidget(Qt.DockWidgetArea.BottomDockWidgetArea, self.dock)
        self.dock.open_as_window()
        self._action = self.dock.toggleViewAction()
        self._action.setIcon(QIcon(str(icon_path("measure-targets"))))
        self.iface.addPluginToMenu("HRSI", self._action)
        self.iface.addToolBarIcon(self._action)
        self._exit_guard = ExitGuard(self.dock)
        self.iface.registerApplicationExitBlocker(self._exit_guard)
        self._steps = FirstSteps(self.dock, "", self.iface.mapCanvas(), self.iface.mainWindow())
        self._recovery = RecoveryOffer(self.dock, self.iface.messageBar())
        for title, slot in (
            (tr("First steps"), self._steps.show_in_front),
            (tr(MENU_ENTRY), lambda: PackageOffer(self.iface.messageBar(), self.iface.mainWindow()).show()),
            (tr("Print layout"), lambda: self.iface.openLayoutDesigner(make_print_layout(self.iface.mapCanvas()))),
            (tr("Recover unsaved measurements"), partial(self._recovery.show, is_asked=True)),
        ):
            action = QAction(title, self.iface.mainWindow())
            action.triggered.connect(lambda _checked=False, slot=slot: slot())
            self.iface.addPluginToMenu("HRSI", action)
            self._actions.append(action)
        compare = QAction(tr("Compare before and after"), self.iface.mainWindow())
        compare.setCheckable(True)
        compare.setIcon(QIcon(str(icon_path("ortho-check"))))
        comparison = Comparison(compare)
        compare.toggled.connect(comparison.switch)
        self.iface.addPluginToMenu("HRSI", compare)
        self._actions.append(compare)
        compile_in_background(self.iface.mainWindow())
        self._recovery.show()
        if is_tour_wanted() and self.iface.mainWindow().isVisible():
            self._steps.show_in_front()
        elif is_tour_wanted():  # some window managers put it behind a main window that comes later
            self.iface.initializationCompleted.connect(self._steps.show_in_front)

    def unload(self) -> None:
        """Remove the provider, which the registry deletes, and the panel."""
        if self.provider is not None:
            QgsApplication.processingRegistry().removeProvider(self.provider)
            self.provider = None
        if self.dock is not None:
            self.iface.unregisterApplicationExitBlocker(self._exit_guard)
            for action in (self._action, *self._actions):
                self.iface.removePluginMenu("HRSI", action)
            self._steps.close()
            self._steps.deleteLater()
            self.iface.removeToolBarIcon(self._action)
            self.iface.removeDockWidget(self.dock)
            self.dock.shut_down()
            self.dock.deleteLater()
            self.dock = None
        if self._translator is not None:
            QCoreApplication.removeTranslator(self._translator)
