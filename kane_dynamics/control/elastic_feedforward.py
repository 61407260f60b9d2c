"""Feedforward of elastic joints: motor motion and torques for a motion of the links."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from kane_dynamics._util.checks import constant, finite_times, instance, number
from kane_dynamics._util.fixed_attributes import fixed
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.text import listing, SHORT
from kane_dynamics._util.typing import Array, Flags, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.driven_mechanism import closed_configurations
from kane_dynamics.mechanics.algebra.user_functions import NotFiniteError
from kane_dynamics.mechanics.ball_joints import (joint_positions, moved, neutral,
                                                 require_angles)
from kane_dynamics.mechanics.constraints import checked_names
from kane_dynamics.mechanics.constraints.conditioning import Stack, stacked, system
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.constraints.speeds import JOINT_RATES
from kane_dynamics.mechanics.constraints.transmission import require_transmission
from kane_dynamics.mechanics.elastic_inverse_dynamics import (damped_step,
                                                              deflection_rates,
                                                              drive_sides,
                                                              elastic_inverse_dynamics,
                                                              ElasticLinks,
                                                              torque_of_motor)
from kane_dynamics.mechanics.elastic_joints import spring_deflection
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.drive import Drive, StiffnessCurve
from kane_dynamics.model.elastic_model import link_side
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion, SmoothState
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.methods.configuration_methods import warn_of_degrees
from kane_dynamics.robot.robot import Robot
import numpy as np

ROWS = ('gear_torque', 'gear_torque_rate', 'gear_torque_acceleration', 'motor_position',
        'motor_speed', 'motor_acceleration', 'motor_torque')
WHAT = 'elastic feedforward'
MOST_ROWS = 10_000_000  # of a motion
TRIES = 50  # configurations for that check
INSTANT = 0.3  # s, at which it is checked that constraints do not depend on motors
GRAVITY_RATES = np.zeros((2, 3)).astype(object)  # of a base at rest
# Time constant D / k, s, up to which a damped deflection counts as settled. Integrated, its
# acceleration would have the rounding of tau_J times k / D^2.
SETTLED = 1e-6


class LinkSpeeds(NamedTuple):
    """
    Independent speeds of links and motors, constraint rows, and actuators, by index.

    `in_speeds_of_robot`: of its choice of generalized speeds, else joint rates; `speeds`:
    which of `free` are those of links, in the order of the inputs.
    """

    in_speeds_of_robot: bool
    free: tuple[int, ...]
    kept: tuple[int, ...]
    speeds: tuple[int, ...]
    actuators: tuple[tuple[int, float], ...] | None


class ClosedPositions(NamedTuple):
    """
    Coordinates of the links, (N, n), that close loops at positions of `joints`, (N, k).

    `times` has the times, (1, N), s, where the loops depend on them; else it is empty.
    """

    joints: tuple[str, ...]
    positions: Array
    times: Array
    links: Array


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

    Under constraints, the motion is that of the independent speeds of the links, and joints
    without actuators have zero torque. More actuators than independent speeds share the
    load so that the sum of weight times torque squared is least, as in
    `Robot.joint_torques`; the deflections are those of these torques.

    Parameters
    ----------
    robot : Robot
        With drives, and any speeds and constraints that do not depend on the motors. Its
        parameters, gravity and payload, may change.
    actuated : sequence of str, or mapping of str to float, optional
        Under constraints: the joints with actuators, rigid or elastic, or the weights of
        their torques. Default: those with drives, and the rigid ones of the robot's
        `actuated`.

    Attributes
    ----------
    joint_names : tuple of str
        The joints of the links, in the order of all columns.
    speed_names : tuple of str
        The independent speeds of the links, in the order of u, udot, jerk and snap; by
        default the joints.
    actuated_names : tuple of str
        The joints with actuators: all of a tree.
    kernel : Kernel
        The compiled function, also of batches.

    Raises
    ------
    InputError
        The robot has no drives; speeds or constraints depend on motors; joints with
        actuators are unknown, or fewer than independent speeds; or the motor's motion does
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

    def __init__(self, robot: Robot, *,
                 actuated: Sequence[str] | Mapping[str, float] | None = None) -> None:
        instance(robot, Robot, 'robot')
        _check(robot)
        model = link_side(robot.model)
        self.robot = robot
        self.joint_names = model.joint_names
        # The equations of the links alone, with what the robot carries.
        options = robot.options
        self._frames = tuple(options['wrench_frames'])
        self._tree = TreeEquations(model, wrench_frames=self._frames,
                                   payload_frame=options['payload_frame'],
                                   friction=robot.friction,
                                   feedforward_friction=options['feedforward_friction'])
        sides = drive_sides(robot.model, model.joint_names)
        self._damped = [side for side in sides if robot.friction and _lags(side.drive)]
        self._sides = [side for side in sides if side not in self._damped]

        # The mechanism in the robot's speeds, of which those of links are the inputs.
        speeds = speeds_of_links(robot)
        self.speed_names = tuple(robot.speed_names[k] for k in speeds)
        self._actuators = _actuators(robot, self.joint_names, self.speed_names, actuated)
        self._by_choice: dict[LinkSpeeds, ElasticLinks] = {}
        self._kernels: dict[tuple[LinkSpeeds, str], Kernel] = {}
        self._last_closed: ClosedPositions | None = None
        self.kernel = self._compiled(self._choice_of_speeds(), self._law,
                                     'elastic_feedforward')
        self._call: Callable[..., Array] = self.kernel.entry('', self.kernel)
        if self._damped:
            self._call = self._refuse

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle robot and actuators; the kernel loads from the cache."""
        actuated = None
        if self._actuators is not None:
            actuated = {self.joint_names[k]: weight for k, weight in self._actuators}
        return partial(type(self), actuated=actuated), (self.robot,)

    @property
    def actuated_names(self) -> tuple[str, ...]:
        """Return the joints with actuators, rigid or elastic, in the order of the columns."""
        if self._actuators is None:
            return self.joint_names
        places = sorted(k for k, _ in self._actuators)
        return tuple(self.joint_names[k] for k in places)

    def _refuse(self, *state: Any) -> Array:
        """Raise InputError: a damped deflection is a state, which a call does not have."""
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
            Of `joint_names`, or under constraints of as many of them as independent
            speeds; with a continuous jerk.
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
        require_angles(self._tree.model, 'motion')
        self.check_joints(motion.joint_names)
        # A cubic or quintic motion is smooth enough if its jerk does not jump.
        if isinstance(motion, Motion):
            motion = SmoothMotion.from_motion(motion)
        self.warn_of_degrees(motion)
        if deflection is not None:
            deflection = constant(deflection, (self._tree.n,), 'deflection', InputError)
        start = float(motion.times[0])
        step = number(step, 'step', 'a positive number, s, of at most the duration',
                      lambda h: 0.0 < h <= motion.duration - start)
        # Rows at equal steps, as many as memory permits.
        intervals = (motion.duration - start) / step
        if intervals > MOST_ROWS:
            raise InputError(f'step: {step:g} s for a motion of {motion.duration - start:g} s; '
                             f'expected at most {MOST_ROWS} rows')
        # A last step that ends beyond the motion is evaluated at its end.
        count = round(intervals) + 1
        times: Array = start + step * np.arange(count, dtype=np.float64)
        state = motion.sample(np.minimum(times, motion.duration))
        rows, links = self.rows_along(times, state, motion.joint_names, deflection)
        return ElasticMotion(times, links[:, 0].copy(), *rows.swapaxes(0, 1))

    def check_joints(self, joints: Sequence[str]) -> None:
        """Raise InputError unless a motion of these joints is one of the links."""
        count = len(self.speed_names)
        distinct = set(joints)
        # As many joints as independent speeds determine the motion.
        fits = len(joints) == len(distinct) == count
        if not fits or not distinct <= set(self.joint_names):
            raise InputError(f'motion: of {listing(joints)}; expected {count} of '
                             f'{listing(self.joint_names)}, as many as independent speeds '
                             'of the links')

    def warn_of_degrees(self, motion: SmoothMotion | Motion, stacklevel: int = 4) -> None:
        """Warn if the points of a motion look like degrees."""
        robot = self.robot
        positions = motion.sample(motion.times)[0]
        rows = np.zeros((len(positions), robot.n_q))
        for column, name in zip(positions.T, motion.joint_names):
            rows[:, robot.coordinate_names.index(name)] = column
        warn_of_degrees(robot, rows, 'motion', stacklevel)

    def rows_along(self, times: Array, state: SmoothState, joints: Sequence[str],
                   deflection: Any = None) -> tuple[Array, Array]:
        """
        Return the rows `ROWS` along a motion, (N, 7, n), and the links' motion, (N, 3, n).

        Parameters
        ----------
        times : (N,) array
            s, not decreasing; the two sides of a jump of the snap have one time.
        state : SmoothState
            Of the joints at these times, unchecked, (N, k) arrays.
        joints : sequence of k str
            As many of `joint_names` as independent speeds, in any order.
        deflection : (n,) array_like, optional
            As in `along`.

        Raises
        ------
        InputError, LoopError
            Under constraints: a constraint is one of velocities, or the loops do not close.

        """
        choice = self._choice_of_joints(tuple(joints))
        inputs = list(state)
        # Configurations in which the loops are closed, then the law at all times at
        # once.
        time = self.robot.equations.time_inputs(times)
        inputs[0] = self.closed(times, state.q, joints)
        kernel = self._compiled(choice, self._law, 'elastic_feedforward')
        rows = np.asarray(kernel(*inputs, *time))
        # The motion of all links, which the deflections are added to.
        if self._links(choice).is_tree:
            links = np.ascontiguousarray(np.stack(inputs[:3], axis=1))
        else:
            motion = self._compiled(choice, self._motion_law, 'elastic_link_motion', 3)
            links = np.asarray(motion(*inputs[:3], *time))
        if self._damped:
            self._add_first(rows[0], links[0], deflection)
            # Damped deflections are states: from row to row, beginning with the first.
            steps = np.diff(times)
            self._damped_kernel.scan([rows[:-1], links[:-1], rows[1:], links[1:], steps],
                                     rows[1:])
        return rows, links

    def closed(self, times: Array, positions: Array, joints: Sequence[str]) -> Array:
        """Return the coordinates of the links, (N, n), for positions of `joints`, (N, k)."""
        robot = self.robot
        # At other speeds of a motion the configurations are the same. Threads read and
        # replace the record as a whole.
        last = self._last_closed
        if last is not None and last.joints == tuple(joints):
            # Of the times, those that the loops depend on.
            is_same = np.array_equal(last.positions, positions)
            if is_same and np.array_equal(last.times, robot.equations.time_inputs(times)):
                return last.links
        # All coordinates, with the motors at zero.
        motors = [elastic.drive.motor for elastic in robot.drives]
        fixed = (*joints, *motors)
        driving = list(map(robot.coordinate_names.index, fixed))
        places = list(map(robot.coordinate_names.index, self.joint_names))
        at_zero = np.zeros((len(times), len(motors)))
        whole = closed_configurations(robot, driving, times, np.hstack([positions, at_zero]))
        result = np.ascontiguousarray(whole[:, places])
        moments = np.array(robot.equations.time_inputs(times))
        self._last_closed = ClosedPositions(tuple(joints), positions.copy(), moments, result)
        return result

    def _add_first(self, row: Array, link: Array, deflection: Any) -> None:
        """Complete the first row, (7, n), with the deflections of damped drives."""
        for k, drive, joint in self._damped:
            if deflection is None:
                delta = spring_deflection(drive, row[0, k])
            else:
                delta = deflection[k]
            # The rows of the deflection's rates, then of the motor, as `damped_step`
            # has them.
            _, rate, acceleration, _ = deflection_rates(drive, delta, row[:3, k])
            row[3:6, k] = link[:, k] + [delta, rate, acceleration]
            load = drive.rotor_inertia * row[5, k] + row[0, k]
            row[6, k] = torque_of_motor(self._tree, joint, (row[4, k], row[5, k]), load)

    @property
    def damped(self) -> bool:
        """Return whether the deflection of a drive is a state."""
        return bool(self._damped)

    @lazy_property
    def _damped_kernel(self) -> Kernel:
        """Return the step of the damped drives along a motion."""
        # Each row is complete but for the damped drives, which the step fills in.
        n = self._tree.n

        def step(before: Matrix, link_before: Matrix, rows: Matrix, link: Matrix,
                 h: Scalar) -> Matrix:
            return damped_step(self._tree, self._damped, before, link_before, rows, link, h)
        return self.robot.compiled(step, name='elastic_feedforward_step',
                                   shape=(len(ROWS), n), before=(len(ROWS), n),
                                   link_before=(3, n), rows=(len(ROWS), n), link=(3, n),
                                   h=())

    def __call__(self, q: Any, u: Any, udot: Any, jerk: Any, snap: Any,
                 gravity_rates: Any = None, wrenches: Any = None, t: Any = None) -> Array:
        """
        Return the rows `ROWS`, (7, n), or (N, 7, n) of a batch.

        Parameters
        ----------
        q : (n_q,) or (N, n_q) array_like
            Coordinates of the links, rad or m; under constraints a closed configuration.
        u, udot, jerk, snap : (p,) or (N, p) array_like
            Independent speeds of the links, `speed_names`, and their first, second and
            third time derivatives.
        gravity_rates : (2, 3) or (N, 2, 3) array_like, optional
            First and second time derivatives of gravity, as of a moving base; m/s^3 and
            m/s^4. Default: zero.
        wrenches : (3, k, 6) or (N, 3, k, 6) array_like, optional
            Wrenches at the robot's `wrench_frames`, and two time derivatives; force, then
            moment, world axes. Default: zero.
        t : float or (N,) array_like, optional
            Time, s, on which equations with functions of time depend. Default: 0.

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
        ConstraintError
            A loop is open, or the state is singular.

        """
        # The usual call has a kernel of its own, with less arithmetic.
        # The shortest call needs no further arrays.
        if gravity_rates is None and wrenches is None and t is None:
            return self._call(q, u, udot, jerk, snap)
        if self._damped:
            self._refuse()
        # What is left out is zero: gravity at rest, no wrench.
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
        times = finite_times(0.0 if t is None else t)
        if times.ndim and times.shape != batch:
            raise InputError(f't: shape {times.shape}; expected one time, or one a state of '
                             f'{batch}')
        inputs += self.robot.equations.time_inputs(times, q)
        return np.asarray(self._general_kernel(*inputs))

    @lazy_property
    def _general_kernel(self) -> Kernel:
        """Return the function with derivatives of gravity, and wrenches if declared."""
        law = self._loaded_law if self._frames else self._moved_law
        choice = self._choice_of_speeds()
        return self._compiled(choice, law, 'elastic_feedforward_general')

    # The links in a choice of speeds and rows, and the functions that are compiled.

    def _choice_of_speeds(self) -> LinkSpeeds:
        """Return the robot's own choice of speeds, in which calls state the motion."""
        mechanism = self.robot.mechanism
        speeds = list(map(mechanism.speed_names.index, self.speed_names))
        return LinkSpeeds(True, tuple(mechanism.free), tuple(mechanism.kept),
                          tuple(speeds), self._actuators)

    def _choice_of_joints(self, joints: tuple[str, ...]) -> LinkSpeeds:
        """Return the choice in which the rates of these joints are the speeds."""
        robot = self.robot
        mechanism = robot.mechanism
        # The speeds that the robot has already need no other choice.
        in_joint_rates = mechanism.speeds.key == JOINT_RATES
        if in_joint_rates and joints == self.speed_names:
            return self._choice_of_speeds()
        names = robot.model.joint_names
        motors = [elastic.motor for elastic in robot.drives]
        free = sorted([*map(names.index, joints), *motors])
        speeds = [free.index(names.index(name)) for name in joints]
        return LinkSpeeds(False, tuple(free), tuple(mechanism.kept), tuple(speeds),
                          self._actuators)

    def _links(self, choice: LinkSpeeds) -> ElasticLinks:
        """Return the links in a choice."""
        # Each choice of speeds and rows has its own equations, made once.
        if choice not in self._by_choice:
            robot = self.robot
            mechanism = robot.mechanism
            if not choice.in_speeds_of_robot:
                mechanism = Mechanism(robot.model, None, mechanism.constraints,
                                      sizes=mechanism.sizes,
                                      rank_tolerance=mechanism.rank_tolerance)
            mechanism = mechanism.with_choice(choice.free, choice.kept)
            actuators = None if choice.actuators is None else dict(choice.actuators)
            geometry = robot.equations.tree.geometry
            self._by_choice[choice] = ElasticLinks(self._tree, self._sides, mechanism,
                                                   geometry, choice.speeds, actuators)
        return self._by_choice[choice]

    def _compiled(self, choice: LinkSpeeds, law: Callable[..., Matrix], name: str,
                  rows: int = len(ROWS)) -> Kernel:
        """Return a law of the links as native code, of (rows, n)."""
        p = len(choice.speeds)
        inputs: dict[str, tuple[int, ...]] = {}
        # The arguments of the laws, which have more of them in turn.
        inputs['link_speed'] = (p,)
        inputs['link_acceleration'] = (p,)
        if law != self._motion_law:
            inputs['jerk'] = (p,)
            inputs['snap'] = (p,)
        if law in (self._moved_law, self._loaded_law):
            inputs['gravity_rates'] = (2, 3)
        if law == self._loaded_law:
            inputs['wrenches'] = (3, len(self._frames), 6)
        return self._in_choice(choice, law, name, inputs, (rows, self._tree.model.n))

    def compiled(self, joints: Sequence[str],
                 law: Callable[[ElasticLinks, dict[str, Any]], Any], name: str,
                 inputs: Mapping[str, tuple[int, ...]], shape: tuple[int, ...]) -> Kernel:
        """
        Return a function of the links in the rates of joints as native code.

        Parameters
        ----------
        joints : sequence of str
            As of `check_joints`, whose rates are the independent speeds.
        law : callable
            Called with the links, and q, the inputs, t and `parameters` by name.
        name : str
            Of the function in errors.
        inputs : mapping of str to tuple of int
            Shapes of what the kernel takes behind the coordinates of the links, (n_q,).
        shape : tuple of int
            Of the result.

        """
        def traced(choice: LinkSpeeds, q: Vector, *values: Any, t: Scalar,
                   parameters: Vector, limits: Vector) -> Any:
            links = self._links(choice)
            named = dict(zip(inputs, values, strict=True))
            result = law(links, {'q': q, **named, 't': t, 'parameters': parameters})
            return self._guarded(links, result, q, t, limits)
        return self._in_choice(self._choice_of_joints(tuple(joints)), traced, name, inputs,
                               shape)

    def _in_choice(self, choice: LinkSpeeds, law: Callable[..., Any], name: str,
                   inputs: Mapping[str, tuple[int, ...]], shape: tuple[int, ...]) -> Kernel:
        """Return a function of the links in a choice of speeds and rows as native code."""
        known = self._kernels.get((choice, name))
        if known is not None:
            return known
        shapes = {'link_position': (len(self._tree.model.coordinate_names),), **inputs}
        reason = None
        if not self._links(choice).is_tree:
            reason = partial(self._reason, choice, law, name, inputs, shape)
        kernel: Kernel = self.robot.kernels.compiled(partial(law, choice), name, shapes,
                                                     shape, reason=reason)
        self._kernels[choice, name] = kernel
        return kernel

    def _reason(self, choice: LinkSpeeds, law: Callable[..., Any], name: str,
                inputs: Mapping[str, tuple[int, ...]], shape: tuple[int, ...],
                state: dict[str, Array]) -> Kernel | None:
        """Return the kernel with rows that are regular at a state, or raise the error."""
        # Other rows where these are singular; actuators that cannot drive the motion
        # are named.
        links = self._links(choice)
        mechanism = links.mechanism
        q = links.whole(state['link_position']).astype(np.float64)
        t = float(state.get('t', np.zeros(())))
        regular = self.robot.speed_sets.instead(mechanism, {'q': q, 't': np.array(t)})
        if regular is not None:
            kept = tuple(regular.equations.mechanism.kept)
            return self._in_choice(choice._replace(kept=kept), law, name, inputs, shape)
        if links.actuated is not None:
            S = system(stacked(mechanism, q, t), choice.free, choice.kept)
            T = np.asarray(np.linalg.inv(S)[:, :mechanism.n], dtype=np.float64)
            require_transmission(mechanism, T, links.determining, True, q)
        return None

    def _law(self, choice: LinkSpeeds, q: Vector, u: Vector, udot: Vector, jerk: Vector,
             snap: Vector, *, t: Scalar, parameters: Vector, limits: Vector) -> Matrix:
        """Return the rows with constant gravity and without wrenches; traced."""
        return self._loaded_law(choice, q, u, udot, jerk, snap, GRAVITY_RATES, None, t=t,
                                parameters=parameters, limits=limits)

    def _moved_law(self, choice: LinkSpeeds, q: Vector, u: Vector, udot: Vector, jerk: Vector,
                   snap: Vector, gravity_rates: Matrix, *, t: Scalar,
                   parameters: Vector, limits: Vector) -> Matrix:
        """Return the rows without wrenches; traced."""
        return self._loaded_law(choice, q, u, udot, jerk, snap, gravity_rates, None, t=t,
                                parameters=parameters, limits=limits)

    def _loaded_law(self, choice: LinkSpeeds, q: Vector, u: Vector, udot: Vector, jerk: Vector,
                    snap: Vector, gravity_rates: Matrix, wrenches: Any, *, t: Scalar,
                    parameters: Vector, limits: Vector) -> Matrix:
        """Return the rows; traced."""
        links = self._links(choice)
        # Gravity and its first two derivatives, of a base that moves.
        gravity = np.stack([parameters[:3], *gravity_rates])
        rows = elastic_inverse_dynamics(links, q, np.stack([u, udot, jerk, snap]),
                                        wrenches, gravity, parameters[3:], t)
        return self._guarded(links, rows, q, t, limits)

    def _guarded(self, links: ElasticLinks, rows: Any, q: Vector, t: Scalar,
                 limits: Vector) -> Any:
        """Return rows, as NaN where loops are open or the state is almost singular."""
        if not self.robot.equations.watched:
            return rows
        return links.watched(rows, q, t, limits)

    def _motion_law(self, choice: LinkSpeeds, q: Vector, u: Vector, udot: Vector, *,
                    t: Scalar) -> Matrix:
        """Return position, speed and acceleration of the links, (3, n); traced."""
        motion = self._links(choice).motion(q, np.stack([u, udot]), t)
        # With two rates, the series ends with the values.
        return np.stack([joint_positions(self._tree.model, q), motion.qdot, motion.qddot])


def _lags(drive: Drive) -> bool:
    """Return whether the deflection settles slowly enough to be a state of its own."""
    stiffness = drive.stiffness
    if isinstance(stiffness, StiffnessCurve):
        stiffness = min(stiffness.slopes)
    return drive.damping > SETTLED * stiffness


def _check(robot: Robot) -> None:
    """Raise InputError for a robot whose motors do not follow from four derivatives."""
    if not robot.drives:
        raise InputError(f"{WHAT}: robot '{robot.model.name}' without drives; expected "
                         'elastic joints (with_drives)')
    # Drives for which four derivatives of q do not determine the motor's motion.
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
            raise InputError(f"{WHAT}: joint '{name}' with {reason}")


def speeds_of_links(robot: Robot) -> list[int]:
    """
    Return the indices of the independent speeds that are those of links.

    Raises
    ------
    InputError
        Constraints, or the speeds of links, depend on motors.

    """
    mechanism = robot.mechanism
    motors = [elastic.motor for elastic in robot.drives]
    if mechanism.in_joint_speeds:
        return [k for k in range(robot.n) if k not in motors]

    # Constraints must not depend on motors: neither by their columns nor by position.
    at_first, at_second = _with_other_motors(mechanism, motors)
    rows_depend = at_first.J[:, motors].any(axis=1)
    rows_depend |= _rows_differ(at_first.J, at_second.J)
    rows_depend |= _differ(at_first.b, at_second.b)
    rows_depend |= _differ(at_first.residual, at_second.residual)
    if rows_depend.any():
        names = [mechanism.labels[k] for k in np.flatnonzero(rows_depend)]
        raise InputError(f'{WHAT}: constraints on motors, {listing(names)}; expected some of '
                         'links alone, because the motion of the motors is computed')

    # Speeds without an entry of a motor are those of links. They must not depend on
    # the motors either, and all others belong to one motor each.
    free = list(mechanism.free)
    Y = at_first.Y[free]
    of_motors = Y[:, motors].any(axis=1)
    speeds_depend = _rows_differ(Y, at_second.Y[free])
    speeds_depend |= _differ(at_first.Z[free], at_second.Z[free])
    if of_motors.sum() != len(motors) or (speeds_depend & ~of_motors).any():
        raise InputError(f'{WHAT}: speeds {listing(mechanism.speed_names)}; expected '
                         f'{robot.n - len(motors)} that are those of links alone and do not '
                         'depend on motors')
    return np.flatnonzero(~of_motors).tolist()


def _differ(x: Array, y: Array) -> Flags:
    """Return which entries differ beyond rounding; NaN equals NaN."""
    equal: Flags = np.isclose(x, y, equal_nan=True)
    return ~equal


def _rows_differ(A: Matrix, B: Matrix) -> Flags:
    """Return which rows have an entry that differs beyond rounding."""
    return np.asarray(_differ(A, B).any(axis=1))


def _with_other_motors(mechanism: Mechanism, motors: Sequence[int]) -> list[Stack]:
    """Return speeds and rows at a configuration, and with the motors somewhere else."""
    model = mechanism.model
    rng = np.random.default_rng(0)
    failure: NotFiniteError | None = None
    for _ in range(TRIES):
        # Without symmetries; user-defined functions may be finite in a part of all.
        step = rng.uniform(-1.0, 1.0, model.n)
        elsewhere = step.copy()
        elsewhere[list(motors)] += 0.3
        try:
            # Links as they are; motors moved, to see whether anything depends on them.
            stacks = []
            for change in (step, elsewhere):
                q = moved(model, neutral(model), change)
                stacks.append(stacked(mechanism, q, INSTANT))
            return stacks
        except NotFiniteError as error:
            failure = error
    assert failure is not None
    raise failure


def joints_with_actuators(robot: Robot) -> tuple[str, ...]:
    """
    Return the joints of the links that have actuators, in the order of the links.

    Of a tree all but modes of beams; under constraints those with drives, and the rigid
    ones of the robot's `actuated`.
    """
    joints = link_side(robot.model).joint_names
    stated = _stated_weights(robot, joints, None)
    if stated is not None:
        return tuple(name for name in joints if name in stated)
    bending = {robot.joint_names[k] for k in robot.model.modal_coordinates}
    return tuple(name for name in joints if name not in bending)


def _actuators(robot: Robot, joints: Sequence[str], speeds: Sequence[str],
               actuated: Sequence[str] | Mapping[str, float] | None
               ) -> tuple[tuple[int, float], ...] | None:
    """Return the joints with actuators, by their index, with weights; None of a tree."""
    weights = _stated_weights(robot, joints, actuated)
    if weights is None:
        return None

    # Modes of beams have no actuator.
    bending = {robot.joint_names[k] for k in robot.model.modal_coordinates}
    valid = [name for name in joints if name not in bending]
    indexed = []
    for name, weight in weights.items():
        if name not in valid:
            raise InputError(f'actuated: {name!r}; expected some of {listing(valid)}')
        checked = number(weight, f"actuated: weight of '{name}'", 'a positive number',
                         lambda x: 0.0 < x < np.inf)
        indexed.append((joints.index(name), checked))
    # As many torques as independent speeds, or the motion cannot be driven.
    if len(indexed) < len(speeds):
        raise InputError(f'{WHAT}: joints with actuators {listing(weights)}; expected at '
                         f'least {len(speeds)}, the number of independent speeds of the '
                         f'links ({listing(speeds)}): actuated= names further ones')
    return tuple(indexed)


def _stated_weights(robot: Robot, joints: Sequence[str],
                    actuated: Sequence[str] | Mapping[str, float] | None
                    ) -> dict[str, float] | None:
    """Return the weight of each joint that has an actuator, unchecked; None of a tree."""
    if not robot.constraint_names:
        if actuated is not None:
            raise InputError(f'actuated: {SHORT.repr(actuated)} of a tree; expected None, '
                             'because each joint has its own torque')
        return None
    if isinstance(actuated, Mapping):
        return dict(actuated)
    if actuated is not None:
        return dict.fromkeys(checked_names(actuated, 'actuated') or (), 1.0)

    # By default the drives, and those rigid joints that the robot states.
    weights = dict.fromkeys([elastic.name for elastic in robot.drives], 1.0)
    of_robot = robot.options['actuated'] or ()
    for name in of_robot:
        if name in joints:
            weights[name] = 1.0
            if isinstance(of_robot, Mapping):
                weights[name] = of_robot[name]
    return weights
