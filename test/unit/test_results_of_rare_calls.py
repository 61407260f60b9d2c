"""Results of public methods that other public calls mostly make for the user."""

from functools import cache
from types import SimpleNamespace

from degenerate_input import beam
from kane_dynamics import (CartesianImpedance, Controller, DependentSpeeds,
                           Drive, ElasticFeedforward, FrictionError, HybridForce,
                           InputError, load_urdf, LoopTracker, Motion,
                           PointVelocity, PosePath, Prescribed, QuasiStatic, Robot,
                           SmoothMotion, stiffened, TaskSpace, with_drives)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.control.terms import Terms
from kane_dynamics.identification import Efforts, Excitation, PayloadEstimator
from kane_dynamics.identification.excitation.fourier_basis import FourierBasis
import numpy as np
from palletizer import DRIVEN, palletizer, positions
import pytest

Q, U = np.array([0.4, -0.9]), np.array([0.3, -0.5])
STIFFNESS = [300.0] * 3 + [20.0] * 3


@cache
def arm(**options):
    return Robot(load_urdf(resource_path('urdf', 'two_link.urdf')), **options)


def test_functions_of_constraints_are_the_values_of_the_users_functions():
    at = SimpleNamespace(q=np.array([0.2, 0.5]), t=0.4,
                         other_speeds=lambda dependent: ['joint1'])
    prescribed = Prescribed('joint1', lambda t: 2.0 * t**3)
    found = prescribed.functions(at)
    assert found['position(t)'] == pytest.approx(0.128)
    assert found['the velocity of position(t)'] == pytest.approx(0.96)
    moving = PointVelocity('tip', [1.0, 0.0, 0.0], value=lambda t: 3.0 * t)
    assert moving.functions(at) == {'value(t)': pytest.approx(1.2)}
    assert PointVelocity('tip', [1.0, 0.0, 0.0]).functions(at) == {}
    speeds = DependentSpeeds(['joint2'], lambda q, t: [[q[1] * t]], lambda q, t: [q[0]])
    found = speeds.functions(at)
    assert found['A(q, t)'].tolist() == [[pytest.approx(0.2)]]
    assert found['B(q, t)'].tolist() == [pytest.approx(0.2)]


@pytest.mark.parametrize('lead', [0.0, 0.02])
def test_the_change_of_friction_is_that_of_the_speed_ahead(lead):
    model = load_urdf(resource_path('urdf', 'two_link.urdf'))
    options = {'feedforward_friction': lead} if lead else {}
    robot = Robot(model, **options)
    terms = Terms()
    assert terms.changes_friction(robot) == bool(lead)
    assert not Terms(friction=False).changes_friction(robot)
    udot = np.array([-8.0, 12.0])
    plain = Robot(model)
    frictionless = Robot(model, friction=False)

    def friction(u):
        return plain.bias_force(Q, u) - frictionless.bias_force(Q, u)
    np.testing.assert_allclose(terms.friction_change(robot, Q, U, udot),
                               friction(U + lead * udot) - friction(U), atol=1e-12)


def test_a_smooth_motion_without_jumps_is_accepted_and_one_with_jumps_only_before_them():
    # t^3 from 0 to 2 s, at rest outside.
    coefficients = np.array([0.0, 0.0, 0.0, 1.0]).reshape(1, 4, 1)
    motion = SmoothMotion(('joint',), np.array([0.0, 2.0]), coefficients)
    with pytest.raises(InputError, match='speed'):
        motion.require_no_jumps()
    motion.require_no_jumps(after=2.0)  # it stops only there
    motion.require_no_jumps((10.0, 10.0, 10.0))


def test_the_limits_of_a_straight_section_are_those_of_the_frame():
    poses = np.array([np.eye(4), np.eye(4)])
    poses[1, 0, 3] = 2.0
    path = PosePath.through(poses)
    limits, = path.section_limits(np.array([0.5, 1.0, 4.0]), np.array([1.0, 2.0, 3.0]))
    rate = 2.0 / path.length  # m of the frame for each unit of s
    assert (limits.length, limits.speed * rate) == (path.length, pytest.approx(0.5))
    assert limits.acceleration * rate == pytest.approx(1.0)
    assert limits.jerk * rate == pytest.approx(4.0)


def test_a_tracker_follows_an_unchecked_measurement_as_a_checked_one():
    robot = palletizer()
    start, end = positions(robot, 0.2, 0.3, -0.1, 0.5), (0.21, 0.31, -0.09, 0.49)
    order = [robot.joint_names.index(name) for name in DRIVEN]
    trackers = [LoopTracker(robot, DRIVEN) for _ in range(2)]
    target = positions(robot, *end)[order]
    rates = np.array([0.1, -0.2, 0.3, 0.4])
    for tracker in trackers:
        tracker.restart(start)
    trackers[0].update(target, rates)
    trackers[1].measurement[:] = np.concatenate([target, rates])
    trackers[1].update_checked()
    np.testing.assert_array_equal(trackers[0].q, trackers[1].q)
    np.testing.assert_array_equal(trackers[0].u, trackers[1].u)
    np.testing.assert_allclose(trackers[1].q[order], target, atol=1e-12)


def test_friction_without_its_motion_adapts_like_one_that_begins():
    moved, fresh = (FrictionError(['joint'], memory=0.5) for _ in range(2))
    for k in range(20):
        moved.adapt(0.01, np.array([0.9]), np.array([np.sin(k)]), np.array([-1.0]))
    values = moved.coulomb, moved.damping, moved.offset
    moved.forget_motion()
    assert (moved.coulomb, moved.damping, moved.offset) == values
    fresh.coulomb, fresh.damping, fresh.offset = (value.copy() for value in values)
    for error in (moved, fresh):
        error.adapt(0.01, np.array([0.9]), np.array([0.4]), np.array([-2.0]))
    np.testing.assert_array_equal(moved.coulomb, fresh.coulomb)
    np.testing.assert_array_equal(moved.damping, fresh.damping)


def test_the_speeds_of_an_excitation_are_the_derivatives_of_its_positions():
    basis = FourierBasis(5.0, 3)
    coefficients = np.random.default_rng(0).normal(size=(basis.size, 2))
    excitation = Excitation(('a', 'b'), basis, coefficients, 1, 1.0, {})
    t = np.linspace(0.1, 4.9, 40)
    h = 1e-4
    q, u, udot = excitation.sample(t)
    later, earlier = excitation.sample(t + h), excitation.sample(t - h)
    np.testing.assert_allclose((later[0] - earlier[0]) / (2 * h), u, atol=1e-6)
    np.testing.assert_allclose((later[1] - earlier[1]) / (2 * h), udot, atol=1e-5)
    assert np.abs(excitation.sample(np.array([0.0]))[1]).max() < 1e-12
    np.testing.assert_allclose(q[0], basis.at(t)[0][0] @ coefficients)


def test_a_quasi_static_arm_accepts_its_own_rigid_model_and_joints():
    bending = QuasiStatic(Robot(beam()))
    bending.require_rigid_model(Robot(stiffened(beam())))
    bending.require_drives('joints', bending.speed_names)
    with pytest.raises(InputError, match='for a robot with joints'):
        bending.require_rigid_model(palletizer())


def test_elastic_feedforward_takes_motions_of_its_links():
    """A law on the links is compiled with their inertia; degrees are remarked on."""
    drives = {name: Drive(400.0, rotor_inertia=0.3) for name in ('joint1', 'joint2')}
    model = with_drives(load_urdf(resource_path('urdf', 'two_link.urdf')), drives)
    feedforward = ElasticFeedforward(Robot(model))
    names = feedforward.joint_names
    feedforward.check_joints(names)
    feedforward.check_joints(tuple(reversed(names)))
    small, large = (Motion.from_points([0.0, 1.0], [np.zeros(2), np.full(2, far)],
                                       joint_names=names) for far in (0.5, 90.0))
    feedforward.warn_of_degrees(small)
    with pytest.warns(UserWarning, match='degrees'):
        feedforward.warn_of_degrees(large)
    scaled = feedforward.compiled(names, lambda links, at: at['factor'] * at['q'],
                                  'scaled', {'factor': ()}, (2,))
    q = np.array([0.2, -0.4])
    np.testing.assert_allclose(scaled.entry('', scaled)(q, 3.0), 3.0 * q)


def laws():
    """Return what makes each law, and a call of it."""
    robot = arm()
    pose = robot.frame_pose('tip', Q + 0.1)
    return {
        'CartesianImpedance': (
            lambda: CartesianImpedance(robot, 'tip', stiffness=STIFFNESS),
            lambda law: law.torque(Q, U, pose)),
        'HybridForce': (
            lambda: HybridForce(robot, 'tip', force_directions=['z'],
                                stiffness=STIFFNESS),
            lambda law: law.torque(Q, U, pose)),
        'TaskSpace': (lambda: TaskSpace(robot, 'tip', directions=['x', 'z']),
                      lambda law: law.at(Q, U).inertia),
        'Controller': (lambda: Controller(robot, mode='computed_torque'),
                       lambda law: law.command(0.0, Q, U).tau),
        'Efforts': (lambda: Efforts('joint_torque'),
                    lambda law: law.torque(robot, Q[None], U[None], np.ones((1, 2)))),
        'PayloadEstimator': (lambda: PayloadEstimator(robot, 'tip', (0.1, 0.2)),
                             lambda law: law.gravity)}


@pytest.mark.parametrize('name', laws())
def test_a_compiled_law_gives_what_its_first_call_would(name):
    make, call = laws()[name]
    compiled = make()
    compiled.compile(*([arm()] * (name == 'Efforts')))
    np.testing.assert_array_equal(call(compiled), call(make()))
