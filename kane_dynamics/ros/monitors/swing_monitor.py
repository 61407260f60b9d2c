"""Warn of springs and walls that are too stiff for the rate of the joint states."""

from collections import deque
from collections.abc import Mapping
from typing import Any, NamedTuple

from kane_dynamics.control.controller import Controller
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import KaneError
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.modes.live_law import LiveLaw
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.torque_path.cycle_observer import Cycle
from kane_dynamics.task_space.sampled_spring import JointSpring, steady_share, swing
import numpy as np
from rclpy.clock import Clock, ClockType

PERIOD = 1.0  # s between two looks at the arm
STATES = 11  # whose median distance is the period of the states


class _Watched(NamedTuple):
    """A state of a mode with a spring, and the stamps of the states up to it, ns."""

    q: Array
    mode: Mode
    law: LiveLaw
    stamps: tuple[int, ...]

    @property
    def period(self) -> float:
        """
        Return the time between two states, s.

        It is the median: single states may be refused, pause or not be observed, and the
        clock may jump.
        """
        return float(np.median(np.diff(self.stamps))) / NANO


class SwingMonitor:
    """
    Finds springs with which an arm would swing up, since its states come too seldom.

    The torque path keeps one state, and stamps, when the services' thread asks for them.

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
        # In steady time: a simulated clock that stands must not stop the watch.
        self._timer = server.create_timer(PERIOD, self._examine,
                                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def start(self) -> None:
        """Forget the states and the warning."""
        self._watched: _Watched | None = None
        self._stamps: deque[int] = deque(maxlen=STATES)
        self.warning = ''

    stop = start

    def on_loads_changed(self) -> None:
        """Do nothing: the next look reads the payload."""

    def on_cycle(self, cycle: Cycle) -> None:
        """Note the stamp of a state, and keep the state if one is asked for."""
        if self._watched is not None:
            return
        stamps = self._stamps  # the services' thread may begin others meanwhile
        stamps.append(cycle.stamp)
        if len(stamps) < STATES:
            return
        mode = self._controller.mode
        law = self._laws.get(mode)
        if law is not None:
            self._watched = _Watched(cycle.state.q.copy(), mode, law, tuple(stamps))

    def close(self) -> None:
        """Stop looking."""
        self._server.destroy_timer(self._timer)

    def _examine(self) -> None:
        """Warn of the spring of the latest state, if it is too stiff."""
        watched = self._watched
        self._stamps = deque(maxlen=STATES)
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
        # The law as a spring and damper about this state, then the walls beside it.
        spring = watched.law.joint_spring(watched.q)
        walls = watched.law.wall_spring(watched.q)
        warning = ''
        if spring is not None:
            warning = self._words_of(watched, spring, None, 'stiffness')
        if walls is not None and not warning:
            warning = self._words_of(watched, walls, spring, 'stiffness of its wall')
        return warning

    def _words_of(self, watched: _Watched, spring: JointSpring, other: JointSpring | None,
                  what: str) -> str:
        """Return the warning of an oscillation of two springs; empty if both are steady."""
        # The least damped motion when torques are held over a period.
        robot = self._controller.robot
        inertia = robot.mass_matrix(watched.q)
        motion = swing(inertia, spring.beside(other), watched.period)
        if not motion.swings_up:
            return ''
        # The share of the stiffness that would be steady.
        share = steady_share(inertia, spring, watched.period, other)
        joint = robot.speed_names[motion.joint]
        return (f"{watched.mode}: joint '{joint}' swings up: with joint states each "
                f'{watched.period * 1e3:.3g} ms its amplitude grows by '
                f'{motion.growth:.2g} in each; expected at most {100.0 * share:.2g}% of the '
                f'{what}, states more often, or the inertia of the rotors as '
                '`armature` in the supplement')
