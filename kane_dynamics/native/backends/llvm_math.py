"""Elementary functions as LLVM assembly, several arguments abreast and without branches."""

import math
import struct
import sys

ABREAST = 4  # elementary functions of one state that are evaluated at once

# Minimax coefficients of sin(r)/r and cos(r) in r^2 on |r| <= pi/4, those of fdlibm's kernels.
SIN = (-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
       2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10)
COS = (4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
       -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11)
# exp(r) = 1 + r + r^2 (1/2! + r/3! + ...): the Taylor tail past r^13 is under 1e-17 for ln(2)/2.
EXP = tuple(1.0 / math.factorial(k) for k in range(2, 14))
# Of positions, rad or m. Two doubles of that size are 1e-4 apart, and three orders of magnitude
# further the reduction of angles fails, which sums and multiples of positions must not reach.
LARGEST = 1e12
ROUND = 6755399441055744.0  # 1.5 * 2^52: adding it rounds to the nearest integer


def largest(argument: str) -> float:
    """Return the largest size that entries of an argument of this name may have."""
    return LARGEST if argument in ('q', 'q0') else math.inf


def scale(most: float) -> float:
    """Return by what a number is multiplied so as to overflow where it is larger than `most`."""
    return 1.0 if math.isinf(most) else sys.float_info.max / most


def literal(value: float) -> str:
    """Return a double as LLVM writes it, bit for bit."""
    return f'0x{struct.unpack("<Q", struct.pack("<d", float(value)))[0]:016X}'


def splat(value: float, width: int) -> str:
    """Return a constant of so many equal doubles."""
    return literal(value) if width == 1 else f'splat (double {literal(value)})'


def vector_type(width: int) -> str:
    """Return LLVM's name of so many doubles in one register; of one, plainly a double."""
    return 'double' if width == 1 else f'<{width} x double>'


class Vector:
    """Writes arithmetic on `width` doubles at once, line by line, with fresh names."""

    def __init__(self, lines: list[str], prefix: str, width: int) -> None:
        """Append to `lines`; `prefix` keeps the names apart."""
        self.lines, self.prefix, self.width, self.count = lines, prefix, width, 0
        self.type, self.integer = vector_type(width), f'<{width} x i64>'

    def new(self, code: str) -> str:
        """Append one instruction and return the name of its result."""
        self.count += 1
        name = f'%{self.prefix}.{self.count}'
        self.lines.append(f'  {name} = {code}')
        return name

    def const(self, value: float) -> str:
        """Return the constant in every lane."""
        return splat(value, self.width)

    def op(self, code: str, a: str, b: str) -> str:
        """Return the result of a binary instruction."""
        return self.new(f'{code} {self.type} {a}, {b}')

    def fma(self, a: str, b: str, c: str) -> str:
        """Return a b + c, rounded once."""
        return self.new(f'call {self.type} @llvm.fma.v{self.width}f64({self.type} {a}, '
                        f'{self.type} {b}, {self.type} {c})')

    def bits(self, a: str) -> str:
        """Return the lanes as integers, bit for bit."""
        return self.new(f'bitcast {self.type} {a} to {self.integer}')

    def double(self, a: str) -> str:
        """Return integer lanes as doubles, bit for bit."""
        return self.new(f'bitcast {self.integer} {a} to {self.type}')

    def integer_op(self, code: str, a: str, k: int) -> str:
        """Return an integer instruction with a constant."""
        return self.new(f'{code} {self.integer} {a}, splat (i64 {k})')

    def select(self, condition: str, a: str, b: str) -> str:
        """Return a where the condition holds, else b."""
        return self.new(f'select <{self.width} x i1> {condition}, {self.type} {a}, '
                        f'{self.type} {b}')

    def shuffle(self, a: str, b: str, places: list[int]) -> str:
        """Return the lanes at these places of a and b, those of b counted on from a's."""
        mask = ', '.join(f'i32 {place}' for place in places)
        return self.new(f'shufflevector {self.type} {a}, {self.type} {b}, '
                        f'<{self.width} x i32> <{mask}>')

    def polynomial(self, coefficients: tuple[float, ...], x: str) -> str:
        """Evaluate sum c_k x^k by Estrin's scheme: short chains keep the pipeline full."""
        terms = [self.const(c) for c in coefficients]
        power = x
        while len(terms) > 1:
            paired = [self.fma(power, terms[k + 1], terms[k])
                      for k in range(0, len(terms) - 1, 2)]
            terms = paired + ([terms[-1]] if len(terms) % 2 else [])
            if len(terms) > 1:
                power = self.op('fmul', power, power)
        return terms[0]

    def sin_cos(self, x: str) -> tuple[str, str]:
        """
        Return (sin x, cos x), by a two-term Cody-Waite reduction with fma.

        2 ulp for |x| < 1e6; an absolute error of 1e-15 up to 1e15, and nonsense beyond 3e15.
        """
        shifted = self.fma(x, self.const(2.0 / math.pi), self.const(ROUND))
        quadrant = self.bits(shifted)
        turns = self.new(f'fneg {self.type} '
                         + self.op('fsub', shifted, self.const(ROUND)))
        r = self.fma(turns, self.const(1.5707963267948966), x)
        r = self.fma(turns, self.const(6.123233995736766e-17), r)
        z = self.op('fmul', r, r)
        sine = self.fma(self.op('fmul', r, z), self.polynomial(SIN, z), r)
        head = self.fma(z, self.const(-0.5), self.const(1.0))
        cosine = self.fma(self.op('fmul', z, z), self.polynomial(COS, z), head)
        odd = self.new(f'icmp ne {self.integer} {self.integer_op("and", quadrant, 1)}, '
                       'zeroinitializer')
        result = []
        for value, turned in ((self.select(odd, cosine, sine), quadrant),
                              (self.select(odd, sine, cosine),
                               self.integer_op('add', quadrant, 1))):
            sign = self.integer_op('shl', self.integer_op('and', turned, 2), 62)
            flipped = self.new(f'xor {self.integer} {self.bits(value)}, {sign}')
            result.append(self.double(flipped))
        return result[0], result[1]

    def tanh(self, x: str) -> str:
        """Return tanh x = E / (E + 2), E = expm1(2 |x|), with the sign of x; 3 ulp."""
        size = self.new(f'call {self.type} @llvm.fabs.v{self.width}f64({self.type} {x})')
        over = self.new(f'fcmp ogt {self.type} {size}, {self.const(20.0)}')  # NaN stays NaN
        size = self.select(over, self.const(20.0), size)
        z = self.op('fadd', size, size)
        shifted = self.fma(z, self.const(1.0 / math.log(2.0)), self.const(ROUND))
        k = self.new(f'fneg {self.type} ' + self.op('fsub', shifted, self.const(ROUND)))
        r = self.fma(k, self.const(6.93147180369123816490e-01), z)
        r = self.fma(k, self.const(1.90821492927058770002e-10), r)
        small = self.fma(self.op('fmul', r, r), self.polynomial(EXP, r), r)
        power = self.double(self.integer_op(
            'shl', self.integer_op('add', self.bits(shifted), 1023), 52))
        E = self.fma(power, small, self.op('fsub', power, self.const(1.0)))
        quotient = self.op('fdiv', E, self.op('fadd', E, self.const(2.0)))
        return self.new(f'call {self.type} @llvm.copysign.v{self.width}f64('
                        f'{self.type} {quotient}, {self.type} {x})')
