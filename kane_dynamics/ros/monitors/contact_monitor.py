"""The momentum observer beside the torque path: what pushes the arm, and whether it should."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from kane_dynamics.control.collision_detection import CollisionDetector, frame_wrench
from kane_dynamics.control.momentum_observer import MomentumObserver, OBSERVED
from kane_dynamics.errors import InputError
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.monitors.applied_torque import AppliedTorque
from kane_dynamics.ros.parameters.parameter_checks import per_joint
from kane_dynamics.ros.torque_path.cdr import joint_efforts, wrench_stamped
from kane_dynamics.ros.torque_path.cycle_observer import Cycle
import numpy as np
from rclpy.publisher import Publisher
from std_msgs.msg import Bool

DAMPING = 0.05  # m, of the wrench: estimated torques are noisy, and divided by it
SHARE = 0.02  # of its effort limit: a joint's threshold where none is given


class Outputs(NamedTuple):
    """Publishers of external torques and wrench, given serialised messages, and of the flag."""

    torques: Publisher
    wrench: Publisher
    collision: Publisher


def settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """
    Return gain, thresholds and times of observer and detector.

    Raises
    ------
    InputError
        A list is of the wrong length, or a threshold is neither given nor to be had from the
        effort limits.

    """
    joints = robot.joint_names
    limits = np.minimum(np.array(robot.limits.effort),
                        per_joint(values, 'limits.effort', joints, np.inf))
    threshold = per_joint(values, 'observer.threshold', joints, SHARE * limits)
    if not values['observer.threshold'].size and not np.isfinite(threshold).all():
        joint = joints[int(np.flatnonzero(~np.isfinite(threshold))[0])]
        raise InputError(f"parameter 'observer.threshold' is empty, and joint '{joint}' has no "
                         f'effort limit of which to take {SHARE:.0%}; valid: one number or one '
                         'per joint, N m or N')
    return {'gain': per_joint(values, 'observer.gain', joints, 0.0), 'threshold': threshold,
            'confirm': values['observer.confirm'], 'release': values['observer.release'],
            'clear': values['observer.clear']}


def observed_frame(values: Mapping[str, Any], model: Model) -> str:
    """Return the frame at which the wrench is estimated: as given, else the tip of the arm."""
    return str(values['observer.frame'] or (values['tip'] and values['prefix'] + values['tip'])
               or model.bodies[-1].name)


class ContactMonitor:
    """
    Watches the torque path with an observer and a detector, and publishes what they find.

    Torques of wrenches that come on `~/wrench` are known: the estimate is of what is beyond them.

    Parameters
    ----------
    robot : Robot
        That of the torque path.
    values : mapping
        The node's parameters.
    outputs : Outputs
    log : rcutils logger
    reject : callable
        Takes the reason and the details of every state that the observer cannot use.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any], outputs: Outputs, log: Any,
                 reject: Callable[[str, str], None]) -> None:
        self._robot, self._outputs, self._log, self._reject = robot, outputs, log, reject
        self.collisions: Counter[str] = Counter()  # by joint
        joints, given = robot.joint_names, settings(values, robot)
        robot.compile(*OBSERVED)
        self._acting = AppliedTorque(robot, values, reject)
        self._observer = MomentumObserver(robot, gain=given.pop('gain'))
        self.detector = CollisionDetector(joints, **given)
        self._torque_message = joint_efforts(joints)
        frame = observed_frame(values, robot.model)
        self._wrench_message = wrench_stamped(frame)
        self._workspace = robot.bind()
        self._pose = self._workspace.at_frame('frame_pose', frame)
        self._partials = self._workspace.at_frame('partial_velocities', frame)
        self._origin = self._last = 0
        self._pose(), self._partials()  # compiled now, not in a cycle
        self.update(values)

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        given = settings(values, self._robot)
        self._observer.tune(given.pop('gain'), values['state_timeout'])
        self.detector.tune(**given)
        self._thresholds = given['threshold']
        self._acting.update(values)
        self._period = round(NANO / values['observer.rate'])

    def start(self) -> None:
        """Forget all and say that nothing collides."""
        self._observer.reset()
        self.detector.reset()
        self._origin = self._last = 0
        self._outputs.collision.publish(Bool(data=False))

    def stop(self) -> None:
        """Forget all: what is not watched does not collide."""
        self.start()

    def refresh(self) -> None:
        """Take a changed payload or gravity for what it is, not for a push."""
        self._observer.refresh()

    def take(self, cycle: Cycle) -> None:
        """Look at one state and the command that answered it; publish what is due."""
        state, acting = cycle.state, self._acting.torque(cycle)
        if acting is None:
            self._observer.reset()
            return
        if self._acting.measured == self._observer.held:  # nothing carries over
            self._observer.reset()
            self._observer.held = not self._acting.measured
        self._origin = self._origin or cycle.stamp
        t = (cycle.stamp - self._origin) / NANO
        try:
            torque = self._observer.update(t, state.q, state.u, acting)
        except InputError as error:  # finite numbers that lead beyond
            self._reject('not finite', str(error))
            return
        if self.detector.update(t, torque):
            self._tell(torque)
        if not 0 <= cycle.stamp - self._last < self._period:
            self._last = cycle.stamp
            self._publish(state.sec, state.nanosec, state.q, torque)

    def _tell(self, torque: Array) -> None:
        """Publish and log the flag, which has changed."""
        self._outputs.collision.publish(Bool(data=self.detector.collision))
        if self.detector.joint is None:
            self._log.info('the collision has ended')
            return
        self.collisions[self.detector.joint] += 1
        joints: Sequence[str] = self._robot.joint_names
        words = ', '.join(
            f"'{name}' {torque[k]:.3g} (threshold {self._thresholds[k]:.3g})"
            for k, name in enumerate(joints) if name in self.detector.beyond)
        self._log.warning(f"collision at joint '{self.detector.joint}'; external torques, N m or "
                          f'N: {words}')

    def _publish(self, sec: int, nanosec: int, q: Array, torque: Array) -> None:
        """Send the torques, and the wrench in axes of its frame."""
        self._workspace.q[:] = q
        world = frame_wrench(self._partials(), torque, damping=DAMPING).wrench
        for message, publisher, numbers in (
                (self._torque_message, self._outputs.torques, torque),
                (self._wrench_message, self._outputs.wrench,
                 (world.reshape(2, 3) @ self._pose()[:3, :3]).ravel())):
            message.stamp(sec, nanosec)
            message.numbers[:] = numbers
            publisher.publish(message.serialized())

    def figures(self) -> dict[str, str]:
        """Return printable figures for the diagnostics."""
        figures = {'collision': self.detector.joint or 'none',
                   'joints beyond threshold': ', '.join(self.detector.beyond) or 'none'}
        return figures | {f'collisions: {joint}': str(count)
                          for joint, count in self.collisions.items()}
