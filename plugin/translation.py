"""The plugin in the language of QGIS: texts are English in the code, and come translated from ``i18n``.

`scripts/make_translations.py` collects them; what it finds must be literal text where `tr` is called.
"""

from pathlib import Path

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QCoreApplication, QTranslator

CONTEXT = "HRSI"
FOLDER = Path(__file__).resolve().parent / "i18n"


def tr(text: str) -> str:
    """Return a text of the plugin in the language of QGIS; English where there is no translation."""
    return QCoreApplication.translate(CONTEXT, text)


def install_translator(language: str = "") -> QTranslator | None:
    """Translate from now on to a language (by default that of QGIS); None where there is no such translation.

    The translator works as long as it is kept.
    """
    language = (language or QgsApplication.locale() or "en").partition("_")[0]
    translator = QTranslator()
    if not translator.load(str(FOLDER / f"hrsi_{language}.qm")):
        return None
    QCoreApplication.installTranslator(translator)
    return translator
