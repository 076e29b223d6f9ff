"""The declared algorithms, and `run` to call one by its name.

To add an algorithm, write what it says of itself in ``declarations/NAME.py``, its ``run`` and ``summarise`` in
``NAME.py``, and enter it here: one import, one entry. Importing this package is quick: declarations are light, and the
module of an algorithm, which imports what is heavy, is loaded when it is run.
"""

from typing import Any

from ..hrsi_engine.foundation.progress import Progress, silent
from .declarations import (
    adjust,
    crop,
    evaluate,
    fit_rpc,
    gcps_from_reference,
    interest_points,
    localize,
    match,
    measure_targets,
    ortho_check,
    orthorectify,
    project,
    refine_rpc,
    rpc_info,
    strip,
    tie_points,
    triangulate,
    write_rpc,
)
from .interface.declare import Algorithm, Context, Log, Report
from .interface.options import check_options, find_algorithm
from .laboratory.declarations import register, simulate

REGISTRY: dict[str, Algorithm] = {
    module.ALGORITHM.name: module.ALGORITHM
    for module in (
        triangulate,
        tie_points,
        adjust,
        evaluate,
        refine_rpc,
        write_rpc,
        crop,
        strip,
        rpc_info,
        project,
        localize,
        fit_rpc,
        gcps_from_reference,
        interest_points,
        match,
        measure_targets,
        orthorectify,
        ortho_check,
        simulate,
        register,
    )
}


def run(name: str, /, *, progress: Progress = silent, log: Log = lambda message: None, **options: Any) -> Report:
    """Run a declared algorithm and return its report.

    Parameters
    ----------
    name : as on the command line: ``"triangulate"``
    progress : callback ``(fraction, message) -> bool``; False cancels
    log : callback for messages, one line each
    **options : the algorithm's options as on the command line, with underscores: ``sigma_image=0.5``

    Raises
    ------
    HrsiError
        Unknown algorithm or option, a value out of its range, or what the algorithm itself raises.
    """
    algorithm = find_algorithm(REGISTRY, name)
    return algorithm.execute(check_options(algorithm, options), Context(progress, log))
