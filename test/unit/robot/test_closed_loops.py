"""Single calls of constrained robots: closed, regular, however stated."""

from functools import partial

from kane_dynamics import (Closure, ComputedTorque, ConstraintError, disc, Drive,
                           InputError, LoopTracker, ModelBuilder, Motion, power_balance,
                           Prescribed, Robot, rotation_rpy, simulate, with_drives)
from kane_dynamics.mechanics.constraints import loop_closure
from kinds_of_mechanism import case, PAIRS
from linkages import at_angle, four_bar, four_bar_model, PIN, sleigh
import numpy as np
import pytest

HEADINGS = np.deg2rad(
    [0.0, 45.0, 80.0, 89.0, 89.99, 90.0, 90.000001, 91.0, 135.0, 270.0])


def turning(angle):
    """Return the rotation about z."""
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def constraint_forces_by_name(robot, q, u, tau):
    """Return constraint forces by row."""
    return dict(zip(robot.constraint_names, robot.constraint_forces(q, u, tau)))


@pytest.mark.parametrize('heading', HEADINGS)
def test_forces_of_a_loop_do_not_depend_on_the_heading_of_its_base(heading):
    robot = four_bar('table', 'crank', turntable=True)
    u = np.array([0.0, 5.0])
    at_rest = np.zeros(2)
    q = np.array([heading, *at_angle(0.8)])
    tau = robot.inverse_dynamics(q, u, at_rest)
    alone = four_bar('crank').inverse_dynamics(q[1:], u[1:], [0.0])
    np.testing.assert_allclose(tau[1], alone[0], rtol=1e-10)
    size = np.linalg.norm(robot.constraint_forces(q, u, tau)[:3])
    expected = four_bar('crank').constraint_forces(q[1:], u[1:], alone)
    assert size == pytest.approx(np.linalg.norm(expected[:3]), rel=1e-9)
    reaction = robot.joint_reaction('rocker', q, u, at_rest)
    at_zero = robot.joint_reaction('rocker', [0.0, *q[1:]], u, at_rest)
    for part in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(turning(heading).T @ reaction[part], at_zero[part],
                                   atol=1e-7)


def test_a_batch_answers_where_only_some_states_need_other_rows():
    robot = four_bar('table', 'crank', turntable=True)
    q = np.array([[heading, *at_angle(0.8)] for heading in HEADINGS])
    u = np.tile([0.0, 5.0], (len(q), 1))
    at_rest = np.zeros((len(q), 2))
    together = robot.inverse_dynamics(q, u, at_rest)
    np.testing.assert_allclose(together, np.tile(together[0], (len(q), 1)), atol=1e-8)
    workspace = robot.bind()
    workspace.q[:] = q[5]
    workspace.u[:] = u[5]
    np.testing.assert_allclose(workspace.inverse_dynamics(), together[5], rtol=1e-9)


def test_redundant_rows_share_their_force_with_the_least_sum_of_squares():
    model = four_bar_model()
    twice = [PIN, Closure('end', 'ground', 'spherical', name='again')]
    q = at_angle(0.8)
    u = np.array([5.0])
    at_rest = np.zeros(1)
    single = four_bar('crank')
    once = single.constraint_forces(q, u, single.inverse_dynamics(q, u, at_rest))
    for order in (twice, twice[::-1]):
        robot = Robot(model, constraints=order, independent=['crank'])
        forces = constraint_forces_by_name(robot, q, u,
                                           robot.inverse_dynamics(q, u, at_rest))
        for axis, value in zip('xyz', once):
            assert forces[f'pin/{axis}'] == pytest.approx(value / 2.0, abs=1e-9)
            assert forces[f'again/{axis}'] == pytest.approx(value / 2.0, abs=1e-9)


def test_joints_carry_what_redundant_rows_exert():
    robot = Robot(four_bar_model(),
                  constraints=[PIN, Closure('end', 'ground', 'spherical', name='again')])
    q = at_angle(0.8)
    u = np.array([5.0])
    np.testing.assert_allclose(robot.joint_reactions(q, u, [0.0]),
                               four_bar('crank').joint_reactions(q, u, [0.0]), atol=1e-8)


@pytest.mark.parametrize(('call', 'more'), [
    ('inverse_dynamics', 2), ('forward_dynamics', 2), ('mass_matrix', 0),
    ('bias_force', 1),
    ('gravity_force', 0), ('kinetic_energy', 1), ('joint_rates', 1),
    ('joint_reactions', 2),
    ('constraint_forces', 2), ('joint_accelerations', 2)])
def test_every_call_refuses_an_open_loop(call, more):
    robot = four_bar('crank')
    q = at_angle(0.8) + [0.0, 0.0, 0.3]
    with pytest.raises(ConstraintError,
                       match=r"constraint 'pin/.': its residual is 0\.\d* m at "
                       r"\{'crank': 0.8.*expected at most 0.0001 m"):
        getattr(robot, call)(q, *[np.ones(1)] * more)


def test_the_tolerance_of_closures_can_be_set_and_put_off():
    model = four_bar_model()
    q = at_angle(0.8) + [0.0, 0.0, 1e-3]
    with pytest.raises(ConstraintError, match='residual'):
        Robot(model, constraints=[PIN], independent=['crank']).mass_matrix(q)
    for tolerance in (0.01, (0.01, 0.2), None):
        robot = Robot(model, constraints=[PIN], independent=['crank'],
                      closure_tolerance=tolerance)
        assert np.isfinite(robot.mass_matrix(q)).all()
    robot.parameters.closure_tolerance = 1e-5
    with pytest.raises(ConstraintError, match='expected at most 1e-05 m'):
        robot.mass_matrix(q)
    with pytest.raises(InputError,
                       match='closure_tolerance: -1; expected a positive number'):
        robot.parameters.closure_tolerance = -1


def two_four_bars(*sizes, far=0.46, rounded=0.0, **choice):
    """
    Return four-bars of these sizes, m, with a frame that is far away, and q of both.

    The pin of the last one is `rounded` beside its plane, m.
    """
    b = ModelBuilder('four-bars')
    pins = []
    for k, size in enumerate(sizes):
        on = 'world'
        at = (0.0, k, 0.0)
        for bar, length in (('crank', 0.3), ('coupler', 0.9), ('rocker', 0.7)):
            b.body(f'{bar}{k}', on, axis=(0, -1, 0), at=at,
                   inertial=disc(1.0, 0.1 * size))
            on = f'{bar}{k}'
            at = (length * size, 0, 0)
        b.frame(f'end{k}', on, at=at)
        beside = rounded if k == len(sizes) - 1 else 0.0
        b.frame(f'ground{k}', 'world', at=(size, k + beside, 0))
        pins.append(Closure(f'end{k}', f'ground{k}', 'spherical', name=f'pin{k}'))
    b.frame('far', 'crank0', at=(far, 0, 0))
    robot = Robot(b.model(), constraints=pins, **choice)
    return robot, robot.closed_configuration([0.8, -1.2, -1.0] * len(sizes))


@pytest.mark.parametrize('sizes', [(1.0, 1e-3), (1e-3, 1.0), (1e-3,), (1e-6,)])
def test_every_loop_is_judged_by_its_own_length(sizes):
    robot, q = two_four_bars(*sizes)
    assert robot.mechanism.closure_length == pytest.approx(max(sizes))
    step = 1e-3 * np.sqrt(min(sizes) / 1e-3)  # small loops fall fast
    u, calls = np.zeros(robot.n), (
        robot.mass_matrix, lambda q: simulate(robot, q, u, step, step=step),
        lambda q: ComputedTorque(robot, Motion.from_points(
            [0.0, 1.0], [q, q], joint_names=robot.joint_names), kp=1.0, kd=1.0))
    for call in calls:
        call(q)
    for k, size in enumerate(sizes):
        for angle, is_open in ((1e-5, False), (0.05, True)):
            moved = q.copy()
            moved[3 * k + 2] += angle
            if not is_open:
                robot.mass_matrix(moved)
                continue
            residual = np.abs(robot.constraint_residual(moved)).max()
            assert residual == pytest.approx(0.034 * size, rel=0.1)
            for call in calls:
                with pytest.raises((ConstraintError, InputError), match=f'pin{k}'):
                    call(moved)


def test_every_loop_is_closed_in_its_own_length():
    robot, q = two_four_bars(1.0, 1e-3)
    q[5] += 8e-9  # rad: 5e-12 m
    units = robot.mechanism.closure_units
    assert np.abs(robot.constraint_residual(q) / units).max() > 5e-9
    closed = robot.closed_configuration(q)
    assert np.abs(robot.constraint_residual(closed) / units).max() < 1e-11


@pytest.mark.parametrize('error', [0.0, 1e-9, 1e-7])
def test_axes_that_meet_in_a_point_up_to_rounding_make_no_tiny_loop(error):
    """A spherical four-bar, as a file with seven decimals states it."""
    rng = np.random.default_rng(0)

    def bars(ground=None):
        b = ModelBuilder('spherical four-bar')
        on = 'world'
        for bar, tilt in (('crank', 0.0), ('coupler', 0.5), ('rocker', 1.2)):
            b.body(bar, on, axis=(0, 0, 1), rpy=(tilt, 0, 0),
                   at=error * rng.uniform(-1, 1, 3), inertial=disc(1.0, 0.1))
            on = bar
        b.frame('end', on, rpy=(0.9, 0, 0), at=error * rng.uniform(-1, 1, 3))
        b.frame('tool', 'coupler', at=(0, 0, 0.4))
        if ground is not None:
            b.frame('ground', 'world', rpy=rotation_rpy(ground[:3, :3]))
        return b.model()
    q = [0.5, 0.8, 0.6]
    ground = Robot(bars()).frame_pose('end', q)
    robot = Robot(bars(ground), constraints=[Closure('end', 'ground', 'revolute')],
                  configuration=q, rank_tolerance=1e-4)
    assert robot.mechanism.closure_length == pytest.approx(0.4)
    tracker = LoopTracker(robot, ['crank'])
    tracker.restart(robot.closed_configuration(q))
    tracker.update([0.55], np.zeros(1))
    assert np.isfinite(robot.mass_matrix(tracker.q)).all()


@pytest.mark.parametrize('other', [0.1, 1.0])
def test_a_rounded_loop_is_judged_alike_beside_loops_of_any_size(other):
    tolerance = {'rank_tolerance': 5e-4}
    robot, q = two_four_bars(other, 0.1, rounded=2e-5, **tolerance)
    tracker = LoopTracker(robot, ['crank0', 'crank1'])
    tracker.restart(q)
    tracker.update(q[[0, 3]], np.zeros(2))
    assert tracker.residual == pytest.approx(2e-4)  # lengths of this loop
    with pytest.raises(ConstraintError, match='pin1/y'):
        two_four_bars(other, 0.1, rounded=1e-4, **tolerance)


@pytest.mark.parametrize('zero', [0.0, 1000.0])
def test_the_place_of_a_sliders_zero_does_not_make_its_loop_larger(zero):
    b = ModelBuilder('slider-crank')
    b.body('crank', axis=(0, -1, 0), inertial=disc(1.0, 0.1))
    b.body('rod', 'crank', axis=(0, -1, 0), at=(0.1, 0, 0), inertial=disc(1.0, 0.1))
    b.body('slide', kind='prismatic', rpy=(0, -0.3, 0), axis=(1, 0, 0),
           at=(zero * np.cos(0.3), 0, zero * np.sin(0.3)), inertial=disc(1.0, 0.1))
    b.frame('end', 'rod', at=(0.3, 0, 0))
    robot = Robot(b.model(), constraints=[Closure('end', 'slide', 'spherical')],
                  configuration=[0.3, 0.0, 0.4 - zero])
    assert robot.mechanism.closure_length == pytest.approx(0.3)


def test_calls_at_singular_speeds_are_errors_and_near_them_right():
    robot = sleigh('body/x', 'body/rz')
    there = [0.0, 0.0, np.pi / 2.0]
    words = (r"singular at \{.*'body/rz': 1.570796327\}.*under 'runner' the speeds "
             'body/x, body/rz do not determine the joint rates there')
    for call, further_arguments in (('inverse_dynamics', 2), ('mass_matrix', 0),
                                    ('joint_rates', 1)):
        with pytest.raises(ConstraintError, match=words):
            getattr(robot, call)(there, *[np.ones(2)] * further_arguments)
    near = [0.0, 0.0, np.pi / 2.0 - 1e-3]
    np.testing.assert_allclose(robot.joint_rates(near, [1e-3, 1.0]),
                               [1e-3, 1e-3 / np.tan(1e-3), 1.0], rtol=1e-9)


def driven():
    """Return the four-bar with its crank driven through whole turns: nothing is free."""
    def angle(t):
        return 0.8 + 5.0 * t + 0.3 * np.sin(3.0 * t)
    return Robot(four_bar_model(),
                 constraints=[PIN, Prescribed('crank', angle, name='drive')],
                 configuration=at_angle(0.8))


def test_a_mechanism_without_degrees_of_freedom_moves_with_constraint_forces():
    robot = driven()
    free = four_bar('crank')
    assert robot.n == 0
    run = simulate(robot, at_angle(0.8), [], 1.0, step=1e-3, sample=0.25)
    assert run.u.shape == (5, 0) and run.drift < 1e-10
    for q, t, force in zip(run.q, run.t, run.constraint_forces):
        speed = 5.0 + 0.9 * np.cos(3.0 * t)
        rate = -2.7 * np.sin(3.0 * t)
        assert q[0] == pytest.approx(0.8 + 5.0 * t + 0.3 * np.sin(3.0 * t), abs=1e-10)
        tau = free.inverse_dynamics(q, [speed], [rate])
        assert force[-1] == pytest.approx(tau[0], rel=1e-8)
        np.testing.assert_allclose(robot.joint_accelerations(q, [], [], t=t),
                                   free.joint_accelerations(q, [speed], [rate]),
                                   rtol=1e-8)
    assert robot.verify() < 1e-9


def test_power_of_a_prescribed_motion_balances():
    robot = driven()
    run = simulate(robot, at_angle(0.8), [], 1.0, step=1e-3, sample=0.05)
    balance = power_balance(robot, run.q, run.u, run.udot, t=run.t)
    assert np.abs(balance.constraints).max() > 10.0
    assert np.abs(balance.residual).max() < 1e-8 * np.abs(balance.constraints).max()


def test_accelerations_of_dependent_joints_are_the_rates_of_their_rates():
    robot = four_bar('crank')
    q = at_angle(1.1)
    h = 1e-5
    u = np.array([2.0])
    udot = np.array([-3.0])
    rates = robot.joint_rates(q, u)
    ahead, back = (robot.joint_rates(robot.closed_configuration(q + s * h * rates,
                                                                fixed=['crank']),
                                     u + s * h * udot) for s in (1.0, -1.0))
    np.testing.assert_allclose(robot.joint_accelerations(q, u, udot),
                               (ahead - back) / (2 * h), rtol=1e-6)
    tree = Robot(four_bar_model())
    np.testing.assert_array_equal(tree.joint_accelerations(q, q, q), q)


def test_a_given_configuration_says_which_branch_is_meant():
    model = four_bar_model()
    q0 = at_angle(0.8)
    mirrored = np.array([0.8, *(four_bar('crank').closed_configuration(
        (0.8, -2.5, 2.0), fixed=['crank'])[1:])])
    assert np.abs(mirrored - q0).max() > 0.5
    for start in (q0, mirrored):
        robot = Robot(model, constraints=[PIN], independent=['crank'],
                      configuration=start)
        there = robot.closed_configuration((6.0, 0.0, 0.0), fixed=['crank'])
        back = Robot(model, constraints=[PIN], independent=['crank'],
                     configuration=there)
        np.testing.assert_allclose(
            back.closed_configuration((0.8, 0.0, 0.0), fixed=['crank']), start,
            atol=1e-9)
        for branch in (q0, mirrored):
            np.testing.assert_allclose(robot.closed_configuration(
                branch + 1e-3, fixed=['crank'], start=branch)[1:], branch[1:], atol=0.01)
            np.testing.assert_allclose(robot.closed_configuration(
                branch, fixed=['crank'], start=branch), branch, atol=1e-10)
    with pytest.raises(InputError, match=r'start: .*without fixed'):
        robot.closed_configuration(q0, start=q0)
    with pytest.raises(InputError, match=r"start of joint 'rocker': nan"):
        robot.closed_configuration(q0, fixed=['crank'], start=[*q0[:2], np.nan])
    with pytest.raises(ConstraintError, match=r'configuration: closing its loops moves'):
        Robot(model, constraints=[PIN], configuration=(0.8, 0.0, -1.5))
    with pytest.raises(ConstraintError,
                       match=r'configuration: .*expected 3 finite numbers'):
        Robot(model, constraints=[PIN], configuration=(0.8, 0.0))


@pytest.mark.parametrize(
    'kinds', [('closed loop',), ('nonholonomic',), ('chosen speeds',), *(
        pair for pair in PAIRS if 'closed loop' in pair or 'nonholonomic' in pair)],
    ids=' + '.join)
def test_loops_close_by_compiled_rows_where_those_of_the_definition_close(kinds):
    one = case(*kinds)
    robot = one.robot
    mechanism = one.mechanism
    rng = np.random.default_rng(1)
    fixed = [name for name in robot.speed_names if name in robot.coordinate_names]
    for _ in range(3):
        q = one.q + 0.05 * rng.uniform(-1.0, 1.0, robot.n_q)
        for names in ((), fixed):
            np.testing.assert_allclose(
                robot.closed_configuration(q, t=one.time, fixed=names),
                loop_closure.closed_configuration(mechanism, q, t=one.time, fixed=names),
                atol=1e-11)
        if fixed:
            np.testing.assert_allclose(
                robot.closed_configuration(q, t=one.time, fixed=fixed, start=one.q),
                loop_closure.followed_configuration(mechanism, one.q, q,
                                                    t=one.time, fixed=fixed), atol=1e-11)


def test_loops_with_rows_that_are_not_finite_are_said_not_to_close():
    b = ModelBuilder('tethered')
    b.body('puck', kind='planar', inertial=disc(1.0, 0.1))
    b.frame('end', 'puck')
    b.frame('anchor', 'world')
    robot = Robot(b.model(), constraints=[
        Closure('end', 'anchor', 'distance', length=0.5, name='tether')])
    np.testing.assert_allclose(robot.closed_configuration([0.3, 0.4, 1.0]),
                               [0.3, 0.4, 1.0])
    for close in (robot.closed_configuration,
                  partial(loop_closure.closed_configuration, robot.mechanism)):
        with pytest.raises(ConstraintError, match=r"'tether/.*nan"):
            close([0.0, 0.0, 0.0])


def test_actuators_that_move_no_motor_are_refused_in_words():
    model = with_drives(four_bar_model(), {'crank': Drive(800.0, rotor_inertia=0.3)})
    robot = Robot(model, constraints=[PIN], actuated=['crank', 'coupler'])
    q = robot.closed_configuration([0.8, 0.0, -1.5, 0.8])
    u = tau = np.zeros(robot.n)
    for call in (lambda: robot.joint_torques(tau, q),
                 lambda: simulate(robot, q, u, 0.01)):
        with pytest.raises(ConstraintError,
                           match=r'crank, coupler: these joints do not determine '
                           'the motion in any configuration; expected'):
            call()
