"""Make samples of an arm's motion and torques from the messages of its topics."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from kane_dynamics.model.model import Model
from kane_dynamics.ros.common.conversion import Array, NANO, nanoseconds
from kane_dynamics.ros.loads.wrench_input import WrenchInput
from kane_dynamics.ros.monitors.applied_torque import AppliedTorque
from kane_dynamics.ros.torque_path.closed_loop_reader import closed_loop_reader
from kane_dynamics.ros.torque_path.joint_state_reader import JointStateReader
from kane_dynamics.ros.torque_path.path_controller import path_controller
import numpy as np
from sensor_msgs.msg import JointState

PERIOD = NANO // 100  # ns between two samples, whose velocities give the acceleration
MAX_GAP = 3  # longest time between two samples for an acceleration, periods
WAITING = 100  # states that wait for the torques of their stamp, or torques for states


class TorqueSample(NamedTuple):
    """A state and the torque that acted: ns, rad, rad/s, N m."""

    stamp: int
    q: Array
    u: Array
    torque: Array


class MeasuredState(NamedTuple):
    """Positions, speeds and efforts of a joint state, as `AppliedTorque` reads them."""

    q: Array
    u: Array
    effort: Array
    has_effort: bool
    has_velocity: bool = True


class TorqueSamples:
    """
    Samples of an arm's motion at a steady rate.

    The torque of a sample is the effort of its joint state, or the command that a
    dynamics node published with the stamp of the state. Known wrenches are added.

    Parameters
    ----------
    model : Model
    values : mapping
        Parameters of the arm and of its efforts.
    now : callable
        Returns the clock with which stamps of wrenches are compared, ns.
    reject : callable
        Called with the reason and the details of each message that cannot be used.

    Attributes
    ----------
    robot : Robot
        The robot of `model` with rigid links, whose loads may be set.
    bending : QuasiStatic or None
        The flexible arm, if `model` is one.

    """

    def __init__(self, model: Model, values: Mapping[str, Any], now: Callable[[], int],
                 reject: Callable[[str, str], None]) -> None:
        controller = path_controller(model, values)
        self.robot = controller.robot
        self.bending = controller.bending
        self._source = values['observer.torque']
        self._now = now
        self._reject = reject
        self._reader = closed_loop_reader(controller, values) or JointStateReader(
            self.robot.joint_names)
        self._reader.need_effort = True
        self._applied = AppliedTorque(self.robot, values, reject, self.bending)
        self.wrenches = WrenchInput(self.robot, now, values, reject)
        self._last = 0  # stamp of the last sampled state, ns
        self._states: dict[int, MeasuredState] = {}  # by stamp, without torques yet
        self._torques: dict[int, Array] = {}  # by stamp, without a state yet

    def of_state(self, data: bytes) -> TorqueSample | None:
        """Return the sample of a serialized JointState, if it is due and complete."""
        reader = self._reader
        reason = reader.read(data, need_velocity=True)
        stamp = reader.stamp
        # A sample is due after a period, and after a jump back of the clock.
        if reason is None and 0 <= stamp - self._last < PERIOD:
            return None
        if reason is None:
            reason = reader.complete()
        if reason is not None:
            self._reject(f'joint states: {reason}', reader.detail)
            return None
        self._last = stamp
        state = MeasuredState(reader.q.copy(), reader.u.copy(), reader.effort.copy(),
                              reader.has_effort)
        if self._source == 'effort' or (state.has_effort and self._source == 'auto'):
            return self._sample(stamp, state, np.zeros(self.robot.n_q))
        tau = self._torques.pop(stamp, None)
        if tau is not None:
            return self._sample(stamp, state, tau)
        _put(self._states, stamp, state)
        return None

    def of_torques(self, message: JointState) -> TorqueSample | None:
        """Return the sample of a state that waits for these torques of a dynamics node."""
        stamp = nanoseconds(message.header.stamp)
        # Joints without a motor have no torque.
        torques = dict(zip(message.name, message.effort))
        tau = np.array([torques.get(name, 0.0) for name in self.robot.joint_names])
        # The torques of a state may come before the state itself.
        state = self._states.pop(stamp, None)
        if state is not None:
            return self._sample(stamp, state, tau)
        _put(self._torques, stamp, tau)
        return None

    def _sample(self, stamp: int, state: MeasuredState, tau: Array) -> TorqueSample | None:
        """Return a sample; None without a known torque."""
        external = self.wrenches.torques(state.q, self._now())
        torque = self._applied.torque(state, tau, external)
        if torque is None:
            return None
        return TorqueSample(stamp, state.q, state.u, torque.copy())


def _put(waiting: dict[int, Any], stamp: int, value: Any) -> None:
    """Add a value by its stamp; drop the oldest one of too many."""
    waiting[stamp] = value
    if len(waiting) > WAITING:
        del waiting[next(iter(waiting))]
