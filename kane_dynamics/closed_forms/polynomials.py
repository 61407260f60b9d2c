"""
Short expressions, by polynomials in sines, cosines, symbols and square roots.

SymPy's `expand` expands a nested expression before terms cancel, which takes too long
for mechanisms with oblique axes. Here each node of the expression is converted once to a
polynomial of SymPy's sparse rings, and sin^2 = 1 - cos^2 is applied after every product.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from kane_dynamics.errors import InputError
import sympy as sp
from sympy.polys.rings import ring
from sympy.simplify.fu import TR8

MOST_TERMS = 5000  # of a polynomial; more are too many to read
MOST_SHORTENED = 200  # terms; simplifying more takes minutes


class Polynomials:
    """
    Polynomials of expressions with common generators.

    Parameters
    ----------
    expressions : sequence of SymPy expressions
        All expressions that will be expanded.

    """

    def __init__(self, expressions: Sequence[Any]) -> None:
        """Collect the generators, and the rules that reduce their powers."""
        self.plain = _Trig(expressions)
        atoms = sorted(self.plain.atoms, key=sp.default_sort_key)

        # A ring needs a generator, also where all expressions are numbers.
        self.ring, *generators = ring(atoms or 'x', sp.QQ)
        self.generators = dict(zip(atoms, generators))
        self._values: dict[Any, Any] = {}
        # The square of each sine and each root, by the place of its generator.
        self._rules: list[tuple[int, Any]] = []
        for place, atom in enumerate(atoms):
            if isinstance(atom, sp.sin):
                cosine = self.generators[sp.cos(*atom.args)]
                self._rules.append((place, self.ring.one - cosine**2))
            elif atom.is_Pow:
                self._rules.append((place, self.ring.one * int(atom.base)))

    def of(self, expression: Any) -> Any:
        """
        Return an expression as a polynomial, in lowest powers of sines and roots.

        Raises
        ------
        InputError
            If it has more than `MOST_TERMS` terms.

        """
        if expression not in self._values:
            self._values[expression] = self._expanded(expression)
        return self._values[expression]

    def by(self, polynomial: Any, variables: Iterable[Any]) -> dict[Any, Any]:
        """Return the coefficients of a polynomial in some generators, by monomial."""
        places = [self.ring.symbols.index(x) for x in variables if x in self.generators]
        coefficients: dict[Any, Any] = {}
        # Each term belongs to the monomial of its powers in these variables.
        for powers, coefficient in polynomial.terms():
            remaining = list(powers)
            monomial = sp.Integer(1)
            for k in places:
                remaining[k] = 0
                monomial *= self.ring.symbols[k]**powers[k]
            part = coefficients.setdefault(monomial, self.ring.zero)
            part[tuple(remaining)] = coefficient
        return coefficients

    def _expanded(self, expression: Any) -> Any:
        expression = self.plain.form(expression)
        # By the form of the expression: a number, a generator, a sum, a power or a
        # product.
        if expression.is_Rational:
            return self.ring.one * sp.QQ(expression.p, expression.q)
        if expression in self.generators:
            return self.generators[expression]
        if expression.is_Add:
            result = self.ring.zero
            for part in expression.args:
                result = self._bounded(result + self.of(part))
            return result
        if expression.is_Pow:
            factors = [self.of(expression.base)] * int(expression.exp)
        else:  # products of short polynomials first, which keeps intermediate ones short
            factors = sorted(map(self.of, expression.args), key=len)
        result = self.ring.one
        for factor in factors:
            result = self._bounded(self._lowered(result * factor))
        return result

    def _bounded(self, polynomial: Any) -> Any:
        if len(polynomial) > MOST_TERMS:
            raise InputError(f'closed form: more than {MOST_TERMS} terms; expected '
                             'fewer joints (--joints), or numbers for symbols '
                             '(--numbers)')
        return polynomial

    def _lowered(self, polynomial: Any) -> Any:
        """Return a polynomial with second powers of sines and roots replaced."""
        for place, square in self._rules:
            # x^n = x^(n - 2) square, until no power above 1 remains.
            while any(powers[place] > 1 for powers in polynomial):
                low = self.ring.zero
                high = self.ring.zero
                for powers, coefficient in polynomial.items():
                    if powers[place] > 1:
                        lowered = list(powers)
                        lowered[place] -= 2
                        high[tuple(lowered)] = coefficient
                    else:
                        low[powers] = coefficient
                polynomial = low + high * square
        return polynomial


class _Trig:
    """Symbols and functions (sin, cos, roots) of which expressions are polynomials."""

    def __init__(self, expressions: Sequence[Any]) -> None:
        """Collect the symbols and functions of the expressions."""
        self.atoms: set[Any] = set()
        self._forms: dict[Any, Any] = {}
        waiting = list(expressions)
        visited = set()

        # Sums, products and integer powers are taken apart; what remains are the atoms.
        while waiting:
            x = self.form(waiting.pop())
            if x in visited:
                continue
            visited.add(x)
            if x.is_Add or x.is_Mul:
                waiting.extend(x.args)
            elif x.is_Pow and x.exp.is_Integer and x.exp > 0:
                waiting.append(x.base)
            elif not x.is_Rational:
                self.atoms.add(x)
                # sin^2 = 1 - cos^2 needs both.
                if isinstance(x, sp.sin):
                    self.atoms.add(sp.cos(*x.args))

    def form(self, x: Any) -> Any:
        """Return a node as a sum or a product of simpler nodes, or unchanged."""
        if isinstance(x, sp.sin | sp.cos):
            # Expanding a constant offset would double the terms.
            if x not in self._forms:
                offset = x.args[0].as_coeff_Add()[0]
                self._forms[x] = sp.expand_trig(x) if offset == 0 else x
            return self._forms[x]
        if x.is_Pow and x.exp == sp.S.Half and x.base.is_Integer and not x.base.is_prime:
            # The root of a product is the product of the roots of its prime factors.
            roots = [sp.sqrt(p)**k for p, k in sp.factorint(x.base).items()]
            return sp.Mul(*roots, evaluate=False)
        return x


def shortened(expressions: Sequence[Any], q: Iterable[Any], u: Iterable[Any] = (), *,
              progress: Callable[[float], object] = lambda done: None) -> list[Any]:
    """
    Return simplified expressions, with sin^2 + cos^2 = 1 and sums of angles applied.

    Parameters
    ----------
    expressions : sequence of SymPy expressions
        Expressions in sines and cosines of q, polynomial in u and in tanh(u), |u| and
        exp(-u^2).
    q, u : symbols
        Coordinates and speeds; the coefficient of each product of speeds is simplified
        by itself, and left expanded if it has more than `MOST_SHORTENED` terms.
    progress : callable
        Called with the finished fraction of the expressions.

    Raises
    ------
    InputError
        If an expression has too many terms.

    """
    angles = list(q)
    polynomials = Polynomials(expressions)
    # Terms are sorted by products of speeds and of the functions that friction has.
    frictions = [x for x in polynomials.generators if isinstance(x, sp.tanh | sp.Abs | sp.exp)]
    speeds = [*u, *frictions]
    results = []
    for done, expression in enumerate(expressions, 1):
        parts = polynomials.by(polynomials.of(expression), speeds)
        terms = []
        for product, part in parts.items():
            terms.append(product * _short(part, angles))
        results.append(sp.Add(*terms))
        progress(done / len(expressions))
    return results


def _short(polynomial: Any, q: list[Any]) -> Any:
    """Return the shorter form of a polynomial: in functions of q or of sums of q."""
    products = polynomial.as_expr()
    if len(polynomial) > MOST_SHORTENED:
        return products
    # Products of sines and cosines as sums of those of summed angles.
    sums = sp.expand(TR8(products))

    # Or with the even powers of the cosines as sines, where that is shorter.
    for x in q:
        with_sines = _lowered(products, sp.cos(x), sp.sin(x))
        products = min(products, with_sines, key=sp.count_ops)
    return min(map(sp.factor_terms, (products, sums)), key=sp.count_ops)


def _lowered(expression: Any, high: Any, low: Any) -> Any:
    """Return a polynomial with high^2 replaced by 1 - low^2."""
    lowered = []
    for (power,), coefficient in sp.Poly(expression, high, domain='EX').terms():
        square = (1 - low**2)**(power // 2)
        lowered.append(coefficient * high**(power % 2) * square)
    return sp.expand(sp.Add(*lowered))
