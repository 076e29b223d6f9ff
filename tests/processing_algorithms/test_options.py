"""Options given in Python or as text are checked against their declaration."""

from pathlib import Path

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.processing_algorithms.interface.declare import Kind
from hrsi.processing_algorithms.interface.options import KINDS, check_options, suggestion
from hrsi.tests.sample_algorithm import SAMPLE

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
