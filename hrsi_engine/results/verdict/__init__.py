"""Verdict on an adjusted block: ok, doubtful or unusable, with its reasons and advice for each.

| module       | contains                                                                                 |
|--------------|------------------------------------------------------------------------------------------|
| verdict      | all checks, the worst level, and the accuracy in one sentence                            |
| evidence     | input of the checks: adjustment, residuals, refined RPCs; notes on systematic residuals  |
| significance | tests with a stated error probability                                                    |
| solution     | convergence, sigma0, corrections against their priors, refined RPCs against their models |
| ground_truth | GCPs, check points, laser points and DEM against the block                               |
| connections  | tie points of each image: rejected, too few, parts without GCPs, extrapolation           |
| fields       | systematic residuals of an image as a polynomial of the position                         |
| jitter       | waves of an image along its lines                                                        |

Each check yields `foundation.reasons.Reason`. A reason must be significant in a test with a stated error probability,
and large enough to matter: with ten thousand points the small systematic errors of any camera are significant.
"""

from .evidence import Evidence, describe_residual_fields
from .verdict import Verdict, find_reasons, summarise_accuracy

__all__ = ["Evidence", "Verdict", "describe_residual_fields", "find_reasons", "summarise_accuracy"]
