"""
Sines, cosines and tanh of exported C: loops without branches that a compiler vectorises.

The reduction of an angle subtracts a multiple of pi/2 in three parts, so that it needs no fused
multiply-add; larger angles than `MOST`, fast-math and x87 arithmetic go to libm.
"""

from dataclasses import dataclass
import math

from kane_dynamics.native.elementary import COS, EXP, SIN


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
              (1.57079632673412561417e+00, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
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
"""

TEXTS = {'sin_cos': """\
static inline void sin_cos(const @real@ *x, int count, @real@ *s, @real@ *c)
{
    int k;
#ifdef @UPPER@_SINCOS
    for (k = 0; k < count; ++k) @UPPER@_SINCOS(x[k], &s[k], &c[k]);
#else
    int plain = @UPPER@_PLAIN;
    for (k = 0; k < count; ++k) plain |= !(fabs@f@(x[k]) < @most@);
    if (plain) {
        for (k = 0; k < count; ++k) {
            s[k] = sin@f@(x[k]);
            c[k] = cos@f@(x[k]);
        }
        return;
    }
    for (k = 0; k < count; ++k) {
        const @real@ turns = (x[k] * @inverse@ + @round@) - @round@;
        const @real@ whole = (turns * @quarter@ + @round@) - @round@;
        const @real@ quadrant = turns - @four@ * whole; /* -2, -1, 0, 1 or 2 */
        const @real@ r = ((x[k] - turns * @part0@) - turns * @part1@) - turns * @part2@;
        const @real@ z = r * r;
        const @real@ sine = r + r * z * (@sine@);
        const @real@ cosine = (@one@ - @half@ * z) + z * z * (@cosine@);
        const @real@ odd = quadrant * quadrant; /* 1 where sine and cosine change places */
        const @real@ first = odd == @one@ ? cosine : sine;
        const @real@ second = odd == @one@ ? sine : cosine;
        s[k] = quadrant == @zero@ || quadrant == @one@ ? first : -first;
        c[k] = quadrant == @zero@ || quadrant == -@one@ ? second : -second;
    }
#endif
}
""", 'tanh_each': """\
static inline void tanh_each(const @real@ *x, int count, @real@ *y)
{
    int k;
#ifdef @UPPER@_TANH
    for (k = 0; k < count; ++k) y[k] = @UPPER@_TANH(x[k]);
#else
    if (@UPPER@_PLAIN) {
        for (k = 0; k < count; ++k) y[k] = tanh@f@(x[k]);
        return;
    }
    for (k = 0; k < count; ++k) { /* E / (E + 2) with E = exp(2 |x|) - 1; NaN stays NaN */
        const @real@ size = fabs@f@(x[k]);
        const @real@ twice = @two@ * (size > @saturated@ ? @saturated@ : size);
        const @real@ shifted = twice * @log2e@ + @round@;
        const @real@ powers = shifted - @round@;
        const @real@ r = (twice - powers * @ln2high@) - powers * @ln2low@;
        const @real@ small = r + r * r * (@exp@);
        union { @real@ number; @integer@ bits; } power;
        @real@ e;
        power.number = shifted;
        power.bits = (power.bits + @bias@u) << @mantissa@;
        e = power.number * small + (power.number - @one@);
        e = e / (e + @two@);
        y[k] = x[k] < @zero@ ? -e : e;
    }
#endif
}
"""}


def literal(value: float, precision: Precision) -> str:
    """Return a constant of a precision as C writes it."""
    if precision.suffix:
        text = f'{value:.{precision.digits}g}'
        return (text if any(mark in text for mark in '.en') else f'{text}.0') + precision.suffix
    return repr(float(value))


def elementary_functions(upper: str, precision: Precision, names: set[str]) -> str:
    """Return those C functions of sines, cosines and tanh; macros begin with `upper`."""
    def horner(coefficients: tuple[float, ...], variable: str) -> str:
        text = literal(coefficients[-1], precision)
        for coefficient in reversed(coefficients[:-1]):
            text = f'{literal(coefficient, precision)} + {variable} * ({text})'
        return text
    sine, cosine, exp = (table[:count] for table, count in zip((SIN, COS, EXP), precision.terms))
    high = 6.93147180369123816490e-01 if not precision.suffix else 0.693359375
    numbers = {
        'most': precision.most, 'inverse': 2.0 / math.pi, 'round': precision.rounding,
        'quarter': 0.25, 'four': 4.0, 'one': 1.0, 'half': 0.5, 'zero': 0.0, 'two': 2.0,
        'part0': precision.parts[0], 'part1': precision.parts[1], 'part2': precision.parts[2],
        'saturated': precision.saturated, 'log2e': 1.0 / math.log(2.0), 'ln2high': high,
        'ln2low': (1.90821492927058770002e-10 if not precision.suffix
                   else math.log(2.0) - high)}
    words = {'UPPER': upper, 'real': precision.c, 'f': precision.suffix,
             'integer': precision.integer, 'bias': str(precision.bias),
             'mantissa': str(precision.mantissa), 'sine': horner(sine, 'z'),
             'cosine': horner(cosine, 'z'), 'exp': horner(exp, 'r'),
             **{name: literal(value, precision) for name, value in numbers.items()}}
    text = '\n'.join([HEAD, *(TEXTS[name] for name in sorted(names))]) if names else ''
    for name, word in words.items():
        text = text.replace(f'@{name}@', word)
    return text
