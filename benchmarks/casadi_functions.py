"""
Functions for CasADi in machine code and as expression graphs, interleaved.

Inverse dynamics of the FR3 with its Jacobian. Pinocchio's graph is compared too where
its `pinocchio.casadi` is installed; the wheels of `pin` lack it.
"""

from collections.abc import Callable
import statistics
import sys
import time
from typing import Any

import casadi
from gates import exit_status
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
import numpy as np

URDF = resource_path('urdf', 'fr3.urdf')
STATES = 200
ROUNDS = 60
GATE = 10.0  # least ratio of Pinocchio's time to that of machine code


def with_jacobian(function: Any, n: int) -> Any:
    """Return a function of q, u, udot that gives the torques and their Jacobian."""
    inputs = [casadi.MX.sym(name, n) for name in ('q', 'u', 'udot')]
    torques = function(*inputs)
    return casadi.Function('both', inputs, [
        torques, *function.jacobian()(*inputs, casadi.DM(*torques.shape))])


def graph_with_jacobian(torques: Callable[..., Any], n: int) -> Any:
    """Return the same as one graph, in which common subexpressions are computed once."""
    inputs = [casadi.SX.sym(name, n) for name in ('q', 'u', 'udot')]
    tau = torques(*inputs)
    return casadi.Function('graph', inputs,
                           [tau, *(casadi.jacobian(tau, x) for x in inputs)],
                           {'cse': True})


def pinocchio_torques() -> Callable[..., Any] | None:
    """Return Pinocchio's inverse dynamics of SX expressions; None without it."""
    try:
        import pinocchio
        import pinocchio.casadi as symbolic
    except ImportError:
        return None
    model = pinocchio.buildReducedModel(
        *_locked(pinocchio.buildModelFromUrdf(str(URDF))))
    traced = symbolic.Model(model)
    return lambda q, u, udot: symbolic.rnea(traced, traced.createData(), q, u, udot)


def _locked(model: Any) -> tuple[Any, list[int], Any]:
    """Return a model, its fingers, and the configuration at which they are locked."""
    fingers = [k for k, name in enumerate(model.names) if 'finger' in name]
    return model, fingers, np.zeros(model.nq)


def main() -> int:
    """Print the comparison; return 1 if the gate does not hold."""
    robot = Robot(load_urdf(URDF, tip='fr3_link7'), friction=False)
    functions = {
        'machine code': with_jacobian(robot.casadi('inverse_dynamics', compiled=True),
                                      robot.n),
        'expression graph': graph_with_jacobian(
            robot.casadi('inverse_dynamics', compiled=False), robot.n)}
    peer = pinocchio_torques()
    if peer is not None:
        functions['Pinocchio'] = graph_with_jacobian(peer, robot.n)
    inputs = [casadi.DM(x)
              for x in np.random.default_rng(0).normal(size=(3, robot.n, STATES))]
    mapped = {name: function.map(STATES) for name, function in functions.items()}
    first = [np.array(x) for x in mapped['machine code'](*inputs)]
    for name, function in mapped.items():
        for x, expected in zip(function(*inputs), first, strict=True):
            np.testing.assert_allclose(np.array(x), expected, atol=1e-9, err_msg=name)
    times: dict[str, list[float]] = {name: [] for name in mapped}
    for _ in range(ROUNDS):
        for name, function in mapped.items():
            began = time.process_time()
            function(*inputs)
            times[name].append((time.process_time() - began) / STATES)
    ratios = {
        name: statistics.median(x / y for x, y in zip(durations, times['machine code']))
        for name, durations in times.items()}
    print('Inverse dynamics of the FR3 with its Jacobian, seven axes, CasADi '
          f'{casadi.__version__}: relative time')
    for name, ratio in ratios.items():
        print(
            f'  {name:20}{ratio:8.1f}   ({1e6 * statistics.median(times[name]):.1f} us)')
    if peer is None:
        print('LEFT OUT: Pinocchio: no pinocchio.casadi; its gate is not checked')
    elif ratios['Pinocchio'] < GATE:
        print(f'FAILED: {ratios["Pinocchio"]:.1f} times as fast as Pinocchio; expected '
              f'{GATE:g}')
        return exit_status(False)
    return 0


if __name__ == '__main__':
    sys.exit(main())
