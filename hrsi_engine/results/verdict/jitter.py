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
    significant = [
        (waves[0], image)
        for waves, image in zip(evidence.waves, block.images, strict=True)
        if waves and waves[0].amplitude_px >= JITTER.reported_px
    ]
    if not significant:
        return
    wave, image = max(significant, key=lambda one: one[0].amplitude_px)
    description = describe_waves(image, [wave])[0]
    size = f"{wave.amplitude_px:.2g} px ({description['amplitude_m']:.2g} m)"
    seconds = f" ({description['period_s']:.3g} s)" if description["period_s"] else ""
    ids = [image.id for _, image in significant]
    rays = block.rays_per_point()[block.points.role == Role.TIE]
    between = "; their tie points show only the difference of the vibrations" if np.median(rays) == 2.0 else ""
    yield Reason(
        "jitter",
        Level.DOUBTFUL,
        f"the residuals of image {list_ids(ids)} follow waves along the lines (jitter, a vibration of the attitude): "
        f"{image.id} has {size} {wave.axis} the track with a period of "
        f"{wave.period_lines:.0f} lines{seconds}{between if len(ids) > 1 else ''}",
        "choose auto for `jitter`, which estimates and removes it by dense tie points along all lines; no model of an "
        "RPC's correction follows it",
        images=tuple(ids),
    )


def find_remaining_jitter(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for jitter that the images do not separate from the ground, and that exceeds all other errors.

    Tie points show no vibration that moves all rays of a point in the same way: along the base it is a wave of the
    heights. Its size is that of the samples of the curves' errors at the tie points.
    """
    result = evidence.result
    if result.jitter is None or result.shared_shifts_m is None:
        return
    ties = np.flatnonzero(result.block.points.role == Role.TIE)
    ties = ties[np.isfinite(result.ground_covariance_m2[ties]).all(axis=(1, 2))]
    if not len(ties):
        return
    squares = np.mean(result.shared_shifts_m[ties] ** 2, axis=0)  # (3, e), those of the jitter last
    of_jitter = squares[:, -len(result.jitter.samples) :].sum(axis=1)
    others = result.ground_covariance_m2[ties].diagonal(axis1=1, axis2=2).mean(axis=0)
    others = others + squares[:, : -len(result.jitter.samples)].sum(axis=1)
    axes = {"positions in plan": slice(0, 2), "heights": slice(2, 3)}
    found = [
        f"{name} of {np.sqrt(of_jitter[axis].sum()):.2g} m (standard deviation; all other errors: "
        f"{np.sqrt(others[axis].sum()):.2g} m)"
        for name, axis in axes.items()
        if of_jitter[axis].sum() > others[axis].sum()
    ]
    if found:
        period = 2.0 * np.pi / result.jitter.priors[0, 0]
        yield Reason(
            "jitter",
            Level.DOUBTFUL,
            f"jitter with a period of about {period:.0f} lines was removed, but the images do not separate all of it "
            f"from the ground: it leaves waves in the {' and in the '.join(found)}; CE90 and LE90 contain them",
            "give a surface, laser points or more GCPs along the lines, or an image from another direction",
            images=tuple(result.jitter.curves),
        )
