"""Joint states of an arm with closed loops, which determine all other joints."""

from collections.abc import Mapping, Sequence
from typing import Any

from kane_dynamics.control.controller import Controller
from kane_dynamics.loop_tracking.loop_error import LoopError
from kane_dynamics.loop_tracking.loop_tracker import compare_with, LoopTracker, path_rows
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.torque_path.joint_state_reader import JointStateReader
from kane_dynamics.urdf.tree import ROOT_JOINT
import numpy as np


def commanded_joints(robot: Robot, followed: Sequence[str]) -> tuple[int, ...]:
    """Return the indices of the joints in `commands`: those with actuators."""
    equations = robot.equations
    names = robot.joint_names
    if equations.in_joint_rates:
        # The joint that parameter `root_joint` adds has no motors; `prefix` may stand
        # before it.
        return tuple(k for k, name in enumerate(names) if f'{ROOT_JOINT}/' not in name)
    if equations.actuated is not None:
        return tuple(equations.actuated)
    return tuple(sorted(map(names.index, followed)))


def command_fault(controller: Controller) -> str:
    """Return why an arm cannot be commanded by its joint states; empty if it can."""
    robot = controller.robot
    rows = path_rows(robot)
    if rows:
        return (f"parameter 'constraints': {', '.join(rows)} on velocities; expected "
                'constraints on positions, because joint states do not determine the '
                'configuration otherwise')
    # The joints that determine the others are named, unless all are measured.
    is_stated = robot.options['independent'] is not None
    if is_stated or len(controller.followed) == len(robot.coordinate_names):
        return ''
    return ("parameter 'constraints': no key `independent` in the file; expected it to name "
            'the joints that are measured and follow motions')


def closed_loop_reader(controller: Controller, values: Mapping[str, Any]
                       ) -> 'ClosedLoopReader | None':
    """Return the reader of an arm with closed loops; None for other arms."""
    return ClosedLoopReader(controller,
                            values) if controller.robot.constraint_names else None


class ClosedLoopReader(JointStateReader):
    """
    Reads the measured joints; the rules of the loop close the loops from them.

    A message must have the joints that follow motions, as many as there are degrees of
    freedom; it may have further joints, whose positions are compared with the closed
    loops. `q` and `u` are the positions of all joints and the independent speeds.

    Parameters
    ----------
    controller : Controller
        Its robot, and the joints that follow motions.
    values : mapping
        The node's parameters; closure.* are used.

    """

    def __init__(self, controller: Controller, values: Mapping[str, Any]) -> None:
        robot = controller.robot
        followed = controller.followed
        names = robot.joint_names
        others = [name for name in names if name not in followed]
        super().__init__(followed, others,
                         [names[k] for k in commanded_joints(robot, followed)])
        self._places = list(map(names.index, others))
        self.tracker = LoopTracker(robot, followed)
        self.q = self.tracker.q
        self.u = self.tracker.u
        self.state = self.tracker.measurement
        # What is read is the tracker's measurement
        self._q, self._u = np.split(self.state, 2)
        self.update(values)

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        self.tracker.tolerance = values['closure.tolerance']
        self.tracker.max_figure = values['closure.max_conditioning']

    def restart(self) -> None:
        """Begin with the assembly mode of the file, or of the first state."""
        self.tracker.restart()

    @property
    def lost(self) -> bool:
        """Return whether the assembly mode is unknown."""
        return not self.tracker.known

    def compare(self) -> None:
        """Note the further joints of the state, which the loop has compared."""
        compare_with(self.tracker, self._further, self.positions)

    def complete(self) -> str | None:
        """Close the loops at the state, without a torque path; return None, or a reason."""
        try:
            self.tracker.update_checked(self._further, self.positions)
        except LoopError as error:
            self.detail = error.detail
            return 'closed loops'
        return None

    @property
    def _further(self) -> tuple[int, ...]:
        """Return the further joints of the state."""
        return tuple(self._places[k] for k in self.others)

    def figures(self) -> dict[str, str]:
        """Return the entries for the diagnostics."""
        tracker = self.tracker
        return {'closed loops: residual': f'{tracker.residual:.1e} rad or lengths',
                'closed loops: conditioning': f'{tracker.figure:.1f}',
                'closed loops: deviation of measured joints': f'{tracker.deviation:.4f} '
                'm or rad'}
