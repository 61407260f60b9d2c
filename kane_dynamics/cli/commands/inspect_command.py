"""The command `inspect`: properties of a robot, and its comparison with Pinocchio."""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict
import math
from typing import Any
import warnings

from kane_dynamics._util.typing import Array
from kane_dynamics.analysis.model_checks import examine_masses
from kane_dynamics.cli.printing import brief, print_json, print_section, print_table
from kane_dynamics.cli.robot_options import load_robot, selection, source_of
from kane_dynamics.errors import InputError, ModelError, ModelWarning
from kane_dynamics.kinematics.poses import rotation_rpy
from kane_dynamics.model.model import Body, Joint, Model, WORLD
from kane_dynamics.model.plausible_sizes import upward_gravity
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf import load_urdf
from kane_dynamics.urdf.document import read_source
import numpy as np

STATES = 100  # random states of the comparison
TOLERANCE = 1e-12  # of the comparison, relative to the largest torque
DEEPEST = 16  # levels of the tree that are indented


def inspect(options: Namespace) -> int:
    """Print the properties of a robot; on request compare it with Pinocchio."""
    model_texts: list[str] = []
    model, robot = load_robot(options, model_texts)
    upward = upward_gravity(model.gravity)
    if upward:
        model_texts.append(upward)
    if not options.verbose:
        model_texts = [brief(text) for text in model_texts]
    facts = describe(model, robot, model_texts,
                     operations=options.operations or options.json,
                     frames=options.frames or options.json)
    # Agreement with a peer decides the exit code.
    agrees = True
    if options.against:
        facts['against'] = _comparison(options)
        agrees = facts['against']['agrees']
    if options.json:
        print_json(facts)
    else:
        print_facts(facts)
    return 0 if agrees else 1


def _comparison(options: Namespace) -> dict[str, Any]:
    """Return the comparison of the chosen robot with Pinocchio."""
    # Pinocchio reads no supplement; friction is compared for neither.
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ModelWarning)
        bare = load_urdf(source_of(options), **selection(options))
    return compare_pinocchio(source_of(options), bare)


def describe(model: Model, robot: Robot, model_texts: Sequence[str] = (), *,
             operations: bool = False, frames: bool = False) -> dict[str, Any]:
    """
    Return bodies, joints, limits and masses as plain data.

    The problems are defects that make the dynamics impossible. Operation counts of the
    kernels are added on request; kernels that a problem makes impossible are left out.
    """
    moving_mass = math.fsum(body.inertial.mass for body in model.bodies)
    problems = [finding.words for finding in examine_masses(robot)]
    facts = {'name': model.name, 'joint_names': list(model.joint_names),
             'base': model.base_name, 'base_mass': model.base_inertial.mass,
             'moving_mass': moving_mass, 'gravity': model.gravity.tolist(),
             'bodies': [_body(model, body) for body in model.bodies],
             'constraints': _constraints(robot),
             'warnings': list(model_texts), 'problems': problems}
    # Parts that are long.
    if frames:
        facts['frames'] = _frames(model)
    if operations:
        facts['operations'] = _operations(robot)
    return facts


def _body(model: Model, body: Body) -> dict[str, Any]:
    """Return a body and its joint."""
    joint = body.joint
    master = model.coordinate_names[joint.coordinate]
    return {'joint': joint.name, 'kind': joint.kind, 'body': body.name,
            'parent': _carrier(model, body.parent),
            'depth': sum(1 for _ in model.path(body.parent)), 'mass': body.inertial.mass,
            'mimics': None if joint.name == master else master,
            'multiplier': joint.multiplier, 'offset': joint.offset,
            'limits': asdict(joint.limits), 'damping': joint.damping,
            'friction': joint.friction, 'armature': joint.armature,
            'stiffness': joint.stiffness}


def _carrier(model: Model, index: int) -> str:
    """Return the name of a body, or of the base."""
    return model.base_name if index == WORLD else model.bodies[index].name


def _frames(model: Model) -> list[dict[str, Any]]:
    """Return the frames with the body that carries each, and their poses on it."""
    frames = []
    for frame in model.frames:
        frames.append({'frame': frame.name, 'body': _carrier(model, frame.body),
                       'position': frame.translation.tolist(),
                       'rpy': rotation_rpy(frame.rotation).tolist()})
    return frames


def _constraints(robot: Robot) -> dict[str, Any]:
    """Return degrees of freedom, rows, actuators, and the residual of the loops."""
    labels = robot.mechanism.labels
    independent_rows = set(robot.mechanism.kept)
    redundant = [label for k, label in enumerate(labels) if k not in independent_rows]
    # Without a closed configuration there is nothing to measure.
    residual = None
    if robot.configuration is not None:
        residuals = robot.constraint_residual(robot.configuration)
        residual = float(np.abs(residuals).max(initial=0.0))
    return {'degrees_of_freedom': robot.n, 'independent': list(robot.speed_names),
            'actuated': list(robot.actuated_names), 'rows': list(labels),
            'redundant': redundant, 'residual': residual}


def _operations(robot: Robot) -> dict[str, dict[str, int]]:
    """Return the operation counts of all available kernels."""
    counts = {}
    for name in robot.kernels.names:
        try:
            counts[name] = asdict(robot.kernels.program(name).operation_count())
        except ModelError:
            continue  # with massless joints there is no forward dynamics
    return counts


# Text of these facts.

def print_facts(facts: dict[str, Any]) -> None:
    """Print the results of `describe` and of a comparison."""
    constraints = facts['constraints']
    print(f'{facts["name"]}: {constraints["degrees_of_freedom"]} degrees of freedom, '
          f'{len(facts["bodies"])} moving bodies of {facts["moving_mass"]:.6g} kg on '
          f'{facts["base"]} of {facts["base_mass"]:.6g} kg\n')
    _print_bodies(facts['bodies'])
    _print_constraints(constraints)
    # Parts on request.
    table = []
    for frame in facts.get('frames', ()):
        table.append([frame['frame'], frame['body'], *frame['position'], *frame['rpy']])
    print_section('frames, on the bodies that carry them:',
                  ['frame', 'body', 'x [m]', 'y', 'z', 'roll [rad]', 'pitch', 'yaw'],
                  table)
    if facts.get('operations'):
        _print_operations(facts['operations'])
    # Problems first: warnings follow from the file, problems from what it says.
    for level in ('problem', 'warning'):
        for words in facts[f'{level}s']:
            print(f'\n{level}: {words}')
    if 'against' in facts:
        _print_comparison(facts['against'])


def _print_bodies(bodies: list[dict[str, Any]]) -> None:
    """Print the tree of joints with masses and limits."""
    angle, rate, torque = _units(bodies)
    table = []
    for body in bodies:
        # The indentation shows the tree, down to a depth that fits the line.
        indent = '  ' * min(body['depth'], DEEPEST)
        kind = body['kind'] if body['mimics'] is None else f'mimics {body["mimics"]}'
        limits = body['limits']
        table.append([indent + body['joint'], kind, body['body'], body['mass'],
                      _range(limits), _limit(limits['velocity']),
                      _limit(limits['effort'])])
    print_table(['joint', 'kind', 'body', 'mass [kg]', f'range [{angle}]',
                 f'speed [{rate}]',
                 f'effort [{torque}]'], table)


def _units(bodies: list[dict[str, Any]]) -> tuple[str, str, str]:
    """Return the units of positions, speeds and efforts of the kinds of joints that are there."""
    kinds = {body['kind'] for body in bodies}
    if kinds == {'prismatic'}:
        return 'm', 'm/s', 'N'
    if 'prismatic' in kinds:
        return 'rad, m', 'rad/s, m/s', 'N m, N'
    return 'rad', 'rad/s', 'N m'


def _print_constraints(constraints: dict[str, Any]) -> None:
    """Print independent speeds and actuators, and the constraint rows, if there are any."""
    residual = 'no configuration is given'
    if constraints['residual'] is not None:
        residual = (f'largest residual at the given configuration: '
                    f'{constraints["residual"]:.3g} m or rad')
    title = (f'constraints: independent {", ".join(constraints["independent"])}; actuated '
             f'{", ".join(constraints["actuated"])}; {residual}')
    table = []
    for row in constraints['rows']:
        table.append([row, 'redundant' if row in constraints['redundant'] else ''])
    print_section(title, ['row', ''], table)


def _print_operations(operations: dict[str, dict[str, int]]) -> None:
    """Print the operation counts of the compiled functions."""
    print('\noperations of one call:')
    kinds = list(next(iter(operations.values())))
    # A row for each function, a column for each kind of operation.
    table = []
    for name, count in operations.items():
        row = [name]
        for kind in kinds:
            row.append(str(count[kind]))
        table.append(row)
    print_table(['function', *kinds], table)


def _print_comparison(against: dict[str, Any]) -> None:
    """Print the comparison with Pinocchio."""
    verdict = 'agrees' if against['agrees'] else 'DIFFERS'
    print(f'\ninverse dynamics against {against["peer"]} {against["version"]} at '
          f'{against["states"]} random states: largest difference '
          f'{against["relative_error"]:.2g} of the largest torque: '
          f'{verdict} (tolerance {TOLERANCE:g})')


def _range(limits: dict[str, float]) -> str:
    """Return the range of positions as text."""
    if math.isinf(limits['lower']) and math.isinf(limits['upper']):
        return 'free'
    return f'{_limit(limits["lower"])} to {_limit(limits["upper"])}'


def _limit(value: float) -> str:
    """Return a limit as text."""
    return f'{value:.6g}' if math.isfinite(value) else 'none'


# The comparison with Pinocchio.

def compare_pinocchio(source: str | bytes, model: Model) -> dict[str, Any]:
    """
    Compare inverse dynamics without friction with Pinocchio's at random states.

    Joints that do not move here are held at zero there; torques of mimic joints are
    added to those of the joints that they follow. So parts of a robot and mimic joints
    are compared too.

    Raises
    ------
    InputError
        If Pinocchio is not installed, or the model has a floating or planar joint.

    """
    peer = pinocchio_model(source, model)
    import pinocchio as pin
    data = peer.createData()
    robot = Robot(model, friction=False)
    # Pinocchio has the joints of the URDF: types that expand to several have other
    # coordinates.
    joints = [body.joint for body in model.bodies]
    for joint in joints:
        if not peer.existJointName(joint.name):
            raise InputError(f"joint '{joint.name}': part of a floating or planar "
                             'joint, whose coordinates differ in Pinocchio; expected '
                             'single joints')
    rng = np.random.default_rng(0)
    differences = []
    torques = []
    for _ in range(STATES):
        state = _random_state(robot, rng)
        tau_peer = pin.rnea(peer, data, *_peer_state(peer, joints, state))
        tau = _projected(peer, joints, model.n, tau_peer)
        differences.append(robot.inverse_dynamics(*state) - tau)
        torques.append(tau)

    # Relative to the largest torque; without any, the error itself.
    largest = float(np.abs(torques).max(initial=0.0))
    error = float(np.abs(differences).max(initial=0.0))
    if largest > 0.0:
        error /= largest
    return {'peer': 'pinocchio', 'version': pin.__version__, 'states': STATES,
            'relative_error': error, 'agrees': error <= TOLERANCE}


def pinocchio_model(source: str | bytes, model: Model) -> Any:
    """Return Pinocchio's model of the whole URDF; raise InputError if it is not installed."""
    try:
        import pinocchio as pin
    except ImportError:
        raise InputError('Pinocchio: not installed; expected pip install pin') from None
    peer = pin.buildModelFromXML(read_source(source))
    peer.gravity.linear = np.array(model.gravity)
    return peer


def _peer_state(peer: Any, joints: Sequence[Joint], state: tuple[Array, Array, Array]
                ) -> tuple[Array, Array, Array]:
    """Return Pinocchio's positions, speeds and accelerations for ours."""
    import pinocchio as pin
    q, u, udot = state
    q_peer = pin.neutral(peer)
    u_peer = np.zeros(peer.nv)
    udot_peer = np.zeros(peer.nv)
    for joint in joints:
        peer_joint = peer.joints[peer.getJointId(joint.name)]
        k = joint.coordinate
        position = joint.multiplier * q[k] + joint.offset
        if peer_joint.nq == 1:
            q_peer[peer_joint.idx_q] = position
        else:  # a continuous joint: cosine and sine
            q_peer[peer_joint.idx_q:peer_joint.idx_q + 2] = math.cos(position), math.sin(position)
        u_peer[peer_joint.idx_v] = joint.multiplier * u[k]
        udot_peer[peer_joint.idx_v] = joint.multiplier * udot[k]
    return q_peer, u_peer, udot_peer


def _projected(peer: Any, joints: Sequence[Joint], n: int, tau_peer: Array) -> Array:
    """Return Pinocchio's torques of joints as torques of the coordinates that move them."""
    tau = np.zeros(n)
    for joint in joints:
        peer_joint = peer.joints[peer.getJointId(joint.name)]
        tau[joint.coordinate] += joint.multiplier * tau_peer[peer_joint.idx_v]
    return tau


def _random_state(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return random q within the limits, u and udot."""
    return (robot.random_configuration(rng), rng.uniform(-2.0, 2.0, robot.n),
            rng.uniform(-5.0, 5.0, robot.n))
