"""The statement of what the arm compensates, against the table of arms."""

from collections.abc import Mapping
from typing import Any

from kane_dynamics.analysis.known_arms import (arms_named, contradiction,
                                               effort_contradiction)
from kane_dynamics.model.model import Model
from kane_dynamics.ros.parameters.parameter_checks import arm_gravity, unstated

ARM_PAYLOAD = ('the arm compensates gravity itself, so that `commands` do not change: set '
               'the payload in the arm as well, or state in parameter arm_payload which '
               'one the arm compensates')


def examine_statement(values: Mapping[str, Any], model: Model) -> list[str]:
    """
    Return how parameters contradict the table of arms.

    The parameters are arm_compensates, and efforts.* if they are used.

    Parameters
    ----------
    values : mapping
        The checked parameters of the dynamics node.
    model : Model
        The robot, whose name and joints identify the arm.

    Raises
    ------
    InputError
        The parameter is not set; the message has what the table lists for the arm.

    """
    prefix = values['prefix']
    joints = [name.removeprefix(prefix) for name in model.joint_names]
    rows = arms_named(model.name, joints)
    stated = values['arm_compensates']
    if not stated:
        # The statement is needed; for a known arm the error shows it.
        listed = []
        for row in rows:
            if row.compensates:
                listed.append(f'{", ".join(row.compensates)} for {row}')
        hint = ''
        if listed:
            hint = f'. {model.name} is known: {"; or ".join(listed)}'
        raise unstated(hint)
    contradictions = [contradiction(rows, stated)]
    # Efforts are read by the observer only, unless it uses the command.
    if values['observer.enabled'] and values['observer.torque'] != 'command':
        contradictions.append(effort_contradiction(rows, values['efforts.kind'],
                                                   values['efforts.gravity']))
    return [words for words in contradictions if words]


def payload_remark(values: Mapping[str, Any]) -> str:
    """Return the remark on a new payload, for the arm itself; empty without one."""
    compensates = 'gravity' in values['arm_compensates']
    return ARM_PAYLOAD if compensates and arm_gravity(values) is None else ''
