"""
Functions for CasADi in machine code, as graphs and as generated C, interleaved.

Inverse dynamics of two arms, and with its Jacobian. The peers are our expression graph
and a Newton-Euler program in the links' frames, written for CasADi alone: by CasADi's
interpreter, and as C that CasADi generates, compiled by gcc and by clang with -O3
-march=native. The fastest counts.
"""

from collections.abc import Callable
import contextlib
from functools import partial
import subprocess
import sys
import tempfile
import time
from typing import Any

import casadi
from compilers import compilers
from gates import exit_status
from interleaved_timing import interleaved
from kane_dynamics import load_urdf, Model, Robot
from kane_dynamics._util.resources import resource_path
import numpy as np

ARMS = {'fr3': 'fr3_link7', 'ur10e': 'wrist_3_link'}
STATES = 200
# Least time of the fastest program of Newton and Euler over that of machine code.
GATES = {'inverse dynamics': 1.2, 'with its Jacobian': 0.9}


def with_jacobian(function: Any, n: int) -> Any:
    """Return a function of q, u, udot that gives the torques and their Jacobian."""
    inputs = [casadi.MX.sym(name, n) for name in ('q', 'u', 'udot')]
    torques = function(*inputs)
    return casadi.Function('both', inputs, [
        torques, *function.jacobian()(*inputs, casadi.DM(*torques.shape))])


def alone(torques: Callable[..., Any], n: int, name: str) -> Any:
    """Return a function of q, u, udot that gives the torques, of one graph."""
    inputs = [casadi.SX.sym(key, n) for key in ('q', 'u', 'udot')]
    return casadi.Function(name, inputs, [torques(*inputs)], {'cse': True})


def graph_with_jacobian(torques: Callable[..., Any], n: int, name: str) -> Any:
    """Return the same as one graph, common subexpressions computed once."""
    inputs = [casadi.SX.sym(key, n) for key in ('q', 'u', 'udot')]
    tau = torques(*inputs)
    return casadi.Function(name, inputs,
                           [tau, *(casadi.jacobian(tau, x) for x in inputs)],
                           {'cse': True})


def newton_euler(model: Model) -> Callable[..., Any]:
    """Return inverse dynamics of a serial arm: Newton-Euler in the links' frames."""
    def torques(q: Any, u: Any, udot: Any) -> Any:
        omega, alpha = casadi.SX.zeros(3), casadi.SX.zeros(3)
        acceleration = -casadi.SX(np.array(model.gravity))
        rotations, forces = [], []
        for k, body in enumerate(model.bodies):
            joint = body.joint
            axis = casadi.SX(joint.axis)
            # Velocity and acceleration of the joint's origin, in the frame of the link.
            arm = casadi.SX(joint.translation)
            acceleration += (casadi.cross(alpha, arm)
                             + casadi.cross(omega, casadi.cross(omega, arm)))
            R = casadi.SX(joint.rotation) @ rotation(joint.axis, q[k])
            omega = R.T @ omega + axis * u[k]
            alpha = R.T @ alpha + axis * udot[k] + casadi.cross(omega, axis * u[k])
            acceleration = R.T @ acceleration
            # Force and moment that the link needs, about its joint.
            inertial = body.inertial
            com, inertia = casadi.SX(inertial.com), casadi.SX(inertial.inertia)
            of_com = acceleration + casadi.cross(alpha, com) + casadi.cross(
                omega, casadi.cross(omega, com))
            force = inertial.mass * of_com
            moment = (inertia @ alpha + casadi.cross(omega, inertia @ omega)
                      + casadi.cross(com, force))
            rotations.append(R)
            forces.append((force, moment))
        tau = [0] * len(model.bodies)
        force, moment = casadi.SX.zeros(3), casadi.SX.zeros(3)
        for k in reversed(range(len(model.bodies))):
            force, moment = force + forces[k][0], moment + forces[k][1]
            joint = model.bodies[k].joint
            tau[k] = casadi.dot(casadi.SX(joint.axis), moment) + joint.armature * udot[k]
            force = rotations[k] @ force
            moment = rotations[k] @ moment + casadi.cross(casadi.SX(joint.translation),
                                                          force)
        return casadi.vertcat(*tau)
    return torques


def rotation(axis: np.ndarray, angle: Any) -> Any:
    """Return the rotation about a unit axis, SX; what is zero stays exactly zero."""
    K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]],
                  [-axis[1], axis[0], 0.0]])
    return casadi.sparsify(casadi.SX.eye(3) + casadi.sin(angle) * casadi.SX(K)
                           + (1 - casadi.cos(angle)) * casadi.SX(K @ K))


def in_c(function: Any, folder: str) -> dict[str, Any]:
    """Return the C that CasADi generates of a function, by each compiler."""
    source = function.generate(f'{function.name()}.c')
    functions = {}
    for k, compiler in enumerate(compilers()):
        library = f'./{function.name()}_{k}.so'
        subprocess.run([*compiler.c, '-O3', '-march=native', '-fPIC', '-shared', '-w',
                        source, '-o', library, '-lm'], check=True, cwd=folder)
        functions[compiler.name] = casadi.external(function.name(), library)
    return functions


def main() -> int:
    """Print the comparison; return 1 if a gate does not hold."""
    met = True
    for name, tip in ARMS.items():
        model = load_urdf(resource_path('urdf', f'{name}.urdf'), tip=tip)
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            met = raced(Robot(model, friction=False), folder) and met
    return exit_status(met)


def raced(robot: Robot, folder: str) -> bool:
    """Print the comparison for an arm; return whether its gate holds."""
    n = robot.n
    machine_code = robot.casadi('inverse_dynamics', compiled=True)
    graphs = {'our graph': robot.casadi('inverse_dynamics', compiled=False),
              'Newton-Euler': newton_euler(robot.model)}
    met = True
    for what, of_ours, of_graph in (
            ('inverse dynamics', machine_code, alone),
            ('with its Jacobian', with_jacobian(machine_code, n), graph_with_jacobian)):
        functions = {'machine code': of_ours}
        for k, (name, torques) in enumerate(graphs.items()):
            graph = of_graph(torques, n, f'graph_{what.count(" ")}_{k}')
            functions[f'{name}, interpreter'] = graph
            for compiler, function in in_c(graph, folder).items():
                functions[f'{name}, C by {compiler}'] = function
        ratios = relative_times(functions, n)
        print(f'{robot.model.name}: {what}, CasADi {casadi.__version__}: relative time')
        for name, ratio in ratios.items():
            print(f'  {name:34}{ratio:8.2f}')
        best = min(ratio for name, ratio in ratios.items() if 'Newton' in name)
        if best < GATES[what]:
            print(f'FAILED: the fastest peer takes {best:.2f} times as long; expected '
                  f'{GATES[what]:g}')
            met = False
    return met


def relative_times(functions: dict[str, Any], n: int) -> dict[str, float]:
    """Return the time of each function over that of machine code; all agree."""
    inputs = [casadi.DM(x)
              for x in np.random.default_rng(0).normal(size=(3, n, STATES))]
    mapped = {name: function.map(STATES) for name, function in functions.items()}
    first = [np.array(x) for x in outputs(mapped['machine code'], inputs)]
    for name, function in mapped.items():
        for x, expected in zip(outputs(function, inputs), first, strict=True):
            np.testing.assert_allclose(np.array(x), expected, err_msg=name, rtol=0.0,
                                       atol=1e-9 * np.abs(expected).max())
    calls = {name: partial(function, *inputs) for name, function in mapped.items()}
    timing = interleaved(calls, clock=time.process_time)
    return {name: timing.ratio(name, 'machine code')[0] for name in functions}


def outputs(function: Any, inputs: list[Any]) -> tuple[Any, ...]:
    """Return the outputs of a function as a tuple."""
    result = function(*inputs)
    return result if isinstance(result, tuple) else (result,)


if __name__ == '__main__':
    sys.exit(main())
