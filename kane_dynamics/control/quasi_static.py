"""Quasi-static dynamics of a flexible robot: modes in equilibrium with the load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from kane_dynamics._util.checks import instance, real_numbers
from kane_dynamics._util.fixed_attributes import fixed
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.driven_mechanism import driving_tracker
from kane_dynamics.loop_tracking.loop_tracker import path_rows
from kane_dynamics.mechanics.constraints.conditioning import SINGULAR
from kane_dynamics.model.flexible_model import stiffened
from kane_dynamics.model.model import Model
from kane_dynamics.robot.feedforward_friction import feedforward_change
from kane_dynamics.robot.robot import Robot
import numpy as np

PRECISION = 1e-10  # relative tolerance of the deflection
CORRECTIONS = 100  # at most
LARGEST = 1e6  # m or rad, of a deflection; far larger than that of any beam
GROWING = 5  # corrections in a row, none the smallest yet: the iteration diverges


@fixed
class QuasiStatic:
    """
    A flexible robot with its modes in equilibrium with the load.

    Elastic forces, gravity and inertial forces of the joint motion balance in every
    mode; speeds and accelerations of the modes are neglected: K eta = load on the modes,
    which depends on eta. This is valid for motions that are slow compared to the lowest
    vibration. Methods use joint quantities only, in the order of `joint_names`, for one
    state or arrays of states.

    With closed loops u, udot and the torques are of the independent joints,
    `speed_names`. These joints keep their positions; the others follow from loop closure
    with the deflected beams.

    Parameters
    ----------
    robot : Robot
        With beams, in joint rates. With constraints on positions, the rates of some
        joints and of all modes are the independent speeds (`Robot(..., independent=)`);
        the torques are those of actuators at these joints. Its parameters, gravity and
        payload, may change.

    Raises
    ------
    InputError
        The robot has no beams, or other speeds or constraints.

    """

    def __init__(self, robot: Robot) -> None:
        instance(robot, Robot, 'robot')
        _check(robot)
        self.robot = robot
        model = robot.model
        speeds = robot.speed_names
        modes = list(model.modal_coordinates)
        joints = [k for k in range(model.n) if k not in modes]
        modal = [model.coordinate_names[k] for k in modes]
        self.joint_names = tuple(model.coordinate_names[k] for k in joints)
        self.speed_names = tuple(name for name in speeds if name not in modal)
        # Places among the coordinates, then among the speeds: the rates of all modes and
        # of some joints.
        self._modes = _index(modes)
        self._joints = _index(joints)
        self._modal_speeds = _index(list(map(speeds.index, modal)))
        self._speeds = _index(list(map(speeds.index, self.speed_names)))
        rows = path_rows(robot)
        if rows:
            raise InputError(f'quasi-static deflections: {", ".join(rows)} on '
                             'velocities; expected constraints on positions')
        self._tracker = driving_tracker(robot, robot.speed_names, max_figure=SINGULAR)
        # Beams do not share modes: the stiffness is block-diagonal.
        stiffness = np.zeros((model.n, model.n))
        for body in model.bodies:
            if body.beam is not None:
                places = list(body.beam.coordinates)
                stiffness[np.ix_(places, places)] = body.beam.stiffness
        self._flexibility = np.linalg.inv(stiffness[np.ix_(modes, modes)])

    def require_rigid_model(self, robot: Robot) -> None:
        """Raise InputError unless a rigid model has these joints and speeds."""
        same_joints = self.joint_names == robot.joint_names
        if not same_joints or self.speed_names != robot.speed_names:
            raise InputError(f'bending: for a robot with joints {list(self.joint_names)} and '
                             f'speeds {list(self.speed_names)}; expected those of this '
                             f'robot, {list(robot.joint_names)} and '
                             f'{list(robot.speed_names)}')

    def require_drives(self, name: str, joints: Sequence[str]) -> None:
        """Raise InputError unless the actuated joints, `name`, are independent ones."""
        if set(joints) != set(self.speed_names):
            raise InputError(f'{name}: {list(joints)}; expected '
                             f'{list(self.speed_names)}, the independent joints, '
                             'because others load the beams through the loops')

    def modes(self, q: Any, u: Any, udot: Any) -> Array:
        """
        Return the modal coordinates in equilibrium, (..., m).

        Parameters
        ----------
        q, u, udot : (..., n) arrays
            Of the joints; rad or m, and s. With closed loops q is closed for rigid
            beams.

        Raises
        ------
        InputError
            A shape is wrong, a number is not finite, or the load exceeds the stiffness
            of the beams.
        LoopError
            The loops do not close with the deflected beams.

        """
        return self._state(q, u, udot)[0][..., self._modes]

    def configuration(self, q: Any) -> Array:
        """Return all coordinates at rest, (..., n + m); errors as `modes`."""
        rest = self._zero_speeds(q)
        return self._state(q, rest, rest)[0]

    def inverse_dynamics(self, q: Any, u: Any, udot: Any) -> Array:
        """Return the joint torques for a motion, (..., n); errors as `modes`."""
        tau: Array = self.robot.inverse_dynamics(*self._state(q, u, udot))
        return tau[..., self._speeds]

    def feedforward_change(self, q: Any, u: Any, udot: Any) -> Array:
        """Return the torques by which commands of a motion exceed inverse dynamics, (..., n)."""
        change = feedforward_change(self.robot, *self._state(q, u, udot))
        return change[..., self._speeds]

    def torque_terms(self, q: Any, u: Any, udot: Any) -> Array:
        """Return the torques by source, (..., 5, n): rows as `Robot.torque_terms`."""
        terms: Array = self.robot.torque_terms(*self._state(q, u, udot))
        return terms[..., self._speeds]

    def gravity_force(self, q: Any) -> Array:
        """Return the torques that balance gravity with deflected beams, (..., n)."""
        rest = self._zero_speeds(q)
        tau: Array = self.robot.gravity_force(self._state(q, rest, rest)[0])
        return tau[..., self._speeds]

    def _state(self, q: Any, u: Any, udot: Any) -> tuple[Array, Array, Array]:
        """Return q with the deflection, u and udot of the whole robot."""
        n = self.robot.n
        # The modes have no columns in the arguments: they follow from the load.
        Q = self._whole('q', q, self.joint_names, self._joints, self.robot.n_q)
        U = self._whole('u', u, self.speed_names, self._speeds, n)
        A = self._whole('udot', udot, self.speed_names, self._speeds, n)
        if not Q.shape[:-1] == U.shape[:-1] == A.shape[:-1]:
            raise InputError(f'u, udot: shapes {np.shape(u)} and {np.shape(udot)} with '
                             f'q of shape {np.shape(q)}; expected as many states of '
                             'each')
        if self._tracker is None or Q.ndim == 1:
            return self._balanced(Q, U, A)
        # Loops are closed state by state.
        flat = [x.reshape(-1, x.shape[-1]) for x in (Q, U, A)]
        rows = [self._balanced(*state)[0] for state in zip(*flat, strict=True)]
        return np.array(rows).reshape(Q.shape), U, A

    def _balanced(self, Q: Array, U: Array, A: Array) -> tuple[Array, Array, Array]:
        """
        Return the state with the modes of the beams in equilibrium.

        With closed loops, Q, U and A are those of one state; without, also of a batch.
        """
        if self._tracker is not None:
            self._tracker.restart(Q)
        smallest = np.inf  # squared size of a correction
        grown = 0  # corrections in a row that were not smaller
        for _ in range(CORRECTIONS):
            # K eta = load on the modes, which depends on eta: fixed-point iteration.
            load = self.robot.inverse_dynamics(Q, U, A)[..., self._modal_speeds]
            change = load @ self._flexibility
            eta = Q[..., self._modes] - change
            if not np.abs(eta).max(initial=0.0) < LARGEST:  # nor if it is not a number
                break
            if self._tracker is None:
                Q[..., self._modes] = eta
            else:
                self._close(Q, eta)
            size = float(np.vdot(change, change))
            if size <= PRECISION**2 * float(np.vdot(eta, eta)):
                return Q, U, A
            grown += 1
            if size < smallest:
                smallest = size
                grown = 0
            if grown == GROWING:
                break
        raise InputError(f'load on the beams of {self.robot.model.name}: no equilibrium '
                         'found; expected a load within their stiffness')

    def _close(self, Q: Array, eta: Array) -> None:
        """Set the modes of a configuration and close its loops."""
        tracker = self._tracker
        assert tracker is not None
        Q[self._modes] = eta
        target = Q[tracker.places]
        rest = np.zeros(len(target))
        tracker.update(target, rest)
        tracker.update(target, rest)  # to rounding, which the iteration needs
        Q[:] = tracker.q

    def _zero_speeds(self, q: Any) -> Array:
        """Return zero speeds for one configuration or for several."""
        batch: tuple[int, ...] = ()
        with suppress(ValueError):  # rows of several lengths, which `_whole` refuses
            batch = np.shape(q)[:-1]
        return np.zeros((*batch, len(self.speed_names)))

    @staticmethod
    def _whole(name: str, values: Any, names: tuple[str, ...], places: slice | list[int],
               count: int) -> Array:
        """Return an array of all coordinates or speeds, with zeros for the modes."""
        try:
            x = real_numbers(values)
        except (TypeError, ValueError):
            raise InputError(f'{name}: {values!r}; expected (..., {len(names)}) numbers '
                             f'for {", ".join(names)}') from None
        if x.shape[-1:] != (len(names),):
            raise InputError(f'{name}: shape {x.shape}; expected (..., {len(names)}) '
                             f'for {", ".join(names)}')
        result = np.zeros((*x.shape[:-1], count))
        result[..., places] = x
        return result


def flexible_robot(model: Model, options: Mapping[str, Any]) -> Robot:
    """
    Return a robot with its beams and drives; under constraints their motions are independent.

    The actuators of an arm with beams are at the independent joints then; InputError for
    others. With drives no actuators are declared, which need one a speed: there are motors
    and rigid joints to act on. `options` are those of `Robot`.
    """
    options = dict(options)
    motors = [elastic.drive.motor for elastic in model.drives]
    # The modes become independent speeds, since the load determines them, not the loops.
    if model.flexible and options.get('independent'):
        joints = options['independent']
        stated = options.pop('actuated', joints)
        if set(stated) != set(joints):
            raise InputError(f'constraints: actuated: {list(stated)}, with beams; '
                             f'expected the independent joints, {list(joints)}, because '
                             'others load the beams through the loops')
        modes = [model.coordinate_names[k] for k in model.modal_coordinates]
        options['independent'] = (*joints, *modes)
    # So do the motors of drives; the actuators are then the motors themselves.
    if motors and options.get('independent'):
        options['independent'] = (*options['independent'], *motors)
        options.pop('actuated', None)
    return Robot(model, **options)


def rigid_and_bending(model: Model, options: Mapping[str, Any]
                      ) -> tuple[Robot, QuasiStatic | None]:
    """Return the robot with rigid links, and the flexible arm if links are beams."""
    bending: QuasiStatic | None = None
    if model.flexible:
        bending = QuasiStatic(flexible_robot(model, options))
    return Robot(stiffened(model), **options), bending


def _check(robot: Robot) -> None:
    """Raise InputError unless a robot has deflections that follow from the load."""
    model, equations = robot.model, robot.equations
    if not model.flexible:
        raise InputError('quasi-static deflections: a robot without beams; expected one '
                         'with beams')
    # Deflections follow from a load, which moves with joints.
    if len(model.modal_coordinates) == model.n:
        raise InputError('quasi-static deflections: a robot whose only motions are '
                         'those of beams; expected joints too')
    if equations.in_joint_rates:
        return
    # The modes must be free: a constraint among them would add forces of its own.
    modes = {model.coordinate_names[k] for k in model.modal_coordinates}
    speeds = set(robot.speed_names)
    if not modes <= speeds or not speeds <= set(robot.coordinate_names):
        raise InputError(f'quasi-static deflections: speeds {list(robot.speed_names)}; '
                         'expected the rates of joints and of all modes, which the '
                         'constraints must not couple')
    equations.require_timeless('quasi-static deflections', 'because the arm rests in them')


def _index(places: list[int]) -> slice | list[int]:
    """Return an index of entries: a slice, which is faster, if contiguous."""
    first = places[0]
    last = places[-1] + 1
    if places == list(range(first, last)):
        return slice(first, last)
    return places
