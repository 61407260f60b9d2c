"""Checks of a robot model before it controls a real arm; the command `doctor` without ROS."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import re
from typing import get_args, Literal

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.friction import has_friction
from kane_dynamics.model.drive import StiffnessCurve
from kane_dynamics.model.link_shapes import LinkShape
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.model.plausible_sizes import upward_gravity
from kane_dynamics.robot.methods.configuration_methods import sampling_range
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf.assembly import DEGREES as DEGREE_LIMIT
from kane_dynamics.urdf.link_shapes import shape_volume
from kane_dynamics.urdf.notices import DEGREE_LIMITS, DEGREES, NO_INERTIAL
import numpy as np
from numpy.typing import NDArray

SAMPLES, STARTS = 500, 8  # random configurations; starts of the search, for each joint
CLOSED_SAMPLES = 50  # random configurations of closed loops; each takes some milliseconds
LONGEST_LINK = 20.0  # m: longer ones are in another unit
DENSEST = 2000.0  # kg/m^3 of a cube as large as the reach; robots have less than a tenth
SMALLEST_REACH = 0.5  # m: what a single link may measure itself
PROBLEMS = (NO_INERTIAL, DEGREES)
SAG = {'prismatic': 0.01, 'revolute': 0.05}  # deflection of a gear under gravity
UNITS = {'prismatic': 'm', 'revolute': 'rad'}
# Densities of links, kg/m^3: hollow structures to solid steel; and the share of the robot's
# mass or volume from which on a link is named.
LIGHTEST_LINK, HEAVIEST_LINK = 200.0, 8000.0
NAMED_SHARE = 0.02
# Efforts that no motor states: one value at so many joints, and N m or N.
ALIKE_EFFORTS, LARGEST_EFFORT = 5, 1000.0
# Largest gravity torque relative to the effort: motors of arms are not so much stronger.
SMALLEST_LOAD = 0.003
SLOWEST, FASTEST = 1.0, 1e3  # Hz of a link on the spring of its drive
# Words in the names of what legged and wheeled robots stand on.
UNDERCARRIAGE = frozenset(('hip', 'thigh', 'knee', 'calf', 'shank', 'ankle', 'foot',
                           'leg', 'upperleg', 'lowerleg', 'wheel'))
NAME_PART = re.compile('[A-Z]?[a-z]+|[A-Z]+(?![a-z])')  # of hip_joint, LHip and LEFT_HIP
SMALLEST_STEP, ROUNDING = 1e-4, 1e-12  # relative to the range; to the gravity force
Level = Literal['problem', 'warning', 'cannot judge', 'fine']


@dataclass(frozen=True)
class Finding:
    """
    The result of one check.

    Attributes
    ----------
    level : 'problem', 'warning', 'cannot judge' or 'fine'
        A problem makes torques wrong or unsafe; a warning may be intended. What lacks
        the data that a check needs cannot be judged, and is not fine.
    words : str

    """

    level: Level
    words: str


def examine_model(model: Model, robot: Robot, warnings: Sequence[str],
                  shapes: Sequence[LinkShape] | None = None) -> list[Finding]:
    """
    Return the findings about a robot model.

    Parameters
    ----------
    model : Model
        The model, as its file states it.
    robot : Robot
        The robot of the model, with its constraints and loads.
    warnings : sequence of str
        Of the model's file.
    shapes : sequence of LinkShape, optional
        Shapes of the links, which masses are compared with; None: not known.

    """
    findings = []
    # From the file to the dynamics: each check may assume that those before found no
    # problem.
    for warning in warnings:
        level: Level = 'problem' if warning.startswith(PROBLEMS) else 'warning'
        if warning.startswith(DEGREE_LIMITS) and _has_limits_in_degrees(model):
            level = 'problem'
        findings.append(Finding(level, f'URDF: {warning}'))
    findings += _examine_compensation(model)
    findings += examine_masses(robot)
    findings += examine_units(model)
    findings += examine_densities(model, shapes or ())
    findings += _examine_limits(model, robot)
    base = model.floating_base
    if base:
        body = base[0].rpartition('/')[0]
        findings.append(Finding('warning',
                                f"floating base on '{body}': its contacts, which a "
                                'URDF does not state, determine the torques that hold '
                                'the robot; expected a check of your own with wrenches '
                                'at the contacts'))
    elif not robot.equations.in_joint_rates:
        findings += _examine_holding_torques(robot)
    else:
        findings += _examine_fixed_base(model)
        findings += _examine_weight(robot)
    findings += _examine_drives(model, robot)
    if model.drives and robot.equations.in_joint_rates:
        findings += _examine_stiffness(model, robot)
    return findings


def _driven_joints(model: Model, robot: Robot) -> list[str]:
    """
    Return the joints with motors.

    Those of a floating base, pins of closed loops and links behind the gear of a drive,
    whose motor is a joint of its own, have none.
    """
    behind_gears = {drive.name for drive in model.drives}
    passive = behind_gears.union(model.floating_base)
    return [name for name in robot.actuated_names if name not in passive]


def _examine_compensation(model: Model) -> list[Finding]:
    """Return findings on the torques that a known arm itself adds to commanded efforts."""
    # Only doctor needs the table of arms, whose reader imports yaml.
    from kane_dynamics.analysis.known_arms import arms_named, words
    findings = []
    for row in arms_named(model.name, model.joint_names):
        if not row.commandable:
            findings.append(Finding('warning', f'efforts cannot be commanded: {row}'))
        elif row.compensates is not None:
            findings.append(Finding(
                'fine',
                f'{row} adds {words(row.compensates)} to commanded efforts itself; '
                'state '
                f'it as arm_compensates [{", ".join(row.compensates)}]'))
    return findings


def _examine_limits(model: Model, robot: Robot) -> list[Finding]:
    """Return warnings of driven joints without limits of effort or speed."""
    driven = _driven_joints(model, robot)
    limits = robot.limits
    findings = []
    # One finding for each kind of limit, with the joints that lack it.
    for limit, values, consequence in (
            ('effort limit', limits.effort, 'torques on them are not bounded'),
            ('speed limit', limits.velocity, 'speeds of motions are not checked')):
        without = []
        for name, value in zip(model.joint_names, values):
            if name in driven and not np.isfinite(value):
                without.append(name)
        if without:
            findings.append(Finding('warning',
                                    f'no {limit}: {listed(without)}; {consequence}'))
    return findings


def _has_limits_in_degrees(model: Model) -> bool:
    """Return whether the limits of most revolute joints look like degrees."""
    bounds = []
    for joint in model.coordinate_joints:
        largest = max(abs(joint.limits.lower), abs(joint.limits.upper))
        if joint.kind == 'revolute' and np.isfinite(largest):
            bounds.append(largest)
    return bool(np.count_nonzero(np.array(bounds) > DEGREE_LIMIT) > len(bounds) / 2)


def _examine_fixed_base(model: Model) -> list[Finding]:
    """
    Return a warning of legs or wheels on a base that is fixed to the world.

    A URDF does not state whether its base moves. Two of the branches on the base have a
    body or joint whose name contains one of `UNDERCARRIAGE` as a word.
    """
    branches: dict[int, str] = {}  # the first such joint of each branch on the base
    branch_of: list[int] = []
    for index, body in enumerate(model.bodies):
        branch = index if body.parent == WORLD else branch_of[body.parent]
        branch_of.append(branch)
        words = NAME_PART.findall(f'{body.name} {body.joint.name}')
        if UNDERCARRIAGE.intersection(map(str.lower, words)):
            branches.setdefault(branch, body.joint.name)
    if len(branches) < 2:
        return []
    return [Finding('warning',
                    f"base '{model.base_name}': fixed to the world, with legs or wheels "
                    f'({listed(branches.values())}); expected root_joint free or planar '
                    '(--root-joint) for a robot that walks or drives, because the torques '
                    'here are those of a robot held at its base')]


def _examine_drives(model: Model, robot: Robot) -> list[Finding]:
    """Return warnings of joints whose friction or rotor inertia is not known."""
    driven = _driven_joints(model, robot)
    rotors = {elastic.drive.motor for elastic in model.drives}  # whose inertia is stated
    # The friction of an elastic joint is that of either side.
    resisting = {joint.name for joint in model.coordinate_joints if has_friction(joint)}
    for elastic in model.drives:
        if elastic.drive.motor in resisting:
            resisting.add(elastic.name)
    frictional = resisting.union(rotors, model.floating_base)
    frictionless: list[str] = []
    without_rotor: list[str] = []
    # Every real drive has friction and a rotor; many URDFs state neither.
    for joint in model.coordinate_joints:
        if joint.name not in frictional:
            frictionless.append(joint.name)
        if joint.name in driven and joint.name not in rotors and not joint.armature:
            without_rotor.append(joint.name)
    findings = []
    if frictionless:
        findings.append(Finding('warning',
                                f'no friction is known of {listed(frictionless)}: '
                                '`kane-dynamics identify` finds it from a recording'))
    if without_rotor:
        findings.append(Finding(
            'warning',
            f'no rotor inertia (armature) is known of {listed(without_rotor)}: behind '
            'a gear it can exceed the inertia of the link; set it in the supplement'))
    return findings


def _examine_stiffness(model: Model, robot: Robot) -> list[Finding]:
    """
    Return warnings of drives that are softer or stiffer than those of any arm.

    Gravity deflects a spring by its torque over the stiffness. With its motor locked, and
    the other joints too, a link vibrates with the frequency sqrt(K / M_jj) / (2 pi).
    """
    # The largest weight and inertia on each drive, over random configurations.
    q = robot.random_configuration(0, SAMPLES)
    gravity = np.abs(robot.gravity_force(q)).max(axis=0)
    inertia = robot.mass_matrix(q).diagonal(axis1=1, axis2=2)
    soft, stiff = [], []
    for elastic in model.drives:
        drive, link = elastic.drive, elastic.link
        stiffness = drive.stiffness
        if isinstance(stiffness, StiffnessCurve):
            stiffness = max(stiffness.slopes)
        # Too soft: gravity bends it far, or the link vibrates slowly; too stiff: it
        # vibrates faster than any.
        sag = gravity[link] / stiffness
        lightest = np.sqrt(stiffness / inertia[:, link].min()) / (2.0 * np.pi)
        heaviest = np.sqrt(stiffness / inertia[:, link].max()) / (2.0 * np.pi)
        words = f"'{elastic.name}' ({stiffness:.4g}: "
        kind = model.coordinate_joints[link].kind
        if sag > SAG[kind]:
            soft.append(f'{words}gravity deflects it by {sag:.2g} {UNITS[kind]})')
        elif lightest < SLOWEST:
            soft.append(f'{words}its link vibrates at {lightest:.2g} Hz)')
        elif heaviest > FASTEST:
            stiff.append(f'{words}its link vibrates at {heaviest:.2g} Hz)')
    findings = []
    if soft:
        findings.append(Finding(
            'warning',
            f'stiffness of the drives of {listed(soft)}: softer than gears of arms; '
            "expected N m/rad on the side of the joint: a value of the motor's side is "
            'to be stated with `side: motor`'))
    if stiff:
        findings.append(Finding(
            'warning',
            f'stiffness of the drives of {listed(stiff)}: as good as rigid; expected '
            'N m/rad on the side of the joint, or no drive'))
    return findings


def examine_units(model: Model) -> list[Finding]:
    """
    Return problems of sizes that no robot has in SI units, and a warning of gravity upwards.

    The reach is the length of all links in one line. Masses are compared with a cube of
    that size, radii of gyration and centers of mass with the reach itself.
    """
    findings = []
    # The longest distance between joints, if all were in one line.
    reach = 0.0
    too_long = []
    for body in model.bodies:
        length = float(np.linalg.norm(body.joint.translation))
        reach += length
        if length > LONGEST_LINK:
            too_long.append(f'{body.joint.name} ({length:.4g} m)')
    # A link that is far too long says most; the inertias are only compared if lengths
    # are plausible.
    if too_long:
        findings.append(Finding('problem',
                                f'links of unusual length: {listed(too_long)}; '
                                'expected m: are these millimeters?'))
    elif reach > 0.0:
        findings += _examine_inertias(model, reach)
    upward = upward_gravity(model.gravity)
    if upward:
        findings.append(Finding('warning', upward))
    return findings


def _examine_inertias(model: Model, reach: float) -> list[Finding]:
    """Return problems of masses, centers of mass and inertias that do not fit the lengths."""
    findings = []
    # Masses in grams would be denser than any robot.
    total = sum(body.inertial.mass for body in model.bodies)
    if total > DENSEST * reach**3:
        findings.append(Finding('problem',
                                f'the masses are {total:.5g} kg together, for a robot '
                                f'whose links reach {reach:.4g} m in one line; expected '
                                'kg: are these grams?'))
    size = max(reach, SMALLEST_REACH)
    # No center of mass lies farther out than the robot reaches, no radius of gyration is
    # larger.
    far, wide = [], []
    for body in model.bodies:
        distance = float(np.linalg.norm(body.inertial.com))
        if distance > size:
            far.append(f'{body.name} ({distance:.4g} m)')
        moment = float(np.linalg.eigvalsh(body.inertial.inertia)[-1])
        if moment > body.inertial.mass * size**2 > 0.0:
            radius = (moment / body.inertial.mass)**0.5
            wide.append(f'{body.name} ({radius:.4g} m)')
    if far:
        findings.append(Finding('problem',
                                'centers of mass farther away than all links reach in '
                                f'one line, {reach:.4g} m: {listed(far)}; expected m: '
                                'are these millimeters?'))
    if wide:
        findings.append(Finding('problem',
                                'radii of gyration larger than all links reach in one '
                                f'line, {reach:.4g} m: {listed(wide)}; expected '
                                'inertias in kg m^2'))
    return findings


def examine_densities(model: Model, shapes: Sequence[LinkShape]) -> list[Finding]:
    """Return a warning of masses that do not fit the volumes of the links."""
    carriers = {frame.name: frame.body for frame in model.frames}
    volumes = np.zeros(len(model.bodies))
    unreadable = []
    for shape in shapes:
        body = carriers.get(shape.link, WORLD)
        try:
            volumes[body] += shape_volume(shape) if body != WORLD else 0.0
        except InputError as error:
            unreadable.append(str(error))
    masses = np.array([body.inertial.mass for body in model.bodies])
    judged = (volumes > 0.0) & (masses > 0.0)
    if 2.0 * masses[judged].sum() < masses.sum() or not judged.any():
        reason = 'no shapes of most moving links; expected them in the URDF, and its meshes'
        if unreadable:
            reason = unreadable[0]
        return [Finding('cannot judge', f'masses by the volumes of the links: {reason}')]

    density = masses[judged] / volumes[judged]
    # A small link may be nearly all motor or screw.
    counts = np.maximum(masses[judged] / masses[judged].sum(),
                        volumes[judged] / volumes[judged].sum()) > NAMED_SHARE
    odd = counts & ((density < LIGHTEST_LINK) | (density > HEAVIEST_LINK))
    total = masses[judged].sum() / volumes[judged].sum()
    if not odd.any():
        return [Finding('fine', 'the masses fit the volumes of the links: '
                                f'{total:.3g} kg/m^3')]
    names = [f'{model.bodies[k].name} ({value:.3g} kg/m^3)' for k, value in
             zip(np.flatnonzero(judged)[odd], density[odd])]
    return [Finding('warning', f'masses over the volumes of their links: {listed(names)}; '
                               f'expected {LIGHTEST_LINK:g} to {HEAVIEST_LINK:g} kg/m^3, '
                               'as of arms: are masses or sizes in another unit?')]


def examine_masses(robot: Robot) -> list[Finding]:
    """Return a problem for joints that move no mass, where M is singular."""
    equations = robot.equations
    if not equations.in_joint_rates:
        return []  # what a mass is missing from, constraints may hold
    q = np.random.default_rng(0).uniform(-1.0, 1.0, equations.n_q)
    M = np.array(equations.mass_matrix(q, robot.parameters.block), dtype=np.float64)
    largest = np.abs(M).max(axis=1, initial=0.0)
    massless = [name for name, entry in zip(robot.joint_names, largest) if entry == 0.0]
    if not massless:
        return []
    return [Finding('problem',
                    f'no mass moves with {listed(massless)}: no torque determines '
                    'their acceleration, forward dynamics and simulation fail; expected '
                    'an <inertial> on what they move, or an armature in the supplement')]


def _holding_efforts(robot: Robot) -> Array:
    """Return the largest torques that can hold the joints, (n_q,), N m or N."""
    efforts = robot.limits.effort.copy()
    # What holds the link of an elastic joint passes its gear and its motor.
    for elastic in robot.drives:
        efforts[elastic.link] = min(elastic.drive.gear_effort, efforts[elastic.motor])
    return efforts


def _too_weak(robot: Robot, torques: Array, what: str) -> list[str]:
    """Return the joints whose torque, (n_q,), exceeds what can hold it, in words."""
    weak = []
    for name, torque, limit in zip(robot.joint_names, torques, _holding_efforts(robot)):
        if torque > limit:
            weak.append(f"'{name}' ({what} up to {torque:.5g}, effort {limit:.5g})")
    return weak


def _examine_weight(robot: Robot) -> list[Finding]:
    """Return whether the effort limits can hold the arm everywhere within its limits."""
    # The largest torque of gravity that a search finds, joint by joint.
    weights = largest_gravity_forces(robot)
    weak = _too_weak(robot, weights, 'weight')
    if weak:
        return [Finding('problem', 'the arm cannot hold itself in every configuration: '
                        f'{listed(weak)} N m or N')]
    # An arm without weight is one whose base is turned, more often than one in space.
    if not weights.any():
        return [Finding('warning',
                        'gravity torques: zero for all joints; expected a base mounted '
                        'as in the URDF, with gravity along its -z')]
    return [_verdict_on_efforts(
        robot, weights,
        f'the efforts hold the arm in {SAMPLES} random configurations within its limits, '
        'and at the largest gravity torques that a search from there finds')]


def _verdict_on_efforts(robot: Robot, torques: Array, fine: str) -> Finding:
    """
    Return whether efforts that exceed the holding torques, (n_q,), say anything.

    Unstated limits and placeholders hold any arm, and so do right limits an arm whose
    masses are a thousand times too small.
    """
    efforts = _holding_efforts(robot)
    loaded = torques > ROUNDING * torques.max(initial=0.0)
    unstated = loaded & ~np.isfinite(efforts)
    names = np.array(robot.joint_names)
    what = 'whether the motors hold the arm'
    if unstated.any():
        return Finding('cannot judge', f'{what}: no effort limit of '
                       f'{listed(names[unstated].tolist())}; expected their limits')
    values, counts = np.unique(efforts[loaded], return_counts=True)
    shares = torques[loaded] / efforts[loaded]
    share = float(shares.max(initial=0.0))
    if share < SMALLEST_LOAD:
        return Finding('warning', 'the largest gravity torque is '
                       f'{100.0 * share:.2g} % of the effort limit; expected more of an '
                       'arm: are masses or efforts in another unit?')
    if counts.max(initial=0) >= ALIKE_EFFORTS or values.max(initial=0.0) >= LARGEST_EFFORT:
        alike = f'{values[counts.argmax()]:g} at {counts.max()} joints'
        return Finding('cannot judge', f'{what}: effort limits that look like '
                       f'placeholders ({alike}, largest {values.max():g} N m or N); '
                       'expected the limits of its motors')
    return Finding('fine', fine)


def _examine_holding_torques(robot: Robot) -> list[Finding]:
    """Return whether the actuators can hold the arm in random closed configurations."""
    try:
        q = robot.random_configuration(0, CLOSED_SAMPLES)
        torques = _holding_sizes(robot, q)
    except ConstraintError as error:
        return [Finding('warning', 'holding torques: not examined in random closed '
                        f'configurations; {error}')]
    efforts = _holding_efforts(robot)
    # The configurations in which an actuator is too weak, and by how much.
    weak = _too_weak(robot, torques.max(axis=0), 'torque')
    beyond = int((torques > efforts).any(axis=1).sum())
    if weak:
        return [Finding('problem', f'the actuators cannot hold the arm in {beyond} of '
                        f'{CLOSED_SAMPLES} random closed configurations within its '
                        f'limits: {listed(weak)} N m or N')]
    return [_verdict_on_efforts(
        robot, torques.max(axis=0),
        f'the efforts of {listed(robot.actuated_names)} hold the arm in '
        f'{CLOSED_SAMPLES} random closed configurations within its limits')]


def _holding_sizes(robot: Robot, q: Array) -> Array:
    """Return the largest absolute torques that hold the robot, (N, n_q), N m or N."""
    return np.abs(robot.joint_torques(robot.gravity_force(q), q))


def largest_gravity_forces(robot: Robot) -> Array:
    """
    Return the largest gravity force that a search finds for each joint, (n,), N m or N.

    The search ascends from the largest of `SAMPLES` random configurations. A missing
    joint limit is half a turn or 1 m from 0, or from the other limit.

    Parameters
    ----------
    robot : Robot
        The robot with its joint limits.

    """
    lower, upper = sampling_range(robot)
    q = np.random.default_rng(0).uniform(lower, upper, (SAMPLES, robot.n))

    forces = _holding_sizes(robot, q)
    # Every joint has its own starts, the samples with its largest forces.
    starts = np.argsort(forces, axis=0)[-STARTS:].T.ravel()
    joint = np.repeat(np.arange(robot.n), STARTS)
    q, largest = q[starts], forces[starts, joint]
    step = np.full(len(starts), 0.25)  # of the range of each coordinate
    while (active := np.flatnonzero(step > SMALLEST_STEP)).size:
        steps = step[active, None] * (upper - lower)
        neighbours, force = _uphill(robot, q[active], joint[active], steps,
                                    (lower, upper))
        higher = force > largest[active] * (1.0 + ROUNDING)
        moved, stuck = active[higher], active[~higher]
        q[moved] = neighbours[higher]
        largest[moved] = force[higher]
        step[stuck] *= 0.5
    return np.asarray(largest.reshape(robot.n, STARTS).max(axis=1))


def _uphill(robot: Robot, q: Array, joint: NDArray[np.int_], step: Array,
            limits: tuple[Array, Array]) -> tuple[Array, Array]:
    """
    Return the neighbour with the largest gravity force, (k, n), and that force, (k,).

    A neighbour is a step away along one coordinate, or along all coordinates that
    increase it.
    """
    lower, upper = limits
    n = q.shape[1]
    rows = np.arange(len(q))

    def forces(q: Array) -> Array:
        flat = _holding_sizes(robot, q.reshape(-1, n))
        return np.asarray(flat.reshape(q.shape)[rows, ..., joint])
    # Steps along one coordinate, forth and back: (k, 2, n) neighbours.
    directions = np.stack([np.eye(n), -np.eye(n)])
    single = np.clip(q[:, None, None] + step[:, None, None] * directions, lower, upper)
    by_single = forces(single)
    # One step along all coordinates that increase the force, each in its better
    # direction.
    better = np.where(by_single[:, 0] >= by_single[:, 1], step, -step)
    increases = by_single.max(axis=1) > forces(q)[:, None]
    combined = np.clip(q + np.where(increases, better, 0.0), lower, upper)[:, None]
    neighbours = np.concatenate([single.reshape(len(q), -1, n), combined], axis=1)
    force = np.concatenate([by_single.reshape(len(q), -1), forces(combined)], axis=1)
    highest = force.argmax(axis=1)
    return neighbours[rows, highest], force[rows, highest]


def examine_efforts(robot: Robot, q: Array, effort: Array) -> list[Finding]:
    """
    Return findings about sign and gravity of efforts measured at rest.

    Parameters
    ----------
    robot : Robot
        The robot that is measured.
    q, effort : (n,) arrays
        At rest; rad or m, N m or N.

    """
    weight = robot.gravity_force(q)
    size = float(np.linalg.norm(weight))
    if size < 1e-9:
        return []
    share = float(effort @ weight) / size**2  # 1: just the weight
    if share > 0.7:
        return [Finding('fine',
                        f'at rest the measured efforts hold {share:.0%} of the weight')]
    if share < -0.7:
        return [Finding('problem',
                        'at rest the measured efforts are the weight with the opposite '
                        'sign: efforts or joint axes are reversed, and torques would '
                        'act in the wrong direction')]
    return [Finding('warning',
                    f'at rest the measured efforts hold {share:.0%} of the weight: the '
                    'arm adds gravity itself (then arm_compensates needs gravity), or '
                    'its efforts leave it out')]


def listed(names: Iterable[str], most: int = 8) -> str:
    """Return names in one line; of many, the first few and their number."""
    all_names = list(names)
    text = ', '.join(all_names[:most])
    if len(all_names) > most:
        text += f' and {len(all_names) - most} more'
    return text


def print_findings(findings: Sequence[Finding]) -> None:
    """Print findings, problems first."""
    counts = []
    for level in get_args(Level):
        of_level = [finding for finding in findings if finding.level == level]
        for finding in of_level:
            print(f'{level:>12}: {finding.words}')
        count = len(of_level)
        plural = 's' if level in ('problem', 'warning') and count != 1 else ''
        counts.append(f'{count} {level}{plural}')
    print(f'\n{", ".join(counts)}')
