"""Torque bounds: reached at vertices of the box, never exceeded inside."""

from dataclasses import replace

from kane_dynamics import (absolute_rates, Drive, Inertial, InputError, load_urdf, Robot,
                           Speeds, Uncertainty, with_drives)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.mechanics.recursive.regressor import (
    inertial_parameters, parameters_of, pseudo_inertia_of)
from kane_dynamics.robot.torque_bounds import torque_deviation
from kinds_of_mechanism import case, KINDS
from mechanisms import random_model, with_joints
import numpy as np
import pytest

RIGID = [kind for kind in KINDS if kind != 'flexible']
SMALL = 1e-3  # relative, so that every vertex is a possible body
SIZES = (0.02, 0.05, 0.3, 0.004)  # of damping, friction, offset and armature


def box_of(model):
    """Return a small box around the inertial parameters, and one around the losses."""
    inertial = SMALL * np.abs(inertial_parameters(model).reshape(-1, 10))
    losses = [size * np.arange(1.0, len(model.bodies) + 1.0) for size in SIZES]
    losses[3] = losses[3] * [not is_part_of_ball(body) for body in model.bodies]
    return Uncertainty(inertial, *losses)


def is_part_of_ball(body):
    """Return whether a joint is a part of a ball joint, which has no armature."""
    return '/w' in body.joint.name


def at_vertex(robot, uncertainty, inertial_signs, loss_signs):
    """Return the robot with a vertex's parameters; signs of bodies and 4 losses."""
    bodies = []
    parameters = inertial_parameters(robot.model).reshape(-1, 10)
    parameters = parameters + inertial_signs * uncertainty.inertial
    for k, body in enumerate(robot.model.bodies):
        inertial = Inertial.from_pseudo_inertia(pseudo_inertia_of(parameters[k]))
        changed = {}
        for name, signs in zip(('damping', 'friction', 'friction_offset', 'armature'),
                               loss_signs, strict=True):
            width = getattr(uncertainty, name)[k]
            changed[name] = getattr(body.joint, name) + float(signs[k]) * width
        bodies.append(
            replace(body, inertial=inertial, joint=replace(body.joint, **changed)))
    return Robot(replace(robot.model, bodies=tuple(bodies)), **robot.options)


def torque_of(robot, q, u, udot, t, wrench=None):
    """Return inverse dynamics by the equations over floats."""
    parameters = np.concatenate([robot.parameters.gravity, np.zeros(10)])
    return np.array(robot.equations.inverse_dynamics(q, u, udot, wrench, parameters, t),
                    dtype=float)


@pytest.mark.parametrize('kind', RIGID)
def test_bounds_are_reached_at_vertices_for_every_kind_of_mechanism(kind):
    c = case(kind)
    robot = c.robot
    model = c.robot.model
    # No loss may become negative at a vertex, whose joint would be none.
    sturdy = []
    for body in model.bodies:
        armature = 0.0 if is_part_of_ball(body) else 1.0
        joint = replace(body.joint, damping=1.0, friction=2.0, armature=armature)
        sturdy.append(replace(body, joint=joint))
    robot = Robot(replace(model, bodies=tuple(sturdy)), **robot.options)
    box = box_of(robot.model)
    bounds = robot.torque_bounds(c.q, c.u, c.udot, box, **c.t)
    Y = robot.regressor(c.q, c.u, c.udot, **c.t)
    rates, accelerations = c.joint_motion
    for row in range(robot.n):
        inertial_signs = np.sign(Y[row]).reshape(-1, 10)
        of_joints = []
        for body in robot.model.bodies:
            joint = body.joint
            along = np.sign(c.T[joint.coordinate, row] * joint.multiplier)
            rate = np.sign(joint.multiplier * rates[joint.coordinate])
            turn = np.sign(joint.multiplier * accelerations[joint.coordinate])
            of_joints.append(along * np.array([rate, rate, 1.0, turn]))
        loss_signs = np.array(of_joints).T
        upper = at_vertex(robot, box, inertial_signs, loss_signs)
        lower = at_vertex(robot, box, -inertial_signs, -loss_signs)
        state = c.q, c.u, c.udot, c.time
        scale = np.abs(bounds.upper).max() + np.abs(bounds.lower).max()
        assert abs(torque_of(upper, *state)[row] - bounds.upper[row]) < 1e-10 * scale
        assert abs(torque_of(lower, *state)[row] - bounds.lower[row]) < 1e-10 * scale


def test_no_torque_of_a_million_samples_is_beyond_its_bounds():
    model = random_model(2, 6, branching=0.3)
    robot = Robot(model)
    box = Uncertainty.of(model, mass=0.2, com=0.02, inertia=0.3, friction=0.4,
                         offset=0.1)
    rng = np.random.default_rng(1)
    states = 250
    samples = 4000
    q, u, udot = rng.uniform(-2.0, 2.0, (3, states, model.n))
    bounds = robot.torque_bounds(q, u, udot, box)
    Y = robot.regressor(q, u, udot)
    torque = robot.inverse_dynamics(q, u, udot)
    closest = np.zeros(model.n)
    joints = [body.joint for body in model.bodies]
    speeds = np.array([joint.friction_speed for joint in joints])
    for k in range(states):
        p = rng.uniform(-1.0, 1.0, (samples, Y.shape[2])) * box.inertial.ravel()
        # Half of the samples are vertices of the box.
        p[::2] = np.sign(p[::2]) * box.inertial.ravel()
        losses = rng.choice([-1.0, 1.0], (4, samples, model.n))
        added = p @ Y[k].T
        added += losses[0] * box.damping * u[k] + losses[1] * box.friction * np.tanh(
            u[k] / speeds)
        added += losses[2] * box.friction_offset + losses[3] * box.armature * udot[k]
        low = bounds.lower[k] - torque[k]
        high = bounds.upper[k] - torque[k]
        slack = 1e-12 * np.abs(torque[k]).max()
        assert (added <= high + slack).all()
        assert (added >= low - slack).all()
        closest = np.maximum(closest, (added / high).max(axis=0))
    assert (closest > 0.5).all()  # or the bounds would be wide


def test_the_box_of_relative_errors_holds_all_bodies_within_them():
    model = random_model(3, 4)
    errors = {'mass': 0.1, 'com': 0.03, 'inertia': 0.2}
    box = Uncertainty.of(model, **errors)
    rng = np.random.default_rng(0)
    for k, body in enumerate(model.bodies):
        m = body.inertial.mass
        center = body.inertial.com
        inertia = body.inertial.inertia
        nominal = parameters_of(body.inertial.pseudo_inertia)
        largest = np.linalg.eigvalsh(inertia).max()
        for _ in range(200):
            sign = rng.choice([-1.0, 1.0], 5)
            moved = Inertial(m * (1.0 + 0.1 * sign[0]), center + 0.03 * sign[1:4],
                             inertia + 0.2 * largest * sign[4] * np.eye(3) * 0.5)
            change = parameters_of(moved.pseudo_inertia) - nominal
            assert (np.abs(change) <= box.inertial[k] * (1.0 + 1e-12) + 1e-14).all()


def test_an_uncertain_payload_is_bounded_at_its_frame():
    robot = case('tree').robot
    c = case('tree')
    box = Uncertainty.of(robot.model, payload_mass=2.0, payload_com=(0.1, 0.0, 0.2))
    bounds = robot.torque_bounds(c.q, c.u, c.udot, box)
    empty = robot.inverse_dynamics(c.q, c.u, c.udot)
    for place in ((0.0, 0.0, 0.0), (0.1, 0.0, 0.2), (0.1, 0.0, 0.0), (0.0, 0.0, 0.2)):
        loaded = robot.with_payload('tool', Inertial(2.0, place, np.zeros((3, 3))))
        tau = loaded.inverse_dynamics(c.q, c.u, c.udot)
        assert (tau <= bounds.upper + 1e-12).all()
        assert (tau >= bounds.lower - 1e-12).all()
        assert (np.abs(tau - empty) > 0.0).all()


def test_bounds_of_a_batch_are_those_of_its_states():
    model = load_urdf(resource_path('urdf', 'ur10e.urdf'))
    robot = Robot(model)
    n = model.n
    box = Uncertainty.of(model, mass=0.1, com=0.01, inertia=0.1, friction=0.3)
    q, u, udot = np.random.default_rng(2).uniform(-2.0, 2.0, (3, 2000, n))
    many = robot.torque_bounds(q, u, udot, box)
    one = robot.torque_bounds(q[7], u[7], udot[7], box)
    np.testing.assert_allclose(many.upper[7], one.upper, rtol=1e-13, atol=1e-12)
    np.testing.assert_allclose(many.lower[7], one.lower, rtol=1e-13, atol=1e-12)


def test_calls_in_turn_keep_their_box_gravity_and_payload():
    c = case('tree')
    robot = c.robot.copy()
    state = (c.q, c.u, c.udot)
    boxes = [Uncertainty.of(robot.model, mass=share) for share in (0.1, 0.2)]
    for box in (*boxes, boxes[0], boxes[0]):
        fresh = Robot(robot.model, **robot.options).torque_bounds(*state, box)
        for bounds in (robot.torque_bounds(*state, box),
                       robot.torque_bounds(*state, box)):
            np.testing.assert_array_equal(bounds.lower, fresh.lower)
            np.testing.assert_array_equal(bounds.upper, fresh.upper)
    robot.parameters.gravity = [1.0, 2.0, 3.0]
    lower, upper = robot.torque_bounds(*state, boxes[0])
    torque = robot.inverse_dynamics(*state)
    np.testing.assert_allclose(0.5 * (lower + upper), torque, rtol=1e-12, atol=1e-12)
    assert (upper - lower > 0.0).any()
    # A copy has its own parameters, and lists are answered as arrays are.
    again = robot.copy()
    again.parameters.gravity = [0.0, 0.0, -9.81]
    assert not np.allclose(again.torque_bounds(*state, boxes[0]).lower, lower)
    of_lists = robot.torque_bounds(*(x.tolist() for x in state), boxes[0])
    np.testing.assert_array_equal(of_lists.upper, upper)


def test_a_wrench_moves_both_bounds():
    model = case('tree').robot.model
    robot = Robot(model, wrench_frames=['tool'])
    c = case('tree')
    box = Uncertainty.of(model, mass=0.1)
    wrench = np.arange(1.0, 7.0)
    free = robot.torque_bounds(c.q, c.u, c.udot, box)
    loaded = robot.torque_bounds(c.q, c.u, c.udot, box, wrench=wrench)
    moved = -robot.external_force(c.q, wrench=wrench)
    np.testing.assert_allclose(loaded.lower - free.lower, moved, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(loaded.upper - free.upper, moved, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize(('change', 'words'), [
    ({'damping': np.zeros(2)}, 'uncertainty: inertial: shape'),
    ({'friction': [-1.0, 0.0]},
     'uncertainty: friction: -1.0; expected finite numbers >= 0'),
    ({'armature': [np.nan, 0.0]}, 'uncertainty: armature: nan'),
    ({'friction_offset': 'no'}, 'uncertainty: friction_offset: not an array of numbers'),
    ({'payload': np.zeros(9)}, r'uncertainty: payload: shape \(9,\); expected \(10,\)')])
def test_impossible_boxes_are_refused(change, words):
    parts = {'inertial': np.zeros((2, 10)), **dict.fromkeys(
        ('damping', 'friction', 'friction_offset', 'armature'), np.zeros(2))}
    if 'damping' in change:
        parts['inertial'] = np.zeros((3, 10))
    with pytest.raises(InputError, match=words):
        Uncertainty(**{**parts, **change})


def test_boxes_of_other_robots_are_refused():
    c = case('tree')
    other_model = random_model(2, 6)
    with pytest.raises(InputError,
                       match='uncertainty: of 6 bodies; expected 2: upper, fore'):
        c.robot.torque_bounds(c.q, c.u, c.udot, Uncertainty.of(other_model, mass=0.1))
    with pytest.raises(InputError, match='expected a Uncertainty'):
        c.robot.torque_bounds(c.q, c.u, c.udot, 0.1)
    with pytest.raises(InputError, match=r'mass: -0\.1; expected a finite number >= 0'):
        Uncertainty.of(other_model, mass=-0.1)
    with pytest.raises(InputError, match='robot: with beams'):
        flexible = case('flexible')
        flexible.robot.torque_bounds(flexible.q, flexible.u, flexible.udot,
                                     Uncertainty.of(flexible.robot.model, mass=0.1))
    bare = Robot(c.robot.model)
    with pytest.raises(InputError, match='without payload frame'):
        bare.torque_bounds(c.q, c.u, c.udot,
                           Uncertainty.of(bare.model, payload_mass=1.0))


def test_an_uncertainty_that_is_missing_is_named():
    robot = Robot(random_model(3, 2))
    for _ in range(2):
        with pytest.raises(InputError, match='uncertainty: a NoneType; expected a Unc'):
            robot.torque_bounds(np.zeros(2), np.zeros(2), np.zeros(2), None)


@pytest.mark.parametrize('loaded', [True, False])
# Of the last, no load moves the drive.
@pytest.mark.parametrize('backdriven', [0.05, 0.4, 1.3])
def test_bounds_with_load_friction_are_reached(backdriven, loaded):
    law = {'damping': 1.0, 'friction': 2.0, 'armature': 0.5, 'load_friction': 0.2,
           'load_friction_backdriven': backdriven}
    model = random_model(3, 3, branching=0.0)
    model = with_joints(model, **law)
    robot = Robot(model)
    box = box_of(model)
    rng = np.random.default_rng(1)
    q, u, udot = rng.uniform(-2.0, 2.0, (3, 3))
    bare = Robot(model, friction=False)
    if not loaded:  # loads of zero, where friction of the load has its kink
        udot = bare.forward_dynamics(q, u, np.zeros(3))
    bounds = robot.torque_bounds(q, u, udot, box)
    Y = robot.regressor(q, u, udot)
    load = bare.inverse_dynamics(q, u, udot)

    def torque(row, load_share, friction_sign):
        """Return the torque of a joint at a share of its load's half-width."""
        inertial_signs = np.sign(Y[row]).reshape(-1, 10)
        friction = friction_sign * np.array([np.sign(u), np.sign(u), np.ones(3)])
        changed = at_vertex(robot, box, load_share * inertial_signs,
                            [*friction, load_share * np.sign(udot)])
        return torque_of(changed, q, u, udot, 0.0)[row]
    for row in range(3):
        width = np.abs(Y[row]) @ box.inertial.ravel() + abs(
            udot[row]) * box.armature[row]
        shares = [-1.0, 1.0]
        if abs(load[row]) < width:
            shares.append(-load[row] / width)
        assert (len(shares) == 3) is not loaded
        scale = np.abs(bounds.upper).max() + np.abs(bounds.lower).max()
        largest = max(torque(row, share, 1.0) for share in shares)
        least = min(torque(row, share, -1.0) for share in shares)
        assert abs(bounds.upper[row] - largest) < 1e-10 * scale
        assert abs(bounds.lower[row] - least) < 1e-10 * scale
        # Nothing between is beyond them.
        for share in np.linspace(-1.0, 1.0, 21):
            between = torque(row, share, rng.uniform(-1.0, 1.0))
            assert least - 1e-10 * scale < between < largest + 1e-10 * scale


def with_load_friction(model, names=None, **law):
    """Return a model whose joints, or those of the names, have load friction."""
    bodies = []
    for body in model.bodies:
        further = {'damping': 1.0, 'friction': 2.0, 'armature': 0.5}
        if names is None or body.joint.name in names:
            further |= {'load_friction': 0.2, 'load_friction_backdriven': 0.4, **law}
        bodies.append(replace(body, joint=replace(body.joint, **further)))
    return replace(model, bodies=tuple(bodies))


def driven_loop():
    """Return a loop with a motor at its independent speed, with load friction."""
    c = case('closed loop')
    names = c.robot.speed_names
    model = with_load_friction(c.robot.model, names)
    robot = Robot(model, **{**c.robot.options, 'actuated': list(names)})
    return robot, c.q, c.u, c.udot, {}


def geared_speeds():
    """Return a chain whose speeds are its joints' rates in other units and order."""
    model = with_load_friction(random_model(3, 3, branching=0.0))
    Y = np.array([[0.0, 0.0, -2.0], [1.0, 0.0, 0.0], [0.0, 0.5, 0.0]])
    speeds = Speeds(lambda q, t: Y, names=('c', 'a', 'b'))
    q, u, udot = np.random.default_rng(3).uniform(-1.5, 1.5, (3, 3))
    return Robot(model, speeds=speeds), q, u, udot, {}


def pushed_chain():
    """Return a chain with a wrench at its tip."""
    model = with_load_friction(random_model(3, 3, branching=0.0))
    frame = model.frames[-1].name
    robot = Robot(model, wrench_frames=[frame])
    q, u, udot = np.random.default_rng(4).uniform(-1.5, 1.5, (3, 3))
    return robot, q, u, udot, {'wrench': np.array([[20.0, -10.0, 30.0, 3.0, 2.0, -1.0]])}


def signs_of(robot, state, row):
    """Return the signs of a torque's derivatives by inertial parameters and losses."""
    inertial = np.sign(robot.regressor(*state)[row]).reshape(-1, 10)
    motion = robot.equations.joint_motion(*state)
    T = np.array(motion.T, dtype=float)
    rates = np.array(motion.qdot, dtype=float)
    turns = np.array(motion.qddot, dtype=float)
    losses = []
    for body in robot.model.bodies:
        joint = body.joint
        along = np.sign(T[joint.coordinate, row] * joint.multiplier)
        rate = np.sign(joint.multiplier * rates[joint.coordinate])
        turn = np.sign(joint.multiplier * turns[joint.coordinate])
        losses.append(along * np.array([rate, rate, 1.0, turn]))
    return inertial, np.array(losses).T


@pytest.mark.parametrize('arm', [driven_loop, geared_speeds, pushed_chain])
@pytest.mark.parametrize('loaded', [True, False])
def test_bounds_with_load_friction_are_reached_with_motors_speeds_and_wrenches(
        arm, loaded):
    robot, q, u, udot, pushed = arm()
    box = box_of(robot.model)
    bare = Robot(robot.model, **{**robot.options, 'friction': False})
    if not loaded:  # loads of zero, where friction of the load has its kink
        udot = bare.forward_dynamics(q, u, np.zeros(robot.n), **pushed)
    state = q, u, udot
    bounds = robot.torque_bounds(*state, box, **pushed)
    scale = np.abs(bounds.upper).max() + np.abs(bounds.lower).max()

    def torque(which, row, share, friction_sign):
        """Return a torque at a share of the load's half-width, friction at a vertex."""
        inertial, losses = signs_of(robot, state, row)
        losses[:3] *= friction_sign
        losses[3] *= share
        changed = at_vertex(which, box, share * inertial, losses)
        return torque_of(changed, *state, 0.0, **pushed)[row]
    for row in range(robot.n):
        ends = [torque(bare, row, share, 0.0) for share in (-1.0, 1.0)]
        shares = [-1.0, 1.0]
        if ends[0] < 0.0 < ends[1]:
            shares.append(float(np.interp(0.0, ends, shares)))
        assert (len(shares) == 3) is not loaded
        largest = max(torque(robot, row, share, 1.0) for share in shares)
        least = min(torque(robot, row, share, -1.0) for share in shares)
        assert abs(bounds.upper[row] - largest) < 1e-10 * scale
        assert abs(bounds.lower[row] - least) < 1e-10 * scale

    # Nothing inside is beyond them.
    rng = np.random.default_rng(1)
    bodies = len(robot.model.bodies)
    for _ in range(50):
        inertial = rng.uniform(-1.0, 1.0, (bodies, 10))
        losses = rng.uniform(-1.0, 1.0, (4, bodies))
        inside = torque_of(at_vertex(robot, box, inertial, losses), *state, 0.0,
                           **pushed)
        assert (bounds.lower - 1e-10 * scale < inside).all()
        assert (inside < bounds.upper + 1e-10 * scale).all()


def test_bounds_of_a_damped_drive_have_the_kink_where_its_gear_transmits_nothing():
    law = {'load_friction': 0.2, 'load_friction_backdriven': 1.5, 'friction_speed': 1e-3}
    model = with_drives(random_model(2, 1), {'joint0': Drive(
        90.0, rotor_inertia=0.5, damping=8.0, friction=law)})
    robot = Robot(model)
    motor = robot.joint_names.index('joint0_motor')
    q, u, udot = np.zeros(2), np.zeros(2), np.zeros(2)
    u[motor], udot[motor] = 0.4, -8.0 * 0.4 / 0.5  # B theta'' + D delta' = 0
    width = 0.1
    bodies = [body.joint.name for body in model.bodies]
    armature = np.where(np.array(bodies) == 'joint0_motor', width, 0.0)
    box = Uncertainty(np.zeros((2, 10)), *np.zeros((3, 2)), armature)
    bounds = robot.torque_bounds(q, u, udot, box)

    # Torque = L + friction of the load L, with the least B at the largest L.
    loads = [(0.5 + change) * udot[motor] + 8.0 * u[motor] for change in (-width, width)]
    torques = [load + (0.2 if load > 0.0 else 1.5) * abs(load) for load in (*loads, 0.0)]
    assert min(torques) == pytest.approx(0.0, abs=1e-12)  # at the kink
    assert bounds.upper[motor] == pytest.approx(max(torques), rel=1e-9)
    assert bounds.lower[motor] == pytest.approx(min(torques), abs=1e-9)


def test_bounds_know_the_whole_law_of_friction_and_refuse_friction_of_the_load():
    model = random_model(2, 3, branching=0.0)
    body, *others = model.bodies
    law = {'friction': 1.0, 'breakaway_friction': 1.5, 'stribeck_speed': 0.1}
    sticky = replace(model,
                     bodies=(replace(body, joint=replace(body.joint, **law)), *others))
    u = np.array([0.3, 0.0, 0.0])
    q = udot = np.zeros(3)
    bounds = Robot(sticky).torque_bounds(q, u, udot,
                                         Uncertainty.of(sticky, friction=0.1))
    joint = sticky.bodies[0].joint
    width = 0.1 * (abs(joint.damping * 0.3) + np.tanh(0.3 / joint.friction_speed))
    assert 0.5 * (bounds.upper - bounds.lower)[0] == pytest.approx(width, rel=1e-12)
    loaded = replace(model, bodies=(body, replace(others[0], joint=replace(
        others[0].joint, load_friction=0.1)), others[1]))
    # Where they are no numbers on both sides of one torque, or loads are not those of
    # speeds.
    box = Uncertainty.of(loaded, mass=0.1)
    with pytest.raises(InputError,
                       match=r'load friction 0\.1.* does not belong to one speed'):
        Robot(loaded, speeds=absolute_rates).torque_bounds(q, u, udot, box)
    with pytest.raises(InputError, match=r'uncertainty: joint .* load friction'):
        torque_deviation(Robot(loaded), q, u, udot, box)


@pytest.mark.parametrize('rate', [-0.8, 0.8])
def test_bounds_of_relative_errors_hold_for_the_friction_of_both_directions(rate):
    model = random_model(2, 3, branching=0.0)
    body, *others = model.bodies

    def scaled(size):
        joint = replace(body.joint, damping=0.0, friction=size,
                        friction_backward=3.0 * size)
        return replace(model, bodies=(replace(body, joint=joint), *others))
    box = Uncertainty.of(scaled(1.0), friction=0.2)
    q = udot = np.zeros(3)
    u = np.array([rate, 0.0, 0.0])
    bounds = Robot(scaled(1.0)).torque_bounds(q, u, udot, box)
    for size in (0.8, 1.2):
        torque = Robot(scaled(size)).inverse_dynamics(q, u, udot)
        assert bounds.lower[0] - 1e-9 <= torque[0] <= bounds.upper[0] + 1e-9
