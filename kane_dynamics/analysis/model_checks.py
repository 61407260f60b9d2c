"""Checks of a robot model before it controls a real arm; the command `doctor` without ROS."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf.notices import DEGREES, NO_INERTIAL
import numpy as np
from numpy.typing import NDArray

SAMPLES, STARTS = 500, 8  # random configurations; starts of the search, for each joint
CLOSED_SAMPLES = 50  # random configurations of closed loops; each takes some milliseconds
LONGEST_LINK = 20.0  # m: longer ones are in another unit
DENSEST = 2000.0  # kg/m^3 of a cube as large as the reach; robots have less than a tenth
SMALLEST_REACH = 0.5  # m: what a single link may measure itself
PROBLEMS = (NO_INERTIAL, DEGREES)
SMALLEST_STEP, ROUNDING = 1e-4, 1e-12  # relative to the range; to the gravity force
Level = Literal['fine', 'warning', 'problem']


@dataclass(frozen=True)
class Finding:
    """
    The result of one check.

    Attributes
    ----------
    level : 'fine', 'warning' or 'problem'
        A warning may be intended; a problem makes torques wrong or unsafe.
    words : str

    """

    level: Level
    words: str


def examine_model(model: Model, robot: Robot, warnings: Sequence[str]) -> list[Finding]:
    """Return the findings about a robot model."""
    found = [Finding('problem' if warning.startswith(PROBLEMS) else 'warning',
                     f'URDF: {warning}') for warning in warnings]
    found += _compensation(model)
    found += examine_masses(robot)
    found += examine_units(model)
    limits, names = robot.limits, model.joint_names
    base = model.floating_base
    actuated = [name for name in robot.actuated_names  # pins of closed loops have no motor
                if name not in base]
    for what, values, consequence in (
            ('effort limit', limits.effort, 'torques on them are not bounded'),
            ('speed limit', limits.velocity, 'speeds of motions are not checked')):
        without = [name for name, value in zip(names, values)
                   if name in actuated and not np.isfinite(value)]
        if without:
            found.append(Finding('warning', f'no {what}: {listed(without)}; {consequence}'))
    if base:
        found.append(Finding('warning', f"floating base on '{base[0].rpartition('/')[0]}': its "
                             'contacts, which a URDF does not state, determine the torques that '
                             'hold the robot; expected a check of your own with wrenches at the '
                             'contacts'))
    elif not robot.equations.in_joint_rates:
        found += _weight_of_mechanism(robot)
    else:
        found += _weight(robot)
    joints = model.coordinate_joints
    for what, missing, consequence in (
            ('friction', [j.name for j in joints
                          if not (j.damping or j.friction) and j.name not in base],
             '`kane-dynamics identify` finds it from a recording'),
            ('rotor inertia (armature)', [j.name for j in joints
                                          if j.name in actuated and not j.armature],
             'behind a gear it can exceed the inertia of the link; set it in the supplement')):
        if missing:
            found.append(Finding('warning', f'no {what} is known of {listed(missing)}: '
                                 f'{consequence}'))
    return found


def _compensation(model: Model) -> list[Finding]:
    """Return what a known arm adds to commanded efforts itself."""
    # Only doctor needs the table of arms, whose reader imports yaml.
    from kane_dynamics.analysis.known_arms import arms_named, words
    found = []
    for row in arms_named(model.name, model.joint_names):
        if not row.commandable:
            found.append(Finding('warning', f'efforts cannot be commanded: {row}'))
        elif row.compensates is not None:
            found.append(Finding(
                'fine', f'{row} adds {words(row.compensates)} to commanded efforts itself; state '
                f'it as arm_compensates [{", ".join(row.compensates)}]'))
    return found


def examine_units(model: Model) -> list[Finding]:
    """
    Return problems of sizes that no robot has in SI units, and a warning of gravity upwards.

    The reach is the length of all links in one line. Masses are compared with a cube of that
    size, radii of gyration and centers of mass with the reach itself.
    """
    found = []
    lengths = {body.joint.name: float(np.linalg.norm(body.joint.translation))
               for body in model.bodies}
    reach = sum(lengths.values())
    long = [f'{name} ({length:.4g} m)' for name, length in lengths.items()
            if length > LONGEST_LINK]
    if long:
        found.append(Finding('problem', f'links of unusual length: {listed(long)}; expected m: '
                             'are these millimeters?'))
    elif reach > 0.0:
        found += _examine_inertias(model, reach)
    if model.gravity[2] > 0.0:
        found.append(Finding('warning', f'gravity {model.gravity.tolist()} m/s^2 points upwards '
                             'in the axes of the base; expected 0 0 -9.81, unless the arm hangs '
                             'from a ceiling'))
    return found


def _examine_inertias(model: Model, reach: float) -> list[Finding]:
    """Return problems of masses, centers of mass and inertias that do not fit the lengths."""
    found = []
    mass = sum(body.inertial.mass for body in model.bodies)
    if mass > DENSEST * reach**3:
        found.append(Finding('problem', f'the masses are {mass:.5g} kg together, for a robot '
                             f'whose links reach {reach:.4g} m in one line; expected kg: are '
                             'these grams?'))
    size = max(reach, SMALLEST_REACH)
    far = [f'{body.name} ({np.linalg.norm(body.inertial.com):.4g} m)' for body in model.bodies
           if np.linalg.norm(body.inertial.com) > size]
    if far:
        found.append(Finding('problem', f'centers of mass farther away than all links reach in '
                             f'one line, {reach:.4g} m: {listed(far)}; expected m: are these '
                             'millimeters?'))
    wide = []
    for body in model.bodies:
        moment = float(np.linalg.eigvalsh(body.inertial.inertia)[-1])
        if moment > body.inertial.mass * size**2 > 0.0:
            radius = (moment / body.inertial.mass)**0.5
            wide.append(f'{body.name} ({radius:.4g} m)')
    if wide:
        found.append(Finding('problem', 'radii of gyration larger than all links reach in one '
                             f'line, {reach:.4g} m: {listed(wide)}; expected inertias in kg '
                             'm^2'))
    return found


def examine_masses(robot: Robot) -> list[Finding]:
    """Return a problem for joints that move no mass, where M is singular."""
    equations = robot.equations
    q = np.random.default_rng(0).uniform(-1.0, 1.0, equations.n_q)
    if not equations.in_joint_rates:
        return []  # what a mass is missing from, constraints may hold
    M = np.array(equations.mass_matrix(q, robot.parameters.block), dtype=np.float64)
    without = [name for name, moved in zip(robot.joint_names, np.abs(M).max(axis=1, initial=0.0))
               if moved == 0.0]
    return [Finding('problem', f'no mass moves with {listed(without)}: no torque determines their '
                    'acceleration, forward dynamics and simulation fail; expected an <inertial> '
                    'on what they move, or an armature in the supplement')] if without else []


def _weight(robot: Robot) -> list[Finding]:
    """Return whether the effort limits can hold the arm everywhere within its limits."""
    most = largest_gravity_forces(robot)
    weak = [f"'{name}' (weight up to {weight:.5g}, effort {limit:.5g})"
            for name, weight, limit in zip(robot.joint_names, most, robot.limits.effort)
            if weight > limit]
    if weak:
        return [Finding('problem', 'the arm cannot hold itself in every configuration: '
                        f'{listed(weak)} N m or N')]
    if not most.any():
        return [Finding('warning', 'gravity torques: zero for all joints; expected a base mounted '
                        'as in the URDF, with gravity along its -z')]
    return [Finding('fine', f'the efforts hold the arm in {SAMPLES} random configurations within '
                    'its limits, and at the largest gravity torques that a search from there '
                    'finds')]


def _weight_of_mechanism(robot: Robot) -> list[Finding]:
    """Return whether the actuators can hold the arm in random closed configurations."""
    try:
        q = robot.random_configuration(0, CLOSED_SAMPLES)
        torques = np.abs(robot.joint_torques(robot.gravity_force(q), q))
    except ConstraintError as error:
        return [Finding('warning', 'holding torques: not examined in random closed '
                        f'configurations; {error}')]
    weak = [f"'{name}' (torque up to {torque:.5g}, effort {limit:.5g})" for name, torque, limit
            in zip(robot.joint_names, torques.max(axis=0), robot.limits.effort) if torque > limit]
    beyond = int((torques > robot.limits.effort).any(axis=1).sum())
    if weak:
        return [Finding('problem', f'the actuators cannot hold the arm in {beyond} of '
                        f'{CLOSED_SAMPLES} random closed configurations within its limits: '
                        f'{listed(weak)} N m or N')]
    return [Finding('fine', f'the efforts of {listed(robot.actuated_names)} hold the arm in '
                    f'{CLOSED_SAMPLES} random closed configurations within its limits')]


def largest_gravity_forces(robot: Robot) -> Array:
    """
    Return the largest gravity force that a search finds for each joint, (n,), N m or N.

    The search ascends from the largest of `SAMPLES` random configurations. A missing joint limit
    is half a turn or 1 m from 0, or from the other limit.

    Parameters
    ----------
    robot : Robot
        The robot with its joint limits.

    """
    lower, upper = robot.sampling_range()
    q = np.random.default_rng(0).uniform(lower, upper, (SAMPLES, robot.n))
    weights = np.abs(robot.gravity_force(q))
    best = np.argsort(weights, axis=0)[-STARTS:].T.ravel()  # separate starts for each joint
    joint = np.repeat(np.arange(robot.n), STARTS)
    q, most, step = q[best], weights[best, joint], np.full(len(best), 0.25)
    while (going := np.flatnonzero(step > SMALLEST_STEP)).size:
        there, found = _uphill(robot, q[going], joint[going], step[going, None] * (upper - lower))
        up = found > most[going] * (1.0 + ROUNDING)
        q[going[up]], most[going[up]] = there[up], found[up]
        step[going[~up]] *= 0.5
    return np.asarray(most.reshape(robot.n, STARTS).max(axis=1))


def _uphill(robot: Robot, q: Array, joint: NDArray[np.int_], step: Array) -> tuple[Array, Array]:
    """
    Return the neighbour with the largest gravity force, (k, n), and that force, (k,).

    A neighbour is a step away along one coordinate, or along all coordinates that increase it.
    """
    lower, upper = robot.sampling_range()
    rows = np.arange(len(q))

    def weights(q: Array) -> Array:
        flat = np.abs(robot.gravity_force(q.reshape(-1, robot.n)))
        return np.asarray(flat.reshape(q.shape)[rows, ..., joint])
    one = step[:, None, None] * np.stack([np.eye(robot.n), -np.eye(robot.n)])  # (k, 2, n, n)
    tried = np.clip(q[:, None, None] + one, lower, upper)
    along = weights(tried)  # (k, 2, n): forth and back
    ways = np.where(along.max(axis=1) > weights(q)[:, None],
                    np.where(along[:, 0] >= along[:, 1], step, -step), 0.0)
    together = np.clip(q + ways, lower, upper)[:, None]
    every = np.concatenate([tried.reshape(len(q), -1, robot.n), together], axis=1)
    found = np.concatenate([along.reshape(len(q), -1), weights(together)], axis=1)
    best = found.argmax(axis=1)
    return every[rows, best], found[rows, best]


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
        return [Finding('fine', f'at rest the measured efforts hold {share:.0%} of the weight')]
    if share < -0.7:
        return [Finding('problem', 'at rest the measured efforts are the weight with the opposite '
                        'sign: efforts or joint axes are reversed, and torques would act in '
                        'the wrong direction')]
    return [Finding('warning', f'at rest the measured efforts hold {share:.0%} of the weight: the '
                    'arm adds gravity itself (then arm_compensates needs gravity), or its efforts '
                    'leave it out')]


def listed(names: Iterable[str], most: int = 8) -> str:
    """Return names in one line; of many, the first few and their number."""
    every = list(names)
    more = f' and {len(every) - most} more' if len(every) > most else ''
    return ', '.join(every[:most]) + more


def print_findings(found: Sequence[Finding]) -> None:
    """Print findings, problems first."""
    counts = []
    for level in ('problem', 'warning', 'fine'):
        group = [finding for finding in found if finding.level == level]
        counts.append(len(group))
        for finding in group:
            print(f'{level:>8}: {finding.words}')
    words = [f'{count} {word}{"s" if count != 1 else ""}'
             for count, word in zip(counts, ('problem', 'warning'))]
    print(f'\n{", ".join(words)}, {counts[2]} fine')
