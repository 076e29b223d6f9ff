"""The cameras of an earlier adjustment as a prior, with the correlations between them.

An adjustment ends with the reduced normal matrix S of its cameras (`equations`), priors included, at the values c. For
later measurements of other points this is all information of the earlier observations: their cost above its minimum is

    (x - c)' S (x - c) / 2

as far as the equations are linear. S has blocks only for pairs of cameras that share a point, while its inverse, the
covariance, is full: therefore S is stored. Added to the normal equations of the new points, it gives the result of one
adjustment of all observations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ...foundation.errors import InputError, list_ids
from ..equations import Normals, Pattern
from ..observations import Observations


@dataclass(frozen=True, eq=False)
class JointCameras:
    """Estimates of k images with c cameras of p parameters, including the drift that their model does not contain.

    images : (k,) ids
    camera : (k,) number of each image's camera
    parameters : (p,) names
    values : (c, p) at which S was formed
    rows, columns, blocks : (b,), (b,), (b, p, p) of the upper half of S, diagonal blocks first in each row
    fixed : (c, p) parameters that were not estimated
    squares : (c, p, p) weighted squares of the derivatives at the measurements (`delivery`)
    gcps : (k,) number of GCPs of the part of the block that contains the image
    """

    images: tuple[str, ...]
    camera: np.ndarray
    parameters: tuple[str, ...]
    values: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    blocks: np.ndarray
    fixed: np.ndarray
    squares: np.ndarray
    gcps: np.ndarray


@dataclass(frozen=True, eq=False)
class JointPrior:
    """Earlier cameras as a prior in a new block; ``camera (c,)`` are their indices among its cameras."""

    known: JointCameras
    camera: np.ndarray

    @classmethod
    def select_cameras(cls, earlier: JointCameras, observations: Observations) -> JointPrior:
        """Return the prior for a block; raise `InputError` if images of the earlier adjustment are missing in it."""
        place = {image.id: index for index, image in enumerate(observations.images)}
        missing = [name for name in earlier.images if name not in place]
        if missing:
            raise InputError(f"the block has no image {list_ids(missing)}, which the earlier adjustment contains")
        camera = np.empty(len(earlier.values), dtype=np.int64)
        camera[earlier.camera] = observations.camera_of_image[[place[name] for name in earlier.images]]
        return cls(earlier, camera)

    @property
    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of connected cameras, each with itself included: rows and columns, ``row <= column``."""
        rows, columns = self.camera[self.known.rows], self.camera[self.known.columns]
        return np.minimum(rows, columns), np.maximum(rows, columns)

    def require_parameters(self, parameters: tuple[str, ...]) -> None:
        """Raise `InputError` if the block's cameras have other parameters than the earlier ones."""
        if parameters != self.known.parameters:
            raise InputError(
                f"the earlier cameras have the parameters {', '.join(self.known.parameters)}, the block's are "
                f"{', '.join(parameters)}: use `model` and `sigma_drift` of the earlier adjustment, or set "
                "`earlier_cameras` to free"
            )

    def enter_start(self, start: np.ndarray, prior_weight: np.ndarray) -> None:
        """Enter the values into ``start (cameras, p)``, and remove these cameras' own ``prior_weight (cameras, p)``."""
        start[self.camera] = self.known.values
        prior_weight[self.camera] = np.where(np.isinf(prior_weight[self.camera]) | self.known.fixed, np.inf, 0.0)

    def add_to(self, normals: Normals, values: np.ndarray, pattern: Pattern) -> None:
        """Add the prior at ``values (cameras, p)`` to the reduced normal equations."""
        earlier, (rows, columns), blocks = self.known, self.pairs, self._turn_blocks()
        merged = (rows == columns) & (earlier.rows != earlier.columns)  # two cameras that share parameters now
        blocks[merged] += blocks[merged].transpose(0, 2, 1)
        np.add.at(normals.blocks, pattern.find_blocks(rows, columns), blocks)
        np.subtract.at(normals.right, self.camera, self._gradient(values))

    def compute_cost(self, values: np.ndarray) -> float:
        """Return half the weighted sum of squares of the prior at ``values (cameras, p)``."""
        return 0.5 * float(np.sum((values[self.camera] - self.known.values) * self._gradient(values)))

    def count_parameters(self, cofactors: np.ndarray, pattern: Pattern) -> float:
        """Return the number of parameters determined by the prior: trace of S Q, for ``cofactors`` on the pattern."""
        earlier = self.known
        rows, columns = self.pairs
        traces = np.einsum("bij,bij->b", self._turn_blocks(), cofactors[pattern.find_blocks(rows, columns)])
        return float(np.sum(np.where(earlier.rows == earlier.columns, traces, 2.0 * traces)))

    def _turn_blocks(self) -> np.ndarray:
        """Return the blocks of S in the order of `pairs`."""
        turned = (self.camera[self.known.rows] > self.camera[self.known.columns])[:, None, None]
        return np.where(turned, self.known.blocks.transpose(0, 2, 1), self.known.blocks)

    def _gradient(self, values: np.ndarray) -> np.ndarray:
        """Return S (x - c), ``(c, p)``."""
        earlier, difference = self.known, values[self.camera] - self.known.values
        size, cameras = earlier.values.size, len(earlier.values)
        start = np.searchsorted(earlier.rows, np.arange(cameras + 1))
        upper = sparse.bsr_matrix((earlier.blocks, earlier.columns, start), shape=(size, size))
        above = np.where((earlier.rows == earlier.columns)[:, None, None], 0.0, earlier.blocks)
        lower = sparse.bsr_matrix((above, earlier.columns, start), shape=(size, size)).T
        return np.asarray(upper @ difference.ravel() + lower @ difference.ravel()).reshape(difference.shape)
