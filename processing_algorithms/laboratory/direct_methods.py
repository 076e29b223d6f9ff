"""The models of `refine-rpc`: those of the engine, and the direct methods of the thesis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.opening.files import read_text
from ...hrsi_engine.laboratory.direct_methods import COEFFICIENTS, DIRECT
from ...hrsi_engine.refinement.model import RefinementModel
from ...hrsi_engine.refinement.models import MODELS

SINGLE_IMAGE_MODELS: dict[str, RefinementModel] = {**MODELS, **DIRECT}


def select_models(model: str, covariance: str | None) -> Mapping[str, RefinementModel]:
    """Return the models by name; the direct methods use the covariance of the coefficients that a file gives.

    Parameters
    ----------
    model : str
        The model of the refinement, for the check that it uses a covariance.
    covariance : str, optional
        Text file of 78 rows with 78 numbers each, of the normalised coefficients in the order of `SLICES` of
        `hrsi_engine.laboratory.direct_methods`.

    Returns
    -------
    mapping of str to RefinementModel
        The models.

    Raises
    ------
    InputError
        The model uses no covariance, or the file has no symmetric, positive definite matrix of this size.
    """
    if covariance is None:
        return SINGLE_IMAGE_MODELS
    if model not in DIRECT:
        raise InputError(
            f"`coefficient_covariance` {covariance}: model {model} does not estimate the coefficients of the RPC: "
            f"choose `model` from {', '.join(DIRECT)}, or leave it out"
        )
    rows = [line.replace(",", " ").split() for line in read_text(covariance).splitlines() if line.strip()]
    try:
        matrix = np.array(rows, dtype=np.float64)
    except ValueError:
        raise InputError(
            f"{covariance}: not a matrix of numbers: {COEFFICIENTS} lines with {COEFFICIENTS} numbers each are needed"
        ) from None
    try:
        return {**MODELS, **{name: method.with_covariance(matrix) for name, method in DIRECT.items()}}
    except InputError as error:
        raise InputError(f"{covariance}: {error}") from None
