"""The contract of every declared algorithm, and `run`."""

import re
from pathlib import Path

import numpy as np
import pytest

import hrsi.processing_algorithms as processing_algorithms
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.processing_algorithms import REGISTRY, run
from hrsi.processing_algorithms.interface.declare import Algorithm, Common, Kind, params_of
from hrsi.processing_algorithms.interface.options import KINDS, check_options, suggestion
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


# ---- options ---------------------------------------------------------------------------------------------------------


REQUIRED = {"images": ("a.tif",), "output_dir": "out"}


def test_every_kind_can_be_read():
    assert set(KINDS) == set(Kind)


def test_what_is_not_given_has_its_default():
    assert check_options(SAMPLE, REQUIRED) == SAMPLE.defaults() | REQUIRED


def test_none_means_not_given():
    assert check_options(SAMPLE, REQUIRED | {"model": None})["model"] == "shift"


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("images", "a.tif", ("a.tif",)),
        ("images", Path("a.tif"), ("a.tif",)),
        ("images", ("a.tif", Path("b.tif")), ("a.tif", "b.tif")),
        ("output_dir", Path("out") / "x", str(Path("out") / "x")),
        ("gcp_ids", "A, B", ("A", "B")),
        ("gcp_ids", ("A", 7), ("A", "7")),
        ("iterations", "12", 12),
        ("iterations", np.int64(12), 12),
        ("height", 3, 3.0),
        ("height", np.float32(0.5), 0.5),
        ("report", False, False),
        ("report", np.bool_(True), True),
    ],
)
def test_accepted(key, value, expected):
    got = check_options(SAMPLE, REQUIRED | {key: value})[key]
    assert got == expected
    assert type(got) is type(expected)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("images", [], "needs IMAGE"),
        ("images", [3], "IMAGE"),
        ("images", 3, "list of file names"),
        ("output_dir", 3, "name of a directory"),
        ("gcps", 3, "--gcps 3 is not a file name"),
        ("gcp_ids", 3, "ids separated by commas"),
        ("iterations", 2.5, "whole number"),
        ("iterations", "2.5", "whole number"),
        ("iterations", True, "whole number"),
        ("iterations", 100, "maximum 99"),
        ("height", True, "not a number"),
        ("height", "inf", "not a number"),
        ("height", [1.0], "not a number"),
        ("model", "Shift", "not one of shift, affine"),
        ("report", "yes", "true or false"),
        ("heigth", 3, "no option heigth; did you mean height"),
    ],
)
def test_refused(key, value, message):
    with pytest.raises(InputError, match=message):
        check_options(SAMPLE, REQUIRED | {key: value})


def test_all_missing_options_are_named_at_once():
    with pytest.raises(InputError, match="needs IMAGE and --output-dir"):
        check_options(SAMPLE, {})


def test_suggestion_is_silent_without_a_near_word():
    assert suggestion("zzz", ["model"]) == ""
