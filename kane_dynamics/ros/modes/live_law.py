"""The interfaces of the laws of modes, with what most of them share."""

from collections.abc import Mapping
import math
from typing import Any, NamedTuple, Protocol

from kane_dynamics._util.typing import Array
from kane_dynamics.control.controller import ModeLaw
from kane_dynamics.control.traced_laws import TracedLaw
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.modes.task_description import TaskDescription, TaskSnapshot
from kane_dynamics.task_space.sampled_spring import JointSpring
import numpy as np

NOTHING = np.zeros(0)
WALL = 'stiffness of its wall'  # the gain of walls at joint limits


class SprungArm(NamedTuple):
    """
    An arm on springs.

    Attributes
    ----------
    inertia : (n, n) array
        kg m^2 or kg.
    names : tuple of n str
        Of its joints.
    own : JointSpring or None
        The springs and dampers of its elastic joints, which act without a delay.

    """

    inertia: Array
    names: tuple[str, ...]
    own: JointSpring | None = None


class LiveLaw(ModeLaw, Protocol):
    """
    A law whose settings follow the parameters of the node.

    Defaults are those of a law without memory that does nothing at the frame.

    Attributes
    ----------
    longest_period : float
        Largest time between two joint states with which its brakes of fast joints are
        stable, s.

    """

    longest_period: float = math.inf

    def check(self, values: Mapping[str, Any]) -> None:
        """Raise InputError unless parameters fit the arm."""

    def update(self, values: Mapping[str, Any]) -> bool:
        """Use checked parameters; return whether a setting of the law changes."""

    def compile(self) -> None:  # noqa: A003
        """Compile what `torque` needs, if the law did not at its construction."""

    def compile_description(self) -> None:
        """Compile what `describe` needs."""
        return

    def restart(self) -> None:
        """Begin at the next state, as after a change of mode or a stop."""

    def snapshot(self, stamp: int) -> TaskSnapshot:
        """Return the record of the last cycle, whose state has the stamp, ns."""
        return TaskSnapshot()

    def describe(self, q: Array, u: Array, snapshot: TaskSnapshot) -> TaskDescription:
        """Return a description of the law at a state; called in the services' thread."""
        return TaskDescription()

    def springs(self, q: Array) -> Mapping[str, JointSpring]:
        """
        Return the springs and dampers of the law in the independent speeds, by their gain.

        Called in the services' thread, at a position (n_q,), with the target there. Each
        one has to be stable beside those before it.
        """
        return {}

    def sprung_arm(self, robot: Robot, q: Array) -> SprungArm:
        """Return the arm that `springs` move; by default that of the torque path."""
        return SprungArm(robot.mass_matrix(q), tuple(robot.speed_names))


class NativeLaw(LiveLaw):
    """Base of the laws of modes that also run on the native torque path."""

    def traced(self) -> TracedLaw:
        """Return the law as a function over any scalar, for an arm in joint rates."""
        raise NotImplementedError

    def settings_numbers(self) -> Array:
        """Return the numbers of the law's parameters, the first settings of `traced`."""
        raise NotImplementedError

    def order_numbers(self, epoch: int) -> Array:
        """Return its further settings: what messages ask for; times are since epoch, ns."""
        return NOTHING

    def mirror(self, memory: Array, epoch: int) -> None:
        """Keep the memory of a cycle of the native thread."""
