"""A surface as control of a block without GCPs: its relief determines the block's position in plan, too.

The tie points of a part of the block are matched with the surface as a whole (`surface.matching`): before the
adjustment from their positions by the original RPCs, over all displacements in the search range, and in every pass from
their positions by the rays alone. With the cofactors Q of the adjusted points, their weights W and targets p these are

    x - Q' W (p - x)        with Q' = (Q^-1 - W)^-1

The remaining displacement d, with the covariance C of the matching and the surface's own error H in plan, is one
observation of the block's position: each of its k points is observed at ``x + d`` with the weight matrix ``(C + H)^-1 /
k``, so that together they have the weight of one displacement. Heights are observed by the surface at the new positions
of the points (`heights`).

If the displacement exceeds the a priori accuracy of the RPCs, their priors are too narrow and would pull the block
back: they are widened by the square of the ratio (a redescending prior).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...block.block import Image
from ...block.pointing import estimate_pointing
from ...foundation.large_arrays import finite_rows
from ...foundation.robust_scale import ROBUST, robust_sigma
from ...foundation.thresholds import EQUALITY, ITERATIONS, REDUNDANCY, SAMPLES, threshold, thresholds
from ...ground.geodesy import ground_difference_m, move_ground
from ...ground.operation_uses import largest_sigma_m
from ...surface.dem import HeightSurface, cell_size_m
from ...surface.matching import SurfaceMatch, SurfaceMatcher, match_surface
from ..equations import PointPriors
from ..source_results import SurfaceOutcome
from .heights import HEIGHTS


@thresholds
class SURFACE_FIT:
    """Limits for the use of a surface as control of a block's position in plan."""

    cells_off: float = threshold(
        0.1, "cells", "standard deviation of a DEM's position in plan, each axis", "GLO-30: CE90 6 m, or 2.8 m of 30 m"
    )
    flat: float = threshold(0.7, "", "largest scatter of misclosures relative to that of heights; else ground is flat")


def estimate_cell_noise_m(sigma_m: float) -> float:
    """Return the noise of single cells: a DEM's standard deviation without its error common to all cells."""
    return float(np.sqrt(1.0 - HEIGHTS.dem_whole**2)) * sigma_m


@dataclass(eq=False)
class SurfacePlan:
    """Observation of the plan position of a part of a block by the relief under its tie points.

    images : ids of the part's images; points : (k,) indices of its tie points
    sigma_m : standard deviation of the surface's heights; pointing_m : of the images' plan position by their RPCs
    before : (k, 3) the points by the original RPCs; first : their match with the surface
    relief_m : robust standard deviation of the points' heights
    """

    images: tuple[str, ...]
    surface: HeightSurface
    points: np.ndarray
    sigma_m: float
    kind: str
    search_m: float
    pointing_m: float
    before: np.ndarray
    first: SurfaceMatch
    relief_m: float
    cell_m: float
    last: SurfaceMatch
    _at: np.ndarray | None = None
    _matches: int = 0

    @classmethod
    def match_points(
        cls,
        images: Sequence[Image],
        surface: HeightSurface,
        points: np.ndarray,
        ground: np.ndarray,
        sigma_m: float,
        kind: str,
        search_m: float,
    ) -> SurfacePlan | None:
        """Return the relief under ``points (k,)`` of ``ground (m, 3)``, after its search; None if there is no match."""
        positions = ground[points]
        first = match_surface(positions, surface, search_m, kind, estimate_cell_noise_m(sigma_m))
        if first is None:
            return None
        relief_m = float(robust_sigma(positions[:, 2] - np.median(positions[:, 2])))
        pointing_m = float(np.median([estimate_pointing(image).sigma_m for image in images]))
        return cls(
            images=tuple(image.id for image in images),
            surface=surface,
            points=points,
            sigma_m=sigma_m,
            kind=kind,
            search_m=search_m,
            pointing_m=pointing_m,
            before=positions,
            first=first,
            relief_m=relief_m,
            cell_m=cell_size_m(surface, positions[0]),
            last=first,
        )

    @property
    def why_open(self) -> str:
        """Reason why the relief does not determine the block's position in plan; empty if it does."""
        match = self.first
        if match.scatter_m > max(EQUALITY.majority * self.relief_m, ROBUST.outlier * self.sigma_m):
            return f"it does not show this terrain (a scatter of {match.scatter_m:.1f} m remains)"
        if match.scatter_m > SURFACE_FIT.flat * self.relief_m:
            return f"the ground is flat: its relief of {self.relief_m:.1f} m is not larger than the misclosures"
        if match.cells < SAMPLES.fewest:
            return f"only {match.cells:.0f} of its parts are independent"
        if not match.is_decided:
            return "another displacement fits equally well"
        along_m = float(np.sqrt(np.linalg.eigvalsh(match.covariance_m2[:2, :2])[1]))
        if along_m > self.pointing_m:
            return (
                f"the displacement is determined to {along_m:.1f} m only (standard deviation along the weakest "
                "direction)"
            )
        return ""

    @property
    def covariance_m2(self) -> np.ndarray:
        """Covariance ``(3, 3)`` of the block's position by the surface, including the surface's own position error."""
        datum_m, vertical_m = largest_sigma_m(getattr(self.surface, "operations", ()))
        shared_m2, cells_m2 = (HEIGHTS.dem_whole * self.sigma_m) ** 2, (SURFACE_FIT.cells_off * self.cell_m) ** 2
        own_m2 = np.array([cells_m2 + datum_m**2, cells_m2 + datum_m**2, shared_m2 + vertical_m**2])
        return np.asarray(self.last.covariance_m2 + np.diag(own_m2))

    @property
    def widening(self) -> float:
        """Factor of the prior standard deviations of the images' pointing by the displacement, at least 1.

        The priors are independent errors of single images, so that the expected error of the part is smaller.
        """
        return 1.0 if self.why_open else max(1.0, self._beyond(self.pointing_m / np.sqrt(len(self.images))) ** 2)

    def _beyond(self, pointing_m: float) -> float:
        """Return the displacement in plan in units of its standard deviation (including that of the RPCs)."""
        displacement = self.first.displacement_m[:2]
        expected = self.covariance_m2[:2, :2] + pointing_m**2 * np.eye(2)
        return float(np.sqrt(displacement @ np.linalg.solve(expected, displacement)))

    def enter_start(self, priors: PointPriors, ground: np.ndarray) -> PointPriors:
        """Return the initial priors with the observed plan position."""
        return priors if self.why_open else self._observe(priors, ground, self.first.displacement_m)

    def add_to_priors(self, priors: PointPriors, ground: np.ndarray, cofactors: np.ndarray) -> PointPriors:
        """Return the priors with the plan position by the surface; as `HeightObservations.add_to_priors`."""
        if self.why_open:
            return priors
        # The points by the rays alone, and the variances of their heights
        positions, Q = ground[self.points], cofactors[self.points]
        W = (1.0 - REDUNDANCY.tested) * priors.build_weight_matrices(self.points)
        by_rays = np.linalg.inv(np.linalg.inv(Q) - W)
        pulled = np.einsum("kij,kjl,kl->ki", by_rays, W, priors.compute_misclosures_m(positions, self.points))
        return self._observe(priors, ground, self._match_again(*(move_ground(positions, -pulled), by_rays[:, 2, 2])))

    def _match_again(self, by_rays: np.ndarray, variance_m2: np.ndarray) -> np.ndarray:
        """Return the remaining displacement ``(3,)``; it is estimated again if the block has moved."""
        usable = finite_rows(by_rays) & (variance_m2 < self.search_m**2)
        now = np.median(by_rays, axis=0)
        block_shift = np.zeros(3) if self._at is None else ground_difference_m(now[None], self._at[None])[0]
        start = (np.zeros(3) if self._at is None else self.last.displacement_m) - block_shift
        has_moved = self._at is None or np.abs(block_shift).max() > ITERATIONS.coarse * self.cell_m
        if has_moved and self._matches < ITERATIONS.most:
            self._matches += 1
            noise_m = estimate_cell_noise_m(self.sigma_m)
            matcher = SurfaceMatcher(by_rays[usable], self.surface, self.kind, variance_m2[usable], noise_m)
            new_match = matcher.refine(start, self.search_m)
            if new_match is None:
                return start
            # A match that leaves the search range or its last minimum is not used
            before = np.median(self.before, axis=0)
            total_shift = ground_difference_m(now[None], before[None])[0] + new_match.displacement_m
            is_inside = np.abs(total_shift[:2]).max() <= self.search_m + self.cell_m
            if is_inside and not new_match.is_apart_from(replace(self.last, displacement_m=start), self.cell_m):
                self.last, self._at = new_match, now
                return new_match.displacement_m
        return start

    def _observe(self, priors: PointPriors, ground: np.ndarray, left_m: np.ndarray) -> PointPriors:
        """Return the priors with each point observed in plan at ``left_m (3,)`` from its present position."""
        target, weight = priors.target.copy(), priors.weight.copy()
        mixed = priors.mixed.copy() if priors.correlated else np.zeros_like(weight)
        point_weight = np.linalg.inv(self.covariance_m2[:2, :2]) / len(self.points)
        target[self.points, :2] = move_ground(ground[self.points], np.append(left_m[:2], 0.0))[:, :2]
        weight[self.points, :2] = point_weight.diagonal()
        mixed[self.points, 0] = point_weight[0, 1]
        return replace(priors, target=target, weight=weight, mixed=mixed)

    def summarise(self, points: np.ndarray) -> SurfaceOutcome:
        """Return the surface's result for the part; ``points (m, 3)`` are the positions of all points of the block."""
        return SurfaceOutcome(
            images=self.images,
            match=self.first,
            left_m=self.last.displacement_m,
            covariance_m2=self.covariance_m2,
            open=self.why_open,
            pointing_m=self.pointing_m,
            beyond_pointing=self._beyond(self.pointing_m),
            surface=self.surface,
            points=points[self.points],
            before=self.before,
        )
