"""Forward dynamics of closed loops, calls from Python: ours and Pinocchio's."""

from dataclasses import replace
from functools import partial
import sys
from typing import Any

from interleaved_timing import interleaved
from machines import (closed_loops, FREE_FLYER, Machine, PRISMATIC, SAME,
                      SETTINGS)
from native_loop import Race, race
import numpy as np
import pinocchio as pin

CALLS = 64


def peer_of(machine: Machine) -> tuple[Any, list[Any]]:
    """Return Pinocchio's model of a machine, and its contacts."""
    model = pin.Model()
    model.gravity.linear = np.array(machine.robot.parameters.gravity)
    for k, row in enumerate(machine.joints):
        axis = row[2:5]
        kind = ('RP'[int(row[1] == PRISMATIC)] + 'XYZ'[int(axis.argmax())])
        if row[1] == FREE_FLYER:
            joint = pin.JointModelFreeFlyer()
        elif axis.max() > 1.0 - 1e-12:
            joint = getattr(pin, f'JointModel{kind}')()
        else:
            joint = (pin.JointModelPrismaticUnaligned if row[1] == PRISMATIC else
                     pin.JointModelRevoluteUnaligned)(axis)
        number = model.addJoint(int(row[0]) + 1, joint, placement(row[5:17]), str(k))
        model.appendBodyToJoint(
            number, pin.Inertia(row[17], row[18:21], row[21:30].reshape(3, 3)),
            pin.SE3.Identity())
        if joint.nv == 1:
            model.armature[model.idx_vs[number]] = row[30]
    return model, [pin.RigidConstraintModel(
        pin.ContactType.CONTACT_3D, model, int(row[0]) + 1, placement(row[1:13]),
        int(row[13]) + 1, placement(row[14:]), pin.ReferenceFrame.LOCAL)
        for row in machine.contacts]


def placement(row: np.ndarray) -> Any:
    """Return a placement from a rotation by rows and a translation."""
    return pin.SE3(row[:9].reshape(3, 3), row[9:])


def compare(name: str, machine: Machine) -> Race:
    """Race the calls at `CALLS` states, after both gave the same numbers."""
    robot = machine.robot
    model, contacts = peer_of(machine)
    data = model.createData()
    contact_data = [each.createData() for each in contacts]
    pin.initConstraintDynamics(model, data, contacts, contact_data)
    ours = list(zip(machine.q[:CALLS], machine.u, machine.x))
    theirs = list(zip(*(part[:CALLS] for part in machine.peer_states)))
    expected = machine.accelerations(
        robot.forward_dynamics(machine.q, machine.u, machine.x))

    def peer(settings: Any, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> Any:
        return pin.constraintDynamics(model, data, q, v, tau, contacts, contact_data,
                                      settings)

    def each(call: Any, states: Any) -> None:
        for state in states:
            call(*state)
    contenders = {'ours': partial(each, robot.forward_dynamics, ours)}
    # Of the settings with which Pinocchio agrees, the fastest counts.
    for accuracy, mu in SETTINGS:
        call = partial(peer, pin.ProximalSettings(accuracy, mu, 50))
        errors = [np.abs(call(*state) - right).max() / np.abs(right).max()
                  for state, right in zip(theirs, expected)]
        if max(errors) < SAME:
            contenders[f'{accuracy:g}, {mu:g}'] = partial(each, call, theirs)
    if len(contenders) == 1:
        raise AssertionError(f'{name}: forward dynamics of Pinocchio differs by more '
                             f'than {SAME:g} of its size with all settings')
    rivals = tuple(name for name in contenders if name != 'ours')
    line = race(robot, 'constraint dynamics', 'Pinocchio from Python',
                interleaved(contenders), CALLS, rivals)
    return replace(line, robot=name)


def races() -> list[Race]:
    """Return all races."""
    return [compare(name, machine) for name, machine in closed_loops().items()]


def main() -> int:
    """Print the races."""
    print(*races(), sep='\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
