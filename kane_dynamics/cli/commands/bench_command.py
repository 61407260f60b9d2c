"""The command `bench`: times of calls from Python, compared with Pinocchio's."""

from argparse import Namespace
from timeit import Timer
from typing import Any

from kane_dynamics.cli.commands.inspect_command import pinocchio_model, print_table
from kane_dynamics.cli.commands.interleaved_timing import interleaved, Timing
from kane_dynamics.cli.shared import load, print_json, source_of
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
    model, robot = load(options)
    peer = why = None
    try:
        peer = peer_of(source_of(options), robot)
    except InputError as error:
        why = str(error)
    timings = call_timings(robot, peer)
    timings[IN_BATCH] = _batch_timing(robot)
    rows = {what: _figures(timing) for what, timing in timings.items()}
    if options.json:
        print_json({'name': model.name, 'joint_names': robot.joint_names, 'calls': rows,
                    'no_peer': why})
        return
    if peer is None:
        print(f'no comparison: {why}')
    print_table(['call', 'ns', 'Pinocchio, ns', 'ratio'][:2 if peer is None else 4], [
        (what, *('' if figure is None else f'{figure:.{digits}f}'
                 for figure, digits in zip(row.values(), (0, 0, 1))
                 if peer is not None or figure is not None)) for what, row in rows.items()])


def _figures(timing: Timing) -> dict[str, float | None]:
    """Return ns per call, ours and Pinocchio's, and their ratio; None without Pinocchio."""
    both = 'theirs' in timing.seconds
    return {'ns': 1e9 * timing.median('ours'),
            'pinocchio_ns': 1e9 * timing.median('theirs') if both else None,
            'ratio': timing.ratio('theirs', 'ours')[0] if both else None}


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
    others = [full.getJointId(name) for name in full.names[1:] if name not in names]
    peer = pin.buildReducedModel(full, others, pin.neutral(full)) if others else full
    if tuple(peer.names[1:]) != names or peer.nq != robot.n:
        raise InputError(f'Pinocchio: coordinates {", ".join(peer.names[1:])}; expected '
                         f'{", ".join(names)}')
    q, u, udot = np.random.default_rng(0).uniform(-1.0, 1.0, (3, robot.n))
    ours = Robot(robot.model, friction=False).inverse_dynamics(q, u, udot)
    theirs = pin.rnea(peer, peer.createData(), q, u, udot)
    if np.abs(ours - theirs).max() > 1e-9 * max(np.abs(ours).max(), 1.0):
        raise InputError('Pinocchio: other torques; expected a model without armature, springs '
                         'and mimic joints, which Pinocchio does not read from a URDF')
    return peer


def call_timings(robot: Robot, peer: Any = None) -> dict[str, Timing]:
    """Time `CALLS` on one arm in turns; the contenders are 'ours' and 'theirs'."""
    q, u, x = np.random.default_rng(0).uniform(-1.0, 1.0, (3, robot.n))
    bound: Any = robot.bind()
    bound.q[:], bound.u[:], bound.udot[:] = q, u, x
    names: dict[str, Any] = {'robot': robot, 'bound': bound, 'q': q, 'u': u, 'x': x,
                             'bound_inverse_dynamics': bound.inverse_dynamics}
    if peer is not None:
        import pinocchio as pin
        names |= {'pin': pin, 'rnea': pin.rnea, 'peer': peer, 'data': peer.createData()}
    contenders = [statement for pair in CALLS.values()
                  for statement in pair[:1 if peer is None else 2]]
    timing = interleaved({statement: Timer(statement, globals=names)
                          for statement in sorted(set(contenders))})
    return {what: Timing({name: timing.seconds[statement]
                          for name, statement in zip(('ours', 'theirs'), pair)
                          if statement in timing.seconds}) for what, pair in CALLS.items()}


def _batch_timing(robot: Robot) -> Timing:
    """Time inverse dynamics of a batch, per state."""
    states = np.random.default_rng(1).uniform(-1.0, 1.0, (3, BATCH, robot.n))
    timing = interleaved({'ours': lambda: robot.inverse_dynamics(*states)}, turns=9)
    return Timing({'ours': timing.seconds['ours'] / BATCH})
