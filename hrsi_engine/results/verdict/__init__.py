"""One verdict on an adjusted block: ok, doubtful or unusable, with the reasons and what to do about each.

| module        | asks                                                                                        |
|---------------|---------------------------------------------------------------------------------------------|
| verdict       | what it all comes to: the worst level, and one sentence of what was reached                 |
| evidence      | what is judged: the adjustment, its residuals, the refined RPCs                             |
| significance  | tests with a stated error probability                                                       |
| solution      | did it converge, do the residuals fit their sigmas, do the corrections fit their priors     |
| ground_truth  | do GCPs and check points agree with the block as well as they should                        |
| connections   | what holds each image: ties left out, weak and missing links, parts without control         |
| fields        | polynomial fields left in the residuals of an image, and the model that removes each        |
| systematic    | what they mean                                                                              |

Each check yields `foundation.reasons.Reason`. A reason is significant by a test with a stated error probability, and
large enough to matter: a block of ten thousand points finds the harmless structure of any camera significant.
"""

from .evidence import Evidence
from .systematic import describe_residual_fields
from .verdict import Verdict, find_reasons, judge, summarise_accuracy

__all__ = ["Evidence", "Verdict", "describe_residual_fields", "find_reasons", "judge", "summarise_accuracy"]
