"""The array type of this package: float64, shapes in the docstrings."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
