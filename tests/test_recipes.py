"""The recipes of docs/developing/heirs.md work: edits are made in a copy of the repository, their checks run there."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from long_tests import mark_beyond

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "developing/heirs.md"
LEFT_OUT = shutil.ignore_patterns(
    ".git", ".venv", "build", "dist", "pictures", "plugin", "benchmarks", ".*_cache", ".hypothesis", ".qgis-settings",
    "data", "*.svg",
)  # fmt: skip
BLOCK = re.compile(
    r"(?:^New file `(?P<file>[^`]+)`:\n\n)?^```(?P<kind>\w+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)


@dataclass
class Recipe:
    """A section of the page: new files, patches (file, lines), and what is run in the end."""

    title: str
    files: dict[str, str] = field(default_factory=dict)
    patches: list[tuple[str, list[str]]] = field(default_factory=list)
    checks: list[list[str]] = field(default_factory=list)


def read_recipes() -> list[Recipe]:
    """Return the recipes that the page holds, in its order."""
    recipes = []
    for section in re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        recipe = Recipe(section.partition("\n")[0])
        for block in BLOCK.finditer(section):
            text = block["text"]
            if block["file"]:
                recipe.files[block["file"]] = text
            elif block["kind"] == "diff":
                file, *lines = text.splitlines()
                recipe.patches.append((file, lines))
            elif block["kind"] == "python":
                recipe.checks.append([sys.executable, "-c", text])
            else:
                words = shlex.split(text)
                assert words[0] == ".venv/bin/python", f"{recipe.title}: run it by .venv/bin/python"
                recipe.checks.append([sys.executable, *words[1:]])
        recipes.append(recipe)
    return recipes


def apply_patch(root: Path, file: str, lines: list[str]) -> None:
    """Make a patch's edits; its old lines must stand in the file one after the other, once."""
    path = root / file
    old = "".join(f"{line[1:]}\n" for line in lines if not line.startswith("+"))
    new = "".join(f"{line[1:]}\n" for line in lines if not line.startswith("-"))
    text = path.read_text(encoding="utf-8")
    found = [match.start() for match in re.finditer(f"^{re.escape(old)}", text, re.MULTILINE)]
    assert len(found) == 1, f"{PAGE.name}: {len(found)} places in {file} have these lines, where one should:\n{old}"
    path.write_text(text[: found[0]] + new + text[found[0] + len(old) :], encoding="utf-8")


@pytest.mark.parametrize("recipe", mark_beyond(1, "thorough", read_recipes()), ids=lambda recipe: recipe.title)
def test_recipe(recipe: Recipe, tmp_path: Path) -> None:
    copy = tmp_path / "hrsi"  # beside which `import hrsi` finds it
    shutil.copytree(ROOT, copy, ignore=LEFT_OUT)
    for file, text in recipe.files.items():
        (copy / file).write_text(text, encoding="utf-8")
    for file, lines in recipe.patches:
        apply_patch(copy, file, lines)
    assert recipe.checks, f"{recipe.title}: nothing shows that it works"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTEST_ADDOPTS": "-p no:pytest_qgis -p no:cacheprovider"}
    for command in recipe.checks:
        run = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, check=False)
        assert run.returncode == 0, f"{recipe.title}: {' '.join(command)}\n{run.stdout[-3000:]}\n{run.stderr[-3000:]}"


def test_every_recipe_is_there() -> None:
    """Those that people ask for."""
    assert [recipe.title for recipe in read_recipes()] == [
        "A refinement model", "An RPC file format", "A format of matches", "An option", "A column of a layer",
        "A reason of the verdict",
    ]  # fmt: skip
