"""Elementary functions (sin, cos, tanh) as branch-free LLVM IR on vectors of doubles."""

import math
import struct
import sys

FUNCTION_LANES = 4  # arguments of one state whose elementary functions are evaluated in one vector

# Minimax coefficients of sin(r)/r and cos(r) in r^2 on |r| <= pi/4, those of fdlibm's kernels.
SIN = (-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
       2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10)
COS = (4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
       -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11)
# exp(r) = 1 + r + r^2 (1/2! + r/3! + ...): the Taylor tail past r^13 is under 1e-17 for ln(2)/2.
EXP = tuple(1.0 / math.factorial(k) for k in range(2, 14))
# Interpolated at Chebyshev nodes: (2 artanh(s) - 2 s) / s^3 in s^2 up to sqrt(2), and
# (arctan(r) - r) / r^3 in r^2 up to tan(pi/8); both leave less than 4e-17.
LOG = (0.6666666666666666, 0.4000000000000088, 0.28571428570803614, 0.22222222391713917,
       0.18181795640132906, 0.15386239702814658, 0.13268773138656886, 0.13086626147840102)
ARCTAN = (-0.3333333333333333, 0.1999999999999552, -0.14285714284666542, 0.11111111015256361,
          -0.09090904578123903, 0.07692183190826087, -0.06664511447381948, 0.0585814891280221,
          -0.0508544973794026, 0.03923165829558719, -0.01917688711906226)
LN2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)  # its leading bits and the rest
SQRT_HALF = struct.unpack('<q', struct.pack('<d', math.sqrt(0.5)))[0]
# Largest position accepted, rad or m. Neighboring doubles of this size are 1e-4 apart. The range
# reduction of sin and cos fails at 1e15; the margin covers sums and multiples of positions.
POSITION_LIMIT = 1e12
ROUND = 6755399441055744.0  # 1.5 * 2^52: adding it rounds to the nearest integer


def size_limit(argument: str) -> float:
    """Return the largest absolute value allowed in the argument of this name."""
    return POSITION_LIMIT if argument in ('q', 'q0') else math.inf


def overflow_scale(most: float) -> float:
    """Return a factor that makes every number larger than `most` overflow to infinity."""
    return 1.0 if math.isinf(most) else sys.float_info.max / most


def literal(value: float) -> str:
    """Return a double as an LLVM hexadecimal literal, bit for bit."""
    return f'0x{struct.unpack("<Q", struct.pack("<d", float(value)))[0]:016X}'


def splat(value: float, width: int) -> str:
    """Return a constant vector with the value in every lane (a scalar for width 1)."""
    return literal(value) if width == 1 else f'splat (double {literal(value)})'


def vector_type(width: int) -> str:
    """Return the LLVM type of `width` doubles; a scalar double for width 1."""
    return 'double' if width == 1 else f'<{width} x double>'


class Vector:
    """Emits LLVM IR instructions on vectors of `width` doubles, each with a fresh name."""

    def __init__(self, lines: list[str], prefix: str, width: int) -> None:
        """Emit into `lines`; `prefix` makes the names unique in the function."""
        self.lines, self.prefix, self.width, self.count = lines, prefix, width, 0
        self.type, self.integer = vector_type(width), f'<{width} x i64>'

    def new(self, code: str) -> str:
        """Append one instruction and return the name of its result."""
        self.count += 1
        name = f'%{self.prefix}.{self.count}'
        self.lines.append(f'  {name} = {code}')
        return name

    def const(self, value: float) -> str:
        """Return a constant vector with the value in every lane."""
        return splat(value, self.width)

    def op(self, code: str, a: str, b: str) -> str:
        """Return the result of a binary instruction."""
        return self.new(f'{code} {self.type} {a}, {b}')

    def fma(self, a: str, b: str, c: str) -> str:
        """Return a b + c with one rounding."""
        return self.new(f'call {self.type} @llvm.fma.v{self.width}f64({self.type} {a}, '
                        f'{self.type} {b}, {self.type} {c})')

    def bits(self, a: str) -> str:
        """Return the bits of the lanes as integers."""
        return self.new(f'bitcast {self.type} {a} to {self.integer}')

    def double(self, a: str) -> str:
        """Return integer lanes reinterpreted as doubles."""
        return self.new(f'bitcast {self.integer} {a} to {self.type}')

    def integer_op(self, code: str, a: str, k: int) -> str:
        """Return the result of an integer instruction with a constant operand."""
        return self.new(f'{code} {self.integer} {a}, splat (i64 {k})')

    def select(self, condition: str, a: str, b: str) -> str:
        """Return, per lane, `a` where the condition holds and `b` elsewhere."""
        return self.new(f'select <{self.width} x i1> {condition}, {self.type} {a}, '
                        f'{self.type} {b}')

    def shuffle(self, a: str, b: str, places: list[int]) -> str:
        """Return lanes selected from `a` (0 to width - 1) and `b` (width to 2 width - 1)."""
        mask = ', '.join(f'i32 {place}' for place in places)
        return self.new(f'shufflevector {self.type} {a}, {self.type} {b}, '
                        f'<{self.width} x i32> <{mask}>')

    def polynomial(self, coefficients: tuple[float, ...], x: str) -> str:
        """Evaluate sum c_k x^k by Estrin's scheme, which has short dependency chains."""
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
        Return (sin x, cos x), with a two-term Cody-Waite range reduction.

        The error is 2 ulp for |x| < 1e6 and 1e-15 absolute up to 1e15; beyond 3e15 the
        results are wrong.
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
        """Return tanh x = sign(x) E / (E + 2) with E = expm1(2 |x|); the error is 3 ulp."""
        size = self.new(f'call {self.type} @llvm.fabs.v{self.width}f64({self.type} {x})')
        over = self.new(f'fcmp ogt {self.type} {size}, {self.const(20.0)}')  # NaN stays NaN
        size = self.select(over, self.const(20.0), size)
        z = self.op('fadd', size, size)
        shifted = self.fma(z, self.const(1.0 / math.log(2.0)), self.const(ROUND))
        k = self.new(f'fneg {self.type} ' + self.op('fsub', shifted, self.const(ROUND)))
        r = self.fma(k, self.const(LN2[0]), z)
        r = self.fma(k, self.const(LN2[1]), r)
        small = self.fma(self.op('fmul', r, r), self.polynomial(EXP, r), r)
        power = self.double(self.integer_op(
            'shl', self.integer_op('add', self.bits(shifted), 1023), 52))
        E = self.fma(power, small, self.op('fsub', power, self.const(1.0)))
        quotient = self.op('fdiv', E, self.op('fadd', E, self.const(2.0)))
        return self.new(f'call {self.type} @llvm.copysign.v{self.width}f64('
                        f'{self.type} {quotient}, {self.type} {x})')

    def exp(self, x: str) -> str:
        """Return exp x = 2^k exp r, with an integer k and 2^k in two factors."""
        for code, most in (('ogt', 710.0), ('olt', -746.0)):  # NaN stays NaN
            past = self.new(f'fcmp {code} {self.type} {x}, {self.const(most)}')
            x = self.select(past, self.const(most), x)
        shifted = self.fma(x, self.const(1.0 / math.log(2.0)), self.const(ROUND))
        k = self.new(f'fneg {self.type} ' + self.op('fsub', shifted, self.const(ROUND)))
        r = self.fma(k, self.const(LN2[1]), self.fma(k, self.const(LN2[0]), x))
        power = self.op('fadd', self.const(1.0),
                        self.fma(self.op('fmul', r, r), self.polynomial(EXP, r), r))
        whole = self.new(f'sub {self.integer} {self.bits(shifted)}, '
                         + self.bits(self.const(ROUND)))
        half = self.integer_op('ashr', whole, 1)
        for part in (half, self.new(f'sub {self.integer} {whole}, {half}')):
            power = self.op('fmul', power, self.double(self.integer_op(
                'shl', self.integer_op('add', part, 1023), 52)))
        return power

    def log(self, x: str) -> str:
        """Return log x = k log 2 + log m, m from sqrt(1/2) to sqrt(2); 1 ulp."""
        tiny = self.new(f'fcmp olt {self.type} {x}, {self.const(sys.float_info.min)}')
        scaled = self.select(tiny, self.op('fmul', x, self.const(2.0**54)), x)
        above = self.integer_op('sub', self.bits(scaled), SQRT_HALF)
        exponent = self.integer_op('ashr', above, 52)
        m = self.double(self.new(f'sub {self.integer} {self.bits(scaled)}, '
                                 + self.integer_op('shl', exponent, 52)))
        k = self.new(f'sitofp {self.integer} {exponent} to {self.type}')
        k = self.op('fsub', k, self.select(tiny, self.const(54.0), self.const(0.0)))
        f = self.op('fsub', m, self.const(1.0))
        s = self.op('fdiv', f, self.op('fadd', f, self.const(2.0)))
        z = self.op('fmul', s, s)
        half = self.op('fmul', self.op('fmul', f, f), self.const(0.5))
        rest = self.op('fmul', s, self.fma(z, self.polynomial(LOG, z), half))
        rest = self.op('fsub', half, self.fma(k, self.const(LN2[1]), rest))
        value = self.fma(k, self.const(LN2[0]), self.op('fsub', f, rest))
        for code, edge, result in (('oeq', 0.0, -math.inf), ('oeq', math.inf, math.inf),
                                   ('ult', 0.0, math.nan)):  # and what is no number stays so
            there = self.new(f'fcmp {code} {self.type} {x}, {self.const(edge)}')
            value = self.select(there, self.const(result), value)
        return value

    def arctan(self, x: str) -> str:
        """Return arctan x = b + arctan r, b one of 0, pi/4, pi/2, with the sign of x; 2 ulp."""
        size = self.new(f'call {self.type} @llvm.fabs.v{self.width}f64({self.type} {x})')
        r, base, rest = size, self.const(0.0), self.const(0.0)
        one = self.const(1.0)
        for edge, reduced, angle, left in (
                (math.sqrt(2.0) - 1.0, self.op('fdiv', self.op('fsub', size, one),
                                               self.op('fadd', size, one)),
                 0.25 * math.pi, 3.061616997868383e-17),
                (math.sqrt(2.0) + 1.0, self.op('fdiv', self.const(-1.0), size),
                 0.5 * math.pi, 6.123233995736766e-17)):
            past = self.new(f'fcmp ogt {self.type} {size}, {self.const(edge)}')
            r = self.select(past, reduced, r)
            base = self.select(past, self.const(angle), base)
            rest = self.select(past, self.const(left), rest)
        z = self.op('fmul', r, r)
        tail = self.fma(self.op('fmul', r, z), self.polynomial(ARCTAN, z), rest)
        value = self.op('fadd', base, self.op('fadd', r, tail))
        return self.new(f'call {self.type} @llvm.copysign.v{self.width}f64({self.type} {value}, '
                        f'{self.type} {x})')


def transpose(v: Vector, rows: list[str]) -> list[str]:
    """Return the columns of a square tile of row vectors."""
    return exchange_blocks(v, rows, v.width // 2)


def exchange_blocks(v: Vector, rows: list[str], distance: int) -> list[str]:
    """Exchange off-diagonal blocks of this size, then of half the size, and so on."""
    while distance:
        kept = [lane for lane in range(v.width) if not lane & distance]
        low = sorted([*kept, *(lane + v.width for lane in kept)], key=lambda k: (
            k % v.width + (distance if k >= v.width else 0)))
        high = [place + distance for place in low]
        rows = [v.shuffle(rows[i], rows[i | distance], low) if not i & distance
                else v.shuffle(rows[i ^ distance], rows[i], high) for i in range(v.width)]
        distance //= 2
    return rows
