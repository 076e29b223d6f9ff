"""Translation of the plugin into the language of QGIS: the texts in the code are English, translations in ``i18n``.

`scripts/make_translations.py` collects the texts, which must be literals in the calls of `tr`.
"""

from pathlib import Path

from qgis.core import QgsApplication
from qgis.PyQt.QtCore import QCoreApplication, QTranslator

CONTEXT = "HRSI"
FOLDER = Path(__file__).resolve().parent / "i18n"


def tr(text: str) -> str:
    """Return a text of the plugin in the language of QGIS; in English if there is no translation."""
    return QCoreApplication.translate(CONTEXT, text)


def install_translator(language: str = "") -> QTranslator | None:
    """Install the translator of a language (by default that of QGIS); return None if there is no translation.

    The translator works only as long as a reference to it exists.
    """
    language = (language or QgsApplication.locale() or "en").partition("_")[0]
    translator = QTranslator()
    if not translator.load(str(FOLDER / f"hrsi_{language}.qm")):
        return None
    QCoreApplication.installTranslator(translator)
    return translator
