"""Images refined separately, combined as the result of an adjustment without common points.

So the residuals, tables, layers and reports of a block can be used for them, too. Every image keeps its own model.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..adjustment.observations import select_points
from ..adjustment.result import Adjustment, CameraEstimates, Decision
from ..adjustment.starting_values.intersection import intersect_points
from ..block.block import Block, Image
from ..block.columns import match_names
from ..block.points import Role
from ..refinement.model import Equations, Linearise, Priors, RefinementModel, RefitRPC
from ..refinement.refine import Refinement


@dataclass(frozen=True, eq=False)
class PerImage:
    """A model that is a different one for each image; values beyond an image's own parameters are ignored."""

    models: dict[str, RefinementModel]
    name: str = "auto"
    title: str = "each image has its own model"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Placeholders: the parameters' actual names are those of each image's model."""
        return tuple(f"p_{k + 1}" for k in range(max(len(model.parameters) for model in self.models.values())))

    @property
    def least_points(self) -> int:
        """The largest number of any image's model."""
        return max(model.least_points for model in self.models.values())

    @property
    def drifts(self) -> np.ndarray:
        """Not defined for different models: all False."""
        return np.zeros(len(self.parameters), dtype=bool)

    def prior_sigmas(self, image: Image, priors: Priors) -> np.ndarray:
        """Return those of the image's model, 0 for parameters that it does not have."""
        model_sigmas = self.models[image.id].prior_sigmas(image, priors)
        return np.concatenate([model_sigmas, np.zeros(len(self.parameters) - len(model_sigmas))])

    def equations(self, image: Image, observed_px: np.ndarray) -> Linearise:
        """Return the equations of the image's model."""
        model = self.models[image.id]
        part = model.equations(image, observed_px)
        count, total = len(model.parameters), len(self.parameters)

        def linearise(values: np.ndarray, ground: np.ndarray) -> Equations:
            linearised = part(values[:count], ground)
            return linearised._replace(by_values=np.pad(linearised.by_values, ((0, 0), (0, 0), (0, total - count))))

        return linearise

    def project(self, image: Image, values: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Return the projection by the image's model."""
        model = self.models[image.id]
        return model.project(image, values[: len(model.parameters)], ground)

    def compute_refined_rpc(self, image: Image, values: np.ndarray) -> RefitRPC:
        """Return the new RPC of the image's model."""
        model = self.models[image.id]
        return model.compute_refined_rpc(image, values[: len(model.parameters)])


def separate_result(block: Block, refinements: Sequence[Refinement]) -> Adjustment:
    """Return refinements, one for each image of the block in its order, as an adjustment.

    Known points on several images are intersected with the refined cameras; no other positions are computed.
    """
    names = {result.model.name for result in refinements}
    model = (
        refinements[0].model if len(names) == 1 else PerImage({result.image.id: result.model for result in refinements})
    )
    values = _pad_rows([result.estimate.values for result in refinements], len(model.parameters))
    sigmas = _pad_rows([result.estimate.sigmas for result in refinements], len(model.parameters))
    covariance = np.zeros((len(refinements), values.shape[1], values.shape[1]))  # 0: not in an image's model
    for place, result in zip(covariance, refinements, strict=True):
        count = len(result.estimate.values)
        place[:count, :count] = result.estimate.covariance
    # Residuals of the measurements that were used, and weights 1 or 0
    points, rows, measured = len(block.points), len(block.measurements), block.measurements
    residual, weight = np.full((rows, 2), np.nan), np.zeros(rows)
    for index, result in enumerate(refinements):
        indices = np.flatnonzero(measured.image == index)
        row, identical = match_names(block.points.ids[measured.point[indices]], result.control.ids)
        residual[indices[identical]] = result.estimate.residual_px[row[identical]]
        weight[indices[identical]] = 1.0
    redundancy = sum(result.estimate.redundancy for result in refinements)
    squares = sum(result.estimate.sigma0**2 * result.estimate.redundancy for result in refinements)
    converged = all(result.estimate.converged for result in refinements)
    # Positions of the known points measured on several images, NaN for others
    ground = np.full((len(block.points), 3), np.nan)
    several = block.known & (block.rays_per_point() >= 2)
    if several.any():
        observations = select_points(block, several)
        ground[observations.points] = intersect_points(
            observations, model, values, block.points.ground[observations.points]
        )
    # The shifts of `Adjustment` for images with GCPs only: the mean of theirs, at every point
    of_gcps = block.points.operation_shifts_m(np.flatnonzero(block.points.role == Role.GCP))
    shifts_m = (
        None if not of_gcps.any() else np.broadcast_to(of_gcps.mean(axis=0), (len(block.points), *of_gcps.shape[1:]))
    )
    return Adjustment(
        block=block, model=model, values=values, values_sigma=sigmas,
        cameras=CameraEstimates(model, values, covariance),
        ground=ground,
        ground_sigma_m=np.full((points, 3), np.nan),
        ground_covariance_m2=np.full((points, 3, 3), np.nan),
        residual_px=residual, weight=weight,
        redundancy_numbers=np.full((rows, 2), np.nan),
        statistic=np.full(rows, np.nan),
        decision=np.full(rows, int(Decision.KEPT), dtype=np.int8),
        sigma0=float(np.sqrt(squares / redundancy)) if redundancy > 0.5 else 1.0,
        observations=2 * sum(len(result.control) for result in refinements),
        unknowns=sum(len(result.model.parameters) for result in refinements),
        redundancy=redundancy, converged=converged,
        status="converged" if converged else "stopped at the iteration limit",
        history=(), solves=0, findings=(), variance_components=(), parts=(), cross_validation=None,
        warnings=tuple(warning for result in refinements for warning in result.warnings),
        shared_shifts_m=shifts_m,
    )  # fmt: skip


def _pad_rows(rows: Sequence[np.ndarray], width: int) -> np.ndarray:
    return np.array([np.pad(row, (0, width - len(row))) for row in rows]).reshape(len(rows), width)
