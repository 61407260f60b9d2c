"""The command `bench`: times of calls from Python, compared with Pinocchio's."""

from argparse import Namespace
from timeit import Timer
from typing import Any

from kane_dynamics.cli.commands.inspect_command import pinocchio_model
from kane_dynamics.cli.commands.interleaved_timing import interleaved, Timing
from kane_dynamics.cli.printing import print_json, print_table
from kane_dynamics.cli.robot_options import load_robot, source_of
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
import numpy as np

BATCH = 10_000  # states
# Statements that are timed: ours and Pinocchio's.
CALLS = {
    'inverse dynamics (rnea)': ('robot.inverse_dynamics(q, u, x)',
                                'pin.rnea(peer, data, q, u, x)'),
    'forward dynamics (aba)': ('robot.forward_dynamics(q, u, x)',
                               'pin.aba(peer, data, q, u, x)'),
    'mass matrix (crba)': ('robot.mass_matrix(q)', 'pin.crba(peer, data, q)'),
    'bound inverse dynamics (rnea)': ('bound.inverse_dynamics()',
                                      'pin.rnea(peer, data, q, u, x)'),
    'the same, without attribute access': ('bound_inverse_dynamics()',
                                           'rnea(peer, data, q, u, x)'),
}
IN_BATCH = f'inverse dynamics, each of {BATCH}'


def bench(options: Namespace) -> None:
    """Time calls of this robot, alternating with Pinocchio's if it is installed."""
    model, robot = load_robot(options)
    peer = reason = None
    # Without a peer the own times are printed alone.
    try:
        peer = peer_of(source_of(options), robot)
    except InputError as error:
        reason = str(error)
    timings = call_timings(robot, peer)
    timings[IN_BATCH] = _batch_timing(robot)
    rows = {what: _figures(timing) for what, timing in timings.items()}
    if options.json:
        print_json({'name': model.name, 'joint_names': robot.joint_names, 'calls': rows,
                    'no_peer': reason})
    elif peer is None:
        print(f'no comparison: {reason}')
        times = [[what, f'{row["ns"]:.0f}'] for what, row in rows.items()]
        print_table(['call', 'ns'], times)
    else:
        _print_comparison(rows)


def _print_comparison(rows: dict[str, dict[str, float | None]]) -> None:
    """Print the times of both libraries and their ratios."""
    table = []
    for what, row in rows.items():
        cells = [what, f'{row["ns"]:.0f}', '', '']
        if row['ratio'] is not None:  # a batch has no counterpart
            cells[2] = f'{row["pinocchio_ns"]:.0f}'
            cells[3] = f'{row["ratio"]:.1f}'
        table.append(cells)
    print_table(['call', 'ns', 'Pinocchio, ns', 'ratio'], table)


def _figures(timing: Timing) -> dict[str, float | None]:
    """Return ns per call, ours and Pinocchio's, and their ratio; None without Pinocchio."""
    figures: dict[str, float | None] = {'ns': 1e9 * timing.median('ours'),
                                        'pinocchio_ns': None, 'ratio': None}
    if 'theirs' in timing.seconds:
        figures['pinocchio_ns'] = 1e9 * timing.median('theirs')
        figures['ratio'], _, _ = timing.ratio('theirs', 'ours')
    return figures


def peer_of(source: str | bytes, robot: Robot) -> Any:
    """
    Return Pinocchio's model of the same arm, with every other joint locked at 0.

    Raises
    ------
    InputError
        If Pinocchio is not installed, or its model has other coordinates or torques.

    """
    full = pinocchio_model(source, robot.model)
    import pinocchio as pin
    names = robot.joint_names
    # Pinocchio has all joints of the URDF; those that the robot lacks are locked.
    locked = [full.getJointId(name) for name in full.names[1:] if name not in names]
    peer = pin.buildReducedModel(full, locked, pin.neutral(full)) if locked else full
    if tuple(peer.names[1:]) != names or peer.nq != robot.n:
        raise InputError(f'Pinocchio: coordinates {", ".join(peer.names[1:])}; expected '
                         f'{", ".join(names)}')
    # Times are compared only if both compute the same torque.
    q, u, udot = np.random.default_rng(0).uniform(-1.0, 1.0, (3, robot.n))
    ours = Robot(robot.model, friction=False).inverse_dynamics(q, u, udot)
    theirs = pin.rnea(peer, peer.createData(), q, u, udot)
    if np.abs(ours - theirs).max() > 1e-9 * max(np.abs(ours).max(), 1.0):
        raise InputError('Pinocchio: other torques; expected a model without armature, '
                         'springs and mimic joints, which Pinocchio does not read from '
                         'a URDF')
    return peer


def call_timings(robot: Robot, peer: Any = None) -> dict[str, Timing]:
    """Time `CALLS` on one arm in turns; the contenders are 'ours' and 'theirs'."""
    q, u, x = np.random.default_rng(0).uniform(-1.0, 1.0, (3, robot.n))
    bound: Any = robot.bind()
    bound.q[:] = q
    bound.u[:] = u
    bound.udot[:] = x
    # The statements are timed with these names as their globals.
    names: dict[str, Any] = {'robot': robot, 'bound': bound, 'q': q, 'u': u, 'x': x,
                             'bound_inverse_dynamics': bound.inverse_dynamics}
    if peer is not None:
        import pinocchio as pin
        names |= {'pin': pin, 'rnea': pin.rnea, 'peer': peer, 'data': peer.createData()}
    # Some calls share a statement, which is timed once.
    statements = set()
    for ours, theirs in CALLS.values():
        statements.add(ours)
        if peer is not None:
            statements.add(theirs)
    timing = interleaved({statement: Timer(statement, globals=names)
                          for statement in sorted(statements)})
    timings = {}
    for what, (ours, theirs) in CALLS.items():
        seconds = {'ours': timing.seconds[ours]}
        if peer is not None:
            seconds['theirs'] = timing.seconds[theirs]
        timings[what] = Timing(seconds)
    return timings


def _batch_timing(robot: Robot) -> Timing:
    """Time inverse dynamics of a batch, per state."""
    states = np.random.default_rng(1).uniform(-1.0, 1.0, (3, BATCH, robot.n))
    timing = interleaved({'ours': lambda: robot.inverse_dynamics(*states)}, turns=9)
    return Timing({'ours': timing.seconds['ours'] / BATCH})
