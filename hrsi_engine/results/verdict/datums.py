"""Coordinate operations: does the loss by a missing grid or geoid exceed the accuracy of the block?"""

from collections.abc import Iterator

from ...adjustment.outcome.area_accuracy import MOST_POINTS
from ...adjustment.statistics.precision import predict_accuracy
from ...foundation.reasons import Level, Reason
from ...ground.geoids import GEOID
from ...ground.operation_uses import advise_grids, describe_missing_grid, describe_substitute
from .evidence import Evidence


def find_missing_grids(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for missing grids and substituted geoids, if their loss exceeds the block's CE90 or LE90."""
    # CE90 and LE90 of the block's points, without the errors of coordinate operations
    covariance = evidence.result.ground_covariance_m2
    accuracy = predict_accuracy(covariance[:: -(-len(covariance) // MOST_POINTS) or 1])
    least = min((value for key in ("ce90_m", "le90_m") if (value := accuracy[key]) is not None), default=0.0)
    for use in evidence.result.block.all_operations:
        for code, text, loss_m, limit_m in (
            ("datum-grid-missing", describe_missing_grid(use), use.loss_m, least),
            ("geoid-substituted", describe_substitute(use), GEOID.substitute_sigma_m, accuracy["le90_m"] or 0.0),
        ):
            if text and not loss_m <= limit_m:
                yield Reason(code, Level.DOUBTFUL, text, advise_grids(use))


def find_ballpark_operations(evidence: Evidence) -> Iterator[Reason]:
    """Yield reasons for datums without a PROJ operation to WGS84, which are treated as equal: errors up to 1 km."""
    for use in evidence.result.block.all_operations:
        if use.operation.is_ballpark:
            yield Reason(
                "horizontal-datum",
                Level.DOUBTFUL,
                f"{use.source}: PROJ has no operation from {use.crs} to WGS84, so the two are treated as equal",
                "convert the source to WGS84 with the parameters of the national survey before the run",
            )


#: Every check of the coordinate operations.
ON_DATUMS = (find_missing_grids, find_ballpark_operations)
