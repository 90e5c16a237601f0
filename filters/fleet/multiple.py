"""Many tests at once: Holm's correction, by which any false discovery among all is as rare as the level says."""

import numpy as np

from filters.types import Array


def holm(p: Array) -> Array:
    """Probabilities corrected for their number; they hold however the tests depend on each other.

    In rising order, p_(k) becomes the greatest of min(1, (n - l + 1) p_(l)) for l = 1 to k.

    `p`: shape (n,), each between 0 and 1.

    References
    ----------
    S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6, 1979.
    """
    order = np.argsort(p)
    raised = np.minimum(1.0, (p.size - np.arange(p.size)) * p[order])
    made = np.empty(p.size)
    made[order] = np.maximum.accumulate(raised)
    return made
