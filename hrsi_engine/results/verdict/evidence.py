"""What is judged: the adjustment with all that is known of it, its residuals and the RPCs that would be written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...adjustment.result import Adjustment, Decision
from ...block.block import Role
from ...refinement.model import RefitRPC
from ..residuals import Residuals
from .fields import ResidualField, find_residual_fields

CAMERA_PX = 0.5  # what a camera's own unmodelled errors may leave in sample and in line, beside the measurement's


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a verdict is found from.

    Parameters
    ----------
    result : Adjustment
        The adjustment.
    left : Residuals
        What it left over.
    refined : sequence of RefitRPC
        The RPCs that would be written, one an image.
    """

    result: Adjustment
    left: Residuals
    refined: Sequence[RefitRPC]

    @cached_property
    def row_role(self) -> np.ndarray:
        """Role of the point of each measurement, ``(n,)``."""
        block = self.result.block
        return block.points.role[block.measurements.point]

    @cached_property
    def left_out(self) -> np.ndarray:
        """Which measurements data snooping left out, ``(n,)``."""
        return self.result.decision != int(Decision.KEPT)

    @cached_property
    def fields(self) -> list[ResidualField]:
        """The significant fields in the residuals of images that were adjusted, the largest first."""
        used = self.result.took_part & ~self.left_out
        image = self.result.block.measurements.image
        held = np.bincount(image[used & ~self.is_role(Role.CHECK)], minlength=len(self.result.block.images)) > 0
        return find_residual_fields(self.result, used & held[image])

    @cached_property
    def field_px(self) -> float:
        """RMS (two dimensions) of the largest field in an image, 0 without any."""
        return self.fields[0].rms_px if self.fields else 0.0

    @cached_property
    def camera_px(self) -> float:
        """Standard deviation of what the cameras leave in sample and in line, the fields told elsewhere included."""
        return float(np.hypot(CAMERA_PX, self.field_px / np.sqrt(2.0)))

    def is_role(self, role: Role) -> np.ndarray:
        """Tell which measurements are of points of a role.

        Parameters
        ----------
        role : Role
            The role.

        Returns
        -------
        (measurements,) ndarray
            Booleans.
        """
        return self.row_role == role
