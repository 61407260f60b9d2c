"""Parameters that change while a node runs: as a whole set, or not at all and with the reason."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.ros.parameters.parameter_checks import declare, in_messages, misspelt, read
from kane_dynamics.ros.parameters.parameter_table import Spec
import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter


class LiveParameters:
    """
    The declared parameters of a node.

    A change is checked with all that come with it before any of them holds, and holds in the
    thread in which the node's callbacks run, between two of them.

    Parameters
    ----------
    node : Node
    specs : sequence of Spec
    frozen : callable
        Returns what to say of a change of a parameter that is not live; empty: it may change.
    check : callable
        Takes all values as they would be and the names of those that are given; raises KaneError
        to refuse them.
    changed : callable
        Takes the values as they were and the names of those that were given; `values` are the
        new ones.

    Attributes
    ----------
    values : dict
        The checked values by name, replaced as a whole; frames are named as in messages.

    Raises
    ------
    InputError
        A value given at start is not valid.

    """

    def __init__(self, node: Node, specs: Sequence[Spec], frozen: Callable[[], str],
                 check: Callable[[Mapping[str, Any], Collection[str]], None],
                 changed: Callable[[Mapping[str, Any], Collection[str]], None]) -> None:
        self._specs = {spec.name: spec for spec in specs}
        self._frozen, self._check, self._changed = frozen, check, changed
        self._given = self._staged = declare(node, specs)
        self.values = in_messages(self._given)
        for remark in misspelt(list(getattr(node, '_parameter_overrides', {})), self._specs):
            node.get_logger().warning(remark)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._after_set)

    def _on_set(self, changes: list[Parameter]) -> SetParametersResult:
        """Check a set of changes as a whole; nothing is applied yet."""
        staged = dict(self._given)
        try:
            for change in changes:
                spec = self._specs.get(change.name)
                if spec is None:  # ROS's own
                    continue
                value = read(spec, change.value)
                reason = '' if spec.live or np.array_equal(value, staged[spec.name]) else (
                    self._frozen())
                if reason:
                    raise InputError(f"parameter '{spec.name}' cannot become {change.value!r} "
                                     f'now: {reason}')
                staged[spec.name] = value
            self._check(in_messages(staged), _names(changes))
        except KaneError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._staged = staged
        return SetParametersResult(successful=True)

    def _after_set(self, changes: list[Parameter]) -> None:
        self._given = self._staged
        before, self.values = self.values, in_messages(self._given)
        self._changed(before, _names(changes))


def _names(changes: list[Parameter]) -> set[str]:
    return {change.name for change in changes}
