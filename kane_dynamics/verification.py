"""Compiled kernels held against Kane's equations as they are defined."""

from typing import Any

from kane_dynamics.errors import CompileError
from kane_dynamics.mechanics import kane
from kane_dynamics.mechanics.payload import with_payload
import numpy as np

TOLERANCE = 1e-9  # relative error of a kernel at which it is taken to be wrong, not rounded


def verified(robot: Any, states: int) -> float:
    """
    Return the largest relative error of a Robot's kernels at random states.

    Forward dynamics is judged by the torque that its answer asks for, and left out where the
    mass matrix is singular.

    Raises
    ------
    CompileError
        An error is larger than `TOLERANCE`; names the quantity and the error.

    """
    rng = np.random.default_rng(0)
    gravity, payload, model = robot.parameters.gravity, robot.parameters.payload, robot.model
    if payload is not None:
        model = with_payload(model, robot.equations.payload_frame.name, payload)
    worst = 0.0
    for _ in range(states):
        q, u, udot = rng.uniform(-2.0, 2.0, (3, robot.n))
        M = kane.mass_matrix(model, q)
        bias = kane.bias_force(model, q, u, gravity=gravity, friction=robot.friction)
        tau = M @ udot + bias
        pairs = {
            'mass_matrix': (robot.mass_matrix(q), M),
            'bias_force': (robot.bias_force(q, u), bias),
            'gravity_force': (robot.gravity_force(q),
                              kane.gravity_force(model, q, gravity=gravity)),
            'inverse_dynamics': (robot.inverse_dynamics(q, u, udot), tau)}
        if robot.n and np.linalg.cond(M) < 1e12:
            pairs['forward_dynamics'] = (M @ robot.forward_dynamics(q, u, tau) + bias, tau)
        for name, (value, reference) in pairs.items():
            size = max(float(np.abs(reference).max(initial=0.0)), 1e-300)
            error = float(np.abs(value - reference).max(initial=0.0)) / size
            if not error < TOLERANCE:
                raise CompileError(f'{name} is off by {error:.3g} of its size from the '
                                   f'definition; at most {TOLERANCE:g} is rounding')
            worst = max(worst, error)
    return worst
