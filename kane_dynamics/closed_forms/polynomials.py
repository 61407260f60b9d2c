"""
Short expressions, by polynomials in sines, cosines, symbols and square roots.

SymPy's `expand` expands a nested expression before terms cancel, which takes too long
for mechanisms with oblique axes. Here each node of the expression is converted once to a
polynomial of SymPy's sparse rings, and sin^2 = 1 - cos^2 is applied after every product.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

from kane_dynamics.errors import InputError
import sympy as sp
from sympy.core.cache import cacheit
from sympy.polys.rings import ring
from sympy.simplify.cse_main import tree_cse
from sympy.simplify.fu import TR6, TR8

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
        atoms = sorted(_atoms(expressions), key=sp.default_sort_key)

        # A ring needs a generator, also where all expressions are numbers.
        self.ring, *generators = ring(atoms or 'x', sp.QQ)
        self.generators = dict(zip(atoms, generators))
        self._values: dict[Any, Any] = {}
        # Monomials, and the polynomials that replace them: squares of sines and roots,
        # and the product of a generator and its inverse.
        self._rules: list[tuple[Any, Any]] = []
        for atom, generator in self.generators.items():
            inverse = None if atom == 1 else self.generators.get(1 / atom)
            if inverse is not None and not (atom.is_Pow and atom.exp.is_negative):
                self._rules.append(((generator * inverse).LM, self.ring.one))
            if isinstance(atom, sp.sin):
                square = self.ring.one - self.generators[sp.cos(*atom.args)]**2
            elif isinstance(atom, sp.Abs):
                square = self.of(atom.args[0]**2)
            elif atom.is_Pow and atom.exp == sp.S.Half:
                square = self.of(atom.base)
            else:
                continue
            self._rules.append(((generator**2).LM, square))

    def of(self, expression: Any) -> Any:
        """
        Return an expression as a polynomial, in lowest powers of sines and roots.

        Raises
        ------
        InputError
            If it has more than `MOST_TERMS` terms.

        """
        if expression not in self._values:
            self._values[expression] = self._expanded(_simple_form(expression))
        return self._values[expression]

    def by(self, polynomial: Any, variables: Iterable[Any]) -> dict[Any, Any]:
        """Return the coefficients of a polynomial in some generators, by monomial."""
        places = {self.ring.symbols.index(x) for x in variables if x in self.generators}
        coefficients: dict[Any, Any] = defaultdict(self.ring.zero.copy)
        # Each term belongs to the monomial of its powers in these variables.
        for powers, coefficient in polynomial.terms():
            monomial = tuple(p if k in places else 0 for k, p in enumerate(powers))
            quotient = self.ring.monomial_ldiv(powers, monomial)
            coefficients[monomial][quotient] = coefficient
        return {self.ring({monomial: 1}).as_expr(): part
                for monomial, part in coefficients.items()}

    def _expanded(self, expression: Any) -> Any:
        """Return the polynomial of a number, a generator, a sum, a power or a product."""
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
        """Return a polynomial with the monomials of all rules replaced."""
        for monomial, replacement in self._rules:
            places = [k for k, power in enumerate(monomial) if power]
            while any(all(powers[k] >= monomial[k] for k in places)
                      for powers in polynomial):
                unchanged = self.ring.zero
                quotients = self.ring.zero
                for powers, coefficient in polynomial.items():
                    quotient = self.ring.monomial_ldiv(powers, monomial)
                    if min(quotient) < 0:
                        unchanged[powers] = coefficient
                    else:
                        quotients[quotient] = coefficient
                polynomial = unchanged + quotients * replacement
        return polynomial


def _atoms(expressions: Sequence[Any]) -> set[Any]:
    """Return the symbols and functions (sin, cos, roots, inverses) of expressions."""
    atoms: set[Any] = set()
    waiting = list(expressions)
    visited = set()
    # Sums, products and integer powers are taken apart; what remains are the atoms.
    while waiting:
        x = _simple_form(waiting.pop())
        if x in visited:
            continue
        visited.add(x)
        if x.is_Add or x.is_Mul:
            waiting.extend(x.args)
        elif x.is_Pow and x.exp.is_Integer:
            waiting.append(x.base)
            if x.exp.is_negative:
                atoms.add(1 / x.base)
        elif isinstance(x, sp.sin | sp.cos):  # sin^2 = 1 - cos^2 needs both
            atoms |= {sp.sin(*x.args), sp.cos(*x.args)}
        elif not x.is_Rational:
            atoms.add(x)
            if x.is_Pow or isinstance(x, sp.Abs):  # its square has these terms
                waiting.append(x.args[0])
    return atoms


@cacheit  # type: ignore[untyped-decorator]  # SymPy has no types
def _simple_form(x: Any) -> Any:
    """Return a node as a sum or a product of simpler nodes, or unchanged."""
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
    if x.exp.is_Rational and x.exp.q == 2 and abs(x.exp.p) > 1:
        # A power of a root, or of its inverse.
        root = x.base**sp.Rational(sp.sign(x.exp), 2)
        return sp.Pow(root, abs(x.exp.p), evaluate=False)
    if x.exp.is_Integer and x.base.is_Add:
        # Of an inverse, the shortest form of the sum; of its products, each factor.
        base = sp.factor_terms(as_polynomial(x.base))
        return sp.Mul(*[factor**x.exp for factor in sp.Mul.make_args(base)])
    return x


def as_polynomial(expression: Any) -> Any:
    """Return an expression expanded, in lowest powers of sines and roots."""
    return Polynomials([expression]).of(expression).as_expr()


def shortened(expressions: Sequence[Any], speeds: Iterable[Any] = ()) -> list[Any]:
    """
    Return simplified expressions, with sin^2 + cos^2 = 1 and sums of angles applied.

    Parameters
    ----------
    expressions : sequence of SymPy expressions
        Polynomial in the speeds, and in tanh(u), |u| and exp(-u^2).
    speeds : symbols
        The coefficient of each product of speeds is simplified by itself, and left
        expanded if it has more than `MOST_FACTORED` terms.

    Raises
    ------
    InputError
        If an expression has too many terms.

    """
    polynomials = Polynomials(expressions)
    # Terms are sorted by products of speeds and of the functions that friction has.
    frictions = [x for x in polynomials.generators if isinstance(x, sp.tanh | sp.Abs | sp.exp)]
    variables = [*speeds, *frictions]
    results: dict[Any, Any] = {}
    for expression in expressions:
        if expression not in results:
            parts = polynomials.by(polynomials.of(expression), variables)
            terms = [product * _shortest(part) for product, part in parts.items()]
            results[expression] = sp.Add(*terms)
    return [results[expression] for expression in expressions]


def _shortest(polynomial: Any) -> Any:
    """Return the shortest form: with cosines, with sines, or in sums of the angles."""
    expression = polynomial.as_expr()
    if len(polynomial) > MOST_FACTORED:
        return expression
    forms = [expression]
    trigonometric = [k for k, x in enumerate(polynomial.ring.symbols)
                     if isinstance(x, sp.sin | sp.cos)]
    if any(sum(powers[k] for k in trigonometric) > 1 for powers in polynomial):
        of_sums = sp.expand_mul(TR8(expression))
        functions = sorted(of_sums.atoms(sp.sin, sp.cos), key=sp.default_sort_key)
        forms += [sp.expand_mul(TR6(expression)), sp.collect(of_sums, functions)]
    return min(map(sp.factor_terms, forms), key=sp.count_ops)


def operations(expressions: Sequence[Any]) -> int:
    """Return the number of operations, with each common subexpression computed once."""
    shared, reduced = tree_cse(expressions, sp.numbered_symbols('x'))
    steps = [*(x for _, x in shared), *reduced]
    return int(sp.count_ops([sp.N(x) for x in steps]))  # fractions are numbers
