"""Contract of the wrapper: every declared parameter and text of every algorithm is in its QGIS algorithm."""

import pytest
from qgis.core import (
    QgsApplication,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingParameterEnum,
    QgsProcessingParameterNumber,
)

from hrsi.plugin.parameters import ADVANCED, BINDINGS, OPTIONAL, Reading, label_of, option_value
from hrsi.plugin.provider import PluginAlgorithm
from hrsi.plugin.results import layer_name
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.interface.declare import Algorithm, Kind, Param, format_default, spell_arguments
from hrsi.processing_algorithms.interface.options import KINDS
from hrsi.tests.qgis.tiny import TINY

DECLARED = [TINY, *REGISTRY.values()]
PARAMS = [
    pytest.param(declaration, param, id=f"{declaration.name}-{param.name}")
    for declaration in DECLARED
    for param in declaration.params
]


def made(declaration: Algorithm) -> QgsProcessingAlgorithm:
    """Return the QGIS algorithm of a declaration as Processing makes it for a run."""
    return PluginAlgorithm(declaration).create()


def test_every_kind_has_a_binding() -> None:
    assert set(BINDINGS) == set(Kind)
    assert {param.kind for param in TINY.params} == set(Kind)


def test_provider_lists_the_registry(hrsi_provider) -> None:
    ids = {algorithm.id() for algorithm in hrsi_provider.algorithms()}
    assert ids == {f"hrsi:{name.replace('-', '')}" for name in REGISTRY} | {"hrsi:triangulatetoorthoimages"}
    for identifier in ids:
        assert QgsApplication.processingRegistry().createAlgorithmById(identifier) is not None


@pytest.mark.parametrize("declaration", DECLARED, ids=lambda declaration: declaration.name)
def test_texts_and_outputs(declaration: Algorithm) -> None:
    algorithm = made(declaration)
    assert algorithm.displayName() == declaration.title
    assert algorithm.group() == declaration.group
    assert algorithm.shortDescription() == declaration.summary
    assert not algorithm.icon().isNull()
    outputs = {output.name() for output in algorithm.outputDefinitions()}
    writes_folder = any(param.kind is Kind.OUTPUT_DIR for param in declaration.params)
    layers = {layer_name(source).upper() for source in declaration.layers}
    judged = {"VERDICT"} if any(param.key == "force_write" for param in declaration.params) else set()
    judged |= {"IMAGES_MADE"} if declaration.images_made else set()
    judged |= {"MAP"} if declaration.are_maps else set()  # a raster that the next step of a model takes
    assert outputs == layers | judged | ({"REPORT", "REPORT_HTML", "OUTPUT_DIR"} if writes_folder else {"REPORT"})


@pytest.mark.parametrize(("declaration", "param"), PARAMS)
def test_parameter(declaration: Algorithm, param: Param) -> None:
    algorithm = made(declaration)  # owns the definition
    definition = algorithm.parameterDefinition(param.key.upper())
    assert definition.defaultValue() == (format_default(param) if isinstance(param.default, tuple) else param.default)
    assert definition.help() == f"{spell_arguments(param.help, declaration.params, label_of)}."
    assert "`" not in definition.help()
    flags = definition.flags()
    optional = bool(flags & OPTIONAL)
    assert not (optional and (param.required or param.piped))
    assert optional or param.required or param.piped or param.default is not None
    assert bool(flags & ADVANCED) or not param.advanced
    if param.default not in (None, ()):
        assert definition.checkValueIsAcceptable(definition.defaultValue())
    if isinstance(definition, QgsProcessingParameterEnum):
        assert tuple(definition.options()) == param.choices
        assert definition.usesStaticStrings()
    if isinstance(definition, QgsProcessingParameterNumber):
        assert param.minimum is None or definition.minimum() == param.minimum
        assert param.maximum is None or definition.maximum() == param.maximum


def test_help_is_html_with_every_parameter() -> None:
    text = made(TINY).shortHelpString()
    assert "<p>First paragraph.</p><p>Second with a &lt; sign.</p>" in text
    assert "<strong>Sigma image (px)</strong><br/>Sigma of a measurement." in text
    assert text.count("<strong>") == len(TINY.params)


@pytest.mark.parametrize("declaration", DECLARED, ids=lambda declaration: declaration.name)
def test_what_a_dialog_is_filled_with_reaches_the_algorithm_as_its_dataclass_has_it(declaration: Algorithm) -> None:
    """Each default that QGIS shows, read again, is the one of the dataclass."""
    algorithm = made(declaration)
    shown = {d.name(): d.defaultValue() for d in algorithm.parameterDefinitions() if d.defaultValue() is not None}
    reading = Reading(algorithm, shown, QgsProcessingContext(), QgsProcessingFeedback())
    for param in declaration.params:
        value = option_value(param, reading)
        assert (KINDS[param.kind].parse(value) if value not in (None, ()) else value) == param.default, param.name


def test_long_dialogs_ask_for_what_is_needed_first() -> None:
    """Of the 50 fields of the main job what it reads and writes stands above "Advanced"; short dialogs hide nothing."""
    for name, most in (("triangulate", 10), ("adjust", 9)):  # nine are what a block may be held by, and the folder
        algorithm = made(REGISTRY[name])
        first = [one.name() for one in algorithm.parameterDefinitions() if not one.flags() & ADVANCED]
        assert first[:3] == ["IMAGES", "GCPS", "IMAGE_POINTS"] and "OUTPUT_DIR" in first
        assert len(first) <= most
    short = made(REGISTRY["write-rpc"])
    assert not any(one.flags() & ADVANCED for one in short.parameterDefinitions() if one.name() != "THREADS")
