"""Feedforward of elastic joints: motor motion and torques for a motion of the links."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from kane_dynamics._util.attribute_hints import fixed
from kane_dynamics._util.checks import constant, instance, number
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.elastic_inverse_dynamics import (damped_step,
                                                              deflection_rates,
                                                              drive_sides, driven_by,
                                                              elastic_inverse_dynamics)
from kane_dynamics.mechanics.elastic_joints import spring_deflection
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.drive import Drive, StiffnessCurve
from kane_dynamics.model.elastic_model import link_side
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion, SmoothState
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
import numpy as np

ROWS = ('gear_torque', 'gear_torque_rate', 'gear_torque_acceleration', 'motor_position',
        'motor_speed', 'motor_acceleration', 'motor_torque')
GRAVITY_RATES = np.zeros((2, 3)).astype(object)  # of a base at rest
# Time constant D / k, s, up to which a damped deflection counts as settled. Integrated, its
# acceleration would have the rounding of tau_J times k / D^2.
SETTLED = 1e-6


class ElasticMotion(NamedTuple):
    """
    Motor motion and torques along a motion of the links, (N, n) each, joint-side.

    `time`, (N,), in s; `link_position`; then the rows `ROWS`, from `gear_torque` to
    `motor_torque`.
    """

    time: Array
    link_position: Array
    gear_torque: Array
    gear_torque_rate: Array
    gear_torque_acceleration: Array
    motor_position: Array
    motor_speed: Array
    motor_acceleration: Array
    motor_torque: Array


@fixed
class ElasticFeedforward:
    """
    Inverse dynamics of elastic joints to the fourth order, compiled.

    From position, speed and three derivatives of the speeds of the links it computes the
    torque of each gear and two time derivatives, the motor's position, speed and
    acceleration, and the motor's torque, all joint-side. Friction of both sides, payload,
    gravity and wrenches are those of the robot. Rigid joints have a motor that moves with
    the link.

    Parameters
    ----------
    robot : Robot
        With drives, as a tree in joint rates. Its parameters, gravity and payload, may
        change.

    Attributes
    ----------
    joint_names : tuple of str
        The joints of the links, in the order of all arguments and columns.
    kernel : Kernel
        The compiled function, also of batches.

    Raises
    ------
    InputError
        The robot has no drives, constraints or chosen speeds; or the motor's motion does
        not follow from four derivatives of q. With a dead zone the deflection is not
        determined at rest. With `full_coupling` the torque of a gear depends on the
        acceleration of the motors behind it, so that the motor of the first of n joints
        needs 2 (n + 1) derivatives. With damping of a spring, the deflection is a state of
        its own: then `along` integrates it, and a call is refused. Where D / k is at most
        1 us, the deflection is that of the spring alone.

    Examples
    --------
    >>> feedforward = ElasticFeedforward(robot)
    >>> rows = feedforward(q, u, udot, jerk, snap)
    >>> theta, motor_torque = rows[3], rows[6]

    """

    def __init__(self, robot: Robot) -> None:
        instance(robot, Robot, 'robot')
        _check(robot)
        model = link_side(robot.model)
        self.robot = robot
        self.joint_names = model.joint_names
        options = robot.options
        self._frames = tuple(options['wrench_frames'])
        self._tree = TreeEquations(model, wrench_frames=self._frames,
                                   payload_frame=options['payload_frame'],
                                   friction=robot.friction,
                                   feedforward_friction=options['feedforward_friction'])
        sides = drive_sides(robot.model, model.joint_names)
        self._damped = [side for side in sides if robot.friction and _lags(side.drive)]
        self._sides = [side for side in sides if side not in self._damped]
        shapes: dict[str, tuple[int, ...]] = {}
        shapes['link_position'] = (len(model.coordinate_names),)
        for name in ('link_speed', 'link_acceleration', 'jerk', 'snap'):
            shapes[name] = (model.n,)
        self._shapes = shapes
        self.kernel = robot.compiled(self._law, name='elastic_feedforward',
                                     shape=(len(ROWS), model.n), **shapes)
        self._call: Callable[..., Array] = self.kernel.entry('', self.kernel)
        if self._damped:
            self._call = self._refuse

    def _refuse(self, *state: Any) -> Array:
        """Raise InputError: a call has no state of the deflection."""
        names = ', '.join(self.joint_names[side.link] for side in self._damped)
        raise InputError(f'elastic feedforward: damping in the drives of {names}; expected '
                         'along(motion, step), because their deflection is a state of its '
                         'own')

    def along(self, motion: Motion | SmoothMotion, step: float, *,
              deflection: Any = None) -> ElasticMotion:
        """
        Return the motor motion and torques along a motion of the links.

        Parameters
        ----------
        motion : SmoothMotion or Motion
            Of `joint_names`, in this order, with a continuous jerk.
        step : float
            Time between rows, s.
        deflection : (n,) array_like, optional
            Of the damped drives at the beginning, rad or m; others do not matter.
            Default: at rest, k^-1(tau_J).

        Returns
        -------
        ElasticMotion

        Raises
        ------
        InputError
            The jerk of the motion jumps, it has other joints, or the step is not positive
            or longer than the motion.

        """
        if not isinstance(motion, Motion | SmoothMotion):
            raise InputError(f'motion: a {type(motion).__name__}; expected a SmoothMotion '
                             'or a Motion')
        if motion.joint_names != self.joint_names:
            raise InputError(f'motion: of {listing(motion.joint_names)}; expected '
                             f'{listing(self.joint_names)}, in this order')
        if self._tree.n_q != self._tree.n:
            raise InputError('motion: a robot with ball joints, which have no motion of '
                             'joint positions; expected one without')
        if isinstance(motion, Motion):
            motion = SmoothMotion.from_motion(motion)
        start = float(motion.times[0])
        step = number(step, 'step', 'a positive number, s, of at most the duration',
                      lambda h: 0.0 < h <= motion.duration - start)
        count = round((motion.duration - start) / step) + 1
        times: Array = start + step * np.arange(count, dtype=np.float64)
        state = motion.sample(np.minimum(times, motion.duration))
        rows = self.rows_along(times, state, deflection)
        return ElasticMotion(times, state.q, *rows.swapaxes(0, 1))

    def rows_along(self, times: Array, state: SmoothState, deflection: Any = None) -> Array:
        """
        Return the rows `ROWS` of a motion of the links, (N, 7, n), unchecked.

        Parameters
        ----------
        times : (N,) array
            s, not decreasing; the two sides of a jump of the snap have one time.
        state : SmoothState
            Of the links at these times, (N, n) arrays.
        deflection : (n,) array_like, optional
            As in `along`.

        """
        rows = np.asarray(self.kernel(*state))
        if self._damped:
            links = np.ascontiguousarray(np.stack(state[:3], axis=1))
            self._add_first(rows[0], links[0], deflection)
            steps = np.diff(times)
            self._damped_kernel.scan([rows[:-1], links[:-1], rows[1:], links[1:], steps],
                                     rows[1:])
        return rows

    def _add_first(self, row: Array, link: Array, deflection: Any) -> None:
        """Complete the first row, (7, n), with the deflections of damped drives."""
        stated = None
        if deflection is not None:
            stated = constant(deflection, (self._tree.n,), 'deflection', InputError)
        for k, drive, joint in self._damped:
            delta = stated[k] if stated is not None else spring_deflection(drive, row[0, k])
            _, rate, acceleration, _ = deflection_rates(drive, delta, row[:3, k])
            row[3:6, k] = link[:, k] + [delta, rate, acceleration]
            load = drive.rotor_inertia * row[5, k] + row[0, k]
            row[6, k] = driven_by(self._tree, joint, (row[4, k], row[5, k]), load)

    @property
    def damped(self) -> bool:
        """Return whether the deflection of a drive is a state."""
        return bool(self._damped)

    @lazy_property
    def _damped_kernel(self) -> Kernel:
        """Return the step of the damped drives along a motion."""
        n = self._tree.n

        def step(before: Matrix, link_before: Matrix, rows: Matrix, link: Matrix,
                 h: Scalar) -> Matrix:
            return damped_step(self._tree, self._damped, before, link_before, rows, link, h)
        return self.robot.compiled(step, name='elastic_feedforward_step',
                                   shape=(len(ROWS), n), before=(len(ROWS), n),
                                   link_before=(3, n), rows=(len(ROWS), n), link=(3, n),
                                   h=())

    def __call__(self, q: Any, u: Any, udot: Any, jerk: Any, snap: Any,
                 gravity_rates: Any = None, wrenches: Any = None) -> Array:
        """
        Return the rows `ROWS`, (7, n), or (N, 7, n) of a batch.

        Parameters
        ----------
        q : (n_q,) or (N, n_q) array_like
            Coordinates of the links, rad or m.
        u, udot, jerk, snap : (n,) or (N, n) array_like
            Speeds of the links and their first, second and third time derivatives.
        gravity_rates : (2, 3) or (N, 2, 3) array_like, optional
            First and second time derivatives of gravity, as of a moving base; m/s^3 and
            m/s^4. Default: zero.
        wrenches : (3, k, 6) or (N, 3, k, 6) array_like, optional
            Wrenches at the robot's `wrench_frames`, and two time derivatives; force, then
            moment, world axes. Default: zero.

        Returns
        -------
        (7, n) or (N, 7, n) array
            tau_J, tau_J', tau_J'', theta, theta', theta'' and tau_m; N m and rad, or N and
            m.

        Raises
        ------
        InputError
            An argument has a wrong shape or is not finite, or the robot has no frames
            for wrenches.

        """
        if gravity_rates is None and wrenches is None:
            return self._call(q, u, udot, jerk, snap)
        if self._damped:
            self._refuse()
        batch = np.shape(u)[:-1]
        if gravity_rates is None:
            gravity_rates = np.zeros((*batch, 2, 3))
        frames = len(self._frames)
        if wrenches is None:
            wrenches = np.zeros((*batch, 3, frames, 6))
        elif not frames:
            raise InputError('wrenches: the robot has no frames for them; expected '
                             'Robot(..., wrench_frames=)')
        inputs = [q, u, udot, jerk, snap, gravity_rates]
        if frames:
            inputs.append(wrenches)
        return np.asarray(self._general_kernel(*inputs))

    @lazy_property
    def _general_kernel(self) -> Kernel:
        """Return the function with derivatives of gravity, and wrenches if declared."""
        shapes = {**self._shapes, 'gravity_rates': (2, 3)}
        if self._frames:
            shapes['wrenches'] = (3, len(self._frames), 6)
        law = self._loaded_law if self._frames else self._moved_law
        return self.robot.compiled(law, name='elastic_feedforward_general',
                                   shape=self.kernel.shape, **shapes)

    def _law(self, q: Vector, u: Vector, udot: Vector, jerk: Vector, snap: Vector, *,
             parameters: Vector) -> Matrix:
        """Return the rows with constant gravity and without wrenches; traced."""
        return self._moved_law(q, u, udot, jerk, snap, GRAVITY_RATES,
                               parameters=parameters)

    def _moved_law(self, q: Vector, u: Vector, udot: Vector, jerk: Vector, snap: Vector,
                   gravity_rates: Matrix, *, parameters: Vector) -> Matrix:
        """Return the rows without wrenches; traced."""
        return self._loaded_law(q, u, udot, jerk, snap, gravity_rates, None,
                                parameters=parameters)

    def _loaded_law(self, q: Vector, u: Vector, udot: Vector, jerk: Vector,
                    snap: Vector, gravity_rates: Matrix, wrenches: Any, *,
                    parameters: Vector) -> Matrix:
        """Return the rows; traced."""
        gravity = np.stack([parameters[:3], *gravity_rates])
        return elastic_inverse_dynamics(self._tree, self._sides, q,
                                        np.stack([u, udot, jerk, snap]), wrenches,
                                        gravity, parameters[3:])


def _lags(drive: Drive) -> bool:
    """Return whether the deflection settles slowly enough to be a state of its own."""
    stiffness = drive.stiffness
    if isinstance(stiffness, StiffnessCurve):
        stiffness = min(stiffness.slopes)
    return drive.damping > SETTLED * stiffness


def _check(robot: Robot) -> None:
    """Raise InputError for a robot whose motors do not follow from four derivatives."""
    what = 'elastic feedforward'
    if not robot.drives:
        raise InputError(f"{what}: robot '{robot.model.name}' without drives; expected "
                         'elastic joints (with_drives)')
    if robot.constraint_names or robot.options['speeds'] is not None:
        raise InputError(f"{what}: robot '{robot.model.name}' with constraints or chosen "
                         'speeds; expected a tree in joint rates')
    for name, drive, _, _ in robot.drives:
        curve = drive.stiffness
        reason = ''
        if drive.full_coupling:
            reason = ('full_coupling; expected the reduced model, because the motors '
                      'then depend on more than four derivatives of q')
        elif isinstance(curve, StiffnessCurve) and curve.dead_zone:
            reason = (f'a dead zone of {curve.dead_zone:g}; expected none, because no '
                      'torque does not determine the deflection')
        if reason:
            raise InputError(f"{what}: joint '{name}' with {reason}")
