"""Torque explained on a topic, beside the torque path and without weighing on it."""

from collections.abc import Callable

from kane_dynamics.control.controller import Controller, Mode
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.services.explanation_message import explanation_message
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.torque_path.cycle_observer import Cycle
from kane_dynamics.ros.torque_path.wrench_input import WrenchInput
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.publisher import Publisher

LONGEST = 1e6  # s between two messages
# Stamp, measured q and u, desired motion and time in it, wrenches.
Moment = tuple[int, int, Array, Array, Motion | None, float, Array | None]


class TorqueBreakdownTopic:
    """
    Publishes at a rate of its own what the torques of the latest state are made of.

    The torque path only keeps the state; the services' thread, with its own robot, does the rest.
    In mode inverse_dynamics the desired state is explained, once there is a motion; else the
    measured one with the desired acceleration (in gravity compensation at rest). Term switches,
    feedback and limits come after what is explained.

    Parameters
    ----------
    server : Services
    publisher : Publisher
        Of TorqueExplanation.
    rate : float
        1/s.
    controller : Controller
        Of the torque path, for its mode.
    wrenches : WrenchInput or None
        Of the torque path.
    reject : callable
        Takes the reason and the details of every state that cannot be explained.

    """

    def __init__(self, server: Services, publisher: Publisher, rate: float,
                 controller: Controller, wrenches: WrenchInput | None,
                 reject: Callable[[str, str], None]) -> None:
        self._server, self._publisher, self._controller = server, publisher, controller
        self._wrenches, self._reject = wrenches, reject
        self._latest: Moment | None = None
        self._timer = server.create_timer(min(1.0 / rate, LONGEST), self._publish,
                                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def start(self) -> None:
        """Explain nothing that was before."""
        self._latest = None

    def stop(self) -> None:
        """Explain nothing more."""
        self._latest = None

    def refresh(self) -> None:
        """Do nothing: the services' robot has loads of its own."""

    def take(self, cycle: Cycle) -> None:
        """Keep a state; one assignment, so that the other thread sees all of it or nothing."""
        state = cycle.state
        wrench = None if cycle.external is None or self._wrenches is None else (
            self._wrenches.world.copy())
        self._latest = (state.sec, state.nanosec, state.q.copy(), state.u.copy(), cycle.motion,
                        cycle.moment, wrench)

    def close(self) -> None:
        """Publish no more."""
        self._server.destroy_timer(self._timer)

    def _publish(self) -> None:
        latest, self._latest = self._latest, None
        served = self._server.served
        if latest is None or served is None:
            return
        sec, nanosec, q, u, motion, moment, wrench = latest
        served.loads.apply(served.robot)
        try:
            message = explanation_message(
                served.robot, self._explained(q, u, motion, moment), wrench,
                served.robot.joint_names)
        except InputError as error:  # finite numbers that lead beyond
            self._reject('not finite', str(error))
            return
        message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
        self._publisher.publish(message)

    def _explained(self, q: Array, u: Array, motion: Motion | None,
                   moment: float) -> tuple[Array, Array, Array]:
        """Return q, u, udot of which the torques are explained."""
        rest = np.zeros_like(q)
        if self._controller.mode is Mode.GRAVITY_COMPENSATION:
            return q, rest, rest
        if motion is None:
            return (q, rest if self._controller.mode is Mode.INVERSE_DYNAMICS else u, rest)
        desired = motion.sample(moment)
        return (desired if self._controller.mode is Mode.INVERSE_DYNAMICS
                else (q, u, desired[2]))
