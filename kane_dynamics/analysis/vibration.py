"""Small vibrations of a robot about a configuration."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.hyperdual import lifted, seeded
from kane_dynamics.mechanics.energy_form import energies
from kane_dynamics.model.with_payload import with_payload
from kane_dynamics.robot.robot import Robot
import numpy as np


@dataclass(frozen=True, eq=False)
class Vibration:
    """
    Natural frequencies and mode shapes.

    Attributes
    ----------
    frequencies : (k,) array
        rad/s, ascending; 0 for modes without stiffness, negative (minus the growth rate, 1/s) for
        unstable modes.
    shapes : (n, k) array
        Column j: mode shape of frequency j, with unit modal mass.
    names : tuple of str
        Names of the coordinates.

    """

    frequencies: Array
    shapes: Array
    names: tuple[str, ...]


def natural_vibration(robot: Robot, q: Any, held: Sequence[str] = ()) -> Vibration:
    """
    Return natural frequencies and mode shapes at rest: M x'' + K x = 0.

    K is the Hessian of the potential energy.

    Parameters
    ----------
    robot : Robot
        In joint rates, without constraints.
    q : (n,) array
        An equilibrium, or a configuration held by actuators; rad, m, and modal coordinates.
    held : sequence of str
        Coordinates that do not move, such as braked joints.

    Raises
    ------
    InputError
        An unknown coordinate, or the robot has constraints or other speeds.

    """
    names = robot.coordinate_names
    if robot.speed_names != names:
        raise InputError('vibrations: a robot with chosen speeds or constraints; expected one in '
                         'joint rates without constraints')
    for name in held:
        if name not in names:
            raise InputError(f"held: no coordinate '{name}'; expected one of {', '.join(names)}")
    q = np.array(q, dtype=np.float64)
    free = [k for k, name in enumerate(names) if name not in held]
    M, K = robot.mass_matrix(q), stiffness_matrix(robot, q)
    root = np.linalg.inv(np.linalg.cholesky(M[np.ix_(free, free)]))
    square, vectors = np.linalg.eigh(root @ K[np.ix_(free, free)] @ root.T)
    shapes = np.zeros((robot.n, len(free)))
    shapes[free] = root.T @ vectors
    return Vibration(np.sign(square) * np.sqrt(np.abs(square)), shapes, names)


def stiffness_matrix(robot: Robot, q: Array) -> Array:
    """Return d2 PE / dq2, (n, n), exactly: gravity, springs and beams."""
    n, model = robot.n, robot.model
    frame, payload = robot.equations.payload_frame, robot.parameters.payload
    if frame is not None and payload is not None:
        model = with_payload(model, frame.name, payload)
    rows = []
    for unit in np.eye(n):
        value = energies.potential_energy(model, seeded(q, unit, 0, n),
                                          gravity=robot.parameters.gravity)
        rows.append(lifted(value, n).gradient_rate)
    return np.array(rows)
