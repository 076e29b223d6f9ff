"""Pages of the algorithms for the documentation site, made from their declarations (an extension of Sphinx)."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.command_line.command_parser import sections, value_name
from hrsi.processing_algorithms.facade.calls import function_name
from hrsi.processing_algorithms.interface.declare import (
    POSITIONAL_KINDS,
    Algorithm,
    Kind,
    Param,
    option_label,
    spell_arguments,
    value_facts,
)

sys.path.insert(0, str(Path(__file__).parent))
from examples import COMMANDS, example_of  # beside this file

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FOLDER = "algorithms"
OTHER = "..."
#: A value of each kind for the example of a Python call.
EXAMPLES = {
    Kind.IMAGES: '["a.tif", "b.tif"]', Kind.RASTER: '"dem.tif"', Kind.POINTS: '"points.gpkg"',
    Kind.OUTPUT_DIR: '"result"',
}  # fmt: skip


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages before Sphinx reads the folder."""
    app.connect("builder-inited", lambda app: write_pages(Path(app.srcdir) / FOLDER))
    return {"parallel_read_safe": True}


def write_pages(folder: Path) -> None:
    """Write a page for each algorithm, and the index of them; files that say the same already are left alone."""
    folder.mkdir(exist_ok=True)
    pages = {f"{name}.md": algorithm_page(algorithm) for name, algorithm in REGISTRY.items()} | {
        "index.md": index_page()
    }
    for stale in {path.name for path in folder.glob("*.md")} - set(pages):
        (folder / stale).unlink()
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def index_page() -> str:
    """Return the page that lists the algorithms by their groups."""
    groups: dict[str, list[Algorithm]] = {}
    for algorithm in REGISTRY.values():
        groups.setdefault(algorithm.group, []).append(algorithm)
    parts = [
        "# Algorithms",
        "Every algorithm is a command of `hrsi`, an entry of the QGIS Processing toolbox and a Python call.",
    ]
    for group, members in groups.items():
        listed = [f"* [{member.name}]({member.name}.md): {member.summary}" for member in members]
        parts += [f"## {group}", "\n".join(listed)]
    contents = "\n".join(REGISTRY)
    parts.append(f"```{{toctree}}\n:hidden:\n\n{contents}\n```")
    return "\n\n".join(parts) + "\n"


def algorithm_page(algorithm: Algorithm) -> str:
    """Return the page of one algorithm in Markdown."""
    return (
        "\n\n".join([*_opening(algorithm), *_example(algorithm), *_options(algorithm), *_other_faces(algorithm)]) + "\n"
    )


def _example(algorithm: Algorithm) -> Iterator[str]:
    """Yield the example, where the page is one of HRSI's own algorithms."""
    if algorithm.name in COMMANDS:
        yield from example_of(algorithm.name)


def _opening(algorithm: Algorithm) -> Iterator[str]:
    words = [(value_name(param), param.kind) for param in algorithm.params if param.kind in POSITIONAL_KINDS]
    images = "".join(f" {word}{'...' if kind is Kind.IMAGES else ''}" for word, kind in words)
    yield f"# {algorithm.name}"
    yield f"**{algorithm.title}.** {algorithm.summary}."
    yield f"```\nhrsi {algorithm.name} [options]{images}\n```"
    yield _told(algorithm.help, algorithm)


def _options(algorithm: Algorithm) -> Iterator[str]:
    for title, params in sections(algorithm.params).items():
        if params:
            rows = [
                f"| {_spelling(param)} | {_cell(_told(param.help, algorithm))} "
                f"| {_cell('; '.join(value_facts(param)))} |"
                for param in params
            ]
            yield f"## {title[0].upper()}{title[1:]}"
            yield "\n".join(["| option | meaning | value |", "|---|---|---|", *rows])


def _spelling(param: Param) -> str:
    if param.kind in POSITIONAL_KINDS:
        return f"`{value_name(param)}`"
    if param.kind is Kind.FLAG:
        return f"`--{param.name}`, `--no-{param.name}`"
    return f"`--{param.name} {_cell(value_name(param))}`"


def _told(text: str, algorithm: Algorithm) -> str:
    """Return a text with the arguments that it names as options in code."""
    return spell_arguments(text, algorithm.params, lambda param: f"`{option_label(param)}`")


def _cell(text: str) -> str:
    """Return text for a cell of a table."""
    return text.replace("|", "\\|")


def _other_faces(algorithm: Algorithm) -> Iterator[str]:
    needed = [param for param in algorithm.params if param.required]
    yield "## In QGIS and Python"
    yield (
        f"Processing toolbox: HRSI, {algorithm.group}, *{algorithm.title}*. Its id for models, scripts and "
        f"`qgis_process` is `hrsi:{algorithm.name.replace('-', '')}`; options have the names of the command line in "
        "capitals, with `_` for `-`."
    )
    keywords = ", ".join(f"{param.key}={EXAMPLES.get(param.kind, OTHER)}" for param in needed)
    yield f"```python\nimport hrsi\n\nresult = hrsi.{function_name(algorithm.name)}({keywords})\n```"
    yield "[Python](../python.md) says what else may be given, and what a result has."
