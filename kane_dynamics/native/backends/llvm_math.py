"""
Doubles in LLVM IR: literals, vectors and elementary functions.

`Vector` emits branch-free instructions on vectors or scalars.
"""

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
# Of AVX-512: sin(k pi/8), k from 0 to 4, and coefficients of (sin(r)/r - 1)/r^2 and
# (cos(r) - 1)/r^2 in r^2 on |r| <= pi/16. They are interpolated where r^2 times the error is
# a Chebyshev polynomial; sin(r)/r and cos(r) err by 5e-18 and 2e-19. One term less of the
# cosine errs by 5e-17: too much for cosines below 1/4, where it would be another ulp.
EIGHTHS = (0.0, 0.3826834323650898, 0.7071067811865476, 0.9238795325112867, 1.0)
NEAR_SIN = (-0.1666666666666628, 0.00833333333236049, -0.00019841262220147293,
            2.7533788291710934e-06)
NEAR_COS = (-0.5, 0.041666666666665055, -0.0013888888886964574, 2.480157727470733e-05,
            -2.7533601095990004e-07)
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
# The range reduction of sin and cos fails at 8e14; the margin covers sums and multiples
# of positions.
POSITION_LIMIT = 1e12


# Of doubles: bits of the mantissa, bias of the exponent, bits of sqrt(1/2).
MANTISSA = 52
BIAS = 1023
SQRT_HALF = struct.unpack('<q', struct.pack('<d', math.sqrt(0.5)))[0]
HALF_PI = 1.5707963267948966, 6.123233995736766e-17  # leading part and rest
EXP_RANGE = -746.0, 710.0  # beyond these, exp is 0 or infinity
ROUND = 1.5 * 2.0**52  # adding it rounds to the nearest integer


def size_limit(argument: str) -> float:
    """Return the largest absolute value allowed in the argument of this name."""
    return POSITION_LIMIT if argument in ('q', 'q0') else math.inf


def literal(value: float) -> str:
    """Return a double as an LLVM hexadecimal literal, bit for bit."""
    return f'0x{struct.unpack("<Q", struct.pack("<d", float(value)))[0]:016X}'


def overflow_scale(most: float) -> float:
    """Return a factor by which numbers larger than `most` overflow to infinity."""
    return 1.0 if math.isinf(most) else sys.float_info.max / most


def constant_vector(element: str, value: str, width: int) -> str:
    """
    Return a constant vector with the value in every lane; a scalar for width 1.

    Every lane is written out, since the shorter `splat (value)` needs LLVM 18.

    Parameters
    ----------
    element, value : str
        LLVM's type and literal of one lane.
    width : int
        Number of lanes.

    """
    if width == 1:
        return value
    lanes = ', '.join([f'{element} {value}'] * width)
    return f'<{lanes}>'


def vector_type(width: int) -> str:
    """Return the LLVM type of `width` numbers; a scalar for width 1."""
    return 'double' if width == 1 else f'<{width} x double>'


def intrinsic_end(width: int) -> str:
    """Return the end of the name of an LLVM intrinsic of `width` numbers."""
    return 'f64' if width == 1 else f'v{width}f64'


# Arguments of one state whose elementary functions are evaluated in one vector.
FUNCTION_LANES = 4
# The instruction of AVX-512 that chooses, per lane, one of the 16 numbers of two vectors.
PERMUTE = 'llvm.x86.avx512.vpermi2var.pd.512'
DECLARED_PERMUTE = f'declare <8 x double> @{PERMUTE}(<8 x double>, <8 x i64>, <8 x double>)'


class Vector:
    """Emits LLVM IR instructions on vectors of `width` numbers, with fresh names."""

    def __init__(self, lines: list[str], prefix: str, width: int,
                 few_operations: bool = False,
                 permutes: bool = False) -> None:
        """
        Emit into `lines`; `prefix` makes the names unique in the function.

        With `few_operations`, functions take fewer operations in longer chains, for code
        that has other operations to do meanwhile. With `permutes`, sine and cosine use
        AVX-512's choice of 16 numbers by the lanes of a vector of 8 doubles.
        """
        self.lines = lines
        self.few_operations = few_operations
        self.permutes = permutes
        self.prefix = prefix
        self.width = width
        self.count = 0
        self.type = vector_type(width)
        self.end = intrinsic_end(width)
        self.integer = 'i64'
        # Names of LLVM's types: of values, of integers of the same size, and of truth
        # values.
        self.truth = 'i1'
        if width > 1:
            self.integer = f'<{width} x {self.integer}>'
            self.truth = f'<{width} x {self.truth}>'

    def new(self, code: str) -> str:
        """Append one instruction and return the name of its result."""
        self.count += 1
        name = f'%{self.prefix}.{self.count}'
        self.lines.append(f'  {name} = {code}')
        return name

    def const(self, value: float) -> str:
        """Return a constant vector with the value in every lane."""
        return constant_vector('double', literal(value), self.width)

    def op(self, code: str, a: str, b: str) -> str:
        """Return the result of a binary instruction."""
        return self.new(f'{code} {self.type} {a}, {b}')

    def fma(self, a: str, b: str, c: str) -> str:
        """Return a b + c with one rounding."""
        return self.new(f'call {self.type} @llvm.fma.{self.end}({self.type} {a}, '
                        f'{self.type} {b}, {self.type} {c})')

    def bits(self, a: str) -> str:
        """Return the bits of the lanes as integers."""
        return self.new(f'bitcast {self.type} {a} to {self.integer}')

    def number(self, a: str) -> str:
        """Return integer lanes reinterpreted as numbers."""
        return self.new(f'bitcast {self.integer} {a} to {self.type}')

    def integer_op(self, code: str, a: str, k: int) -> str:
        """Return the result of an integer instruction with a constant operand."""
        constant = constant_vector('i64', str(k), self.width)
        return self.new(f'{code} {self.integer} {a}, {constant}')

    def select(self, condition: str, a: str, b: str) -> str:
        """Return, per lane, `a` where the condition holds and `b` elsewhere."""
        return self.new(f'select {self.truth} {condition}, {self.type} {a}, '
                        f'{self.type} {b}')

    def shuffle(self, a: str, b: str, places: list[int]) -> str:
        """Return lanes of `a` (0 to width - 1) and `b` (width to 2 width - 1)."""
        mask = ', '.join(map('i32 {}'.format, places))
        return self.new(f'shufflevector {self.type} {a}, {self.type} {b}, '
                        f'<{self.width} x i32> <{mask}>')

    def polynomial(self, coefficients: tuple[float, ...], x: str) -> str:
        """
        Evaluate sum c_k x^k.

        Estrin's scheme has short chains of dependent operations, Horner's the fewest.
        """
        terms = list(map(self.const, coefficients))
        # Horner's scheme has the fewest operations, but each waits for the last.
        if self.few_operations:
            value = terms.pop()
            while terms:
                value = self.fma(value, x, terms.pop())
            return value
        power = x
        while len(terms) > 1:
            # Each pass combines pairs of terms; a last one without a partner stays.
            paired = []
            for k in range(0, len(terms) - 1, 2):
                paired.append(self.fma(power, terms[k + 1], terms[k]))
            if len(terms) % 2:
                paired.append(terms[-1])
            terms = paired
            if len(terms) > 1:
                power = self.op('fmul', power, power)
        return terms[0]

    def sin_cos(self, x: str) -> tuple[str, str]:
        """
        Return (sin x, cos x), with a two-term Cody-Waite range reduction.

        The error is 2 ulp for |x| < 1e6, of results next to zero up to 1e-21 absolute. It
        is 1e-15 absolute up to 1e15, with `permutes` up to 8e14; beyond 3e15 and 8e14 the
        results are wrong. Of floats: 2e-7 absolute up to their position limit.
        """
        # x = k h + r, so that |r| <= h/2: adding `round` leaves the whole number k in the
        # last bits of the mantissa.
        parts = 4 if self.permutes else 1  # of pi/2
        round_up = self.const(ROUND)
        shifted = self.fma(x, self.const(2.0 * parts / math.pi), round_up)
        quadrant = self.bits(shifted)
        k = self.new(f'fneg {self.type} ' + self.op('fsub', shifted, round_up))
        # h in two parts, so that r keeps its digits.
        r = x
        for part in HALF_PI:
            r = self.fma(k, self.const(part / parts), r)
        if self.permutes:
            return self._sin_cos_near_eighths(quadrant, r)
        # Polynomials of sine and cosine of r.
        z = self.op('fmul', r, r)
        sine = self.fma(self.op('fmul', r, z), self.polynomial(SIN, z), r)
        head = self.fma(z, self.const(-0.5), self.const(1.0))
        cosine = self.fma(self.op('fmul', z, z), self.polynomial(COS, z),
                          head)
        # Odd quarter turns exchange them; the second bit of the quarter is the sign.
        odd = self.new(f'icmp ne {self.integer} {self.integer_op("and", quadrant, 1)}, '
                       'zeroinitializer')
        result = []
        for value, turned in ((self.select(odd, cosine, sine), quadrant),
                              (self.select(odd, sine, cosine),
                               self.integer_op('add', quadrant, 1))):
            sign = self.integer_op('shl', self.integer_op('and', turned, 2),
                                   62)
            flipped = self.new(f'xor {self.integer} {self.bits(value)}, {sign}')
            result.append(self.number(flipped))
        return result[0], result[1]

    def _sin_cos_near_eighths(self, number: str, r: str) -> tuple[str, str]:
        """
        Return (sin x, cos x) from those of a, the multiple of pi/8 nearest to x.

        The last bits of `number` are those of a/(pi/8). With r = x - a, sin x = sin a
        + (cos a sin r + sin a (cos r - 1)), and cos x = cos a + (cos a (cos r - 1) -
        sin a sin r). Signs and quarter turns take no operations, and the polynomials are
        shorter than on |r| <= pi/4. The errors are as of `sin_cos`.
        """
        # sin r and cos r - 1.
        z = self.op('fmul', r, r)
        sine = self.fma(self.op('fmul', r, z), self.polynomial(NEAR_SIN, z), r)
        fall = self.op('fmul', z, self.polynomial(NEAR_COS, z))
        # sin a and cos a = sin(a + pi/2) by the last four bits of the number of eighths.
        rising = list(EIGHTHS[:4])
        half_turn = rising + list(EIGHTHS[:0:-1])
        turn = half_turn + [-value for value in half_turn]
        chosen = []
        for table in (turn, turn[4:] + turn[:4]):
            entries = list(map('double {}'.format, map(literal, table)))
            low, high = ', '.join(entries[:8]), ', '.join(entries[8:])
            chosen.append(self.new(
                f'call {self.type} @{PERMUTE}({self.type} <{low}>, {self.integer} {number}, '
                f'{self.type} <{high}>)'))
        sine_a, cosine_a = chosen
        change = self.fma(cosine_a, sine, self.op('fmul', sine_a, fall))
        sine_of_x = self.op('fadd', sine_a, change)
        opposite = self.new(f'fneg {self.type} {sine_a}')
        change = self.fma(opposite, sine, self.op('fmul', cosine_a, fall))
        return sine_of_x, self.op('fadd', cosine_a, change)

    def tanh(self, x: str) -> str:
        """Return tanh x = sign(x) E / (E + 2) with E = expm1(2 |x|), to 3 ulp."""
        size = self.new(f'call {self.type} @llvm.fabs.{self.end}({self.type} {x})')
        # NaN stays NaN.
        over = self.new(f'fcmp ogt {self.type} {size}, {self.const(20.0)}')
        size = self.select(over, self.const(20.0), size)
        # 2 |x| = k log 2 + r, as in `exp`.
        z = self.op('fadd', size, size)
        shifted = self.fma(z, self.const(1.0 / math.log(2.0)),
                           self.const(ROUND))
        k = self.new(f'fneg {self.type} ' + self.op('fsub', shifted,
                                                    self.const(ROUND)))
        r = self.fma(k, self.const(LN2[0]), z)
        r = self.fma(k, self.const(LN2[1]), r)
        small = self.fma(self.op('fmul', r, r), self.polynomial(EXP, r), r)
        # E = 2^k (e^r - 1) + 2^k - 1 loses no digits near zero.
        power = self.number(self.integer_op(
            'shl', self.integer_op('add', self.bits(shifted), BIAS),
            MANTISSA))
        E = self.fma(power, small, self.op('fsub', power, self.const(1.0)))
        quotient = self.op('fdiv', E, self.op('fadd', E, self.const(2.0)))
        return self.new(f'call {self.type} @llvm.copysign.{self.end}('
                        f'{self.type} {quotient}, {self.type} {x})')

    def exp(self, x: str) -> str:
        """Return exp x = 2^k exp r, with an integer k and 2^k in two factors."""
        low, high = EXP_RANGE
        for code, most in (('ogt', high), ('olt', low)):  # NaN stays NaN
            past = self.new(f'fcmp {code} {self.type} {x}, {self.const(most)}')
            x = self.select(past, self.const(most), x)
        # x = k log 2 + r, with log 2 in two parts.
        shifted = self.fma(x, self.const(1.0 / math.log(2.0)),
                           self.const(ROUND))
        k = self.new(f'fneg {self.type} ' + self.op('fsub', shifted,
                                                    self.const(ROUND)))
        r = self.fma(k, self.const(LN2[0]), x)
        r = self.fma(k, self.const(LN2[1]), r)
        power = self.op('fadd', self.const(1.0),
                        self.fma(self.op('fmul', r, r),
                                 self.polynomial(EXP, r), r))
        whole = self.new(f'sub {self.integer} {self.bits(shifted)}, '
                         + self.bits(self.const(ROUND)))
        # Two factors: 2^k alone may be beyond the normal numbers where e^x is not.
        half = self.integer_op('ashr', whole, 1)
        for part in (half, self.new(f'sub {self.integer} {whole}, {half}')):
            power = self.op('fmul', power, self.number(self.integer_op(
                'shl', self.integer_op('add', part, BIAS),
                MANTISSA)))
        return power

    def log(self, x: str) -> str:
        """Return log x = k log 2 + log m, m from sqrt(1/2) to sqrt(2); 1 ulp."""
        # Numbers below the normal ones are scaled up first, by 2^lift.
        lift = MANTISSA + 2
        tiny = self.new(f'fcmp olt {self.type} {x}, {self.const(sys.float_info.min)}')
        scaled = self.select(tiny, self.op(
            'fmul', x, self.const(2.0**lift)), x)
        # x = 2^k m: the exponent's bits, counted from sqrt(1/2), are k, the others m.
        above = self.integer_op('sub', self.bits(scaled), SQRT_HALF)
        exponent = self.integer_op('ashr', above, MANTISSA)
        m = self.number(self.new(f'sub {self.integer} {self.bits(scaled)}, '
                                 + self.integer_op('shl', exponent, MANTISSA)))
        k = self.new(f'sitofp {self.integer} {exponent} to {self.type}')
        k = self.op('fsub', k, self.select(tiny, self.const(lift), self.const(0.0)))
        # log m = 2 artanh(s) with s = f / (2 + f), f = m - 1.
        f = self.op('fsub', m, self.const(1.0))
        s = self.op('fdiv', f, self.op('fadd', f, self.const(2.0)))
        z = self.op('fmul', s, s)
        half = self.op('fmul', self.op('fmul', f, f), self.const(0.5))
        tail = self.op('fmul', s, self.fma(z, self.polynomial(LOG, z), half))
        tail = self.op('fsub', half, self.fma(k, self.const(LN2[1]), tail))
        value = self.fma(k, self.const(LN2[0]), self.op('fsub', f, tail))
        for code, edge, result in (('oeq', 0.0, -math.inf), ('oeq', math.inf, math.inf),
                                   # Of a negative number, and of NaN.
                                   ('ult', 0.0, math.nan)):
            there = self.new(f'fcmp {code} {self.type} {x}, {self.const(edge)}')
            value = self.select(there, self.const(result), value)
        return value

    def arctan(self, x: str) -> str:
        """Return arctan x = b + arctan r, b one of 0, pi/4, pi/2, to 2 ulp."""
        size = self.new(f'call {self.type} @llvm.fabs.{self.end}({self.type} {x})')
        r = size
        base = self.const(0.0)
        low = self.const(0.0)  # of the base
        one = self.const(1.0)
        for edge, reduced, share in (
                (math.sqrt(2.0) - 1.0,
                 self.op('fdiv', self.op('fsub', size, one), self.op('fadd', size, one)),
                 0.5),
                (math.sqrt(2.0) + 1.0, self.op('fdiv', self.const(-1.0), size),
                 1.0)):
            past = self.new(f'fcmp ogt {self.type} {size}, {self.const(edge)}')
            r = self.select(past, reduced, r)
            base = self.select(past, self.const(share * HALF_PI[0]), base)
            low = self.select(past, self.const(share * HALF_PI[1]), low)
        # arctan r = r + r^3 p(r^2); the rest of the base is added to the small part.
        z = self.op('fmul', r, r)
        tail = self.fma(self.op('fmul', r, z), self.polynomial(ARCTAN, z), low)
        value = self.op('fadd', base, self.op('fadd', r, tail))
        return self.new(f'call {self.type} @llvm.copysign.{self.end}({self.type} '
                        f'{value}, {self.type} {x})')


def transpose(v: Vector, rows: list[str], largest: int | None = None) -> list[str]:
    """
    Return the columns of a square tile of row vectors.

    Off-diagonal blocks are exchanged: of the size `largest`, by default half the width,
    then of half that size, and so on. A smaller one completes a tile whose larger blocks
    are exchanged already.
    """
    distance = v.width // 2 if largest is None else largest
    while distance:
        # Of a pair of rows a distance apart, the first takes the low lanes of both, and
        # the second the high ones. Lanes of the second row are numbered from the width
        # on.
        low = []
        high = []
        for lane in range(v.width):
            place = lane - distance + v.width if lane & distance else lane
            low.append(place)
            high.append(place + distance)
        exchanged = []
        for i in range(v.width):
            first = rows[i & ~distance]
            second = rows[i | distance]
            exchanged.append(v.shuffle(first, second, high if i & distance else low))
        rows = exchanged
        distance //= 2
    return rows
