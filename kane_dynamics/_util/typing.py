"""Types shared by signatures."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# What runs over any scalar: floats, dual numbers, SymPy symbols, traced expressions
# (Expr). For the reader: NumPy's types of arrays of objects return Any from every
# operation.
Scalar: TypeAlias = Any
Vector: TypeAlias = Any  # array of scalars, one axis
Matrix: TypeAlias = Any  # array of scalars, two axes or more
