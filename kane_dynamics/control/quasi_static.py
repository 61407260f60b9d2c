"""Quasi-static dynamics of a flexible robot: its modes are in equilibrium with the load."""

from typing import Any

from kane_dynamics._util.attribute_hints import fixed
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
import numpy as np

PRECISION = 1e-10  # relative tolerance of the deflection
MOST = 100  # corrections
GROWING = 2  # corrections that do not decrease: the iteration diverges


@fixed
class QuasiStatic:
    """
    A flexible robot with its modes in equilibrium with the load.

    Elastic forces, gravity and inertial forces of the joint motion balance in every mode; speeds
    and accelerations of the modes are neglected: K eta = load on the modes, which depends on eta.
    This is valid for motions that are slow compared to the lowest vibration. Methods use joint
    quantities only, in the order of `joint_names`, for one state or arrays of states.

    Parameters
    ----------
    robot : Robot
        With beams, in joint rates, without constraints. Its parameters, gravity and payload, may
        change.

    Raises
    ------
    InputError
        The robot has no beams, or it has chosen speeds or constraints.

    """

    def __init__(self, robot: Robot) -> None:
        model = robot.model
        if not model.flexible or robot.constraint_names or (
                robot.speed_names != robot.coordinate_names):
            raise InputError('quasi-static deflections: a robot without beams, or with chosen '
                             'speeds or constraints; expected one with beams, in joint rates and '
                             'without constraints')
        self.robot = robot
        modes = list(model.modal_coordinates)
        joints = [k for k in range(model.n) if k not in modes]
        self._modes, self._joints = _index(modes), _index(joints)
        self.joint_names = tuple(model.coordinate_names[k] for k in joints)
        stiffness = np.zeros((model.n, model.n))
        for body in model.bodies:
            if body.beam is not None:
                places = list(body.beam.coordinates)
                stiffness[np.ix_(places, places)] = body.beam.stiffness
        self._flexibility = np.linalg.inv(stiffness[np.ix_(modes, modes)])

    def modes(self, q: Any, u: Any, udot: Any) -> Array:
        """
        Return the modal coordinates in equilibrium, (..., m).

        Parameters
        ----------
        q, u, udot : (..., n) arrays
            Of the joints; rad or m, and s.

        Raises
        ------
        InputError
            A shape is wrong, a number is not finite, or the load exceeds the stiffness of the
            beams.

        """
        return self._state(q, u, udot)[0][..., self._modes]

    def inverse_dynamics(self, q: Any, u: Any, udot: Any) -> Array:
        """Return the joint torques for a motion, (..., n); arguments and errors as `modes`."""
        tau: Array = self.robot.inverse_dynamics(*self._state(q, u, udot))
        return tau[..., self._joints]

    def torque_terms(self, q: Any, u: Any, udot: Any) -> Array:
        """Return the joint torques by source, (..., 5, n): rows as `Robot.torque_terms`."""
        terms: Array = self.robot.torque_terms(*self._state(q, u, udot))
        return terms[..., self._joints]

    def gravity_force(self, q: Any) -> Array:
        """Return the joint torques that balance gravity with deflected beams, (..., n)."""
        rest = np.zeros(np.shape(q))
        tau: Array = self.robot.gravity_force(self._state(q, rest, rest)[0])
        return tau[..., self._joints]

    def _state(self, q: Any, u: Any, udot: Any) -> tuple[Array, Array, Array]:
        """Return q with the deflection, u and udot of the whole robot, (..., n + m) each."""
        Q, U, A = (self._whole(name, x) for name, x in (('q', q), ('u', u), ('udot', udot)))
        before, grown = np.inf, 0
        for _ in range(MOST):
            change = self.robot.inverse_dynamics(Q, U, A)[..., self._modes] @ self._flexibility
            eta = Q[..., self._modes] - change
            Q[..., self._modes] = eta
            size = float(np.vdot(change, change))
            if size <= PRECISION**2 * float(np.vdot(eta, eta)):
                return Q, U, A
            grown += size >= before
            if grown == GROWING:
                break
            before = size
        raise InputError(f'load on the beams of {self.robot.model.name}: no equilibrium found; '
                         'expected a load within their stiffness')

    def _whole(self, name: str, values: Any) -> Array:
        """Return an array of all coordinates, with zeros for the modes."""
        x, n = np.asarray(values, dtype=np.float64), len(self.joint_names)
        if x.shape[-1:] != (n,):
            raise InputError(f'{name}: shape {x.shape}; expected (..., {n}) for '
                             f'{", ".join(self.joint_names)}')
        result = np.zeros((*x.shape[:-1], self.robot.n))
        result[..., self._joints] = x
        return result


def _index(places: list[int]) -> slice | list[int]:
    """Return an index of these entries: a slice, which is faster, if they are contiguous."""
    first, last = places[0], places[-1] + 1
    return slice(first, last) if places == list(range(first, last)) else places
