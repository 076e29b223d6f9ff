"""What statistical tests would see: each states its power in its docstring, and here it is computed again.

Three forms: ``Power (binomial, 100 trials, 82 to 97): 0.90 fails with 1 %, 0.73 with 98 %`` counts successes;
``Power (chi², 120 values, 0.8 to 1.2): 1.00 fails with 0 %, 1.40 with 98 %`` is of the root mean square of normal
values over what was stated; ``Power (normal, 6 %, 0.8 to 1.2): …`` of a mean known to a share of itself. Values that
depend on one another count as fewer. The first figure is what is right, the second the fault that would be seen.
``Power (comparison): …`` says in words what a comparison of two results on the same draws would see.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, chi2, norm

TESTS = Path(__file__).resolve().parent
STATED = re.compile(
    r"Power \((binomial|chi²|normal), ([\d.]+) (?:trials|values|%), ([\d.]+) to ([\d.]+)\): "
    r"([\d.]+) fails with ([\d.]+) %, ([\d.]+) with ([\d.]+) %"
)
#: The statistics of many blocks or draws that `make test-all` runs, and those beside them without the marker.
UNMARKED = ("test_covariance_is_that_of_repeated_measurements",)


def statistical_tests() -> Iterator[tuple[str, str]]:
    """Return name and docstring of the tests with the marker ``coverage``, wherever it stands in their decorators."""
    for path in sorted(TESTS.rglob("test_*.py")):
        if "coverage" not in (text := path.read_text(encoding="utf-8")) and not any(name in text for name in UNMARKED):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                words = " ".join(map(ast.unparse, node.decorator_list))
                if "mark.coverage" in words or "'coverage'" in words or node.name in UNMARKED:
                    yield f"{path.relative_to(TESTS)}::{node.name}", " ".join((ast.get_docstring(node) or "").split())


def share_outside(kind: str, size: float, low: float, high: float, true: float) -> float:
    """Return how often a test fails, in per cent, where ``true`` holds."""
    if kind == "binomial":
        inside = binom.cdf(high, int(size), true) - binom.cdf(low - 1, int(size), true)
    elif kind == "chi²":
        inside = np.diff(chi2.cdf(size * np.square([low / true, high / true]), size))[0]
    else:
        inside = np.diff(norm.cdf([low, high], true, 0.01 * size * true))[0]
    return 100.0 * (1.0 - float(inside))


CASES = dict(statistical_tests())


@pytest.mark.parametrize("name", CASES)
def test_each_statistical_test_states_its_power(name: str) -> None:
    """What is right fails seldom, the fault is seen nearly always; both are as the docstring says."""
    found = STATED.findall(CASES[name])
    if not found:
        assert "Power (comparison):" in CASES[name], f"{name} does not say which fault it would see"
    for kind, *words in found:
        size, low, high, right, alarm, fault, seen = map(float, words)
        assert share_outside(kind, size, low, high, right) == pytest.approx(alarm, abs=0.6), (name, kind, "alarm")
        assert share_outside(kind, size, low, high, fault) == pytest.approx(seen, abs=0.6), (name, kind, "seen")
        assert alarm <= 5.0 and seen >= 90.0


def test_the_computation_of_the_power() -> None:
    """Against the drawing of lots: 20 000 runs know a share of 10 % to 0.2 %."""
    rng = np.random.default_rng(4)
    draws = np.sqrt(np.mean(np.square(1.1 * rng.normal(size=(20_000, 50))), axis=1))
    outside = 100.0 * np.mean((draws < 0.8) | (draws > 1.2))
    assert share_outside("chi²", 50, 0.8, 1.2, 1.1) == pytest.approx(outside, abs=1.2)
    counts = rng.binomial(100, 0.8, 20_000)
    assert share_outside("binomial", 100, 82, 97, 0.8) == pytest.approx(
        100.0 * np.mean((counts < 82) | (counts > 97)), abs=1.5
    )
