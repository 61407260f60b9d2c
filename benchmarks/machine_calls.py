"""Forward dynamics of closed loops, calls from Python: ours and Pinocchio's."""

from functools import partial
import sys
from typing import Any

from interleaved_timing import interleaved
from machines import ACCURACY, closed_loops, FREE_FLYER, Machine, PRISMATIC
from native_loop import Race
import numpy as np
import pinocchio as pin

CALLS = 64
SAME = 1e-6


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
    settings = pin.ProximalSettings(ACCURACY, ACCURACY, 50)
    ours = list(zip(machine.q[:CALLS], machine.u, machine.x))
    theirs = list(zip(*(part[:CALLS] for part in machine.peer_states)))
    expected = machine.accelerations(
        robot.forward_dynamics(machine.q, machine.u, machine.x))

    def peer(q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> Any:
        return pin.constraintDynamics(model, data, q, v, tau, contacts, contact_data,
                                      settings)
    for arguments, right in zip(theirs, expected):
        error = np.abs(peer(*arguments) - right).max() / np.abs(right).max()
        if not error < SAME:
            raise AssertionError(
                f'{name}: forward dynamics differs by {error:.2g} of its size '
                f'from Pinocchio; at most {SAME:g}')

    def each(call: Any, states: Any) -> None:
        for state in states:
            call(*state)
    timing = interleaved({'ours': partial(each, robot.forward_dynamics, ours),
                          'theirs': partial(each, peer, theirs)})
    return Race(name, robot.n, 'constraint dynamics', 'Pinocchio from Python',
                timing.median('ours') / CALLS, timing.median('theirs') / CALLS,
                timing.ratio('theirs', 'ours'))


def races() -> list[Race]:
    """Return all races."""
    return [compare(name, machine) for name, machine in closed_loops().items()]


def main() -> int:
    """Print the races."""
    print(*races(), sep='\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
