"""The declared algorithms, and `run` to call one by its name.

To add an algorithm, write its declaration in the file of its group in ``declarations``, list it there in
``ALGORITHMS``, and write its ``run`` and ``summarise`` in ``NAME.py``. Importing this package is quick: only
declarations are imported; the module of an algorithm, with its heavy imports, is loaded when it is run.
"""

from typing import Any

from ..hrsi_engine.foundation.progress import Progress, silent
from .declarations import image_points, orthoimages, projects, rpcs, triangulation
from .interface.declare import Algorithm, Context, Log, Report
from .interface.options import check_options, find_algorithm
from .laboratory.declarations import interest_points, match, register, simulate

REGISTRY: dict[str, Algorithm] = {
    algorithm.name: algorithm
    for algorithm in (
        *triangulation.ALGORITHMS,
        *image_points.ALGORITHMS,
        *rpcs.ALGORITHMS,
        *orthoimages.ALGORITHMS,
        *projects.ALGORITHMS,
        *(study.ALGORITHM for study in (interest_points, match, simulate, register)),
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
        Unknown algorithm or option, a value out of its range, or an error of the algorithm itself.
    """
    algorithm = find_algorithm(REGISTRY, name)
    return algorithm.execute(check_options(algorithm, options), Context(progress, log))
