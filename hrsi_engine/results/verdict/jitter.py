"""The reason for jitter: waves along the lines, which neither an RPC nor its correction represents."""

from collections.abc import Iterator

import numpy as np

from ...block.block import Role
from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from ...foundation.thresholds import threshold, thresholds
from ..line_profiles import describe_waves
from .evidence import Evidence


@thresholds
class JITTER:
    """Limit for jitter that is reported."""

    reported_px: float = threshold(
        0.15, "px", "smallest amplitude that is reported", "purpose: y-parallax tolerated by DSM matching"
    )


def find_jitter(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for images whose residuals contain waves along their lines."""
    block = evidence.result.block
    found = [
        (waves[0], image)
        for waves, image in zip(evidence.waves, block.images, strict=True)
        if waves and waves[0].amplitude_px >= JITTER.reported_px
    ]
    if not found:
        return
    wave, image = max(found, key=lambda one: one[0].amplitude_px)
    told = describe_waves(image, [wave])[0]
    size = f"{wave.amplitude_px:.2g} px ({told['amplitude_m']:.2g} m)"
    seconds = f" ({told['period_s']:.3g} s)" if told["period_s"] else ""
    ids = [image.id for _, image in found]
    rays = block.rays_per_point()[block.points.role == Role.TIE]
    between = "; their tie points show only the difference of the vibrations" if np.median(rays) == 2.0 else ""
    yield Reason(
        "jitter", Level.DOUBTFUL,
        f"the residuals of image {list_ids(ids)} follow waves along the lines (jitter, a vibration of the attitude): "
        f"{image.id} has {size} {wave.axis} the track with a period of "
        f"{wave.period_lines:.0f} lines{seconds}{between if len(ids) > 1 else ''}",
        "choose auto for `jitter`, which estimates and removes it by dense tie points along all lines; no model of an "
        "RPC's correction follows it",
        images=tuple(ids),
    )  # fmt: skip


ON_JITTER = (find_jitter,)
