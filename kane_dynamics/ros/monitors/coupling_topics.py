"""
Topics of two coupled arms: the state that this arm sends, and that of its partner.

Both are sensor_msgs/JointState: positions and rates of the coupled joints, and as efforts
the external torques that a momentum observer estimates. The n-th joint is coupled to the
n-th of the partner, whatever their names.
"""

from collections.abc import Callable, Mapping
from typing import Any

from kane_dynamics.control.momentum_observer import MomentumObserver
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import KaneError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.cdr import whole_joint_state
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.common.stamped_numbers import MALFORMED
from kane_dynamics.ros.modes.arm_coupling_mode import ArmCouplingMode
from kane_dynamics.ros.monitors.applied_torque import AppliedTorque
from kane_dynamics.ros.parameters.parameter_checks import per_joint
from kane_dynamics.ros.torque_path.cycle_observer import Cycle
from kane_dynamics.ros.torque_path.joint_state_reader import JointStateReader
from kane_dynamics.task_space.arm_coupling import PartnerState
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

NO_EFFORT, OTHER_COUNT = 'no external torque', 'other number of joints'


class CouplingTopics:
    """
    Sends the state of an arm to its partner after each command, and receives its.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path.
    mode : ArmCouplingMode
        Receives the states of the partner.
    values : mapping
        The node's parameters.
    publisher : Publisher
        Of serialized JointState.
    log : rcutils logger
    reject : callable
        Called with the reason and the details of each state that is not used.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model.

    """

    def __init__(self, robot: Robot, mode: ArmCouplingMode, values: Mapping[str, Any],
                 publisher: Publisher, log: Any, reject: Callable[[str, str], None],
                 bending: QuasiStatic | None = None) -> None:
        self._mode = mode
        self._publisher = publisher
        self._log = log
        self._reject = reject
        # The partner feels external torques: measured ones, less those of the model.
        self._applied = AppliedTorque(robot, values, reject, bending)
        gain = per_joint(values, 'coupling.observer_gain', robot.speed_names, 100.0)
        self._observer = MomentumObserver(robot, gain=gain,
                                          max_gap=values['state_timeout'])
        self._places = list(map(robot.coordinate_names.index, mode.joints))
        self._speeds = list(map(robot.speed_names.index, mode.joints))
        self._message, self._rows = whole_joint_state(mode.joints)
        self._reader: JointStateReader | None = None  # of the partner's joints
        self._was_engaged = False
        self._origin = 0

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        self._applied.update(values)

    def start(self) -> None:
        """Forget the past: the torque path starts or stops."""
        self._observer.reset()
        self._origin = 0
        self._was_engaged = False
        self._mode.partner = None

    stop = start

    def on_loads_changed(self) -> None:
        """Adapt the observer to new gravity and payload, without a jump."""
        self._observer.refresh()

    def on_cycle(self, cycle: Cycle) -> None:
        """Estimate the external torque, and send it with the state."""
        applied = self._applied.torque(cycle)
        if applied is None:
            self._observer.reset()
            return
        # The source of the torque has changed, and with it what the observer integrates.
        if self._applied.measured == self._observer.held:
            self._observer.reset()
            self._observer.held = not self._applied.measured
        # Times since the first cycle, because stamps in seconds have too few digits.
        self._origin = self._origin or cycle.stamp
        state = cycle.state
        t = (cycle.stamp - self._origin) / NANO
        try:
            external = self._observer.update(t, state.q, state.u, applied)
        except KaneError as error:  # overflow from finite numbers, or a singular loop
            self._reject('not finite', str(error))
            return
        positions, rates, efforts = self._rows
        positions[:] = state.q[self._places]
        rates[:] = state.u[self._speeds]
        efforts[:] = external[self._speeds]
        self._message.stamp(*divmod(cycle.stamp, NANO))
        self._publisher.publish(self._message.serialized())
        self._report()

    def _report(self) -> None:
        """Log when the arm engages or is alone again."""
        mode = self._mode
        engaged = mode.law.engaged
        if engaged == self._was_engaged:
            return
        self._was_engaged = engaged
        if engaged:
            self._log.info('coupled: the arm follows its partner')
        else:
            self._log.warning(f'coupling: alone, {mode.reason}; set coupling.engaged '
                              'false, then true, to engage again')

    def on_message(self, data: bytes) -> None:
        """Use a serialized JointState as the state of the partner, or refuse it."""
        reader = self._reader
        if reader is None:
            reader = self._reader_of(data)
            if reader is None:
                return
        fault = reader.read(data, need_velocity=True)
        if fault is not None:
            self._reject(fault, reader.detail)
        elif not reader.has_effort:
            self._reject(NO_EFFORT, 'expected an effort for each joint')
        else:
            # By its stamp: the law drops what is too old, or of another clock.
            self._mode.partner = PartnerState(reader.stamp / NANO, reader.q.copy(),
                                              reader.u.copy(), reader.effort.copy())

    def _reader_of(self, data: bytes) -> JointStateReader | None:
        """Return a reader of the joints of a message; None if their number differs."""
        try:
            names = deserialize_message(data, JointState).name
        except (RuntimeError, MemoryError, ValueError) as error:
            self._reject(MALFORMED, str(error)[:100])
            return None
        # Names may differ between the arms, their number not.
        if len(names) != len(self._places):
            self._reject(OTHER_COUNT, f'{len(names)} joints; expected '
                         f'{len(self._places)}, as many as of this arm')
            return None
        self._reader = JointStateReader(names)
        self._reader.need_effort = True
        return self._reader
