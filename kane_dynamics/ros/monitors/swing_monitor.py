"""Warn of springs that are too stiff for the rate of the joint states."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from kane_dynamics.control.controller import Controller
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import KaneError
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.torque_path.cycle_observer import Cycle
from kane_dynamics.ros.torque_path.live_law import LiveLaw
from kane_dynamics.task_space.sampled_spring import JointSpring, steady_share, swing
from rclpy.clock import Clock, ClockType

PERIOD = 1.0  # s between two looks at the arm
LEAST_STATES = 10  # whose mean distance is the period of the states


class _Watched(NamedTuple):
    """A state of a mode with a spring, and the mean time between its states, s."""

    q: Array
    mode: Mode
    law: LiveLaw
    period: float


class SwingMonitor:
    """
    Finds springs with which an arm would swing up, since its states come too seldom.

    The torque path keeps one state when the services' thread asks for it, and counts.

    Parameters
    ----------
    server : Services
    controller : Controller
        The controller of the torque path.
    laws : mapping of Mode to LiveLaw
        Its laws.
    log : rclpy logger

    Attributes
    ----------
    warning : str
        What is too stiff, and what would not be; empty if nothing is.

    """

    def __init__(self, server: Services, controller: Controller,
                 laws: Mapping[Mode, LiveLaw], log: Any) -> None:
        self._server = server
        self._controller = controller
        self._laws = laws
        self._log = log
        self.warning = ''
        self.start()
        self._timer = server.create_timer(PERIOD, self._examine,
                                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def start(self) -> None:
        """Forget the states and the warning."""
        self._watched: _Watched | None = None
        self._count = 0
        self._first = 0
        self._springs: tuple[Mode, JointSpring] | None = None
        self.warning = ''

    stop = start

    def on_loads_changed(self) -> None:
        """Do nothing: the next look reads the payload."""

    def on_cycle(self, cycle: Cycle) -> None:
        """Count a state, and keep one if it is asked for."""
        if self._count == 0:
            self._first = cycle.stamp
        self._count += 1
        if self._watched is not None or self._count <= LEAST_STATES:
            return
        mode = self._controller.mode
        law = self._laws.get(mode)
        if law is not None:
            period = (cycle.stamp - self._first) / (self._count - 1) / NANO
            self._watched = _Watched(cycle.state.q.copy(), mode, law, period)

    def close(self) -> None:
        """Stop looking."""
        self._server.destroy_timer(self._timer)

    def _examine(self) -> None:
        """Warn of the spring of the latest state, if it is too stiff."""
        watched = self._watched
        self._count = 0
        self._watched = None
        if watched is None or watched.period <= 0.0:
            self.warning = ''
            return
        try:
            warning = self._words(watched)
        except KaneError:  # the loops are singular there; the torque path reports it
            return
        if warning and not self.warning:
            self._log.warning(warning)
        self.warning = warning

    def _words(self, watched: _Watched) -> str:
        """Return the warning of a state; empty if its spring is not too stiff."""
        # The law as a spring and damper about this state, and its least damped motion
        # when torques are held over a period.
        spring = watched.law.joint_spring(watched.q)
        if spring is None:
            return ''
        robot = self._controller.robot
        inertia = robot.mass_matrix(watched.q)
        motion = swing(inertia, spring, watched.period)
        if not motion.swings_up:
            return ''
        # The share of the stiffness that would be steady.
        share = steady_share(inertia, spring, watched.period)
        joint = robot.speed_names[motion.joint]
        return (f"{watched.mode}: joint '{joint}' swings up: with joint states each "
                f'{watched.period * 1e3:.3g} ms its amplitude grows by '
                f'{motion.growth:.2g} in each; expected at most {share:.0%} of the '
                'stiffness, states more often, or the inertia of the rotors as '
                '`armature` in the supplement')
