"""
Short expressions, by polynomials in sines, cosines, symbols and square roots.

SymPy's `expand` expands a nested expression before terms cancel, which takes too long
for mechanisms with oblique axes. Here each node of the expression is converted once to a
polynomial of SymPy's sparse rings, and sin^2 = 1 - cos^2 is applied after every product.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.native.tracing.program import OperationCount
import sympy as sp
from sympy.polys.rings import ring
from sympy.simplify.fu import TR8

MOST_TERMS = 5000  # of a polynomial; more are too many to read
MOST_FACTORED = 40  # terms; common factors of more take long to find


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
        # The square of each sine and each root, by the place of its generator, and the
        # places of a generator and its inverse.
        self._rules: list[tuple[int, Any]] = []
        self._inverses: list[tuple[int, int]] = []
        for place, atom in enumerate(atoms):
            if isinstance(atom, sp.sin):
                cosine = self.generators[sp.cos(*atom.args)]
                self._rules.append((place, self.ring.one - cosine**2))
            elif isinstance(atom, sp.Abs):
                self._rules.append((place, self.of(atom.args[0]**2)))
            elif atom.is_Pow and atom.exp == sp.S.Half:
                self._rules.append((place, self.of(atom.base)))
            is_inverse = atom.is_Pow and atom.exp.is_negative
            if 1 / atom in self.generators and not is_inverse:
                self._inverses.append((place, atoms.index(1 / atom)))

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
        if expression.is_Pow and expression.exp.is_negative:
            factors = [self.generators[1 / expression.base]] * int(-expression.exp)
        elif expression.is_Pow:
            factors = [self.of(expression.base)] * int(expression.exp)
        else:  # products of short polynomials first, which keeps intermediate ones short
            factors = sorted(map(self.of, expression.args), key=len)
        result = self.ring.one
        for factor in factors:
            result = self._bounded(self._lowered(result * factor))
        return result

    def _bounded(self, polynomial: Any) -> Any:
        if len(polynomial) > MOST_TERMS:
            raise InputError(f'derivation: more than {MOST_TERMS} terms; expected '
                             'fewer joints (--joints), or numbers for symbols '
                             '(--numbers)')
        return polynomial

    def _lowered(self, polynomial: Any) -> Any:
        """Return a polynomial with second powers of sines and roots replaced."""
        for pair in self._inverses:
            if any(min(powers[k] for k in pair) for powers in polynomial):
                polynomial = self._cancelled(polynomial, pair)
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

    def _cancelled(self, polynomial: Any, pair: tuple[int, int]) -> Any:
        """Return a polynomial without products of a generator and its inverse."""
        result = self.ring.zero
        for powers, coefficient in polynomial.items():
            common = min(powers[k] for k in pair)
            remaining = list(powers)
            for k in pair:
                remaining[k] -= common
            result += self.ring.from_dict({tuple(remaining): coefficient})
        return result


class _Trig:
    """Symbols and functions (sin, cos, roots, inverses) of polynomial expressions."""

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
            elif x.is_Pow and x.exp.is_Integer:
                self.atoms.add(1 / x.base)
                waiting.append(x.base)
            elif not x.is_Rational:
                self.atoms.add(x)
                # sin^2 = 1 - cos^2 needs both; the square of a root needs its terms.
                if isinstance(x, sp.sin | sp.cos):
                    self.atoms |= {sp.sin(*x.args), sp.cos(*x.args)}
                elif isinstance(x, sp.Abs):
                    waiting.append(x.args[0])
                elif x.is_Pow:
                    waiting.append(x.base)

    def form(self, x: Any) -> Any:
        """Return a node as a sum or a product of simpler nodes, or unchanged."""
        if x not in self._forms:
            self._forms[x] = self._form(x)
        return self._forms[x]

    def _form(self, x: Any) -> Any:
        if isinstance(x, sp.sin | sp.cos):
            # Expanding a constant offset would double the terms.
            offset = x.args[0].as_coeff_Add()[0]
            return sp.expand_trig(x) if offset == 0 else x
        if not x.is_Pow or (x.exp.is_Integer and x.exp.is_positive):
            return x
        if x.exp == sp.S.Half and x.base.is_Integer and not x.base.is_prime:
            # The root of a product is the product of the roots of its prime factors.
            roots = [sp.sqrt(p)**k for p, k in sp.factorint(x.base).items()]
            return sp.Mul(*roots, evaluate=False)
        if x.exp.is_Rational and x.exp.q == 2 and x.exp != sp.S.Half:
            # A power of a root: of a number, or of an expression, positive or negative.
            if x.base.is_Integer:
                return sp.sqrt(x.base) * x.base**(x.exp - sp.S.Half)
            if x.exp == -sp.S.Half:
                return x
            root = sp.sqrt(x.base) if x.exp > 0 else 1 / sp.sqrt(x.base)
            return sp.Pow(root, abs(x.exp.p), evaluate=False)
        if x.base.is_Add:
            # Of an inverse, the shortest form of the sum; of its products, each factor.
            base = sp.factor_terms(as_polynomial(x.base))
            return sp.Mul(*[factor**x.exp for factor in sp.Mul.make_args(base)])
        return x


def as_polynomial(expression: Any) -> Any:
    """Return an expression expanded, in lowest powers of sines and roots."""
    return Polynomials([expression]).of(expression).as_expr()


def shortened(expressions: Sequence[Any], q: Iterable[Any], u: Iterable[Any] = ()) -> list[Any]:
    """
    Return simplified expressions, with sin^2 + cos^2 = 1 and sums of angles applied.

    Parameters
    ----------
    expressions : sequence of SymPy expressions
        Expressions in sines and cosines of q, polynomial in u and in tanh(u), |u| and
        exp(-u^2).
    q, u : symbols
        Coordinates and speeds; the coefficient of each product of speeds is simplified
        by itself, and left expanded if it has more than `MOST_FACTORED` terms.

    Raises
    ------
    InputError
        If an expression has too many terms.

    """
    polynomials = Polynomials(expressions)
    angles = Angles(polynomials, q)
    # Terms are sorted by products of speeds and of the functions that friction has.
    frictions = [x for x in polynomials.generators if isinstance(x, sp.tanh | sp.Abs | sp.exp)]
    speeds = [*u, *frictions]
    results: dict[Any, Any] = {}
    for expression in expressions:
        if expression not in results:
            parts = polynomials.by(polynomials.of(expression), speeds)
            terms = [product * angles.short(part) for product, part in parts.items()]
            results[expression] = sp.Add(*terms)
    return [results[expression] for expression in expressions]


class Angles:
    """Sines and cosines of coordinates in polynomials, as products or of sums."""

    def __init__(self, polynomials: Polynomials, q: Iterable[Any]) -> None:
        """Find the places of the sines and cosines of each coordinate."""
        self.ring = polynomials.ring
        self.places: dict[Any, tuple[int, int]] = {}  # of (cosine, sine), by coordinate
        for x in q:
            if sp.sin(x) in polynomials.generators:
                self.places[x] = (self.ring.symbols.index(sp.cos(x)),
                                  self.ring.symbols.index(sp.sin(x)))

    def short(self, polynomial: Any) -> Any:
        """Return the shorter form of a polynomial: in functions of q or of sums of q."""
        # With the even powers of the cosines as sines, where that is shorter.
        for cosine, sine in self.places.values():
            with_sines = self._with_sines(polynomial, cosine, sine)
            polynomial = min(polynomial, with_sines, key=_operations)
        forms = [polynomial.as_expr()]
        if len(polynomial) > MOST_FACTORED:
            return forms[0]
        trigonometric = [k for pair in self.places.values() for k in pair]
        if any(sum(powers[k] for k in trigonometric) > 1 for powers in polynomial):
            forms.append(self._of_sums(polynomial))
        return min(map(sp.factor_terms, forms), key=sp.count_ops)

    def _with_sines(self, polynomial: Any, cosine: int, sine: int) -> Any:
        """Return a polynomial with cos^2 replaced by 1 - sin^2."""
        square = self.ring.one - self.ring.gens[sine]**2
        result = self.ring.zero
        for powers, coefficient in polynomial.items():
            lowered = list(powers)
            lowered[cosine] %= 2
            term = self.ring.from_dict({tuple(lowered): coefficient})
            result += term * square**(powers[cosine] // 2)
        return result

    def _of_sums(self, polynomial: Any) -> Any:
        """Return a polynomial with products of sines and cosines as those of sums."""
        expanded = sp.expand_mul(TR8(polynomial.as_expr()))
        functions = expanded.atoms(sp.sin, sp.cos)
        return sp.collect(expanded, sorted(functions, key=sp.default_sort_key))


def _operations(polynomial: Any) -> int:
    """Return the operations of a polynomial, term by term."""
    return sum(sum(powers) + 1 for powers in polynomial)


def operations(expressions: Iterable[Any]) -> OperationCount:
    """Return the operations of expressions without sharing; signs cost nothing."""
    counts: dict[Any, OperationCount] = {}

    def count(x: Any) -> OperationCount:
        if x not in counts:
            inner = sum(map(count, x.args), OperationCount())
            counts[x] = inner + _own_operations(x)
        return counts[x]
    return sum(map(count, expressions), OperationCount())


def _own_operations(x: Any) -> OperationCount:
    """Return the operations of a node, without those of its arguments."""
    if x.is_Add:
        return OperationCount(additions=len(x.args) - 1)
    if x.is_Mul:
        factors = [factor for factor in x.args if factor != -1]
        return OperationCount(multiplications=len(factors) - 1)
    if x.is_Pow and x.exp.is_Integer:
        return OperationCount(multiplications=int(abs(x.exp)) - 1,
                              divisions=int(x.exp.is_negative))
    return OperationCount(functions=int(x.is_Function or x.is_Pow))
