"""
Parameters that may change while a node runs.

A set of changes is applied as a whole or not.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.ros.parameters.parameter_checks import (declare, parameter_text, read,
                                                           unknown_parameters,
                                                           with_prefix)
from kane_dynamics.ros.parameters.parameter_table import Spec
import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter


class Owner(NamedTuple):
    """
    A part of a node that uses some of its parameters.

    Attributes
    ----------
    groups : set of str
        The first parts of the names of the live parameters that it reads.
    check : callable
        Raises KaneError unless new values of all parameters fit.
    use : callable
        Uses checked values.

    """

    groups: set[str]
    check: Callable[[Mapping[str, Any]], object]
    use: Callable[[Mapping[str, Any]], object] = bool


def owners_of(owners: Sequence[Owner], changed: Collection[str]) -> list[Owner]:
    """Return the owners that read some of the changed parameters, in their order."""
    groups = {name.partition('.')[0] for name in changed}
    return [owner for owner in owners if owner.groups & groups]


class LiveParameters:
    """
    The declared and checked parameters of a node.

    All changes of one request are checked together before any of them is applied. They
    are applied in the thread of the node's callbacks, between two callbacks.

    Parameters
    ----------
    node : Node
    specs : sequence of Spec
    frozen : callable
        Returns why parameters that are not live cannot change now; empty: they can.
    check : callable
        Receives the new values of all parameters and the names of those in the request;
        raises KaneError to refuse the request.
    changed : callable
        Called after a change with the previous values and the names of the parameters in
        the request; `values` holds the new ones.

    Attributes
    ----------
    values : dict
        The checked values by name, replaced as a whole; frame names include the prefix.

    Raises
    ------
    InputError
        An initial value is invalid.

    """

    def __init__(self, node: Node, specs: Sequence[Spec], frozen: Callable[[], str],
                 check: Callable[[Mapping[str, Any], Collection[str]], None],
                 changed: Callable[[Mapping[str, Any], Collection[str]], None]) -> None:
        self._node = node
        self._specs = {spec.name: spec for spec in specs}
        self._frozen = frozen
        self._check = check
        self._changed = changed
        # Values without the prefix: the present ones, and those of a request that is
        # checked.
        self._present = self._staged = declare(node, specs)
        self.values = with_prefix(self._present)
        overrides = list(getattr(node, '_parameter_overrides', {}))
        for warning in unknown_parameters(overrides, self._specs):
            node.get_logger().warning(warning)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._after_set)

    def _on_set(self, changes: list[Parameter]) -> SetParametersResult:
        """Check a set of changes as a whole, without applying it."""
        # All changes or none: they are staged until ROS has accepted them.
        staged = dict(self._present)
        try:
            for change in changes:
                spec = self._specs.get(change.name)
                if spec is None:  # a parameter of ROS
                    self._refuse_new_clock(change)
                    continue
                value = read(spec, change.value)
                unchanged = np.array_equal(value, staged[spec.name])
                reason = '' if spec.live or unchanged else self._frozen()
                if reason:
                    new_value = parameter_text(change.value)
                    raise InputError(f"parameter '{spec.name}': new value {new_value}; "
                                     f'{reason}')
                staged[spec.name] = value
            self._check(with_prefix(staged), _names(changes))
        except KaneError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._staged = staged
        return SetParametersResult(successful=True)

    def _refuse_new_clock(self, change: Parameter) -> None:
        """Refuse another clock while states are compared with the present one."""
        reason = self._frozen() if change.name == 'use_sim_time' else ''
        if reason and change.value != self._node.get_parameter(change.name).value:
            raise InputError(f"parameter 'use_sim_time': new value {change.value}; "
                             f'{reason}')

    def _after_set(self, changes: list[Parameter]) -> None:
        self._present = self._staged
        previous = self.values
        self.values = with_prefix(self._present)
        self._changed(previous, _names(changes))


def _names(changes: list[Parameter]) -> set[str]:
    return {change.name for change in changes}
