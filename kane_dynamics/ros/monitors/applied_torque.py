"""What torque acts on the arm, as far as a node can know."""

from collections.abc import Callable, Mapping
from typing import Any

from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.parameter_checks import terms
from kane_dynamics.ros.torque_path.cycle_observer import Cycle
import numpy as np


class AppliedTorque:
    """
    The torque that acts on the joints at a state.

    It is the effort of the joint states, where each joint has a finite one, or the node's own
    command with what the arm adds by itself (the terms that are switched off); parameter
    `observer.torque` chooses.

    Parameters
    ----------
    robot : Robot
        That of the torque path.
    values : mapping
        The node's parameters.
    reject : callable
        Takes the reason and the details of every state that lacks velocities, or the effort asked
        for.

    Attributes
    ----------
    measured : bool
        Whether the last torque was the effort of the joint states.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any],
                 reject: Callable[[str, str], None]) -> None:
        self._robot, self._reject, self._zero = robot, reject, np.zeros(robot.n)
        self.measured = False
        robot.compile('torque_terms')
        self.update(values)

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        self._source = values['observer.torque']
        on = terms(values)
        # What the arm adds to a command by itself; of inertia it cannot know.
        self._own = np.array([name != 'inertia' and not getattr(on, name, True)
                              for name in TORQUE_TERMS], dtype=np.float64)

    def torque(self, cycle: Cycle) -> Array | None:
        """Return what acts on the joints, (n,) N m or N; None where that is not known."""
        state = cycle.state
        if not state.moving:
            self._reject('no velocity', 'the joint states have no velocities, without which what '
                         'the motion takes is not known')
            return None
        self.measured = self._source != 'command' and state.measured
        if self._source == 'effort' and not self.measured:
            self._reject('no effort', 'the joint states lack a finite effort for each joint, '
                         'which observer.torque asks for')
            return None
        torque = state.effort if self.measured else cycle.tau
        if not self.measured and self._own.any():
            torque = torque + self._own @ self._robot.torque_terms(state.q, state.u, self._zero)
        return torque if cycle.external is None else torque + cycle.external
