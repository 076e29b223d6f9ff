"""Sparse Cholesky factors of block matrices by nested dissection, with dense fronts (multifrontal method).

The graph of the cameras is cut in two by a small separator, each half again, and so on; a part small enough becomes a
leaf. Eliminating the leaves first and the separators last limits the fill to O(n log n) for planar graphs, which those
of images on the ground nearly are (George 1973). Each node of the tree is a *front*: the dense matrix of its own
unknowns and of its border, the connected unknowns of separators above it::

    | F11  .  |   own       L11 L11' = F11,   B = F21 L11^-T,   update to the parent: F22 - B B'
    | F21 F22 |   border

The same tree gives the inverse on the fill pattern, from the root down, without ever forming the dense inverse
(Takahashi et al. 1973; Erisman and Tinney 1975): with K = B L11^-1 and the inverse Z22 of the border,

    Z21 = -Z22 K,    Z11 = (L11 L11')^-1 + K' Z22 K

Only the lower triangles of these matrices are computed. The cameras of a border are in the order of their elimination,
so that a border's lower triangle is part of that of the parent's front. Independent fronts are processed in parallel.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ...foundation.errors import SolveError
from ...foundation.large_arrays import allocate_zeros
from ...foundation.workers.threads import are_one_thread_calls, call_in_order, thread_count
from . import dense_matrices as dense

LEAF_UNKNOWNS = 256  # a part with fewer is factorised densely: calls would cost more than arithmetic
WORTH_THREADS = 8  # fewest fronts that are processed in parallel
MIRRORED_AT_ONCE = 64  # rows of a symmetric result

Runs = Sequence[tuple[slice, slice]]  # parts of a matrix's rows, and their rows in another matrix


@dataclass(frozen=True, eq=False)
class FrontEntries:
    """The blocks of the matrix that are assembled in a front, in its lower triangle.

    row, column : (k,) indices into the front's cameras (own, border)
    number : (k,) indices of the blocks
    transposed : (k,) True if the front contains the block's transpose
    """

    row: np.ndarray
    column: np.ndarray
    number: np.ndarray
    transposed: np.ndarray


@dataclass(eq=False)
class Front:
    """A node of the tree: the cameras that it eliminates, those of its border, its children; L11^-1 and B as values.

    place : indices of the border's unknowns in the parent's front
    runs : ranges of the border's unknowns that are contiguous in the parent's front too: in the border, and in there
    """

    own: np.ndarray
    children: list[Front] = field(default_factory=list)
    border: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    place: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    runs: Runs = ()
    entries: FrontEntries = field(init=False)
    factor: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    coupling: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))


def _cut_part(graph: sparse.csr_matrix, part: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return a separator of a part (indices of cameras) and the pieces that remain.

    A straight cut across a block, by the cameras' positions ``(n, 2)``, leaves the shortest separator.
    """
    inside = graph[part][:, part]
    count, label = csgraph.connected_components(inside, directed=False)
    if count > 1:  # unconnected components: two groups of similar size
        size = np.bincount(label, minlength=count)
        heap, weight = np.zeros(count, dtype=int), [0, 0]
        for component in np.argsort(-size):
            heap[component] = lighter = int(weight[1] < weight[0])
            weight[lighter] += int(size[component])
        return part[:0], [part[heap[label] == side] for side in (0, 1)]
    cuts = []
    for coordinate in position[part].T:  # cuts through the median; the separator is on the lower side
        upper = np.zeros(len(part), dtype=bool)
        upper[np.argsort(coordinate, kind="stable")[len(part) // 2 :]] = True
        cuts.append((~upper & (inside @ upper.astype(np.int32) > 0), upper))
    separator, upper = min(cuts, key=lambda cut: cut[0].sum())
    if separator.sum() > 0.5 * len(part):
        return part, []
    remaining = ~separator & ~upper
    return part[separator], [piece for piece in (part[remaining], part[upper]) if len(piece)]


class SingularSystemError(SolveError):
    """Error: the normal equations do not determine the parameters of some ``cameras (k,)`` (indices)."""

    def __init__(self, message: str, cameras: np.ndarray) -> None:
        super().__init__(message)
        self.cameras = cameras


def work_through_fronts(fronts: Sequence[Front], work: Callable[[Front], None], from_root: bool = False) -> None:
    """Call ``work`` for all fronts, given children before parents: in this order, or ``from_root`` in reverse.

    If BLAS calls use one thread, independent fronts are processed in parallel, by one thread for each processor. The
    next front is always the first in the sequential order, so that few intermediate results are in memory.
    """
    order = list(reversed(fronts)) if from_root else list(fronts)
    threads = thread_count(0) if are_one_thread_calls() and len(order) >= WORTH_THREADS else 1
    if threads == 1:
        for front in order:
            work(front)
        return
    needs = {front: [] if from_root else front.children for front in order}
    for front in order if from_root else ():
        for child in front.children:
            needs[child].append(front)
    call_in_order(needs, work, threads)


def find_runs(place: np.ndarray) -> Runs:
    """Return the contiguous ranges of some places: as slices of the array, and as slices of the places."""
    ends = [*(np.flatnonzero(np.diff(place) != 1) + 1).tolist(), len(place)]
    begins = [0, *ends[:-1]]
    return [
        (slice(b, e), slice(int(place[b]), int(place[b]) + e - b)) for b, e in zip(begins, ends, strict=True) if b < e
    ]


def list_lower_parts(runs: Runs) -> Iterator[tuple[tuple[slice, slice], tuple[slice, slice]]]:
    """Yield the parts of a small lower triangle, and their parts in a large one, at the places given by ``runs``.

    Runs are ascending. A few slices are copied four times as fast as single rows and columns.
    """
    for number, (rows, places) in enumerate(runs):
        for columns, other_columns in runs[: number + 1]:
            yield (rows, columns), (places, other_columns)


class SparseFactor:
    """Cholesky factor of a block matrix given by its upper blocks.

    graph : symmetric adjacency of the n cameras
    start, columns : compressed rows of the upper blocks
    size : p, unknowns of a camera
    position : (n, 2) of the cameras, in any unit
    """

    def __init__(
        self, graph: sparse.csr_matrix, start: np.ndarray, columns: np.ndarray, size: int, position: np.ndarray
    ) -> None:
        self.cameras, self.size = graph.shape[0], size
        self._start, self._columns = start, columns
        # The fronts of the graph in the order of elimination: children before parents
        leaf = max(1, LEAF_UNKNOWNS // max(size, 1))  # number of cameras up to which a part is not cut further
        self.fronts: list[Front] = []
        pending: list[tuple[np.ndarray, Front | None]] = [(np.arange(self.cameras), None)]
        while pending:
            part, parent = pending.pop()
            separator, halves = (part, []) if len(part) <= leaf else _cut_part(graph, part, position)
            front = Front(np.sort(separator))
            self.fronts.append(front)
            if parent is not None:
                parent.children.append(front)
            pending += [(half, front) for half in halves]
        self.fronts.reverse()
        self._order = np.empty(self.cameras, dtype=np.int64)
        for number, front in enumerate(self.fronts):
            self._order[front.own] = number
        # a symmetric matrix of the indices of the blocks (plus 1; negative for blocks to be transposed)
        block = np.arange(1, len(columns) + 1, dtype=np.int64)
        upper = sparse.csr_matrix((block, columns, start), shape=graph.shape)
        index = sparse.csr_matrix(upper - sparse.triu(upper, 1).T)
        for number, front in enumerate(self.fronts):
            neighbours = graph[front.own].indices
            reached = np.unique(np.concatenate([neighbours, *(child.border for child in front.children)]))
            later = reached[self._order[reached] > number].astype(np.int64)
            front.border = later[np.argsort(self._order[later], kind="stable")]
            # Positions of the front's blocks in it, and of the borders of its children
            cameras = np.concatenate([front.own, front.border])
            order = np.argsort(cameras)
            rows = index[front.own]
            column = order[np.minimum(np.searchsorted(cameras[order], rows.indices), len(cameras) - 1)]
            row = np.repeat(np.arange(len(front.own)), np.diff(rows.indptr))
            indices = (cameras[column] == rows.indices) & (column >= row)  # each once, in the lower triangle
            entry = rows.data[indices]
            front.entries = FrontEntries(
                column[indices], row[indices], np.abs(entry) - 1, (entry > 0) & (column[indices] > row[indices])
            )
            for child in front.children:
                child.place = self._number_unknowns(order[np.searchsorted(cameras[order], child.border)])
                child.runs = find_runs(child.place)

    # ---- values --------------------------------------------------------------------------------------------------

    def factorise(self, blocks: np.ndarray) -> None:
        """Compute the factors of ``blocks (blocks, p, p)``; raises `SolveError` where not positive definite."""
        updates: dict[int, np.ndarray] = {}

        def eliminate(front: Front) -> None:
            cameras, p, eliminated = len(front.own) + len(front.border), self.size, len(front.own) * self.size
            matrix, entries = allocate_zeros((cameras, p, cameras, p)), front.entries
            values = blocks[entries.number]
            values[entries.transposed] = values[entries.transposed].transpose(0, 2, 1)
            matrix[entries.row, :, entries.column, :] = values
            matrix = matrix.reshape(cameras * p, cameras * p)  # its lower triangle
            for child in front.children:
                update = updates.pop(id(child))
                for part, place in list_lower_parts(child.runs):
                    matrix[place] += update[part]
            try:
                front.factor = dense.inverse_cholesky(matrix[:eliminated, :eliminated])
            except np.linalg.LinAlgError as error:
                text = (
                    "the normal equations are singular: add GCPs or tie points, or choose a model with fewer parameters"
                )
                raise SingularSystemError(text, front.own) from error
            front.coupling = dense.multiply_by_triangle(matrix[eliminated:, :eliminated], front.factor, transposed=True)
            dense.subtract_square(matrix[eliminated:, eliminated:], front.coupling)
            updates[id(front)] = matrix[eliminated:, eliminated:]

        work_through_fronts(self.fronts, eliminate)

    def _number_unknowns(self, cameras: np.ndarray) -> np.ndarray:
        return (cameras[:, None] * self.size + np.arange(self.size)).ravel()

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solution for right-hand sides ``(u,)`` or ``(u, k)``."""
        x = np.array(right, dtype=np.float64)
        for front in self.fronts:  # forward substitution
            eliminated, border = self._number_unknowns(front.own), self._number_unknowns(front.border)
            x[eliminated] = front.factor @ x[eliminated]
            x[border] -= front.coupling @ x[eliminated]
        for front in reversed(self.fronts):  # back substitution
            eliminated, border = self._number_unknowns(front.own), self._number_unknowns(front.border)
            x[eliminated] = front.factor.T @ (x[eliminated] - front.coupling.T @ x[border])
        return x

    def project_cofactors(self, rows: sparse.csr_matrix) -> np.ndarray:
        """Return ``R A^-1 R' (k, k)`` of sparse ``rows R (k, u)``.

        With the factors L of A it is Y' Y for L Y = R'. A row is used only in the fronts from its own unknowns up to
        the root, so that rows of the complete block cost little more than the fronts that they share.
        """
        result, adding = allocate_zeros((rows.shape[0],) * 2), threading.Lock()
        by_unknown = rows.tocsc()
        borders: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # rows, and their contributions to a front's border

        def add(front: Front) -> None:
            width = len(front.own) * self.size
            indices = by_unknown[:, self._number_unknowns(front.own)].tocoo()
            brought = [borders.pop(id(child)) for child in front.children]
            taking_part = np.unique(np.concatenate([indices.row, *(numbers for numbers, _ in brought)]))
            x = allocate_zeros((width + len(front.border) * self.size, len(taking_part)))
            x[indices.col, np.searchsorted(taking_part, indices.row)] = indices.data
            for child, (numbers, values) in zip(front.children, brought, strict=True):
                x[np.ix_(child.place, np.searchsorted(taking_part, numbers))] += values
            y = dense.multiply_dense(front.factor, x[:width])
            borders[id(front)] = taking_part, x[width:] - dense.multiply_dense(front.coupling, y)
            square, runs = dense.multiply_by_own_transpose(y), find_runs(taking_part)
            with adding:
                for part, place in list_lower_parts(runs):
                    result[place] += square[part]

        work_through_fronts(self.fronts, add)
        for begin in range(0, len(result), MIRRORED_AT_ONCE):  # parts that fit in the processor's cache
            end = min(begin + MIRRORED_AT_ONCE, len(result))
            lower = np.tril(result[begin:end, begin:end])
            result[begin:end, begin:end] = lower + np.tril(lower, -1).T
            result[begin:end, end:] = result[end:, begin:end].T
        return result

    def invert_on_pattern(self) -> np.ndarray:
        """Return the blocks ``(blocks, p, p)`` of the inverse on the pattern."""
        result = np.empty((len(self._columns), self.size, self.size))
        above: dict[int, np.ndarray] = {}  # by child: the inverse for its parent's cameras, lower triangle

        def invert(front: Front) -> None:
            cameras, width = len(front.own) + len(front.border), len(front.own) * self.size
            inverse = allocate_zeros((cameras * self.size,) * 2)
            parent, outer = above.pop(id(front), inverse), inverse[width:, width:]
            for part, place in list_lower_parts(front.runs):
                outer[part] = parent[place]
            gain = dense.multiply_by_triangle(front.coupling, front.factor)
            pulled = dense.multiply_symmetric(outer, gain)
            inverse[width:, :width] = -pulled
            inverse[:width, :width] = dense.square_lower(front.factor)
            dense.add_product(inverse[:width, :width], gain, pulled)
            entries = front.entries
            values = inverse.reshape(cameras, self.size, cameras, self.size)[entries.row, :, entries.column, :]
            values[entries.transposed] = values[entries.transposed].transpose(0, 2, 1)
            result[entries.number] = values
            for child in front.children:
                above[id(child)] = inverse

        work_through_fronts(self.fronts, invert, from_root=True)
        diagonal = result[self._start[:-1]]  # the first block of each row
        above_it = np.triu_indices(self.size, 1)
        diagonal[:, above_it[0], above_it[1]] = diagonal[:, above_it[1], above_it[0]]
        result[self._start[:-1]] = diagonal
        return result
