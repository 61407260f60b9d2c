"""Types shared by signatures."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# What runs over any scalar: floats, dual numbers, SymPy symbols, traced expressions (Expr).
Scalar: TypeAlias = Any
Vector: TypeAlias = NDArray[Any]  # of scalars, one axis
Matrix: TypeAlias = NDArray[Any]  # of scalars, two axes or more
