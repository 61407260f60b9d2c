"""The messages of one command."""

from collections.abc import Sequence

from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.torque_path.cdr import (float64_multi_array, joint_command,
                                               joint_state_of_efforts)
import numpy as np
from rclpy.publisher import Publisher


class CommandMessages:
    """
    Publishes the torques of the commanded joints, with layouts that are built once.

    Parameters
    ----------
    joints : sequence of str
        All joints.
    commanded : sequence of int
        Indices of the joints with actuators.
    commands, torques : Publisher
        Publishers of Float64MultiArray and of JointState; they receive serialized
        messages.
    stamped : Publisher, optional
        Publisher of JointCommand.

    Attributes
    ----------
    joints : tuple of str
        The commanded joints.

    """

    def __init__(self, joints: Sequence[str], commanded: Sequence[int],
                 commands: Publisher,
                 torques: Publisher, stamped: Publisher | None) -> None:
        self.joints = tuple(joints[k] for k in commanded)
        self._count = len(joints)
        self._places = np.array(commanded, dtype=np.intp)
        self._commands = commands
        self._torques = torques
        self._stamped = stamped
        self._command_message = float64_multi_array(len(self.joints))
        self._torque_message = joint_state_of_efforts(self.joints)
        self._stamped_message = joint_command(self.joints, 'effort')

    def publish(self, tau: Array, sec: int, nanosec: int) -> None:
        """Publish the torques of all joints, (n_q,), first the command."""
        # The command first: the other topics show what it was.
        tau.take(self._places, out=self._command_message.numbers, mode='clip')
        numbers = self._command_message.numbers
        self._commands.publish(self._command_message.serialized())
        if self._stamped is not None:
            self._stamped_message.stamp(sec, nanosec)
            self._stamped_message.numbers[:] = numbers
            self._stamped.publish(self._stamped_message.serialized())
        self._torque_message.stamp(sec, nanosec)
        self._torque_message.numbers[:] = numbers
        self._torques.publish(self._torque_message.serialized())

    def repeat(self) -> None:
        """Publish the last torques again, with their stamp."""
        self._commands.publish(self._command_message.serialized())
        if self._stamped is not None:
            self._stamped.publish(self._stamped_message.serialized())
        self._torques.publish(self._torque_message.serialized())

    def resume(self, tau: Array) -> None:
        """Continue torques that another process published, by `repeat`."""
        for message in (self._command_message, self._torque_message,
                        self._stamped_message):
            message.numbers[:] = tau

    @property
    def last(self) -> Array:
        """Return the last torques of all joints, (n_q,)."""
        return self.of_all(self._command_message.numbers)

    def of_commanded(self, tau: Array) -> Array:
        """Return the torques of the commanded joints, of all torques."""
        return tau[self._places]

    def of_all(self, tau: Array) -> Array:
        """Return the torques of all joints, (n_q,), of those commanded."""
        whole = np.zeros(self._count)
        whole[self._places] = tau
        return whole
