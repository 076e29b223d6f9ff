"""Collect the plugin's texts into ``plugin/i18n/hrsi_*.ts``, and compile these where Qt's lrelease is at hand.

Texts are literals where the code calls ``tr`` or a function that translates for it, and what the declarations of the
algorithms say in dialogs. Translations that are there stay; what is gone from the code goes; what is new is marked as
unfinished. The compiled files are kept beside, so that neither the ZIP nor a checkout needs Qt's tools.
"""

import ast
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
PLUGIN, FOLDER = ROOT / "plugin", ROOT / "plugin" / "i18n"
CONTEXT = "HRSI"
#: Functions whose literal arguments (by place) are translated.
TRANSLATING = {"tr": (0,), "_action": (1, 2)}


def texts_in(path: Path) -> list[str]:
    """Return the literal texts that a module translates."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            name = node.func.id if isinstance(node.func, ast.Name) else ""
            for place in TRANSLATING.get(name, ()):
                given = node.args[place] if place < len(node.args) else None
                if isinstance(given, ast.Constant) and isinstance(given.value, str) and given.value:
                    found.append(given.value)
    return found


def declared_texts() -> list[str]:
    """Return the texts of dialogs, tables and the tour that stand as values and are translated when they are shown."""
    from hrsi.hrsi_engine.foundation.reasons import Level
    from hrsi.plugin import dependencies, first_steps, parameters, provider
    from hrsi.plugin.points_panel import layout, table_models
    from hrsi.processing_algorithms import REGISTRY

    found = [
        layout.EMPTY,
        layout.KIND_TIP,
        dependencies.MENU_ENTRY,
        *(text for step in first_steps.STEPS for text in step),
    ]
    tables = table_models.PointsModel, table_models.MeasurementsModel, table_models.ResidualsModel
    found += [*(title for table in tables for title in table.texts), *layout.PAGES]
    found += [level.label for level in Level]
    found += [provider.title_of(path) for path in sorted(provider.CHAINS.glob("*.model3"))]
    for declaration in REGISTRY.values():
        found += [declaration.title, declaration.group, declaration.summary, declaration.images_made or ""]
        found += [parameters.words_of(param) for param in declaration.params]
        found += [param.group for param in declaration.params]
    return [text for text in found if text]


def all_texts() -> list[str]:
    """Return every text of the plugin once, in order."""
    found = [text for path in sorted(PLUGIN.rglob("*.py")) for text in texts_in(path)]
    return sorted(set(found + declared_texts()))


def translations(path: Path) -> dict[str, str]:
    """Return the finished translations of a file."""
    if not path.exists():
        return {}
    found = {}
    for message in ElementTree.parse(path).getroot().iter("message"):
        translation = message.find("translation")
        if translation is not None and translation.get("type") != "unfinished" and translation.text:
            found[message.findtext("source", "")] = translation.text
    return found


def write(path: Path, language: str, texts: list[str], known: dict[str, str]) -> list[str]:
    """Write a language's file; return the texts without a translation."""
    root = ElementTree.Element("TS", version="2.1", language=language, sourcelanguage="en")
    context = ElementTree.SubElement(root, "context")
    ElementTree.SubElement(context, "name").text = CONTEXT
    for text in texts:
        message = ElementTree.SubElement(context, "message")
        ElementTree.SubElement(message, "source").text = text
        translation = ElementTree.SubElement(message, "translation")
        if text in known:
            translation.text = known[text]
        else:
            translation.set("type", "unfinished")
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding="unicode")
    path.write_text(f'<?xml version="1.0" encoding="utf-8"?>\n<!DOCTYPE TS>\n{body}\n', encoding="utf-8")
    return [text for text in texts if text not in known]


def main() -> int:
    texts, status = all_texts(), 0
    lrelease = next((tool for tool in ("lrelease", "lrelease-qt5", "lrelease6") if shutil.which(tool)), None)
    for path in sorted(FOLDER.glob("hrsi_*.ts")):
        language = path.stem.partition("_")[2]
        missing = write(path, language, texts, translations(path))
        print(f"{path.name}: {len(texts) - len(missing)} of {len(texts)} texts")
        for text in missing:
            print(f"  not translated: {text}")
        status |= bool(missing)
        if lrelease is None:
            print("  lrelease is missing (Debian: qttools5-dev-tools): the .qm file is as it was")
            continue
        subprocess.run(
            [lrelease, "-silent", "-nounfinished", str(path), "-qm", str(path.with_suffix(".qm"))], check=True
        )
    return status


if __name__ == "__main__":
    sys.exit(main())
