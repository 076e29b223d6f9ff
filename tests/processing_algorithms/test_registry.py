"""The contract of every declared algorithm, and `run`."""

import re

import pytest

import hrsi.processing_algorithms as processing_algorithms
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.processing_algorithms import REGISTRY, run
from hrsi.processing_algorithms.interface.declare import Algorithm, Common, Kind, params_of
from hrsi.processing_algorithms.interface.options import KINDS, check_options
from hrsi.tests.sample_algorithm import SAMPLE

ALGORITHMS = pytest.mark.parametrize("algorithm", [*REGISTRY.values(), SAMPLE], ids=lambda algorithm: algorithm.name)


@ALGORITHMS
def test_texts(algorithm: Algorithm):
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", algorithm.name)
    assert all(text.strip() for text in (algorithm.title, algorithm.group, algorithm.summary, algorithm.help))
    assert len(algorithm.summary) <= 100
    assert not algorithm.summary.endswith(".")
    for param in algorithm.params:
        assert re.fullmatch(r"[a-z]+(-[a-z0-9]+)*", param.name)
        assert param.help
        assert not param.help.endswith(".")


@ALGORITHMS
def test_options_are_declared_once_and_beside_the_common_ones(algorithm: Algorithm):
    names = [param.name for param in algorithm.params]
    assert len(set(names)) == len(names)
    assert not {"quiet", "json", "help"} & set(names)
    assert set(params_of(Common)) <= set(algorithm.params)
    assert sum(param.kind is Kind.IMAGES for param in algorithm.params) <= 1


@ALGORITHMS
def test_defaults_pass_the_checks_of_given_values(algorithm: Algorithm):
    required = {param.key: "x" for param in algorithm.params if param.required and param.default is None}
    given = {param.key: param.default for param in algorithm.params if param.default not in (None, "", ())} | required
    check_options(algorithm, given)


@ALGORITHMS
def test_choices_belong_to_choice_options(algorithm: Algorithm):
    for param in algorithm.params:
        assert bool(param.choices) == (param.kind is Kind.CHOICE), param.name
        if param.kind is Kind.CHOICE and param.default is not None:
            assert KINDS[param.kind].parse(param.default) in param.choices


def test_names_are_the_declared_ones():
    assert {name: algorithm.name for name, algorithm in REGISTRY.items()} == {name: name for name in REGISTRY}


def test_run_returns_the_report(tmp_path, monkeypatch):
    monkeypatch.setitem(processing_algorithms.REGISTRY, "sample", SAMPLE)
    fractions, messages = [], []
    report = run(
        "sample",
        images="a.tif",
        output_dir=tmp_path,
        height=3,
        progress=lambda fraction, message="": fractions.append(fraction) or True,
        log=messages.append,
    )
    assert report["options"]["height"] == 3.0
    assert messages == ["a message"]
    assert fractions == sorted(fractions)
    assert len(fractions) == 100


def test_run_names_near_algorithms():
    with pytest.raises(InputError, match="'triangulat'; did you mean triangulate"):
        run("triangulat")
