"""
The kernels of requests, which a thread compiles while the node commands already.

Those of requests that are answered at once come first (`compile_answers`); one that a
request needs earlier is compiled for it. Simulations, which a worker computes, need more
code than all others together: the worker waits for it
(`LaterKernels`).
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
import threading
import time

from kane_dynamics.control.computed_torque import joints_that_follow
from kane_dynamics.control.trajectory_joints import compile_trajectories
from kane_dynamics.errors import CompileError, InputError
from kane_dynamics.feasibility.path_robot import compile_splines
from kane_dynamics.native.machine_code.compiling import reported_to
from kane_dynamics.native.runtime.loops import loops
from kane_dynamics.native.runtime.threads import in_calling_thread
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.contact import checked_contacts, Contact
from kane_dynamics.simulation.simulate import compile_simulation, loop_kernels
from kane_dynamics.simulation.stepper import compile_row_steps

ANSWERS = 'answers'
SIMULATIONS = 'simulations'
POLL = 0.05  # s; requests that wait may be cancelled


def shared_copy(robot: Robot) -> Robot:
    """Return a copy of a robot that shares the code of all quantities, once compiled."""
    for name in robot.kernels.names:
        robot.kernels.kernel(name)
    return robot.copy()


def compile_answers(robots: Sequence[Robot], locks: bool) -> None:
    """
    Compile what desired motions and requests that are answered at once need.

    Parameters
    ----------
    robots : sequence of Robot
        The robot, and the flexible one whose rigid model it is, if it has beams.
    locks : bool
        Whether drives lock themselves, so that forward dynamics may not exist.

    """
    robot = robots[0]
    loops()  # over states, which every kernel shares
    if locks:
        robot.compile()
    else:
        robot.compile(*loop_kernels(robot), 'external_force', 'body_torques')
    compile_splines(robot.n)
    compile_trajectories(robot)
    for flexible in robots[1:]:
        flexible.compile('inverse_dynamics', 'torque_terms', batches=True)


def compile_simulations(robot: Robot, integrators: Sequence[str], sticking: bool,
                        stops: bool, locks: bool, contacts: Sequence[Contact] = ()) -> None:
    """Compile every kernel of simulations by one of some integrators."""
    follow = joints_that_follow(robot)
    for integrator in integrators:
        if not locks:  # else the motion follows from the torque with exact friction alone
            compile_simulation(robot, integrator)
        if sticking or stops or contacts:
            compile_row_steps(robot, integrator, follow, stops, sticking,
                              checked_contacts(robot, contacts))


class _ClosedError(Exception):
    """Ends the thread between two kernels."""


class LaterKernels:
    """
    Kernels that a thread compiles while the node commands already.

    The thread has the priority of the others: one of lower priority, interrupted while it
    has the interpreter, would delay the torque path. LLVM, most of the work, runs without
    the interpreter.

    Parameters
    ----------
    groups : mapping of str to callable
        What compiles the kernels of each kind of request, in the order of use.
    log, log_error : callable
        Receive lines on progress, and on kernels that cannot be compiled.

    """

    def __init__(self, groups: Mapping[str, Callable[[], object]],
                 log: Callable[[str], object], log_error: Callable[[str], object]) -> None:
        self._groups = dict(groups)
        self._log = log
        self._log_error = log_error
        self._waiting = deque(groups)
        self._done: dict[str, str] = {}  # why a group cannot be used; empty if it can
        self._closed = False
        self._changed = threading.Condition()

    def start(self) -> None:
        """
        Compile in a thread.

        The interpreter waits for it when it exits, since LLVM must not outlive it.
        """
        threading.Thread(target=self._run, name='kernels').start()

    def close(self) -> None:
        """End the thread after the present kernel, and the requests that wait for it."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def require(self, group: str,
                proceed: Callable[[], bool] = lambda: True) -> bool:
        """
        Wait until the kernels of a group are compiled; they are the next ones.

        Parameters
        ----------
        group : str
            A key of `groups`.
        proceed : callable
            Asked every `POLL` seconds whether to wait on.

        Returns
        -------
        bool
            False if `proceed` ended it.

        Raises
        ------
        CompileError
            They cannot be compiled.
        InputError
            The node was cleaned up.

        """
        with self._changed:
            # Kernels that a request waits for come first.
            if group in self._waiting:
                self._waiting.remove(group)
                self._waiting.appendleft(group)
        while not self._has_ended(group):
            if not proceed():
                return False
        if group not in self._done:
            raise InputError('node: not configured; expected a configured node')
        if fault := self._done[group]:
            raise CompileError(f'kernels of {group}: {fault}; expected kernels that compile')
        return True

    def _has_ended(self, group: str) -> bool:
        """Return whether a group is done or never will be, after `POLL` seconds at most."""
        with self._changed:
            return self._changed.wait_for(lambda: self._closed or group in self._done, POLL)

    def _run(self) -> None:
        """Compile all groups, unless `close` ends it."""
        began = time.perf_counter()
        # In the background, so that requests for the torque path are served meanwhile.
        try:
            with reported_to(self._log), in_calling_thread(self._require_open):
                while self._waiting:
                    self._compile_next()
        except _ClosedError:
            return
        self._log(f'kernels of {" and ".join(self._groups)} ready after '
                  f'{time.perf_counter() - began:.2f} s')

    def _compile_next(self) -> None:
        with self._changed:
            self._require_open()
            group = self._waiting.popleft()
        fault = ''
        # A group that fails is an error of the requests that need it, not of the node.
        try:
            self._groups[group]()
        except Exception as error:
            if isinstance(error, _ClosedError):
                raise
            fault = f'{type(error).__name__}: {error}'
            self._log_error(f'kernels of {group}: {fault}')
        with self._changed:
            self._done[group] = fault
            self._changed.notify_all()

    def _require_open(self) -> None:
        if self._closed:
            raise _ClosedError
