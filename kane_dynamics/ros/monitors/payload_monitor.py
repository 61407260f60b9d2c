"""Payload estimation in the services' thread."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from geometry_msgs.msg import Vector3
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.identification.payload.payload_estimator import PayloadEstimator
from kane_dynamics.identification.payload.recorded_motion import recorded_joints
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.monitors.applied_torque import AppliedTorque
from kane_dynamics.ros.parameters.parameter_checks import per_joint_of_effort
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.torque_path.cycle_observer import Cycle
from kane_dynamics_interfaces.msg import PayloadEstimate
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.publisher import Publisher

PERIOD = NANO // 100  # ns between two samples, whose velocities give the acceleration
MAX_SAMPLES = 1000  # queued samples: ten seconds
MAX_GAP = 3  # longest time between two samples for an acceleration, periods
DEFAULT_DEVIATION = 0.01  # standard deviation of a torque, fraction of the effort limit


class TorqueSample(NamedTuple):
    """A state and the torque that acted: ns, rad, rad/s, N m."""

    stamp: int
    q: Array
    u: Array
    torque: Array


def estimator_settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """
    Return the settings of the payload estimator.

    Raise InputError if payload.frame is empty, a list has the wrong length, or a joint
    has no deviation and no effort limit.
    """
    if not values['payload.frame']:
        raise InputError("parameter 'payload.frame': empty; expected the frame of the "
                         'payload, as estimator.enabled is true')
    # Deviations are those of the joints whose torques are measured.
    names = recorded_joints(robot)
    effort = np.array(robot.limits.effort)[[robot.joint_names.index(name)
                                            for name in names]]
    sigma = per_joint_of_effort(values, 'estimator.torque_deviation', names, effort,
                                DEFAULT_DEVIATION)
    return {'frame': values['payload.frame'], 'sigma': sigma,
            'memory': max(values['estimator.memory'] * NANO / PERIOD, 2.0)}


class PayloadMonitor:
    """
    Estimates the payload and publishes it at the rate estimator.rate.

    The torque path queues samples; the services' thread processes them. Wrenches on
    `~/wrench` are known and not part of the estimate.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path; its payload parameter is part of the estimate.
    values : mapping
        The node's parameters.
    server : Services
        Its thread computes the estimate.
    publisher : Publisher
        Publisher of PayloadEstimate.
    reject : callable
        Called with the reason and the details of each state that cannot be used.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any], server: Services,
                 publisher: Publisher, reject: Callable[[str, str], None],
                 bending: QuasiStatic | None = None) -> None:
        self._robot = robot
        self._server = server
        self._publisher = publisher
        self._reject = reject
        self._applied_torque = AppliedTorque(robot, values, reject, bending)
        settings = estimator_settings(values, robot)
        self._frame = settings['frame']
        self._estimator = PayloadEstimator(robot, **settings)
        self._reset_pending = False  # carried out by the services' thread
        self._samples: deque[TorqueSample] = deque(maxlen=MAX_SAMPLES)
        self._recent: list[TorqueSample] = []
        # Compiled before the first sample, because the cycle must not wait.
        self._last = 0
        self._estimator.compile()
        self.start()
        self._timer = server.create_timer(1.0 / values['estimator.rate'], self._publish,
                                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def start(self) -> None:
        """Reset the estimate."""
        self._reset_pending = True
        self.on_loads_changed()
        self._samples.clear()
        self._last = 0

    def stop(self) -> None:
        """Drop queued samples; keep the estimate."""
        self._samples.clear()

    def on_loads_changed(self) -> None:
        """Use the new gravity; the payload parameter has no effect on the estimate."""
        self._estimator.gravity = self._robot.parameters.gravity

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        self._applied_torque.update(values)

    def on_cycle(self, cycle: Cycle) -> None:
        """Queue a sample if one is due."""
        # Samples at a steady rate, whatever the rate of the states is; also after a
        # jump back.
        if 0 <= cycle.stamp - self._last < PERIOD:
            return
        torque = self._applied_torque.torque(cycle)
        if torque is not None:
            self._last = cycle.stamp
            state = cycle.state
            self._samples.append(TorqueSample(cycle.stamp, state.q.copy(),
                                              state.u.copy(), torque.copy()))

    def close(self) -> None:
        """Stop publishing."""
        self._server.destroy_timer(self._timer)

    def _publish(self) -> None:
        """Process the queued samples and publish the estimate."""
        used = 0
        estimator = self._estimator
        if self._reset_pending:
            self._reset_pending = False
            self._recent = []
            estimator.reset()
        for _ in range(len(self._samples)):
            try:
                sample = self._samples.popleft()
            except IndexError:  # the torque path has cleared the queue
                break
            # The acceleration of a sample needs the one before and the one after.
            self._recent = [*self._recent[-2:], sample]
            used += self._update_estimate(estimator)
        if not used:
            return
        message = PayloadEstimate(mass=estimator.mass,
                                  mass_deviation=estimator.mass_deviation,
                                  com=_vector(estimator.com),
                                  com_deviation=_vector(estimator.com_deviation))
        message.header.frame_id = self._frame
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self._recent[-1].stamp, NANO)
        self._publisher.publish(message)

    def _update_estimate(self, estimator: PayloadEstimator) -> bool:
        """
        Use the middle one of three consecutive samples.

        Return whether it was used.
        """
        if len(self._recent) < 3:
            return False
        first, middle, last = self._recent
        span = last.stamp - first.stamp
        if not 0 < span < 2 * MAX_GAP * PERIOD:
            return False
        # The central difference of the velocities around the middle sample.
        udot = (last.u - first.u) * (NANO / span)
        try:
            estimator.update(middle.q, middle.u, udot, middle.torque)
        except InputError as error:  # overflow from finite numbers
            self._reject('not finite', str(error))
            return False
        except ConstraintError as error:
            self._reject('singular', str(error))
            return False
        return True


def _vector(values: Array) -> Vector3:
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)
