"""The Processing provider ``hrsi``: one QGIS algorithm for each declared algorithm, and models of them.

Layers are converted to files in `prepareAlgorithm`, in the main thread; the engine then runs in the background thread
of `processAlgorithm` and uses no QGIS object except the feedback.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from qgis.core import (
    Qgis,
    QgsMessageLog,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingModelAlgorithm,
    QgsProcessingOutputMultipleLayers,
    QgsProcessingProvider,
)
from qgis.PyQt.QtGui import QIcon

from ..hrsi_engine.foundation.errors import Cancelled, HrsiError, MissingPackageError
from ..hrsi_engine.foundation.reasons import Level
from ..processing_algorithms.interface.declare import Algorithm, Context, Report, spell_arguments
from ..processing_algorithms.interface.options import check_options
from .background_task import in_main_thread, run_apart
from .dependencies import missing_package_message
from .help import help_url, short_help
from .icons import icon_path
from .parameters import (
    NO_THREADING,
    OPTIONAL,
    SHORT_DIALOG,
    Reading,
    definition,
    field_choosers,
    label_of,
    option_value,
)
from .results import (
    collect_results,
    drop_unlistable_outputs,
    headline,
    load_sources,
    output_definitions,
    show_in_message_bar,
    show_layers,
    write_folder_layers,
)
from .translation import tr

QUICK_LOOK_SOURCE = "block.gpkg|layername=images"  # of algorithms that adjust a block
REMAINING_FROM, REMAINING_EVERY_S = 0.1, 5.0  # share of the work, and time, from which the remaining time is shown
ENGINE_SHARE = 0.85  # of the time of a run, if quick-looks are made after it
STEP_FEEDBACK = "QgsProcessingMultiStepFeedback"  # class in C++ of the feedback of a step of a model


class PluginAlgorithm(QgsProcessingAlgorithm):
    """A declared algorithm in the Processing toolbox."""

    def __init__(self, declaration: Algorithm) -> None:
        super().__init__()
        self.declaration = declaration
        self._options: dict[str, Any] = {}
        self._report: Report = {}

    def createInstance(self) -> PluginAlgorithm:
        return PluginAlgorithm(self.declaration)

    def name(self) -> str:
        """Return the id within the provider: the declared name without hyphens, which QGIS does not allow."""
        return self.declaration.name.replace("-", "")

    def displayName(self) -> str:
        return tr(self.declaration.title)

    def group(self) -> str:
        return tr(self.declaration.group)

    def groupId(self) -> str:
        return "".join(filter(str.isalnum, self.declaration.group.lower()))

    def tags(self) -> list[str]:
        return ["hrsi", "rpc", "satellite", *self.declaration.name.split("-")]

    def shortDescription(self) -> str:
        return tr(self.declaration.summary)

    def helpUrl(self) -> str:
        return help_url(self.declaration)

    def shortHelpString(self) -> str:
        return short_help(self.declaration)

    def icon(self) -> QIcon:
        return QIcon(self.svgIconPath())

    def svgIconPath(self) -> str:
        return str(icon_path(self.declaration.name))

    def createCustomParametersWidget(self, parent: Any = None) -> Any:
        """Return the dialog of an algorithm with many parameters; None: that of QGIS."""
        from .dialog import GroupedDialog  # there is no GUI in qgis_process

        return GroupedDialog(self, parent=parent) if len(self.declaration.params) > SHORT_DIALOG else None

    def initAlgorithm(self, configuration: dict[str, Any] | None = None) -> None:
        for param in self.declaration.params:
            self.addParameter(definition(param, self.declaration.params))
            for chooser in field_choosers(param).values():
                self.addParameter(chooser)
        for output in output_definitions(self.declaration):
            self.addOutput(output)

    @in_main_thread
    def prepareAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> bool:
        reading = Reading(self, parameters, context, feedback)
        self._options = {param.key: option_value(param, reading) for param in self.declaration.params}
        return True

    def processAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, Any]:
        """Run the engine; return an empty result if the user has cancelled."""
        is_given_up = threading.Event()  # the engine may still compute, but not reach the feedback

        def log(message: str) -> None:
            if not is_given_up.is_set():
                feedback.pushInfo(self._name_options(message))

        # A step of a model shows no layers: the model has outputs of its own
        is_shown = context.project() is not None and feedback.metaObject().className() != STEP_FEEDBACK
        makes_quick_looks = bool(
            is_shown and QUICK_LOOK_SOURCE in self.declaration.layers and self._options["output_dir"]
        )
        told = Context(progress_to(feedback, is_given_up, ENGINE_SHARE if makes_quick_looks else 1.0), log)
        try:  # errors become one line, unexpected ones keep their traceback
            options = check_options(self.declaration, self._options)
            report = run_apart(lambda: self.declaration.execute(options, told), feedback.isCanceled)
        except Cancelled:
            is_given_up.set()
            feedback.pushInfo(tr("Cancelled; nothing was written"))
            return {}
        except (MissingPackageError, ImportError) as error:
            from .package_offer import offer_packages  # there is no GUI in qgis_process

            missing = missing_package_message(error)
            offer_packages()
            if missing is None:
                raise
            raise QgsProcessingException(missing) from error
        except (HrsiError, OSError) as error:
            raise QgsProcessingException(self._name_options(str(error))) from None
        feedback.pushConsoleInfo(keep_columns(self._name_options(self.declaration.summarise(report))))
        if unsolved := report.get("unsolved"):
            feedback.reportError(self._name_options(unsolved))
        if verdict := report.get("verdict"):
            told_verdict = self._name_options(headline(verdict))
            if verdict["level"] == Level.UNUSABLE.label:
                feedback.reportError(told_verdict, fatalError=False)  # so that it is shown as a failure
            elif verdict["level"] == Level.DOUBTFUL.label:
                feedback.pushWarning(told_verdict)
        self._report = report
        if makes_quick_looks:
            from ..processing_algorithms.files.result_folder import write_quick_looks

            with suppress(HrsiError, OSError):  # the result itself is written
                run_apart(lambda: write_quick_looks(report, self._options["output_dir"]))
        show_layers(self.declaration, self._options, report, context)
        if "map" in report and is_shown:
            group = f"HRSI {self.displayName()}: {Path(self._options['folder']).resolve().name}"
            with suppress(HrsiError, OSError):  # the project file is written
                load_sources(run_apart(lambda: write_folder_layers(report)), group, context, report["map"]["dems"])
        return drop_unlistable_outputs(collect_results(self.declaration, self._options, report), feedback)

    @in_main_thread
    def postProcessAlgorithm(self, context: QgsProcessingContext, feedback: QgsProcessingFeedback) -> dict[str, Any]:
        """Show the verdict in the message bar above the map."""
        if verdict := self._report.get("verdict"):
            show_in_message_bar(verdict, self.displayName(), self._name_options)
        return {}

    def _name_options(self, message: str) -> str:
        """Return a message with its arguments replaced by the labels of the dialog."""
        return spell_arguments(message, self.declaration.params, label_of)


def progress_to(
    feedback: QgsProcessingFeedback, is_given_up: threading.Event, engine_share: float = 1.0
) -> Callable[[float, str], bool]:
    """Return the engine's progress callback for a QGIS feedback: it returns False if the user has cancelled.

    ``engine_share`` is the share of the complete work after which the engine has ended. From the first tenth on, the
    text above the progress bar has the time that remains at the present average speed.
    """
    began_s, shown, told_s, done = time.monotonic(), "", -math.inf, 0.0

    def progress(fraction: float, message: str = "") -> bool:
        nonlocal shown, told_s, done
        if is_given_up.is_set():
            return False
        # An adjustment with further iterations begins its part again
        done = fraction = max(done, engine_share * fraction)
        feedback.setProgress(100.0 * fraction)
        passed_s = time.monotonic() - began_s
        if (message and message != shown) or passed_s - told_s > REMAINING_EVERY_S:
            shown, told_s = message or shown, passed_s
            text = describe_remaining(fraction, passed_s) if passed_s > REMAINING_EVERY_S else ""
            feedback.setProgressText(f"{shown} {text}".strip())
        return not feedback.isCanceled()

    return progress


def describe_remaining(fraction: float, passed_s: float) -> str:
    """Return the remaining time as text, empty before the first tenth."""
    if not REMAINING_FROM < fraction < 1.0:
        return ""
    left_s = passed_s * (1.0 - fraction) / fraction
    return (
        tr("(about {} min left)").format(round(left_s / 60.0))
        if left_s > 90.0
        else (tr("(about {} s left)").format(max(round(left_s), 1)))
    )


def keep_columns(text: str) -> str:
    """Return a table whose columns remain aligned in the log, which joins spaces."""
    return text.replace("  ", "\u00a0\u00a0")


CHAINS = Path(__file__).resolve().parent / "models"  #: models, made by ``scripts/make_models.py``


def title_of(path: Path) -> str:
    """Return the English title of a model."""
    return path.stem.replace("_", " ").capitalize()


class PackageModel(QgsProcessingModelAlgorithm):
    """A model with a title, and its orthoimages as outputs; QGIS runs it: Python's GIL would freeze the window."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self.is_valid = bool(self.fromFile(str(path)))

    def createInstance(self) -> PackageModel:
        return PackageModel(self._path)

    def displayName(self) -> str:
        return tr(title_of(self._path))

    def flags(self) -> Any:
        """Return the flags without that of the main thread: all steps can run in the background."""
        return super().flags() & ~NO_THREADING

    def icon(self) -> QIcon:
        return QIcon(str(icon_path()))

    def initAlgorithm(self, configuration: dict[str, Any] | None = None) -> None:
        super().initAlgorithm(configuration or {})
        for param in self.destinationParameterDefinitions():  # without a folder, a temporary one is used
            param.setFlags(param.flags() | OPTIONAL)
        self.addOutput(QgsProcessingOutputMultipleLayers("ORTHOIMAGES", tr("Orthoimages")))

    def prepareAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> bool:
        self._folders = {name: str(value) for name, value in parameters.items() if name.endswith(":FOLDER")}
        return True

    def postProcessAlgorithm(self, context: QgsProcessingContext, feedback: QgsProcessingFeedback) -> dict[str, Any]:
        """Return the results with the orthoimages, if their folder was given; empty: the results of the model."""
        folder = self._folders.get("orthorectify:FOLDER", "")
        made = [str(path.resolve()) for path in sorted(Path(folder).glob("*_ortho.tif"))] if folder else []
        return self._folders | {"ORTHOIMAGES": made} if made else {}


class HrsiProvider(QgsProcessingProvider):
    """Group *HRSI* of the Processing toolbox: the declared algorithms, and models of them.

    ``declarations`` are the algorithms by name; None uses HRSI's own registry.
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
        """Add all declared algorithms; without NumPy there are none, and the log has the command to install it."""
        try:
            from ..processing_algorithms import REGISTRY
        except ImportError as error:
            QgsMessageLog.logMessage(missing_package_message(error) or str(error), "HRSI", Qgis.MessageLevel.Critical)
            return
        for declaration in (REGISTRY if self._declarations is None else self._declarations).values():
            self.addAlgorithm(PluginAlgorithm(declaration))
        if self._declarations is None:
            for model in map(PackageModel, sorted(CHAINS.glob("*.model3"))):
                if model.is_valid:
                    self.addAlgorithm(model)
