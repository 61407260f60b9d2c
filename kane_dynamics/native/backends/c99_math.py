"""
Sines, cosines and tanh of exported C: loops without branches that a compiler vectorises.

The reduction of an angle subtracts a multiple of pi/2 in three parts, so that it needs
no fused multiply-add; larger angles than `MOST`, fast-math and x87 arithmetic go to
libm.
"""

from dataclasses import dataclass
import math

from kane_dynamics.native.backends.llvm_math import COS, EXP, LN2, SIN


@dataclass(frozen=True)
class Precision:
    """
    A floating-point type of C.

    Attributes
    ----------
    name : str
        Of the option.
    c, suffix : str
        The type; what ends its constants and libm's names.
    integer : str
        The integer type of its size.
    digits : int
        Of a constant that reads back.
    parts : tuple of float
        pi/2, whose first two parts times a small integer are exact.
    most : float
        The largest angle that these reduce, rad.
    rounding : float
        Adding it rounds to the nearest integer.
    bias, mantissa : int
        Of the exponent; bits of the mantissa.
    terms : tuple of int
        Of the polynomials of sine, cosine and exp.
    saturated : float
        The argument from which on tanh is 1.
    epsilon : float

    """

    name: str
    c: str
    suffix: str
    integer: str
    digits: int
    parts: tuple[float, float, float]
    most: float
    rounding: float
    bias: int
    mantissa: int
    terms: tuple[int, int, int]
    saturated: float
    epsilon: float


PRECISIONS = {precision.name: precision for precision in (
    Precision('float64', 'double', '', 'uint64_t', 17,
              (1.57079632673412561417e+00, 6.07710050630396597660e-11,
               2.02226624879595063154e-21),
              1e5, 1.5 * 2.0**52, 1023, 52, (6, 6, 12), 20.0, 2.0**-52),
    Precision('float32', 'float', 'f', 'uint32_t', 9,
              (1.5703125, 4.837512969970703125e-4, 7.54978995489188216e-08),
              1e3, 1.5 * 2.0**23, 127, 23, (4, 4, 7), 10.0, 2.0**-23))}

HEAD = """\
/* Define @UPPER@_SINCOS(x, s, c), which writes sine and cosine of x to *s and *c, or
 * @UPPER@_TANH(x) to use functions of your own. */
#if defined(__FAST_MATH__) || FLT_EVAL_METHOD != 0
#define @UPPER@_PLAIN 1
#else
#define @UPPER@_PLAIN 0
#endif
/* On x86 with glibc, gcc adds versions for processors with AVX-512 and with AVX and FMA,
 * chosen at start; not in strict C (-std=c99). x86-64-v4, known from gcc 12 on, is AVX-512
 * with the instructions on narrower registers. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__GLIBC__) \\
    && !defined(__STRICT_ANSI__) && !defined(@UPPER@_PORTABLE)
#if __GNUC__ >= 12
#define @UPPER@_VERSIONS __attribute__((target_clones("arch=x86-64-v4", "fma", "default")))
#else
#define @UPPER@_VERSIONS __attribute__((target_clones("avx512f", "fma", "default")))
#endif
#else
#define @UPPER@_VERSIONS
#endif
#ifdef __GNUC__
#define @UPPER@_INLINE static inline __attribute__((always_inline))
#define @UPPER@_APART static __attribute__((noinline, cold, unused))
#else
#define @UPPER@_INLINE static inline
#define @UPPER@_APART static
#endif
"""

TEXTS = {'sin_cos': """\
@UPPER@_APART void sin_cos_plain(const @real@ *x, int count, @real@ *s, @real@ *c)
{
    int k;
    for (k = 0; k < count; ++k) {
#ifdef @UPPER@_SINCOS
        @UPPER@_SINCOS(x[k], &s[k], &c[k]);
#else
        s[k] = sin@f@(x[k]);
        c[k] = cos@f@(x[k]);
#endif
    }
}

@UPPER@_INLINE void sin_cos(const @real@ *x, int count, @real@ *s, @real@ *c)
{
    int k, plain = @UPPER@_PLAIN;
    @real@ size = @zero@;
#ifdef @UPPER@_SINCOS
    plain = 1;
#endif
    for (k = 0; k < count; ++k) size += fabs@f@(x[k]);
    if (plain || !(size < @most@)) {
        sin_cos_plain(x, count, s, c);
        return;
    }
    for (k = 0; k < count; ++k) {
        const @real@ turns = (x[k] * @inverse@ + @round@) - @round@;
        const @real@ whole = (turns * @quarter@ + @round@) - @round@;
        const @real@ quadrant = turns - @four@ * whole; /* -2, -1, 0, 1 or 2 */
        const @real@ r = ((x[k] - turns * @part0@) - turns * @part1@) - turns * @part2@;
        const @real@ z = r * r;
        const @real@ zz = z * z;
        const @real@ sine = r + r * z * (@sine@);
        const @real@ cosine = (@one@ - @half@ * z) + zz * (@cosine@);
        const @real@ odd = quadrant * quadrant; /* 1 where sine and cosine change places */
        const @real@ first = odd == @one@ ? cosine : sine;
        const @real@ second = odd == @one@ ? sine : cosine;
        s[k] = fabs@f@(@two@ * quadrant - @one@) < @two@ ? first : -first;
        c[k] = fabs@f@(@two@ * quadrant + @one@) < @two@ ? second : -second;
    }
}
""", 'tanh_each': """\
@UPPER@_APART void tanh_plain(const @real@ *x, int count, @real@ *y)
{
    int k;
#ifdef @UPPER@_TANH
    for (k = 0; k < count; ++k) y[k] = @UPPER@_TANH(x[k]);
#else
    for (k = 0; k < count; ++k) y[k] = tanh@f@(x[k]);
#endif
}

@UPPER@_INLINE void tanh_each(const @real@ *x, int count, @real@ *y)
{
    int k;
#if @UPPER@_PLAIN || defined(@UPPER@_TANH)
    tanh_plain(x, count, y);
    return;
#endif
    for (k = 0; k < count; ++k) { /* E / (E + 2) with E = exp(2 |x|) - 1; NaN stays NaN */
        const @real@ size = fabs@f@(x[k]);
        const @real@ twice = @two@ * (size > @saturated@ ? @saturated@ : size);
        const @real@ shifted = twice * @log2e@ + @round@;
        const @real@ powers = shifted - @round@;
        const @real@ r = (twice - powers * @ln2high@) - powers * @ln2low@;
        const @real@ z = r * r;
        const @real@ small = r + z * (@exp@);
        union { @real@ number; @integer@ bits; } power;
        @real@ e;
        power.number = shifted;
        power.bits = (power.bits + @bias@u) << @mantissa@;
        e = power.number * small + (power.number - @one@);
        e = e / (e + @two@);
        y[k] = x[k] < @zero@ ? -e : e;
    }
}
"""}


def literal(value: float, precision: Precision) -> str:
    """Return a number as a C literal of a precision."""
    if precision.suffix:
        text = f'{value:.{precision.digits}g}'
        if not any(mark in text for mark in '.en'):
            text = f'{text}.0'
        return text + precision.suffix
    return repr(float(value))


def elementary_functions(upper: str, precision: Precision, names: set[str]) -> str:
    """Return the macros, which begin with `upper`, and the named elementary functions."""
    def polynomial(coefficients: tuple[float, ...], x: str, square: str) -> str:
        """Return C code for sum c_k x^k by pairs: shorter chains than Horner's."""
        # (c_0 + c_1 x) + x^2 ((c_2 + c_3 x) + ...).
        texts = [literal(c, precision) for c in coefficients]
        pairs = [f'{low} + {x} * {high}' for low, high in zip(texts[::2], texts[1::2])]
        if len(texts) % 2:
            pairs.append(texts[-1])
        text = pairs.pop()
        while pairs:
            text = f'({pairs.pop()}) + {square} * ({text})'
        return text
    # Fewer terms of the series suffice for single precision.
    sine, cosine, exp = (table[:count]
                         for table, count in zip((SIN, COS, EXP), precision.terms))
    high, low = LN2
    if precision.suffix:
        high = 0.693359375  # few bits, so that its products with whole numbers are exact
        low = math.log(2.0) - high
    numbers = {
        # The names between @ in the C texts: numbers, then types and polynomials.
        'most': precision.most, 'inverse': 2.0 / math.pi, 'round': precision.rounding,
        'quarter': 0.25, 'four': 4.0, 'one': 1.0, 'half': 0.5, 'zero': 0.0, 'two': 2.0,
        'part0': precision.parts[0], 'part1': precision.parts[1],
        'part2': precision.parts[2],
        'saturated': precision.saturated, 'log2e': 1.0 / math.log(2.0), 'ln2high': high,
        'ln2low': low}
    words = {'UPPER': upper, 'real': precision.c, 'f': precision.suffix,
             'integer': precision.integer, 'bias': str(precision.bias),
             'mantissa': str(precision.mantissa), 'sine': polynomial(sine, 'z', 'zz'),
             'cosine': polynomial(cosine, 'z', 'zz'), 'exp': polynomial(exp, 'r', 'z'),
             **{name: literal(value, precision) for name, value in numbers.items()}}
    text = '\n'.join([HEAD, *(TEXTS[name] for name in sorted(names))])
    for name, word in words.items():
        text = text.replace(f'@{name}@', word)
    return text
