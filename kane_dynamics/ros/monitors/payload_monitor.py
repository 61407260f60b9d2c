"""What the arm carries, estimated beside the torque path and without weighing on it."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from geometry_msgs.msg import Vector3
from kane_dynamics.errors import InputError
from kane_dynamics.identification.payload.payload_estimator import PayloadEstimator
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.monitors.applied_torque import AppliedTorque
from kane_dynamics.ros.parameters.parameter_checks import per_joint
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.torque_path.cycle_observer import Cycle
from kane_dynamics_interfaces.msg import PayloadEstimate
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.publisher import Publisher

PERIOD = NANO // 100  # ns between two samples: accelerations are differences of their speeds
MOST = 1000  # samples that may wait: ten seconds
GAP = 3  # periods between two samples over which no acceleration is taken
SHARE = 0.01  # of its effort limit: the deviation of a joint's torque where none is given


class Sample(NamedTuple):
    """A state, ns, rad and rad/s, and the torque that acted, N m."""

    stamp: int
    q: Array
    u: Array
    torque: Array


def estimator_settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """
    Return frame, deviations and memory of the estimator.

    Raises
    ------
    InputError
        There is no payload frame, a list is of the wrong length, or a deviation is neither given
        nor to be had from the effort limits.

    """
    if not values['payload.frame']:
        raise InputError("parameter 'estimator.enabled' is true, and payload.frame is empty; "
                         'valid: the frame in which a payload is to be told')
    limits, names = np.array(robot.limits.effort), robot.joint_names
    sigma = per_joint(values, 'estimator.torque_deviation', names, SHARE * limits)
    if not np.isfinite(sigma).all():
        joint = names[int(np.flatnonzero(~np.isfinite(sigma))[0])]
        raise InputError(f"parameter 'estimator.torque_deviation' is empty, and joint '{joint}' "
                         f'has no effort limit of which to take {SHARE:.0%}; valid: one number '
                         'or one per joint, N m or N')
    return {'frame': values['payload.frame'], 'sigma': sigma,
            'memory': max(values['estimator.memory'] * NANO / PERIOD, 2.0)}


class PayloadMonitor:
    """
    Samples the torque path and publishes, at a rate of its own, what the arm seems to carry.

    The path only keeps a sample now and then; the services' thread does the rest. A wrench that
    comes on `~/wrench` is known and is not taken for weight.

    Parameters
    ----------
    robot : Robot
        That of the torque path; what it carries by parameter is part of the estimate.
    values : mapping
        The node's parameters.
    server : Services
        In whose thread the estimate is made.
    publisher : Publisher
        Of PayloadEstimate.
    reject : callable
        Takes the reason and the details of every state that cannot be used.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any], server: Services,
                 publisher: Publisher, reject: Callable[[str, str], None]) -> None:
        self._robot, self._server, self._publisher = robot, server, publisher
        self._reject = reject
        self._acting = AppliedTorque(robot, values, reject)
        given = estimator_settings(values, robot)
        self._frame = given['frame']
        self._estimator = PayloadEstimator(robot.model, **given)
        self._anew = False  # whether the other thread shall forget what it knows
        self._samples: deque[Sample] = deque(maxlen=MOST)
        self._recent: list[Sample] = []
        self._last = 0
        zero = np.zeros(robot.n)
        self._estimator.update(zero, zero, zero, zero)  # its kernels compile now
        self.start()
        self._timer = server.create_timer(1.0 / values['estimator.rate'], self._publish,
                                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def start(self) -> None:
        """Forget all."""
        self._anew = True
        self.refresh()
        self._samples.clear()
        self._last = 0

    def stop(self) -> None:
        """Look at nothing more; what has been found stays."""
        self._samples.clear()

    def refresh(self) -> None:
        """Weigh what comes by the gravity of now; the payload by parameter is of no account."""
        self._estimator.gravity = self._robot.parameters.gravity

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        self._acting.update(values)

    def take(self, cycle: Cycle) -> None:
        """Keep a sample where one is due."""
        if 0 <= cycle.stamp - self._last < PERIOD:
            return
        torque = self._acting.torque(cycle)
        if torque is not None:
            self._last = cycle.stamp
            state = cycle.state
            self._samples.append(Sample(cycle.stamp, state.q.copy(), state.u.copy(),
                                        torque.copy()))

    def close(self) -> None:
        """Publish no more."""
        self._server.destroy_timer(self._timer)

    def _publish(self) -> None:
        """Work off the samples that wait, and tell what they say."""
        taken, estimator = 0, self._estimator
        if self._anew:
            self._anew, self._recent = False, []
            estimator.reset()
        for _ in range(len(self._samples)):
            try:
                sample = self._samples.popleft()
            except IndexError:  # the path has forgotten them meanwhile
                break
            self._recent = [*self._recent[-2:], sample]
            taken += self._learn(estimator)
        if not taken:
            return
        message = PayloadEstimate(mass=estimator.mass, mass_deviation=estimator.mass_deviation,
                                  com=_vector(estimator.com),
                                  com_deviation=_vector(estimator.com_deviation))
        message.header.frame_id = self._frame
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self._recent[-1].stamp,
                                                                        NANO)
        self._publisher.publish(message)

    def _learn(self, estimator: PayloadEstimator) -> bool:
        """Use the middle one of three samples, if they follow each other; tell whether it was."""
        if len(self._recent) < 3:
            return False
        before, now, after = self._recent
        if not 0 < after.stamp - before.stamp < 2 * GAP * PERIOD:
            return False
        udot = (after.u - before.u) * (NANO / (after.stamp - before.stamp))
        try:
            estimator.update(now.q, now.u, udot, now.torque)
        except InputError as error:  # finite numbers that lead beyond
            self._reject('not finite', str(error))
            return False
        return True


def _vector(values: Array) -> Vector3:
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)
