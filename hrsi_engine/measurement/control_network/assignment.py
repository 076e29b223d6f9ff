"""One-to-one assignment of candidates: the pairs that are each other's best."""

import numpy as np


def find_mutual_best(first: np.ndarray, second: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Return the indices ``(j,)`` of the candidate pairs ``(k,)`` that cost both their points least.

    Equal costs are settled by the lower numbers of the points.
    """
    order = np.lexsort((second, first, cost))
    best_of_first = np.unique(first[order], return_index=True)[1]
    best_of_second = np.unique(second[order], return_index=True)[1]
    return order[np.intersect1d(best_of_first, best_of_second, assume_unique=True)]
