"""Choice between the two implementations of `Equations`.

Compiled code needs numba (the extra ``speed``) and an image-space polynomial as model; everything else is NumPy's.
numba compiles the loops once, in about half a minute, and keeps them in the package's ``__pycache__`` or, where that
is not writable, in the user's cache. Small blocks are done by NumPy in less time than loading numba takes. The
environment variable HRSI_COMPILED=0 turns compiled code off, 1 asks for it whatever the size.
"""

from __future__ import annotations

from ...foundation.compiled_code import is_wanted
from ...refinement import RefinementModel
from ...refinement.image_space import ImagePolynomial
from ..observations import Observations
from .array_equations import ArrayEquations
from .pattern import Pattern
from .states import Equations

WORTH_COMPILING = 20_000  # image points


def equations_of(observations: Observations, model: RefinementModel, pattern: Pattern, threads: int = 0) -> Equations:
    """Return the equations of a block."""
    if isinstance(model, ImagePolynomial) and is_wanted(observations.count >= WORTH_COMPILING):
        from .compiled_equations import CompiledEquations

        return CompiledEquations(observations, model, pattern, threads)
    return ArrayEquations(observations, model, pattern)
