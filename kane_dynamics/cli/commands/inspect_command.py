"""Properties of a robot as tables, and its comparison with Pinocchio."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
import math
from pathlib import Path
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.analysis.model_checks import examine_masses
from kane_dynamics.errors import InputError, ModelError
from kane_dynamics.kinematics.poses import rotation_rpy
from kane_dynamics.model.model import Joint, Model, WORLD
from kane_dynamics.robot.robot import Robot
import numpy as np

STATES = 100  # random states of the comparison
TOLERANCE = 1e-12  # of the comparison, relative to the largest torque
_DEEPEST = 16  # levels of the tree that are indented


def describe(model: Model, robot: Robot, warnings: Sequence[str] = (), *,
             operations: bool = False, frames: bool = False) -> dict[str, Any]:
    """
    Return bodies, joints, limits and masses as plain data.

    The problems are defects that make the dynamics impossible. Operation counts of the kernels are
    added on request; kernels that a problem makes impossible are left out.
    """
    bodies = []
    for body in model.bodies:
        joint = body.joint
        own = joint.name == model.coordinate_names[joint.coordinate]
        bodies.append({
            'joint': joint.name, 'kind': joint.kind, 'body': body.name,
            'parent': model.base_name if body.parent == WORLD else model.bodies[body.parent].name,
            'depth': sum(1 for _ in model.path(body.parent)), 'mass': body.inertial.mass,
            'mimics': None if own else model.coordinate_names[joint.coordinate],
            'multiplier': joint.multiplier, 'offset': joint.offset,
            'limits': asdict(joint.limits), 'damping': joint.damping,
            'friction': joint.friction, 'armature': joint.armature, 'stiffness': joint.stiffness})
    return {'name': model.name, 'joint_names': list(model.joint_names), 'base': model.base_name,
            'base_mass': model.base_inertial.mass,
            'moving_mass': math.fsum(body.inertial.mass for body in model.bodies),
            'gravity': model.gravity.tolist(), 'bodies': bodies, 'warnings': list(warnings),
            'problems': [finding.words for finding in examine_masses(robot)],
            **({'frames': _frames(model)} if frames else {}),
            **({'constraints': _constraints(robot)} if robot.constraint_names else {}),
            **({'operations': _operations(robot)} if operations else {})}


def _frames(model: Model) -> list[dict[str, Any]]:
    """Return the frames with the body that carries each, and their poses on it."""
    return [{'frame': frame.name,
             'body': model.base_name if frame.body == WORLD else model.bodies[frame.body].name,
             'position': frame.translation.tolist(),
             'rpy': rotation_rpy(frame.rotation).tolist()} for frame in model.frames]


def _constraints(robot: Robot) -> dict[str, Any]:
    """Return what the constraints leave, and by how much the given configuration is open."""
    mechanism = robot.mechanism
    labels, kept = mechanism.labels, set(mechanism.kept)
    given = robot.configuration is not None
    return {'degrees_of_freedom': robot.n, 'independent': list(robot.speed_names),
            'actuated': list(robot.actuated_names), 'rows': list(labels),
            'redundant': [label for k, label in enumerate(labels) if k not in kept],
            'residual': float(np.abs(robot.constraint_residual(robot.configuration)).max())
            if given else None}


def _operations(robot: Robot) -> dict[str, dict[str, int]]:
    """Return the operation counts of all available kernels."""
    found = {}
    for name in robot.kernels.names:
        try:
            found[name] = asdict(robot.kernels.program(name).operation_count())
        except ModelError:
            continue  # with massless joints there is no forward dynamics
    return found


def print_facts(facts: dict[str, Any]) -> None:
    """Print the results of `describe` and of a comparison."""
    constraints = facts.get('constraints')
    degrees = constraints['degrees_of_freedom'] if constraints else len(facts['joint_names'])
    print(f'{facts["name"]}: {degrees} degrees of freedom, '
          f'{len(facts["bodies"])} moving bodies of {facts["moving_mass"]:.6g} kg on '
          f'{facts["base"]} of {facts["base_mass"]:.6g} kg\n')
    slides = {body['kind'] == 'prismatic' for body in facts['bodies']}
    of = [', '.join(pair[slide] for slide in sorted(slides)) for pair in (
        ('rad', 'm'), ('rad/s', 'm/s'), ('N m', 'N'))]
    print_table(['joint', 'kind', 'body', 'mass [kg]', f'range [{of[0]}]', f'speed [{of[1]}]',
                 f'effort [{of[2]}]'], [
        [('  ' * min(body['depth'], _DEEPEST)) + body['joint'],
         body['kind'] if body['mimics'] is None else f'mimics {body["mimics"]}',
         body['body'], body['mass'], _range(body['limits']),
         _limit(body['limits']['velocity']), _limit(body['limits']['effort'])]
        for body in facts['bodies']])
    if constraints:
        residual = constraints['residual']
        print(f'\nconstraints, {len(constraints["rows"])} rows: {", ".join(constraints["rows"])}')
        print(f'redundant: {", ".join(constraints["redundant"]) or "none"}')
        print(f'independent: {", ".join(constraints["independent"])}; '
              f'actuated: {", ".join(constraints["actuated"])}')
        print('no configuration is given' if residual is None else
              f'largest residual at the given configuration: {residual:.3g} m or rad')
    if frames := facts.get('frames'):
        print('\nframes, on the bodies that carry them:')
        print_table(['frame', 'body', 'x [m]', 'y', 'z', 'roll [rad]', 'pitch', 'yaw'], [
            [frame['frame'], frame['body'], *frame['position'], *frame['rpy']]
            for frame in frames])
    if operations := facts.get('operations'):
        print('\noperations of one call:')
        kinds = list(next(iter(operations.values())))
        print_table(['function', *kinds], [[name, *(str(count[kind]) for kind in kinds)]
                                           for name, count in operations.items()])
    for level in ('problem', 'warning'):
        for words in facts[f'{level}s']:
            print(f'\n{level}: {words}')
    against = facts.get('against')
    if against:
        print(f'\ninverse dynamics against {against["peer"]} {against["version"]} at '
              f'{against["states"]} random states: largest difference '
              f'{against["relative_error"]:.2g} of the largest torque: '
              f'{"agrees" if against["agrees"] else "DIFFERS"} (tolerance {TOLERANCE:g})')


def compare_pinocchio(source: str | bytes, model: Model) -> dict[str, Any]:
    """
    Compare inverse dynamics without friction with Pinocchio's at random states.

    Joints that do not move here are held at zero there; torques of mimic joints are added to those
    of the joints that they follow. So parts of a robot and mimic joints are compared too.

    Raises
    ------
    InputError
        If Pinocchio is not installed, or the model has a floating or planar joint.

    """
    peer = pinocchio_model(source, model)
    import pinocchio as pin
    data, robot = peer.createData(), Robot(model, friction=False)
    joints = [body.joint for body in model.bodies]
    for joint in joints:
        if not peer.existJointName(joint.name):
            raise InputError(f"joint '{joint.name}': part of a floating or planar joint, whose "
                             'coordinates differ in Pinocchio; expected single joints')
    rng = np.random.default_rng(0)
    worst = largest = 0.0
    for _ in range(STATES):
        q, u, udot = _random_state(robot, rng)
        q_peer, u_peer, udot_peer = pin.neutral(peer), np.zeros(peer.nv), np.zeros(peer.nv)
        for joint in joints:
            there, k = peer.joints[peer.getJointId(joint.name)], joint.coordinate
            position = joint.multiplier * q[k] + joint.offset
            q_peer[there.idx_q:there.idx_q + there.nq] = (
                position if there.nq == 1 else (math.cos(position), math.sin(position)))
            u_peer[there.idx_v] = joint.multiplier * u[k]
            udot_peer[there.idx_v] = joint.multiplier * udot[k]
        tau_peer = pin.rnea(peer, data, q_peer, u_peer, udot_peer)
        tau = _projected(joints, model.n, [
            tau_peer[peer.joints[peer.getJointId(joint.name)].idx_v] for joint in joints])
        worst = max(worst, float(np.abs(robot.inverse_dynamics(q, u, udot) - tau).max()))
        largest = max(largest, float(np.abs(tau).max()))
    error = worst / largest if largest else worst
    return {'peer': 'pinocchio', 'version': pin.__version__, 'states': STATES,
            'relative_error': error, 'agrees': error <= TOLERANCE}


def pinocchio_model(source: str | bytes, model: Model) -> Any:
    """Return Pinocchio's model of the whole URDF; raise InputError if it is not installed."""
    try:
        import pinocchio as pin
    except ImportError:
        raise InputError('Pinocchio: not installed; expected pip install pin') from None
    peer = (pin.buildModelFromXML(source.decode()) if isinstance(source, bytes)
            else pin.buildModelFromXML(source) if source.lstrip().startswith('<')
            else pin.buildModelFromUrdf(str(Path(source))))
    peer.gravity.linear = np.array(model.gravity)
    return peer


def print_table(header: Sequence[str], rows: Iterable[Iterable[Any]]) -> None:
    """Print a table: texts aligned left, numbers right, with six digits."""
    lines = [[cell if isinstance(cell, str) else f'{cell + 0.0:.6g}' for cell in row]
             for row in rows]
    numeric = [all(_is_number(line[k]) for line in lines) for k in range(len(header))]
    widths = [max(len(line[k]) for line in [list(header), *lines]) for k in range(len(header))]
    for line in [list(header), *lines]:
        print('  '.join(cell.rjust(width) if right else cell.ljust(width) for cell, width, right
                        in zip(line, widths, numeric, strict=True)).rstrip())


def _projected(joints: Sequence[Joint], n: int, torques: Sequence[float]) -> Array:
    """Return torques of joints as torques of the coordinates that move them."""
    tau = np.zeros(n)
    for joint, value in zip(joints, torques, strict=True):
        tau[joint.coordinate] += joint.multiplier * value
    return tau


def _random_state(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return random q within the limits, u and udot."""
    return (robot.random_configuration(rng), rng.uniform(-2.0, 2.0, robot.n),
            rng.uniform(-5.0, 5.0, robot.n))


def _range(limits: dict[str, float]) -> str:
    if math.isinf(limits['lower']) and math.isinf(limits['upper']):
        return 'free'
    return f'{_limit(limits["lower"])} to {_limit(limits["upper"])}'


def _limit(value: float) -> str:
    return f'{value:.6g}' if math.isfinite(value) else 'none'


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text == 'none'
    return True
