"""The verdict on a result where people in QGIS see it: red or amber in the log, and in the message bar."""

from html import escape
from typing import Any

from qgis.core import Qgis, QgsProcessingFeedback
from qgis.utils import iface

from ..hrsi_engine.foundation.reasons import Level
from .translation import tr

LONG = {
    Level.OK.label: 8,
    Level.DOUBTFUL.label: 20,
    Level.UNUSABLE.label: 0,
}  #: seconds in the message bar; 0: it stays
SIGNAL = {
    Level.OK.label: Qgis.MessageLevel.Success,
    Level.DOUBTFUL.label: Qgis.MessageLevel.Warning,
    Level.UNUSABLE.label: Qgis.MessageLevel.Critical,
}


def headline(verdict: dict[str, Any]) -> str:
    """Return the verdict with its worst reason, on one line."""
    reasons = verdict["reasons"]
    if not reasons:
        return f"{tr('Verdict')}: {tr(verdict['level'])}. {verdict['sentence']}"
    more = " " + tr("({} more in the report)").format(len(reasons) - 1) if len(reasons) > 1 else ""
    return f"{tr('Verdict')}: {tr(verdict['level'])}. {reasons[0]['message']}; {reasons[0]['advice']}{more}"


def log_verdict(verdict: dict[str, Any], text: str, feedback: QgsProcessingFeedback) -> None:
    """Write the headline into the log, so that what cannot be used looks like a failure."""
    if verdict["level"] == Level.UNUSABLE.label:
        feedback.reportError(text, fatalError=False)
    elif verdict["level"] == Level.DOUBTFUL.label:
        feedback.pushWarning(text)


def show_in_message_bar(verdict: dict[str, Any], title: str, text: str) -> None:
    """Show the headline above the map, if there is a desktop; QGIS calls this in its main thread only.

    The bar takes texts for HTML, and ids of points may be anything.
    """
    if iface is not None:
        level = verdict["level"]
        iface.messageBar().pushMessage(title, escape(text, quote=False), SIGNAL[level], LONG[level])
