"""Momentum observer and collision detection beside the torque path."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from kane_dynamics.control.collision_detection import CollisionDetector, frame_wrench
from kane_dynamics.control.friction_error import FrictionError
from kane_dynamics.control.momentum_observer import MomentumObserver
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import KaneError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.cdr import joint_state_of_efforts, wrench_stamped
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.monitors.applied_torque import AppliedTorque
from kane_dynamics.ros.parameters.parameter_checks import per_joint
from kane_dynamics.ros.parameters.task_settings import (controlled_frame,
                                                        friction_beyond_model)
from kane_dynamics.ros.torque_path.cycle_observer import ObservedCycle
import numpy as np
from rclpy.publisher import Publisher
from std_msgs.msg import Bool

DAMPING = 0.05  # m, of the wrench: estimated torques are noisy, and divided by it
OBSERVED_BENDING = ('quasi-static deflection at the measured state, not of acceleration '
                    'and contact')
UNCALIBRATED = ('observer.threshold: empty, so ~/collision stays silent; expected '
                'thresholds, as of `kane-dynamics calibrate --collision` for a recording '
                'without contact')


class ContactPublishers(NamedTuple):
    """Publishers of external torques and wrench, serialized, and of the flag."""

    torques: Publisher
    wrench: Publisher
    collision: Publisher


def observer_settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """
    Return the settings of momentum observer and collision detector.

    The thresholds are infinite if none are set. Raise InputError if a list has the wrong
    length.
    """
    joints = robot.speed_names  # all joints, or with closed loops the independent ones
    return {'gain': per_joint(values, 'observer.gain', joints, 0.0),
            'threshold': per_joint(values, 'observer.threshold', joints, np.inf),
            'confirm': values['observer.confirm'], 'release': values['observer.release'],
            'clear': values['observer.clear']}


def friction_settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """
    Return the parameters of the observer as arguments of `FrictionError`.

    Raise InputError if a list has a wrong length.
    """
    joints = robot.speed_names
    settings: dict[str, Any] = {**friction_beyond_model(values, robot)}
    threshold = per_joint(values, 'observer.threshold', joints, np.inf)
    # Without thresholds nothing tells contact from friction: the friction stays as
    # stated.
    calibrated = bool(np.isfinite(threshold).all())
    settings['memory'] = values['observer.friction.memory'] if calibrated else np.inf
    return settings | {'largest': threshold}


def _same(settings: Mapping[str, Any], others: Mapping[str, Any]) -> bool:
    """Return whether two mappings have equal numbers."""
    return settings.keys() == others.keys() and all(
        np.array_equal(value, others[name]) for name, value in settings.items())


class ContactMonitor:
    """
    Estimates external torques, detects collisions, and publishes both.

    Wrenches on `~/wrench` are known and not part of the estimate. With closed loops the
    torques are the generalized forces of the independent joints.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path.
    values : mapping
        The node's parameters.
    publishers : ContactPublishers
    log : rcutils logger
    reject : callable
        Called with the reason and the details of each state that the observer cannot
        use.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model.
    on_collision : callable, optional
        Called with the stamp of its state, ns, and the joint, where a collision begins.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any],
                 publishers: ContactPublishers,
                 log: Any, reject: Callable[[str, str], None],
                 bending: QuasiStatic | None = None,
                 on_collision: Callable[[int, str], object] | None = None) -> None:
        self._robot = robot
        self._on_collision = on_collision
        self._publishers = publishers
        self._log = log
        self._reject = reject
        self.collisions: Counter[str] = Counter()  # by joint
        self._bending = bending
        joints = robot.speed_names
        settings = observer_settings(values, robot)
        self._applied_torque = AppliedTorque(robot, values, reject, bending)
        self._observer = MomentumObserver(robot, gain=settings.pop('gain'))
        self.detector = CollisionDetector(joints, **settings)
        self._torque_message = joint_state_of_efforts(joints)
        frame = controlled_frame(values, robot.model)
        self._wrench_message = wrench_stamped(frame)
        self._workspace = robot.bind()
        self._pose = self._workspace.at_frame('frame_pose', frame)
        self._partials = self._workspace.at_frame('partial_velocities', frame)
        self._origin = self._last = 0
        self._friction: dict[str, Any] = {}
        self._silent = self._started = False
        self._pose(), self._partials()  # compile before the first cycle
        self.update(values)

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        settings = observer_settings(values, self._robot)
        self._observer.tune(settings.pop('gain'), values['state_timeout'])
        self.detector.tune(**settings)
        self._thresholds = settings['threshold']
        # Without thresholds ~/collision is silent; with them it says what is known now.
        was_silent = self._silent
        self._silent = not values['observer.threshold'].size
        if self._silent and not was_silent:
            self._log.warning(UNCALIBRATED)
        if self._started and was_silent and not self._silent:
            self._publishers.collision.publish(Bool(data=self.detector.collision))
        friction = friction_settings(values, self._robot)
        if not _same(friction, self._friction):  # else what it has adapted to stays
            self._friction = friction
            self._observer.friction_error = FrictionError(self._robot.speed_names,
                                                          **friction)
        self._applied_torque.update(values)
        self._period = round(NANO / values['observer.rate'])

    def start(self) -> None:
        """
        Reset observer and detector.

        Publish that there is no collision if it is known.
        """
        self._observer.reset()
        self.detector.reset()
        self._origin = self._last = 0
        self._started = True
        if not self._silent:
            self._publishers.collision.publish(Bool(data=False))

    stop = start

    def on_loads_changed(self) -> None:
        """Adapt the observer to new gravity and payload, without a jump."""
        self._observer.refresh()

    def on_cycle(self, cycle: ObservedCycle) -> None:
        """Update the estimate with one state and its command; publish what is due."""
        state = cycle.state
        applied = self._applied_torque.torque(state, cycle.tau, cycle.external)
        if applied is None:
            self._observer.reset()
            return
        # The source of the torque has changed, and with it what the observer integrates.
        if self._applied_torque.measured == self._observer.held:
            self._observer.reset()
            self._observer.held = not self._applied_torque.measured
        # Times since the first cycle, because stamps in seconds have too few digits.
        self._origin = self._origin or cycle.stamp
        t = (cycle.stamp - self._origin) / NANO
        try:
            torque = self._observer.update(t, state.q, state.u, applied)
        except KaneError as error:  # overflow from finite numbers, or a singular loop
            self._reject('not finite', str(error))
            return
        if self.detector.update(t, torque):
            self._publish_collision(torque)
            if self.detector.joint is not None and self._on_collision is not None:
                self._on_collision(cycle.stamp, self.detector.joint)
        if not 0 <= cycle.stamp - self._last < self._period:
            self._last = cycle.stamp
            self._publish(state.sec, state.nanosec, state.q, torque)

    def _publish_collision(self, torque: Array) -> None:
        """Publish and log the flag after a change."""
        self._publishers.collision.publish(Bool(data=self.detector.collision))
        if self.detector.joint is None:
            self._log.info('collision ended')
            return
        self.collisions[self.detector.joint] += 1
        joints: Sequence[str] = self._robot.speed_names
        # All joints beyond their thresholds, the first of which names the collision.
        words = ', '.join(
            f"'{name}' {torque[k]:.3g} (threshold {self._thresholds[k]:.3g})"
            for k, name in enumerate(joints) if name in self.detector.beyond)
        self._log.warning(f"collision at joint '{self.detector.joint}'; external "
                          f'torques, N m or N: {words}')

    def _publish(self, sec: int, nanosec: int, q: Array, torque: Array) -> None:
        """Publish the torques, and the wrench in the axes of its frame."""
        self._workspace.q[:] = q
        # The wrench at the frame that explains the torques best.
        world = frame_wrench(self._partials(), torque, damping=DAMPING).wrench
        for message, publisher, numbers in (
                (self._torque_message, self._publishers.torques, torque),
                (self._wrench_message, self._publishers.wrench,
                 (world.reshape(2, 3) @ self._pose()[:3, :3]).ravel())):
            message.stamp(sec, nanosec)
            message.numbers[:] = numbers
            publisher.publish(message.serialized())

    def figures(self) -> dict[str, str]:
        """Return the entries for the diagnostics."""
        collision = 'not detected: ' + UNCALIBRATED if self._silent else 'none'
        figures = {'collision': self.detector.joint or collision,
                   'joints above threshold': ', '.join(self.detector.beyond) or 'none'}
        if self._bending is not None:
            figures['observer: flexible links'] = OBSERVED_BENDING
        return figures | {f'collisions: {joint}': str(count)
                          for joint, count in self.collisions.items()}
