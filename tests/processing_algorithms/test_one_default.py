"""An option has one default, for dataclass, declaration, command line, Python and panel; QGIS has a test of its own."""

import ast
import re
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest
import simulated_blocks as blocks
from parsed_sources import walk_sources

from hrsi.hrsi_engine.adjustment.options import AdjustOptions
from hrsi.hrsi_engine.foundation.options import inner_options_of, option_of
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.block_steps import plausibility
from hrsi.processing_algorithms.command_line.command_parser import algorithm_parser
from hrsi.processing_algorithms.interface.declare import (
    POSITIONAL_KINDS,
    Algorithm,
    Kind,
    fill_options,
    settings_of,
    spell_arguments,
    value_facts,
)
from hrsi.processing_algorithms.interface.options import check_options
from hrsi.processing_algorithms.point_session import MODEL
from hrsi.processing_algorithms.point_session import adjusting as panel
from hrsi.tests.sample_algorithm import SAMPLE

ROOT = Path(__file__).resolve().parents[2]
ALGORITHMS = pytest.mark.parametrize("algorithm", [*REGISTRY.values(), SAMPLE], ids=lambda algorithm: algorithm.name)
#: A value for what has to be named.
NAMED: dict[Kind, Any] = {Kind.IMAGES: ("a.tif",), Kind.OUTPUT_DIR: "out"}


def declared_fields(options: type) -> list[tuple[type, Field]]:
    """Return every field that is an option, nested ones too, with the dataclass it stands in."""
    found = []
    for part in fields(options):
        inner = inner_options_of(part)
        if inner is not None:
            found += declared_fields(inner)
        elif option_of(part) is not None:
            found.append((options, part))
    return found


@ALGORITHMS
def test_the_default_of_every_face_is_the_field_s(algorithm: Algorithm):
    by_name = {param.argument: param for param in algorithm.params}
    parser = algorithm_parser(algorithm)
    needed = {param.key: NAMED.get(param.kind, "x") for param in algorithm.params if param.required}
    typed = algorithm_parser(algorithm).parse_words([])  # nothing typed: the parser has no defaults of its own
    assert typed == {} or set(typed) <= {param.key for param in algorithm.params if param.kind in POSITIONAL_KINDS}
    options = check_options(algorithm, needed)
    for owner, part in declared_fields(algorithm.options):
        param = by_name[part.name] if by_name[part.name].help == option_of(part).help else None
        if param is None:  # two nested dataclasses have a field of this name; their options have names of their own
            param = next(p for p in algorithm.params if p.name == option_of(part).name)
        if part.default is MISSING:
            assert param.required, f"{owner.__name__}.{part.name}"
            continue
        assert param.default is part.default
        assert param.required or options[param.key] is part.default
        page = re.sub(r"\s", "", parser.format_help())
        assert all(re.sub(r"\s", "", fact) in page for fact in value_facts(param)), param.name


@ALGORITHMS
def test_python_gets_the_dataclass_as_it_stands(algorithm: Algorithm):
    """What `run` fills from nothing but what has to be named equals the dataclass called with that alone."""
    needed = {param.key: NAMED.get(param.kind, "x") for param in algorithm.params if param.required}
    filled = fill_options(algorithm.options, check_options(algorithm, needed))
    assert is_dataclass(filled)
    for part in fields(filled):
        inner = inner_options_of(part)
        if inner is not None and not any(p.required for p in algorithm.params if p.key in settings_of_nothing(inner)):
            assert getattr(filled, part.name) == inner()


def settings_of_nothing(options: type) -> set[str]:
    """Return the keys of the options that have no default."""
    return {part.name for _, part in declared_fields(options) if part.default is MISSING}


def test_the_panel_adjusts_with_the_same_defaults(monkeypatch):
    used: list[AdjustOptions] = []

    def keep(block: object, options: AdjustOptions, *_: object) -> None:
        used.append(options)
        raise InterruptedError

    monkeypatch.setattr(panel, "BlockUpdater", keep)
    monkeypatch.setattr(plausibility, "check_block", lambda *_, **__: [])
    with pytest.raises(InterruptedError):
        panel.adjust_block(blocks.block()[0], MODEL.default)
    assert used == [AdjustOptions()]
    assert MODEL.default is AdjustOptions.model
    assert (AdjustOptions.reject_sigma, AdjustOptions.sigma_dem_m) == (4.0, None)


@ALGORITHMS
def test_settings_of_a_report_run_again(algorithm: Algorithm):
    """What a report keeps of the options is what `run` takes, and leads to the same options."""
    needed = {param.key: NAMED.get(param.kind, "x") for param in algorithm.params if param.required}
    options = fill_options(algorithm.options, check_options(algorithm, needed))
    again = fill_options(algorithm.options, check_options(algorithm, settings_of(options)))
    assert again == options


@ALGORITHMS
def test_texts_name_options_that_are_there(algorithm: Algorithm):
    """Help names options as arguments; where it names those of other algorithms, no backtick is left."""
    for text in (algorithm.help, *(param.help for param in algorithm.params)):
        assert "--" not in text
        assert "`" not in spell_arguments(text, algorithm.params)


@pytest.mark.parametrize("part", ["hrsi_engine", "processing_algorithms", "plugin"])
def test_texts_name_arguments_and_no_options(part: str):
    """Only the command line writes ``--options``; `projects` and `dependencies` those of others."""
    spared = {"command_line", "interface", "projects", "dependencies.py"}
    examples = re.compile(r"(echo .* \| )?hrsi ")  # command lines, for who reads the command line's help
    options = [
        (path.relative_to(ROOT), node.lineno)
        for path, node in walk_sources(["--"], [part])
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        and re.search(r"(?<!projsync )--[A-Za-z]", node.value)  # PROJ's own program has an option
        and not examples.match(node.value)
    ]  # fmt: skip
    told = [(path, line) for path, line in options if not spared & set(path.parts)]
    assert told == []
    assert options, "what is spared has options: the search does not see them"


def test_the_command_line_writes_arguments_as_options():
    triangulate = REGISTRY["triangulate"].params
    assert spell_arguments("give `sigma_dem_m`, or `model`", triangulate) == "give --sigma-dem, or --model"
    assert spell_arguments("names `images` and `height`", triangulate) == "names IMAGE and height"
    assert spell_arguments("`reject_sigma` of `reject`", triangulate) == "--reject of --reject"
