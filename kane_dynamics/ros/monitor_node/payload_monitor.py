"""Estimate the payload while the arm moves."""

from collections.abc import Callable, Mapping
from typing import Any

from geometry_msgs.msg import Vector3
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.identification.payload.payload_estimator import PayloadEstimator
from kane_dynamics.identification.payload.recorded_motion import recorded_joints
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.monitor_node.torque_samples import MAX_GAP, PERIOD, TorqueSample
from kane_dynamics.ros.parameters.parameter_checks import per_joint_of_effort
from kane_dynamics_interfaces.msg import PayloadEstimate
import numpy as np

DEFAULT_DEVIATION = 0.01  # standard deviation of a torque, fraction of the effort limit


def estimator_settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """
    Return the settings of the payload estimator.

    Raise InputError if a list has the wrong length, or a joint has no deviation and no
    effort limit.
    """
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
    Estimates the payload from samples of the arm's motion.

    Parameters
    ----------
    robot : Robot
        Its gravity is used; the payload that it knows is part of the estimate.
    values : mapping
        Parameters payload.frame and estimator.*.
    reject : callable
        Called with the reason and the details of each sample that cannot be used.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any],
                 reject: Callable[[str, str], None]) -> None:
        self._robot = robot
        self._reject = reject
        self._frame = values['payload.frame']
        self._estimator = PayloadEstimator(robot, **estimator_settings(values, robot))
        self._estimator.compile()
        self._recent: list[TorqueSample] = []
        self._used = 0  # samples since the last message
        self.on_loads_changed()

    def on_loads_changed(self) -> None:
        """Use the robot's gravity; its payload has no effect on the estimate."""
        self._estimator.gravity = self._robot.parameters.gravity

    def add(self, sample: TorqueSample) -> None:
        """Use the middle one of the three latest samples."""
        # The acceleration of a sample needs the one before and the one after.
        self._recent = [*self._recent[-2:], sample]
        if len(self._recent) < 3:
            return
        first, middle, last = self._recent
        span = last.stamp - first.stamp
        if not 0 < span < 2 * MAX_GAP * PERIOD:
            return
        # The central difference of the velocities around the middle sample.
        udot = (last.u - first.u) * (NANO / span)
        try:
            self._estimator.update(middle.q, middle.u, udot, middle.torque)
        except InputError as error:  # overflow from finite numbers
            self._reject('not finite', str(error))
        except ConstraintError as error:
            self._reject('singular', str(error))
        else:
            self._used += 1

    def message(self) -> PayloadEstimate | None:
        """Return the estimate, if samples were used since the last message."""
        if not self._used:
            return None
        self._used = 0
        estimator = self._estimator
        message = PayloadEstimate(mass=estimator.mass,
                                  mass_deviation=estimator.mass_deviation,
                                  com=_vector(estimator.com),
                                  com_deviation=_vector(estimator.com_deviation))
        message.header.frame_id = self._frame
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self._recent[-1].stamp, NANO)
        return message


def _vector(values: Array) -> Vector3:
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)
