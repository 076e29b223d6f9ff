"""The normal equations of a block with the ground points eliminated (thesis eqs. 5.44-5.49).

Per image point, with residual v = observed - computed and weight w = (robust weight) / sigma²::

    v = A da + B dx        A (2, p): camera parameters,  B (2, 3): east, north, up of the point, metres

    | N  W | |da|   |n|      N  blocks (p, p) of the cameras,   V  blocks (3, 3) of the points,
    | W' V | |dx| = |m|      W  one block (p, 3) per image point

The points are eliminated one by one: (N - W V^-1 W') da = n - W V^-1 m, then dx = V^-1 (m - W' da). No matrix over all
observations is formed. The steps are the same for all models: the cameras are linearised (`linearisation`) for one part
of the block after the other, and the points of each part are eliminated, by compiled loops (`elimination_kernels`) in
threads or, without numba, with NumPy (`elimination`).

Compiled code needs numba (the extra ``fast``). numba compiles the loops once, in about half a minute, and stores them
in the package's ``__pycache__`` or, if that is not writable, in the user's cache. For small blocks NumPy takes less
time than loading numba. The environment variable HRSI_COMPILED=0 disables compiled code, 1 enables it for any size.
"""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ...foundation.compiled_code import is_wanted
from ...foundation.large_arrays import allocate_zeros
from ...foundation.thresholds import MEMORY, threshold, thresholds
from ...foundation.workers.threads import thread_count
from ...ground.geodesy import move_ground
from ...refinement.model import RefinementModel
from ..observations import Observations
from .elimination import NumpyElimination
from .linearisation import Cameras, CamerasByImage, Linearisation, NumbaCameras, Portion, take_whole_block
from .pattern import Pattern
from .states import Cofactors, Normals, PointPriors, State


@thresholds
class POINT_STEPS:
    """Limits for the convergence of intersections, and for the use of compiled loops."""

    closure_m: float = threshold(1e-4, "m", "step of an intersection at which it has converged")
    most_step_m: float = threshold(5e3, "m", "largest step of an intersection (weak geometry)")


MOST_SUMS_BYTES = 2**29  # memory of the threads' sums of the reduced matrix: it limits the number of threads
INTERSECT_STEPS = 15


class NormalEquations:
    """Interface of the normal equations for the solver; ``weight (n,)`` in 1/px², 0 for image points that are not used.

    observations : measurements and points, in the solver's order
    model : the cameras' correction model
    pattern : pairs of cameras with common points
    threads : number for compiled loops; 0 for all processors
    cameras : existing ones of the same observations and model; otherwise they are made
    drawn_from : image points of the complete block, if these are a part: its compiled loops are used for the part, too
    """

    def __init__(
        self,
        observations: Observations,
        model: RefinementModel,
        pattern: Pattern,
        threads: int = 0,
        cameras: Cameras | None = None,
        drawn_from: int = 0,
    ) -> None:
        self.observations, self.pattern = observations, pattern
        self._elimination: NumpyElimination
        if is_wanted(max(observations.count, drawn_from) >= MEMORY.rows):
            from .compiled_elimination import NumbaElimination  # needs numba, and takes a second

            self._elimination, self.threads = NumbaElimination(observations, pattern), thread_count(threads)
        else:
            self._elimination, self.threads = NumpyElimination(observations, pattern), 1
        if cameras is None and self._elimination.compiled:  # not all models have compiled loops
            from ...refinement.compiled_cameras import FAMILIES

            cameras = NumbaCameras(observations, model) if type(model) in FAMILIES else None
        self.cameras: Cameras = cameras or CamerasByImage(observations, model)
        self._parts = self._elimination.list_parts()

    def compute_residuals(self, state: State) -> np.ndarray:
        """Return observed - computed of all image points, ``(n, 2)`` px."""
        linearise, residual = self.cameras.linearise_at(state), np.empty((self.observations.count, 2))
        first = self.observations.first

        def write(part: Portion, _: int) -> None:
            residual[first[part.points[0]] : first[part.points[-1] + 1]] = linearise(part).residual

        self._for_parts(write)
        return residual

    def form_normals(self, state: State, weight: np.ndarray, priors: PointPriors, contributes: np.ndarray) -> Normals:
        """Return the reduced equations at a state.

        weight : (n,) of the image points, 1/px², 0 for those not used; priors : of the points' positions
        contributes : (m,) mask of the points that enter the cameras' part; V^-1 and m are computed for all points
        """
        observations, pattern, linearise = self.observations, self.pattern, self.cameras.linearise_at(state, keep=True)
        structure, points = self.cameras.structure, len(observations.points)
        threads = max(1, min(self.threads, MOST_SUMS_BYTES // max(8 * pattern.blocks * len(structure.mixing) ** 2, 1)))
        by_point = np.empty((observations.count, 2)), np.empty((points, 3, 3)), np.empty((points, 3))
        size = len(structure.mixing)
        sums = [
            Normals(
                by_point[0],
                allocate_zeros((pattern.blocks, structure.terms**2, structure.size**2)),
                np.zeros((pattern.cameras, size)),
                *by_point[1:],
            )
            for _ in range(threads)
        ]

        def add(part: Portion, thread: int) -> None:
            self._elimination.eliminate_points(
                part, linearise(part), weight, state.ground, priors, contributes=contributes, sums=sums[thread]
            )

        self._for_parts(add, threads)
        total = sums[0]
        for partial in sums[1:]:
            total.blocks += partial.blocks
            total.right += partial.right
        total.blocks, total.right = structure.fold(total.blocks), total.right @ structure.mixing
        return total

    def compute_point_steps(self, state: State, weight: np.ndarray, normals: Normals, step: np.ndarray) -> np.ndarray:
        """Return the points' steps ``(m, 3)`` in metres that follow from the cameras' ``step (cameras, p)``."""
        linearise, steps = self.cameras.linearise_at(state), np.empty_like(state.ground)
        by_coefficient = np.ascontiguousarray(step @ self.cameras.structure.mixing.T)

        def write(part: Portion, _: int) -> None:
            self._elimination.substitute_back(part, linearise(part), weight, normals, by_coefficient, steps)

        self._for_parts(write)
        return steps

    def linearise_points(self, state: State, points: np.ndarray) -> tuple[np.ndarray, Linearisation]:
        """Return the image points of some points in order (indices), and their linearised equations."""
        linear = self.cameras.linearise_at(state)(Portion.select(self.observations, points))
        return self.observations.find_rows(points)[0], linear

    def compute_cofactors(self, state: State, weight: np.ndarray, normals: Normals, cameras: np.ndarray) -> Cofactors:
        """Return the cofactors of points and computed image points from those of the ``cameras (blocks, p, p)``."""
        linearise = self.cameras.linearise_at(state)
        cofactors = Cofactors(np.empty_like(normals.inverse), np.empty((self.observations.count, 2, 2)))
        by_coefficient = self.cameras.structure.unfold(cameras)

        def write(part: Portion, _: int) -> None:
            self._elimination.compute_cofactors(part, linearise(part), weight, normals, by_coefficient, cofactors)

        self._for_parts(write)
        return cofactors

    def intersect(
        self, state: State, weight: np.ndarray, priors: PointPriors, points: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the positions ``(m, 3)`` of the points intersected with fixed cameras; NaN if there is none.

        If ``points`` (indices) are given, only these are intersected.
        """
        ground = state.ground.copy()  # changed in place while other points are computed
        moving = self.cameras.linearise_at(State(state.values, ground))

        def move(part: Portion, _: int) -> None:
            linearise = moving
            for _step in range(INTERSECT_STEPS):
                step = self._elimination.solve_points(part, linearise(part), weight, ground, priors)
                length = np.linalg.norm(step, axis=1, keepdims=True)
                step *= np.minimum(1.0, POINT_STEPS.most_step_m / np.maximum(length, POINT_STEPS.most_step_m))
                ground[part.points] = move_ground(ground[part.points], step)
                open_points = part.points[length[:, 0] > POINT_STEPS.closure_m]
                if not len(open_points):
                    break
                part = Portion.select(self.observations, open_points)
                if not self.cameras.by_parts:
                    linearise = self.cameras.linearise_at(State(state.values, ground.copy()))

        parts = None if self.cameras.by_parts else [take_whole_block(self.observations)]
        self._for_parts(move, parts=parts if points is None else [Portion.select(self.observations, points)])
        return ground

    def _for_parts(
        self, work: Callable[[Portion, int], None], threads: int = 0, parts: Sequence[Portion] | None = None
    ) -> None:
        """Call ``work(part, thread)`` for all parts; each thread takes the next waiting part."""
        parts = self._parts if parts is None else parts
        threads = min(threads or self.threads, len(parts))
        waiting, lock = iter(parts), threading.Lock()

        def work_off(thread: int) -> None:
            while True:
                with lock:
                    part = next(waiting, None)
                if part is None:
                    return
                work(part, thread)

        if threads <= 1:
            work_off(0)
            return
        with ThreadPoolExecutor(threads) as pool:
            for future in [pool.submit(work_off, thread) for thread in range(threads)]:
                future.result()
