"""Floating-point types of LLVM IR: literals, limits, coefficients of functions."""

from ctypes import c_float
from dataclasses import dataclass
import math
import struct
import sys

# Minimax coefficients of sin(r)/r and cos(r) in r^2 on |r| <= pi/4, those of fdlibm's
# kernels.
SIN = (-1.66666666666666324348e-01, 8.33333333332248946124e-03,
       -1.98412698298579493134e-04, 2.75573137070700676789e-06,
       -2.50507602534068634195e-08, 1.58969099521155010221e-10)
COS = (4.16666666666666019037e-02, -1.38888888888741095749e-03,
       2.48015872894767294178e-05, -2.75573143513906633035e-07,
       2.08757232129817482790e-09, -1.13596475577881948265e-11)
# exp(r) = 1 + r + r^2 (1/2! + r/3! + ...): the Taylor tail past r^13 is under 1e-17 for
# ln(2)/2.
EXP = tuple(1.0 / math.factorial(k) for k in range(2, 14))
# Interpolated at Chebyshev nodes: (2 artanh(s) - 2 s) / s^3 in s^2 up to sqrt(2), and
# (arctan(r) - r) / r^3 in r^2 up to tan(pi/8); both leave less than 4e-17.
LOG = (0.6666666666666666, 0.4000000000000088, 0.28571428570803614, 0.22222222391713917,
       0.18181795640132906, 0.15386239702814658, 0.13268773138656886,
       0.13086626147840102)
ARCTAN = (-0.3333333333333333, 0.1999999999999552, -0.14285714284666542,
          0.11111111015256361, -0.09090904578123903, 0.07692183190826087,
          -0.06664511447381948, 0.0585814891280221, -0.0508544973794026,
          0.03923165829558719, -0.01917688711906226)
# log 2: its leading bits and the rest.
LN2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
# Largest position accepted, rad or m. Neighboring doubles of this size are 1e-4 apart.
# The range reduction of sin and cos fails at 1e15; the margin covers sums and multiples
# of positions.
POSITION_LIMIT = 1e12


@dataclass(frozen=True)
class Real:
    """
    A floating-point type of LLVM, with what its elementary functions need.

    Attributes
    ----------
    name : str
        LLVM's name.
    bits, mantissa : int
        Of a number; of its mantissa without the leading one.
    largest, smallest : float
        Of the finite and of the positive normal numbers.
    half_pi, log_2 : two floats
        Leading part and rest of pi/2 and of log 2.
    exp_range : two floats
        Beyond these, exp is 0 or infinity.
    sine, cosine, exp, log, arctan : tuples of float
        The terms of SIN, COS, EXP, LOG and ARCTAN that are used.
    position_limit : float
        Largest position accepted, rad or m.

    """

    name: str
    bits: int
    mantissa: int
    largest: float
    smallest: float
    half_pi: tuple[float, float]
    log_2: tuple[float, float]
    exp_range: tuple[float, float]
    sine: tuple[float, ...]
    cosine: tuple[float, ...]
    exp: tuple[float, ...]
    log: tuple[float, ...]
    arctan: tuple[float, ...]
    position_limit: float

    @property
    def bias(self) -> int:
        """Return the bias of the exponent."""
        return (1 << self.bits - self.mantissa - 2) - 1

    @property
    def round(self) -> float:  # noqa: A003
        """Return a number whose addition rounds to the nearest integer."""
        return 1.5 * 2.0**self.mantissa

    @property
    def sqrt_half(self) -> int:
        """Return the bits of sqrt(1/2)."""
        kind = '<qd' if self.bits == 64 else '<if'
        content = struct.pack(f'<{kind[2]}', math.sqrt(0.5))
        number: int = struct.unpack(kind[:2], content)[0]
        return number

    def size_limit(self, argument: str) -> float:
        """Return the largest absolute value allowed in the argument of this name."""
        return self.position_limit if argument in ('q', 'q0') else math.inf

    def literal(self, value: float) -> str:
        """Return a number of this type as an LLVM hexadecimal literal, bit for bit."""
        value = float(value) if self.bits == 64 else c_float(value).value
        return f'0x{struct.unpack("<Q", struct.pack("<d", value))[0]:016X}'


DOUBLE = Real('double', 64, 52, sys.float_info.max, sys.float_info.min,
              (1.5707963267948966, 6.123233995736766e-17), LN2, (-746.0, 710.0),
              SIN, COS, EXP, LOG, ARCTAN, POSITION_LIMIT)
# Neighboring floats are 1e-3 apart at its largest position. Terms that are left out are
# under 3e-9 of the result.
FLOAT = Real('float', 32, 23, 2.0**128 - 2.0**104, 2.0**-126,
             (1.57079637050628662109375, -4.37113900018624283e-8),
             (0.693359375, -2.12194440054690583e-4), (-104.0, 89.0), SIN[:4], COS[:4],
             EXP[:7], LOG[:4], ARCTAN[:8], 1e4)
# Of doubles, which all code uses that names no other type.
literal = DOUBLE.literal
size_limit = DOUBLE.size_limit


def overflow_scale(most: float, real: Real = DOUBLE) -> float:
    """Return a factor by which numbers larger than `most` overflow to infinity."""
    return 1.0 if math.isinf(most) else real.largest / most


def splat(value: float, width: int, real: Real = DOUBLE) -> str:
    """Return a constant vector with the value in every lane (a scalar for width 1)."""
    number = real.literal(value)
    return number if width == 1 else constant_vector(real.name, number, width)


def constant_vector(element: str, value: str, width: int) -> str:
    """
    Return a constant vector with the value in every lane.

    Every lane is written out, since the shorter `splat (value)` needs LLVM 18.

    Parameters
    ----------
    element, value : str
        LLVM's type and literal of one lane.
    width : int
        Number of lanes.

    """
    lanes = ', '.join([f'{element} {value}'] * width)
    return f'<{lanes}>'


def vector_type(width: int, real: Real = DOUBLE) -> str:
    """Return the LLVM type of `width` numbers; a scalar for width 1."""
    return real.name if width == 1 else f'<{width} x {real.name}>'


def intrinsic_end(width: int, real: Real = DOUBLE) -> str:
    """Return the end of the name of an LLVM intrinsic of `width` numbers."""
    return f'f{real.bits}' if width == 1 else f'v{width}f{real.bits}'
