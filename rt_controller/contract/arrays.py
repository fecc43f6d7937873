"""The array type of all packages."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
