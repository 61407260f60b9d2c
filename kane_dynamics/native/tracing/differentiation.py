"""
Differentiation of traced values: forward and reverse mode, one rule for each operation.

Every operation y = f(a, b) has one rule: its slopes dy/da and dy/db, traced values
themselves. Both modes multiply and add these slopes along the graph, in opposite orders:

    forward:   dy = dy/da da + dy/db db           from the inputs to the outputs
    reverse:   a* += y* dy/da,  b* += y* dy/db    from the outputs to the inputs

Forward mode gives the product of the Jacobian and a tangent vector, reverse mode the
product of a cotangent vector and the Jacobian, each for a few times the operations of
the function. The results are traced values, so passes can be applied to results of
passes, for second derivatives. Source: A. Griewank, A. Walther, "Evaluating
Derivatives", 2nd ed., SIAM 2008, chapters 3 and 4.

Where a function is not smooth, the derivative is that of the branch which computes its
value: of `less` and `floor` it is 0, of `select(c, x, y)` that of the selected value. So
the derivative of abs(x) is 1 at 0, and that of min(x, y) and max(x, y) at x = y is that
of x.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from kane_dynamics.native.tracing.expression import Expr, operands
from kane_dynamics.native.tracing.program import Program
from kane_dynamics.native.tracing.subroutine import call, inlined, replayed, Subroutines
import numpy as np

LARGE = 50_000  # operations, times passes, of a Jacobian whose passes are calls

# The slopes of every operation y = f(a, b): by a and by b.
SLOPES: dict[str, Callable[..., tuple[Any, ...]]] = {
    'add': lambda y, a, b: (1.0, 1.0),
    'sub': lambda y, a, b: (1.0, -1.0),
    'mul': lambda y, a, b: (b, a),
    'div': lambda y, a, b: (1.0 / b, -(y * (1.0 / b))),
    'neg': lambda y, a: (-1.0,),
    'sin': lambda y, a: (np.cos(a),),
    'cos': lambda y, a: (-np.sin(a),),
    'tanh': lambda y, a: (1.0 - y * y,),
    'sqrt': lambda y, a: (0.5 / y,),
    'exp': lambda y, a: (y,),
    'log': lambda y, a: (1.0 / a,),
    'arctan': lambda y, a: (1.0 / (1.0 + a * a),),
    'floor': lambda y, a: (0.0,),
    'less': lambda y, a, b: (0.0, 0.0),
    'select': lambda y, c, a, b: (0.0, c.select(1.0, 0.0), c.select(0.0, 1.0)),
}


def forward(outputs: Iterable[Any], inputs: Sequence[Expr], tangents: Iterable[Any],
            share: Subroutines) -> list[Any]:
    """
    Return the tangents of outputs: the Jacobian times the tangents of the inputs.

    Parameters
    ----------
    outputs : iterable of scalars
        Traced values, or floats, which do not vary.
    inputs : sequence of Expr
        Traced values that the outputs depend on, in the order of `tangents`.
    tangents : iterable of scalars
        The rate of change of each input; structural zeros cause no arithmetic.
    share : Subroutines
        Registry of the derived subroutines: one for all passes of a program.

    """
    outputs = list(outputs)
    # In the order of the graph, the tangents of operands are known before those of
    # results.
    tangent: dict[int, Any] = {}
    for x, dx in zip(inputs, tangents, strict=True):
        tangent[x.index] = dx
    for y in _between(inputs, outputs):
        if y.op == 'call':  # the tangents of all of its results
            of_arguments = [_of(tangent, a) for a in y.args[1:]]
            tangent[y.index] = _forward_call(y, of_arguments, share)
        elif y.op == 'output':
            tangent[y.index] = tangent[y.args[0].index][y.args[1]]
        else:
            total: Any = 0.0
            for a, slope in zip(y.args, SLOPES[y.op](y, *y.args)):
                total = _plus(total, _times(slope, _of(tangent, a)))
            tangent[y.index] = total
    return [_of(tangent, y) for y in outputs]


def reverse(outputs: Iterable[Any], cotangents: Iterable[Any], inputs: Sequence[Expr],
            share: Subroutines) -> list[Any]:
    """
    Return the cotangents of inputs: the cotangents of the outputs times the Jacobian.

    Parameters
    ----------
    outputs, inputs, share
        As in `forward`.
    cotangents : iterable of scalars
        The weight of each output.

    """
    outputs = list(outputs)
    # In the opposite order: a value passes its weight on when all that use it have added
    # theirs.
    cotangent: dict[int, Any] = {}

    def add(x: Any, weight: Any) -> None:
        if isinstance(x, Expr):
            cotangent[x.index] = _plus(cotangent.get(x.index, 0.0), weight)
    for y, weight in zip(outputs, cotangents, strict=True):
        add(y, weight)
    # Of a call: the cotangents of its results by their places.
    of_results: dict[int, dict[int, Any]] = {}
    for y in reversed(_between(inputs, outputs)):
        weight = cotangent.get(y.index, 0.0)
        if y.op == 'call':
            callee = y.args[0]
            weights = [of_results[y.index].get(k, 0.0) for k in range(len(callee.outputs))]
            for a, share_of_a in zip(operands(y), _reverse_call(y, weights, share)):
                add(a, share_of_a)
        elif y.op == 'output':
            of_results.setdefault(y.args[0].index, {})[y.args[1]] = weight
        else:
            for a, slope in zip(y.args, SLOPES[y.op](y, *y.args)):
                add(a, _times(weight, slope))
    return [cotangent.get(x.index, 0.0) for x in inputs]


def jacobian(outputs: Any, inputs: Sequence[Expr], share: Subroutines) -> Any:
    """
    Return the Jacobian of outputs by inputs, of the outputs' shape and one more axis.

    By forward mode, a pass for each input, or by reverse mode, a pass for each output:
    whichever are fewer. Together the passes share the function's values, and each has
    only its own nonzero entries; but where that code would be large, they are calls of
    one subroutine.
    # Reverse mode gives rows of the Jacobian, forward mode columns.
    """
    flat = list(np.ravel(np.asarray(outputs, dtype=object)))
    # As many passes as there are inputs, forward, or outputs, backward: the fewer.
    by_inputs = len(inputs) <= len(flat)
    passes = min(len(inputs), len(flat))

    def one_pass(y: Any, x: Sequence[Expr], seed: Any) -> list[Any]:
        return forward(y, x, seed, share) if by_inputs else reverse(y, seed, x, share)
    # Code of all passes together, where they share the function's values.
    if passes * len(_between(inputs, flat)) <= LARGE:
        rows = [one_pass(flat, inputs, unit) for unit in np.eye(passes)]
    else:
        rows = _by_calls(one_pass, flat, inputs, passes, share)
    matrix = np.array(rows, dtype=object).reshape(passes, max(len(inputs), len(flat)))
    return (matrix.T if by_inputs else matrix).reshape(*np.shape(outputs), len(inputs))


def _by_calls(one_pass: Callable[..., list[Any]], outputs: Sequence[Any],
              inputs: Sequence[Expr], passes: int,
              share: Subroutines) -> list[list[Any]]:
    """Return the results of passes by calls of one subroutine."""
    function = Program('function', (), tuple(outputs), (len(outputs),))
    # The values that the function is computed from: its inputs first.
    place = {x.index: k for k, x in enumerate(inputs)}
    leaves = list(inputs)
    for node in function.schedule():
        if node.op == 'input' and node.index not in place:
            place[node.index] = len(leaves)
            leaves.append(node)

    def traced(values: Any, seed: Any) -> Any:
        # The function is computed again from its leaves within each call.
        results = replayed(function, lambda node: values[place[node.index]])
        return np.array(one_pass(results, values[:len(inputs)], seed))
    subroutine = share.trace('row', traced, [('values', (len(leaves),)),
                                             ('seed', (passes,))])
    return [call(subroutine, leaves, unit) for unit in np.eye(passes)]


def _between(inputs: Sequence[Expr], outputs: Sequence[Any]) -> list[Expr]:
    """Return the nodes that depend on inputs and lead to outputs, in order."""
    roots = [y for y in outputs if isinstance(y, Expr)]
    if not roots:
        return []
    last = max(y.index for y in roots)
    nodes = roots[0].trace.nodes[:last + 1]
    first = {x.index for x in inputs}

    # Forward: which nodes vary with the inputs.
    varying = bytearray(len(nodes))
    for node in nodes:
        by_operands = any(varying[a.index] for a in operands(node))
        varying[node.index] = node.index in first or by_operands

    # Backward: which nodes lead to an output. What is before the inputs does not matter.
    needed = bytearray(len(nodes))
    for y in roots:
        needed[y.index] = 1
    for node in reversed(nodes):
        if needed[node.index] and node.index not in first:
            for a in operands(node):
                needed[a.index] = 1

    # Both, without the inputs themselves.
    between = []
    for node in nodes:
        is_between = varying[node.index] and needed[node.index]
        if is_between and node.index not in first:
            between.append(node)
    return between


def _forward_call(node: Expr, tangents: list[Any], share: Subroutines) -> Any:
    """Return the tangents of the results of a call, by a derived subroutine."""
    callee, *arguments = node.args

    def derived(values: Any, rates: Any) -> Any:
        # Only traced values vary; constants of the call stay constants.
        moving = [k for k, x in enumerate(values) if isinstance(x, Expr)]
        moving_values = [values[k] for k in moving]
        moving_rates = [rates[k] for k in moving]
        return np.array(forward(inlined(callee, values), moving_values, moving_rates,
                                share))
    return share(f'{callee.name}_forward', derived, arguments, tangents)


def _reverse_call(node: Expr, cotangents: list[Any], share: Subroutines) -> Any:
    """Return the cotangents of the operands of a call, by a derived subroutine."""
    callee, *arguments = node.args

    def derived(values: Any, weights: Any) -> Any:
        moving_values = [x for x in values if isinstance(x, Expr)]
        return np.array(reverse(inlined(callee, values), weights, moving_values, share))
    return share(f'{callee.name}_reverse', derived, arguments, cotangents)


def _of(tangent: dict[int, Any], x: Any) -> Any:
    """Return the tangent of an operand, 0 for one that does not vary."""
    return tangent.get(x.index, 0.0) if isinstance(x, Expr) else 0.0


def _times(x: Any, y: Any) -> Any:
    """
    Return x y; a factor `select(c, a, 0)` selects the product instead.

    So an infinite slope of a branch that is not selected does not give 0 times infinity.
    """
    for factor, cofactor in ((x, y), (y, x)):
        if _masked(factor) and isinstance(cofactor, Expr):
            c, a, b = factor.args
            return c.select(_times(a, cofactor), _times(b, cofactor))
    return x * y


def _plus(x: Any, y: Any) -> Any:
    """Return x + y; the sum of two factors masked by one condition is masked, too."""
    if _masked(x) and _masked(y) and x.args[0] is y.args[0]:
        c, a, b = x.args
        return c.select(_plus(a, y.args[1]), _plus(b, y.args[2]))
    return x + y


def _masked(x: Any) -> bool:
    """Return whether a scalar is a selection with the constant 0 as alternative."""
    return isinstance(x, Expr) and x.op == 'select' and any(
        not isinstance(a, Expr) and a == 0.0 for a in x.args[1:])
