"""
The table of features by kind of mechanism: what works, by which check, or why not.

`python test/helpers/feature_matrix.py` writes the table into docs/limits.md.
"""

from dataclasses import dataclass, field
from pathlib import Path
import sys

import feature_checks as check
from kinds_of_mechanism import ELASTIC, KINDS

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / 'docs' / 'limits.md'
BEGIN = '<!-- features by kind: generated -->\n'
END = '<!-- end of the generated table -->\n'
TREE, SPEEDS, LOOP, ROLLING, TIME, BEAM, BALL = KINDS
COLUMNS = (*KINDS, ELASTIC)

# Reasons, one sentence each. The first are of physics or definition, the others of
# today.
NO_TEN = ("A beam's inertia is a set of modal integrals, not the ten inertial "
          'parameters of a body, in which the regressor is linear.')
NO_SHAPE = ('The positions of some joints do not determine the positions of a '
            'nonholonomic mechanism, which depend on the path.')
BENDS = ('The deflections of beams follow from the load, and the motion of the joints '
         'does not state them; `QuasiStatic` computes them in equilibrium.')
NO_SPLIT = ('Chosen speeds may mix the rates of joints and modes, and modes are in '
            'equilibrium alone.')
NO_ACTUATOR = ('No actuator moves the coordinates of bending; `Controller(bending=)` '
               'commands the joints of an arm with beams.')
NO_SCALE = 'What follows a function of time cannot be moved faster or slower.'
NO_REST = ('A mechanism that follows a function of time has no equilibrium about which '
           'it could vibrate.')
NO_ANGLE = ('The position of a ball joint is a rotation, which the points and splines '
            'of a motion do not state.')
NO_START = ('A trajectory does not state at which time of a function of time it starts.')
NO_ROTATION = (
    'The position of a ball joint is a rotation, which joint states do not state.')
SAME = ('Joint states and efforts belong to joints: chosen speeds would not change a '
        'message.')
NO_JUMP = ('The torques of the fastest motion along a path jump, which springs do not '
           'transmit; `fastest` scales a SmoothMotion.')
BY_MOTORS = ('Motors move the links of elastic joints through springs: '
             '`MotorSideControl`, its '
             '`trajectory` and the other laws of elastic joints command them.')
NO_FUNCTION = 'A function of time is Python code, which no parameter file states.'


@dataclass(frozen=True)
class Row:
    """
    A feature.

    Attributes
    ----------
    name : str
    check : callable, optional
        Fails unless a case's result is that of an independent formulation. It runs for
        every kind and pair without a reason, and must be refused for the others.
    reasons : dict of kind or pair to sentence
        Why it does not work. A pair has the reasons of its kinds.
    tests : dict of kind to test
        Existing tests that show it instead of the check: 'file::name'.
    pairs : bool
        Whether the check runs for pairs of kinds too; slow ones run for the others only.

    """

    name: str
    check: object
    reasons: dict = field(default_factory=dict)
    tests: dict = field(default_factory=dict)
    pairs: bool = True

    def reason(self, *kinds):
        """Return why it does not work for these kinds, or None."""
        reasons = [self.reasons[key] for key in (kinds, *kinds) if key in self.reasons]
        return reasons[0] if reasons else None


CONTROL = 'test/unit/control/'
NODE = 'test/e2e/test_node_'
LIMITS = 'test/unit/feasibility/test_feasibility_'
DERIVATIVES = 'test/property/test_derivatives_of_all_kinds.py::'
ROWS = (
    Row('inverse dynamics, external wrenches', check.inverse_dynamics),
    Row('forward dynamics', check.forward_dynamics),
    Row('mass matrix and its inverse', check.mass_matrix),
    Row('bias force', check.bias),
    Row('gravity force', check.gravity),
    Row('friction force', check.friction),
    Row('Coriolis matrix', check.coriolis),
    Row('derivatives of inverse dynamics', check.inverse_derivatives, {}, dict.fromkeys(
        KINDS[:-1],
        f'{DERIVATIVES}test_inverse_dynamics_derivatives_are_the_definitions'),
        pairs=False),
    Row('derivatives of forward dynamics', check.forward_derivatives, {}, dict.fromkeys(
        KINDS[:-1],
        f'{DERIVATIVES}test_forward_dynamics_derivatives_are_the_definitions'),
        pairs=False),
    Row('Jacobian and its rate', check.jacobian),
    Row('velocity and acceleration of frames', check.frames, pairs=False),
    Row('kinetic and potential energy', check.kinetic_and_potential_energy),
    Row('center of mass, centroidal momentum and its rate', check.centroidal),
    Row('torque by source', check.sources),
    Row('torque by body', check.by_body),
    Row('regressor', check.regressor, {BEAM: NO_TEN}),
    Row('constants of links and joints as arguments', check.constants, {BEAM: NO_TEN},
        pairs=False),
    Row('joint reactions', check.joint_reactions),
    Row('constraint forces', check.constraint_forces),
    Row('workspace', check.workspace, pairs=False),
    Row('batches', check.batches, pairs=False),
    Row('operations of JAX', check.operations_of_jax, pairs=False),
    Row('pickling', check.pickling, pairs=False),
    Row('`verify`', check.verification, pairs=False),
    Row('`simulate`', check.simulation, pairs=False),
    Row('`simulate` with the implicit integrator', check.implicit),
    Row('`ComputedTorque`', check.computed_torque, {
        BEAM: NO_ACTUATOR, BALL: NO_ANGLE, ELASTIC: BY_MOTORS}, pairs=False),
    Row('`Controller`, beams by `QuasiStatic`', check.controller, {
        BALL: NO_ANGLE, ELASTIC: BY_MOTORS}, {
            BEAM: f'{CONTROL}test_quasi_static.py::'
            'test_feedforward_with_bending_tracks_far_better'}, pairs=False),
    Row('`MomentumObserver`', check.observer),
    Row('collision detection', check.collision, pairs=False),
    Row('payload estimate', check.payload),
    Row('joint stops of `simulate`', check.stopped, pairs=False),
    Row('exact friction of `simulate`', check.slid_exactly, pairs=False),
    Row('presliding friction of `simulate`', None, {},
        {**dict.fromkeys(
            KINDS, 'test/unit/simulation/test_presliding.py::'
            'test_every_kind_of_mechanism_moves_as_a_readable_reference'), ELASTIC:
         'test/unit/simulation/test_presliding.py::'
         'test_bristles_of_a_motor_are_seen_through_its_gear'}, pairs=False),
    Row('power balance', check.balanced_power, pairs=False),
    Row('sweep', check.swept),
    Row('view and plots of a simulated motion', check.drawn, pairs=False),
    Row('node', None, {
        SPEEDS: SAME, ROLLING: NO_SHAPE, TIME: NO_FUNCTION, BALL: NO_ROTATION},
        {TREE: (f'{NODE}torques.py::'
                'test_along_a_motion_the_torques_equal_those_of_the_library'),
         LOOP: f'{NODE}closed_loops.py::'
         'test_computed_torque_moves_the_plant_with_only_the_driven_joints_measured',
         BEAM: f'{NODE}flexible.py::'
         'test_quasi_static_feedforward_is_better_than_rigid_feedforward',
         ELASTIC: f'{NODE}elastic_joints.py::'
         'test_elastic_feedforward_leaves_a_twentieth_of_the_vibration'}, pairs=False),
    Row('`export_c`', check.exported, pairs=False),
    Row('natural vibration', check.vibration, {TIME: NO_REST}),
    Row('`demand`, `largest_payload`: motion of the driving joints, beams by '
        '`QuasiStatic`', check.demanded, {ROLLING: NO_SHAPE, BALL: NO_ANGLE}, {
            ELASTIC: f'{LIMITS}of_drives.py::'
            'test_the_demand_satisfies_the_equations_of_links_and_motors'}, pairs=False),
    Row('`fastest`, beams by `QuasiStatic`', check.scaled, {
        ROLLING: NO_SHAPE,
        TIME: NO_SCALE,
        (SPEEDS, BEAM): NO_SPLIT,
        BALL: NO_ANGLE},
        {ELASTIC: (f'{LIMITS}of_drives.py::'
                   'test_the_fastest_speed_reaches_a_limit_of_the_drive')}),
    Row('`time_optimal`', check.timed, {
        ROLLING: NO_SHAPE,
        TIME: NO_SCALE,
        BEAM: BENDS,
        BALL: NO_ANGLE,
        ELASTIC: NO_JUMP}),
    Row('`TrajectoryOptimizer`', check.optimized, {ELASTIC: BY_MOTORS}),
    Row('`fill_trajectory`, beams by `QuasiStatic`', check.filled, {
        ROLLING: NO_SHAPE,
        TIME: NO_START,
        (SPEEDS, BEAM): NO_SPLIT,
        BALL: NO_ANGLE,
        ELASTIC: BY_MOTORS}),
)


def table():
    """Return the features of every kind, the table of the others and its notes."""
    notes = []
    everywhere = []
    lines = []
    for row in ROWS:
        reasons = [row.reason(kind) for kind in COLUMNS]
        if not any(reasons):
            everywhere.append(row.name)
            continue
        cells = []
        for reason in reasons:
            if reason is not None and reason not in notes:
                notes.append(reason)
            cells.append('yes' if reason is None else f'no ({notes.index(reason) + 1})')
        lines.append(f'| {row.name} | {" | ".join(cells)} |')
    head = [f'Every kind has: {"; ".join(everywhere)}.', '',
            f'| | {" | ".join(COLUMNS)} |', f'|---{"|---" * len(COLUMNS)}|']
    tail = ['', *(f'{k}. {note}' for k, note in enumerate(notes, 1))]
    return '\n'.join([*head, *lines, *tail]) + '\n'


def page(text):
    """Return the text of docs/limits.md with the table."""
    head, _, tail = text.partition(BEGIN)
    return f'{head}{BEGIN}\n{table()}\n{END}{tail.partition(END)[2]}'


if __name__ == '__main__':
    PAGE.write_text(page(PAGE.read_text(encoding='utf-8')), encoding='utf-8')
    print(f'{PAGE}: written', file=sys.stderr)
