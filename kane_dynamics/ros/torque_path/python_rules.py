"""
Rules that Python evaluates in the message loop: around the torque of a law, and a stop.

Each rule is called in place of its kernel, which it calls itself, with what Python has
computed. The loop runs in callbacks then.
"""

from collections.abc import Callable
from typing import Any, Protocol

from kane_dynamics._util.typing import Array
from kane_dynamics.control.terms import Mode
from kane_dynamics.control_cycle.cycle import DROPS, FAULT, LAST_HEARD, LAW_KNOWN, STOPS
from kane_dynamics.control_cycle.cycle_results import NO_TORQUE, REFUSED
from kane_dynamics.control_cycle.cycle_rules import PathState
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.ros.common.conversion import NANO
import numpy as np

HOLDING = PathState._fields.index('holding')
Compute = Callable[[], object]


class PythonLaw(Protocol):
    """
    A law that Python evaluates, with its stop.

    Attributes
    ----------
    detail : str
        Why it gave no torque the last time; empty if it did.

    """

    detail: str

    @property
    def need_velocity(self) -> bool:
        """Return whether states without velocities are dropped."""

    @property
    def pose(self) -> Array | None:
        """Return the positions that are held, (n,) rad or m; None without."""

    def torque(self) -> Array:
        """
        Return the torques of all joints at the state of the cycle, (n_q,).

        Raises
        ------
        InputError, ConstraintError
            It has no finite torque; closed loops do not determine it.

        """

    def begin_of_stop(self) -> Array:
        """Return where the arm is and how fast, (2 n,); raises as `torque`, or NaN."""

    def stop_torque(self) -> Array:
        """Return the torques of all joints that bring the arm to rest; raises likewise."""


class PythonRules:
    """
    The rules around a law that Python evaluates.

    Parameters
    ----------
    path : TorquePath
    law : PythonLaw

    Attributes
    ----------
    by_name : dict of str to PythonRule
        As `NativeLoop` takes them.

    """

    def __init__(self, path: Any, law: PythonLaw) -> None:
        self._path = path
        self._law = law
        self.by_name = {'answer': self.answer, 'refuse': self.refuse, 'hold': self.hold}

    @property
    def detail(self) -> str:
        """Return why the law gave no torque the last time; empty if it did."""
        return self._law.detail

    @property
    def need_velocity(self) -> bool:
        """Return whether states without velocities are dropped."""
        return self._law.need_velocity

    def answer(self, compute: Compute) -> None:
        """Command the torque of the law at an accepted state."""
        loop = self._path.native
        law = self._law
        law.detail = ''
        try:
            torque = law.torque()
        except (InputError, ConstraintError) as error:
            law.detail = str(error)
            loop.keep(NO_TORQUE if isinstance(error, InputError) else REFUSED)
            return
        loop.torque[:] = self._path.messages.of_commanded(torque)
        compute()
        pose = law.pose
        loop.result[HOLDING] = pose is not None
        if pose is not None:
            loop.next.pose[:] = pose

    def refuse(self, compute: Compute) -> None:
        """Refuse a state; a stop begins where the law says that the arm is."""
        path = self._path
        loop = path.native
        live = loop.memory
        # Without a prediction the arm is taken to rest at its last accepted state.
        rest = loop.stop_begin
        rest[:] = live.accepted
        rest[len(rest) // 2:] = 0.0
        compute()
        begins = loop.result[FAULT] > live.entries[FAULT]
        if not (begins and path.states.holds and live.known):
            return
        try:
            begin = self._law.begin_of_stop()
        except (InputError, ConstraintError):  # no finite state, or singular loops
            return
        if np.isfinite(begin).all():
            rest[:] = begin
            compute()

    def hold(self, compute: Compute) -> None:
        """Command the torque that brings the arm to rest, or else the last torque."""
        path = self._path
        if path.native.memory.entries[STOPS] < 0.5:
            return
        try:
            torque = self._law.stop_torque()
        except (InputError, ConstraintError):  # not finite, or the loops are singular there
            return
        path.native.torque[:] = path.messages.of_commanded(torque)
        compute()


class ControllerLaw:
    """
    The law of the controller of a path, which Python evaluates.

    Parameters
    ----------
    path : TorquePath

    Attributes
    ----------
    detail : str
        As of `PythonLaw`.

    """

    def __init__(self, path: Any) -> None:
        self.detail = ''
        self._path = path

    @property
    def need_velocity(self) -> bool:
        """Return whether the law of the mode uses speeds."""
        return self._path.controller.mode is not Mode.GRAVITY_COMPENSATION

    @property
    def pose(self) -> Array | None:
        """Return the positions that are held, (n,) rad or m; None with a motion."""
        pose: Array | None = self._path.controller.pose
        return pose

    def torque(self) -> Array:
        """Return the torques of the controller at the state of the cycle, (n_q,)."""
        path = self._path
        loop = path.native
        live = loop.memory
        controller = path.controller
        # Between two cycles: new loads, and what the law remembers of another one.
        path.apply_loads()
        if live.entries[LAW_KNOWN] < 0.5:
            controller.stop()
        # What comes next never runs ahead of the clock, whatever the message says.
        now, stamp = loop.event[:2]
        at = path.time_of(min(now, stamp))
        motion, moment = path.active_motion.at(at)
        if live.entries[DROPS] > loop.plan.settings.drops:
            motion, moment = None, 0.0
        q, u = measured(path)
        external = None
        if path.wrenches is not None:
            external = path.wrenches.torques(q, path.time_of(now))
        torque: Array = controller.torque(q, u, motion, moment, external, at / NANO)
        return torque

    def begin_of_stop(self) -> Array:
        """Return where the arm is by the model since its last state, and how fast."""
        path = self._path
        live = path.native.memory
        elapsed = (live.entries[LAST_HEARD] - float(live.states.stamp)) / NANO
        begin: Array = path.reached_from(live.q.copy(), live.u.copy(), elapsed)
        return begin

    def stop_torque(self) -> Array:
        """Return the torques of all joints along the stop, (n_q,)."""
        path = self._path
        live = path.native.memory
        stop, elapsed = path.stop_of_now()
        torque: Array = path.controller.motion_torque(
            live.q.copy(), stop, elapsed, path.time_of(live.entries[LAST_HEARD]) / NANO)
        return torque


def controller_rules(path: Any) -> PythonRules:
    """Return the rules of a path around the law of its controller."""
    return PythonRules(path, ControllerLaw(path))


def measured(path: Any) -> tuple[Array, Array]:
    """Return copies of the positions, (n_q,), and speeds, (n,), of the state of a cycle."""
    live = path.native.memory
    if path.loops is not None:
        return live.q.copy(), live.u.copy()
    return path.native.state[:len(live.trusted)].copy(), live.trusted.copy()
