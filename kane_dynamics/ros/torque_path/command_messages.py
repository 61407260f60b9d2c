"""The messages of one command."""

from collections.abc import Sequence

from kane_dynamics.ros.common.cdr import (float64_multi_array, interface_groups,
                                          joint_command, joint_state_of_efforts)
from kane_dynamics.ros.common.conversion import Array
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
        Publisher of JointCommand, or of DynamicInterfaceGroupValues with several
        interfaces.
    interfaces : sequence of str
        Of the commands, which have the numbers of all joints for each of them.

    Attributes
    ----------
    joints : tuple of str
        The commanded joints.
    publishers : tuple
        Those of commands, torques and stamped commands, or None.

    """

    def __init__(self, joints: Sequence[str], commanded: Sequence[int],
                 commands: Publisher,
                 torques: Publisher, stamped: Publisher | None,
                 interfaces: Sequence[str] = ('effort',)) -> None:
        self.joints = tuple(joints[k] for k in commanded)
        self._count = len(joints)
        self._places = np.array(commanded, dtype=np.intp)
        self.publishers = commands, torques, stamped
        # The messages are made once; a command only fills in its numbers.
        self._command_message = float64_multi_array(
            len(interfaces) * len(self.joints))
        self._torque_message = joint_state_of_efforts(self.joints)
        if len(interfaces) == 1:
            self._stamped_message = joint_command(self.joints, interfaces[0])
        else:
            self._stamped_message = interface_groups(self.joints, interfaces)

    def publish(self, tau: Array, sec: int, nanosec: int, command: Array | None) -> None:
        """Publish a command, if there is one, then the torques of the commanded joints."""
        # The command first: the other topics show what it was.
        commands, torques, stamped = self.publishers
        if command is not None:
            self._command_message.numbers[:] = command
            commands.publish(self._command_message.serialized())
        if stamped is not None and command is not None:
            self._stamped_message.stamp(sec, nanosec)
            numbers = self._stamped_message.numbers
            numbers[:] = command.reshape(numbers.shape)
            stamped.publish(self._stamped_message.serialized())
        self._torque_message.stamp(sec, nanosec)
        self._torque_message.numbers[:] = tau
        torques.publish(self._torque_message.serialized())

    def of_commanded(self, tau: Array) -> Array:
        """Return the torques of the commanded joints, of all torques."""
        return tau[self._places]

    def of_all(self, tau: Array) -> Array:
        """Return the torques of all joints, (n_q,), zero where none is commanded."""
        whole = np.zeros(self._count)
        whole[self._places] = tau
        return whole
