"""Publish the torque breakdown of the latest state, in the services' thread."""

from collections.abc import Callable

from kane_dynamics.control.controller import Controller, Mode
from kane_dynamics.control.followed_motion import FollowedMotion
from kane_dynamics.errors import KaneError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.loads.wrench_input import WrenchInput
from kane_dynamics.ros.services.explanation_message import explanation_message
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.torque_path.cycle_observer import Cycle
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.publisher import Publisher

MAX_PERIOD = 1e6  # s between two messages
# Stamp, measured q and u, active motion and time since its start, wrenches.
BreakdownInput = tuple[int, int, Array, Array, Motion | None, float, Array | None]


class TorqueBreakdownTopic:
    """
    Publishes the torque breakdown of the latest state at the rate explanation.rate.

    The torque path stores the state; the services' thread evaluates it with its own
    robot. In mode inverse_dynamics with an active motion, the desired state is
    evaluated; otherwise the measured state with the desired acceleration (in
    gravity_compensation and hand_guiding, at rest). Term switches, feedback and limits
    are not part of the breakdown.

    Parameters
    ----------
    server : Services
    publisher : Publisher
        Publisher of TorqueExplanation.
    rate : float
        Rate of messages, 1/s.
    controller : Controller
        The controller of the torque path, for its mode.
    wrenches : WrenchInput or None
        The wrench input of the torque path.
    reject : callable
        Called with the reason and the details of each state that cannot be evaluated.

    """

    def __init__(self, server: Services, publisher: Publisher, rate: float,
                 controller: Controller, wrenches: WrenchInput | None,
                 reject: Callable[[str, str], None]) -> None:
        self._server = server
        self._publisher = publisher
        self._controller = controller
        self._wrenches = wrenches
        self._reject = reject
        self._latest: BreakdownInput | None = None
        self._motion: FollowedMotion | None = None  # of the services' robot
        self._timer = server.create_timer(min(1.0 / rate, MAX_PERIOD), self._publish,
                                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def start(self) -> None:
        """Drop the stored state."""
        self._latest = None

    stop = start

    def on_loads_changed(self) -> None:
        """Do nothing: the robot of the services has its own loads."""

    def on_cycle(self, cycle: Cycle) -> None:
        """Store a state in one assignment, which is atomic for the services' thread."""
        state = cycle.state
        wrench = None if cycle.external is None or self._wrenches is None else (
            self._wrenches.world.copy())
        self._latest = (state.sec, state.nanosec, state.q.copy(), state.u.copy(),
                        cycle.motion, cycle.moment, wrench)

    def close(self) -> None:
        """Stop publishing."""
        self._server.destroy_timer(self._timer)

    def _publish(self) -> None:
        latest = self._latest
        # The latest state alone: older ones are of no interest.
        self._latest = None
        served = self._server.served
        if latest is None or served is None:
            return
        sec, nanosec, q, u, motion, moment, wrench = latest
        served.loads.apply(served.robot)
        if self._motion is None:
            self._motion = FollowedMotion(served.robot, self._controller.followed)
        try:
            message = explanation_message(
                served.robot, self._evaluated_state(q, u, motion, moment), wrench,
                served.robot.speed_names)
        except KaneError as error:  # overflow from finite numbers, or a singular loop
            self._reject('not finite', str(error))
            return
        message.header.stamp.sec = sec
        message.header.stamp.nanosec = nanosec
        self._publisher.publish(message)

    def _evaluated_state(self, q: Array, u: Array, motion: Motion | None,
                         moment: float) -> tuple[Array, Array, Array]:
        """Return the q, u, udot whose torques are broken down."""
        at_rest = np.zeros_like(u)
        mode = self._controller.mode
        # The motion whose torques the mode commands: at rest, as measured, or as
        # desired.
        if mode in (Mode.GRAVITY_COMPENSATION, Mode.HAND_GUIDING):
            return q, at_rest, at_rest
        if motion is None:
            return q, at_rest if mode is Mode.INVERSE_DYNAMICS else u, at_rest
        assert self._motion is not None
        self._motion.restart()
        desired, accelerations = self._motion.state(q, motion, moment, 0.0)
        if mode is Mode.INVERSE_DYNAMICS:
            return desired
        return q, u, self._motion.speed_rates(q, u, accelerations, 0.0)
