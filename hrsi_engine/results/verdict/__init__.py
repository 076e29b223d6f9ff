"""Verdict on an adjusted block: ok, doubtful or unusable, with its reasons and advice for each.

| module       | contains                                                                               |
|--------------|----------------------------------------------------------------------------------------|
| verdict      | all checks, the worst level, and the accuracy in one sentence                          |
| evidence     | input of the checks: adjustment, residuals, refined RPCs, systematic fields; tests     |
| solution     | convergence, sigma0, drifts against those of the sensors, refined RPCs, datums         |
| ground_truth | GCPs and check points against the block, and GCPs that are deformed as a whole         |
| heights      | laser points, DEM and surfaces against the block                                       |
| connections  | tie points of each image: rejected, too few, parts without GCPs, extrapolation         |
| jitter       | waves of an image along its lines                                                      |

Each check yields `foundation.reasons.Reason`. A reason must be significant in a test with a stated error probability,
and large enough to matter: with ten thousand points the small systematic errors of any camera are significant.
"""

from .evidence import Evidence, describe_residual_fields
from .verdict import Verdict, find_reasons, summarise_accuracy

__all__ = ["Evidence", "Verdict", "describe_residual_fields", "find_reasons", "summarise_accuracy"]
