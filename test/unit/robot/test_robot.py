"""Promises of Robot: compiled kernels, recursion and definition agree."""

from dataclasses import replace

from kane_dynamics import (Body, CompileError, Inertial, InputError, Joint, Limits,
                           load_urdf, Model, ModelBuilder, ModelError, point_mass, Robot,
                           rod, simulate)
from kane_dynamics.mechanics.algebra.vector import axis_rotation
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.recursive.link import denavit_hartenberg, linkage
from kane_dynamics.model.model import with_payload
from mechanisms import random_inertial, random_model, random_state, with_bodies
import numpy as np
import pytest

SEEDS = range(6)


def assert_equal(value, reference, tolerance=1e-11):
    """Compare relative to the largest entry."""
    scale = max(np.abs(reference).max(), 1e-300)
    assert np.abs(np.asarray(value) - reference).max() <= tolerance * scale


def test_coordinates_in_any_order_mean_the_same():
    model = random_model(4, 5)
    order = [3, 0, 4, 1, 2]
    rank = {old: new for new, old in enumerate(order)}

    def renumbered(body):
        coordinate = rank[body.joint.coordinate]
        return replace(body, joint=replace(body.joint, coordinate=coordinate))
    names = tuple(model.coordinate_names[k] for k in order)
    shuffled = replace(with_bodies(model, renumbered), coordinate_names=names)
    q, u, udot = random_state(model, 1)
    a = Robot(model)
    b = Robot(shuffled)
    assert_equal(b.inverse_dynamics(q[order], u[order], udot[order]),
                 a.inverse_dynamics(q, u, udot)[order])
    assert_equal(b.forward_dynamics(q[order], u[order], udot[order]),
                 a.forward_dynamics(q, u, udot)[order], 1e-9)


def test_a_payload_equals_inertia_on_the_model_and_changes_without_compiling():
    model = random_model(5, 5)
    robot = Robot(model, payload_frame='frame3')
    payload = random_inertial(np.random.default_rng(2))
    q, u, udot = random_state(model, 3)
    assert_equal(robot.inverse_dynamics(q, u, udot),
                 kane.inverse_dynamics(model, q, u, udot))
    robot.parameters.payload = payload
    loaded = with_payload(model, 'frame3', payload)
    assert_equal(robot.inverse_dynamics(q, u, udot),
                 kane.inverse_dynamics(loaded, q, u, udot))
    assert_equal(robot.mass_matrix(q), kane.mass_matrix(loaded, q))
    assert_equal(robot.potential_energy(q), Robot(loaded).potential_energy(q))
    assert_equal(robot.kinetic_energy(q, u), Robot(loaded).kinetic_energy(q, u))
    robot.parameters.payload = None
    assert_equal(robot.inverse_dynamics(q, u, udot),
                 kane.inverse_dynamics(model, q, u, udot))


@pytest.mark.parametrize('count', [1, 2])
def test_wrenches_act_where_they_are_declared(count):
    model = random_model(6, 5, mimics=1)
    names = ['frame4', 'frame2'][:count]
    robot = Robot(model, wrench_frames=names)
    q, u, udot = random_state(model, 3)
    wrench = np.random.default_rng(0).normal(size=(count, 6))
    reference = kane.inverse_dynamics(
        model, q, u, udot, wrenches={n: (w[:3], w[3:]) for n, w in zip(names, wrench)})
    assert_equal(robot.inverse_dynamics(q, u, udot, wrench=wrench), reference)
    assert_equal(robot.inverse_dynamics(q, u, udot),
                 kane.inverse_dynamics(model, q, u, udot))
    udot_pushed = robot.forward_dynamics(q, u, reference, wrench=wrench)
    assert_equal(udot_pushed, udot, 1e-9)
    batch = np.stack([wrench, 2.0 * wrench])
    two = robot.inverse_dynamics(*(np.stack([x, x]) for x in (q, u, udot)), wrench=batch)
    assert_equal(two[0], reference)
    with pytest.raises(InputError, match='wrench: shape'):
        robot.inverse_dynamics(q, u, udot, wrench=wrench[:, :5])


def test_a_joint_that_moves_no_mass_has_no_forward_dynamics():
    model = Model('light', (Body('a', -1, Joint('j', 'revolute', [0, 0, 1])),), ('j',))
    robot = Robot(model)
    robot.compile()
    with pytest.raises(ModelError, match="joint 'j' moves no mass"):
        robot.forward_dynamics([0.0], [0.0], [1.0])
    assert robot.inverse_dynamics([0.0], [0.0], [1.0]) == 0.0


def test_configuration_with_a_singular_mass_matrix_is_reported():
    point = Inertial(1.0, [0.0, 0.0, 0.0], np.zeros((3, 3)))
    hinge = Joint('a', 'revolute', [0, 0, 1])
    # At 0 the point is on the hinge.
    slide = Joint('b', 'prismatic', [1, 0, 0], coordinate=1)
    robot = Robot(
        Model('polar', (Body('1', -1, hinge), Body('2', 0, slide, point)), ('a', 'b')))
    assert robot.forward_dynamics([0.0,
                                   1.0], [0.0, 0.0], [1.0, 0.0])[0] == pytest.approx(1.0)
    for kind in (list, np.array):
        with pytest.raises(InputError, match='mass matrix is singular'):
            robot.forward_dynamics(kind([0.0, 0.0]), kind([0.0, 0.0]), kind([1.0, 0.0]))


def test_overflow_is_an_error_and_not_a_torque():
    model = random_model(1, 3)
    huge = np.full(3, 1e308)
    with pytest.raises(InputError, match='not finite'):
        Robot(model).inverse_dynamics(np.zeros(3), huge, huge)
    with pytest.raises(InputError, match='state 1 is not finite'):
        rows = np.stack([np.ones(3), huge])
        Robot(model).inverse_dynamics(np.zeros((2, 3)), rows, rows)


def test_verify_finds_a_wrong_kernel():
    robot = Robot(random_model(1, 3))
    other_robot = Robot(random_model(2, 3))
    robot.kernels._made['mass_matrix', ''] = other_robot.kernels.kernel('mass_matrix')
    with pytest.raises(CompileError, match='mass_matrix: relative error'):
        robot.verify()


@pytest.mark.parametrize('states', [0, -1, 1.5, True])
def test_verify_without_a_state_is_refused(states):
    with pytest.raises(InputError, match=f'states: {states}; expected an integer >= 1'):
        Robot(random_model(1, 3)).verify(states)


def test_a_mechanism_of_one_joint_and_one_of_thirty_compile():
    for n in (1, 30):
        robot = Robot(random_model(7, n, passive=False))
        assert robot.verify(1) < 1e-11


def test_compile_leaves_out_what_a_robot_lacks_unless_it_is_asked_for(monkeypatch):
    b = ModelBuilder('massless tip')
    b.body('link', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    b.body('tip', 'link', axis=(0, 1, 0), at=(1, 0, 0))
    robot = Robot(b.model())
    robot.compile()
    for name in ('forward_dynamics', 'inverse_mass_matrix'):
        with pytest.raises(ModelError, match="joint 'tip' moves no mass"):
            robot.compile(name)

    # Any other error is one of this call, not of a later one.
    def fails(self, name):
        raise InputError(f'{name}: broken')
    monkeypatch.setattr(type(robot.kernels), 'kernel', fails)
    with pytest.raises(InputError, match='broken'):
        robot.compile()


def test_limits_stand_in_the_order_of_the_coordinates():
    model = random_model(2, 4)
    limits = Robot(model).limits
    for k, body in enumerate(model.bodies):
        joint = body.joint.limits
        assert (limits.lower[k], limits.upper[k], limits.velocity[k],
                limits.effort[k]) == (
                    joint.lower, joint.upper, joint.velocity, joint.effort)


def test_limits_beyond_all_positions_are_none_to_random_configurations():
    b = ModelBuilder('slider and hinge')
    far = Limits(-1e16, 1e16)
    b.body('slider', kind='prismatic', inertial=point_mass(1.0), limits=far)
    b.body('hinge', 'slider', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)),
           limits=Limits(-1e308, 5.0))
    robot = Robot(b.model())
    q = robot.random_configuration(0, 1000)
    assert -1.0 <= q[:, 0].min() < -0.9 and 0.9 < q[:, 0].max() <= 1.0
    assert 5.0 - np.pi <= q[:, 1].min() < 2.0 and 4.9 < q[:, 1].max() <= 5.0
    assert np.isfinite(robot.gravity_force(q)).all()


def test_a_robot_without_joints_has_empty_results_and_no_simulation():
    robot = Robot(load_urdf('<robot name="box"><link name="box"/></robot>'))
    nothing = np.zeros(0)
    robot.compile()
    for derivatives in (robot.inverse_dynamics_derivatives,
                        robot.forward_dynamics_derivatives):
        assert [np.shape(part) for part in derivatives(nothing, nothing,
                                                       nothing)] == 3 * [(0, 0)]
    assert robot.jacobian('box', nothing).shape == (6, 0)
    assert robot.jacobian_rate('box', nothing, nothing).shape == (6, 0)
    assert robot.jacobian('box', np.zeros((4, 0))).shape == (4, 6, 0)
    with pytest.raises(InputError, match='robot: no joints'):
        simulate(robot, nothing, nothing, 0.1)


def test_a_planar_two_link_arm_costs_no_more_than_its_reduced_closed_form():
    link = random_model(0, 1, prismatic=0.0, passive=False).bodies[0].inertial
    z = Joint('a', 'revolute', [0, 0, 1])
    elbow = Joint('b', 'revolute', [0, 0, 1], translation=[0.4, 0.0, 0.0], coordinate=1)
    flat = Model('2R', (Body('1', -1, z, link), Body('2', 0, elbow, link)), ('a', 'b'),
                 gravity=[0.0, -9.81, 0.0])
    count = Robot(flat).operation_count()['inverse_dynamics']
    # 18 and 12 with gravity a constant; as a run-time vector it takes two more of each.
    assert (count.multiplications, count.additions) == (20, 14)


def general_arm(n):
    """Return an arm without parallel, perpendicular or meeting axes; the first is z."""
    rng = np.random.default_rng(5)
    skewed = axis_rotation(np.array([2.0, 3.0, 6.0]) / 7.0, 0.6, 0.8)
    rows = []
    for i in range(n):
        rows.append(
            Body(f'body{i}', i - 1,
                 Joint(f'joint{i}', 'revolute', [0, 0, 1], skewed if i else np.eye(3),
                       rng.normal(size=3), i), random_inertial(rng)))
    bodies = tuple(rows)
    return Model('general', bodies, tuple(body.joint.name for body in bodies))


@pytest.mark.parametrize('n', [3, 4, 7])
def test_a_general_arm_costs_81_multiplications_and_70_additions_a_joint(n):
    count = Robot(general_arm(n)).operation_count()['inverse_dynamics']
    assert (count.multiplications, count.additions) == (81 * n - 104, 70 * n - 97)


def test_denavit_hartenberg_offsets_are_along_z_and_x():
    links = denavit_hartenberg(linkage(general_arm(6)))
    for link in links[1:]:
        x, y, z = link.translation
        assert x != 0.0 and y == 0.0
        assert (z == 0.0) == (link.parent == 0)
        assert link.rotation[0].tolist() == [1.0, 0.0, 0.0]
