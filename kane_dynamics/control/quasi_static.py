"""Feedforward of a flexible robot whose beams are taken to bend as the load at the moment says."""

from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
import numpy as np

PRECISION = 1e-10  # of the deflection, at which it is found
MOST = 100  # corrections
GROWING = 2  # that are not smaller than the one before: there is no end to them


class QuasiStatic:
    """
    A flexible robot as its joints see it, its modes in equilibrium with the load.

    Elastic forces, gravity and the inertia of the motion that the joints have balance in every
    mode, whose speed and acceleration are left out: K eta = the load on the modes, which itself
    depends on eta. That holds as far as the motion is slow beside the lowest vibration. Its
    methods take and return what is of the joints alone, in the order of `joint_names`; arrays of
    states too.

    Parameters
    ----------
    robot : Robot
        With beams, in joint rates, without constraints. Its parameters, gravity and payload, may
        change.

    Raises
    ------
    InputError
        The robot is not of that kind.

    """

    def __init__(self, robot: Robot) -> None:
        model = robot.model
        if not model.flexible or robot.constraint_names or (
                robot.speed_names != robot.coordinate_names):
            raise InputError('quasi-static deflections are those of robots with beams, in joint '
                             'rates and without constraints')
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
            A shape is wrong, a number is not finite, or the load bends the beams beyond what
            their stiffness bears.

        """
        return self._state(q, u, udot)[0][..., self._modes]

    def inverse_dynamics(self, q: Any, u: Any, udot: Any) -> Array:
        """Return the joints' torques for a motion, (..., n); arguments and errors as `modes`."""
        tau: Array = self.robot.inverse_dynamics(*self._state(q, u, udot))
        return tau[..., self._joints]

    def torque_terms(self, q: Any, u: Any, udot: Any) -> Array:
        """Return them by source, (..., 5, n): rows as of `Robot.torque_terms`."""
        terms: Array = self.robot.torque_terms(*self._state(q, u, udot))
        return terms[..., self._joints]

    def gravity_force(self, q: Any) -> Array:
        """Return the torques that hold gravity, where it has bent the beams, (..., n)."""
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
        raise InputError(f'the load bends the beams of {self.robot.model.name} beyond what their '
                         'stiffness bears: no equilibrium was found')

    def _whole(self, name: str, values: Any) -> Array:
        """Return an array of the joints with zeros for the modes."""
        x, n = np.asarray(values, dtype=np.float64), len(self.joint_names)
        if x.shape[-1:] != (n,):
            raise InputError(f'{name} has shape {x.shape}; expected (..., {n}) for '
                             f'{", ".join(self.joint_names)}')
        result = np.zeros((*x.shape[:-1], self.robot.n))
        result[..., self._joints] = x
        return result


def _index(places: list[int]) -> slice | list[int]:
    """Return what picks these entries: a slice, which is several times faster, if it can."""
    first, last = places[0], places[-1] + 1
    return slice(first, last) if places == list(range(first, last)) else places
