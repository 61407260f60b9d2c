"""Warn of gains, springs and walls that are too stiff for the rate of the joint states."""

from collections import deque
from collections.abc import Mapping
from typing import Any, NamedTuple

from kane_dynamics.control.controller import Controller
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import KaneError
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.modes.live_law import LiveLaw
from kane_dynamics.ros.modes.stability import instability
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.torque_path.cycle_observer import Cycle
import numpy as np
from rclpy.clock import Clock, ClockType

PERIOD = 1.0  # s between two looks at the arm
STATES = 11  # whose median distance is the period of the states


class _Watched(NamedTuple):
    """A state of a mode with feedback, and the stamps of the states up to it, ns."""

    q: Array
    mode: Mode
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
        if mode is Mode.COMPUTED_TORQUE or mode in self._laws:
            self._watched = _Watched(cycle.state.q.copy(), mode, tuple(stamps))

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
            warning = instability(self._controller, self._laws, watched.mode, watched.q,
                                  watched.period)
        except KaneError:  # the loops are singular there; the torque path reports it
            return
        if warning and not self.warning:
            self._log.warning(warning)
        self.warning = warning
