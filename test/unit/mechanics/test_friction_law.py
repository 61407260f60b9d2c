"""The friction law: every term against its formula, in every formulation."""

from dataclasses import replace

from definition import Definition
import energies
from kane_dynamics import (absolute_rates, ComputedTorque, load_urdf, ModelBuilder,
                           MomentumObserver, Motion, point_mass, Robot, rod, simulate)
from kane_dynamics.closed_forms import derivation
from kane_dynamics.errors import ConstraintError, InputError, ModelError
from kane_dynamics.feasibility import fastest, time_optimal
from kane_dynamics.mechanics import friction
from kane_dynamics.model.model import Joint, Limits
from linkages import at_angle, four_bar_model, PIN
from mechanisms import random_model, random_state, wheel
import numpy as np
import pytest
from same_numbers import assert_same_numbers

AXIS = (0.0, 0.0, 1.0)
LAW = {'damping': 0.7, 'fast_damping': 0.25, 'damping_speed': 0.6, 'friction': 1.2,
       'friction_backward': 0.8,
       'breakaway_friction': 1.5, 'stribeck_speed': 0.4, 'load_friction': 0.2,
       'load_friction_backdriven': 0.35, 'friction_speed': 0.05, 'friction_offset': 0.1}


def formula(joint, v, load):
    """Return the friction of a sliding joint, written for each direction."""
    excess = (joint.breakaway_friction - joint.friction) * np.exp(
        -(v / joint.stribeck_speed)**2)
    coulomb = joint.friction if v > 0.0 else joint.friction_backward
    fraction = joint.load_friction if v * load > 0.0 else joint.load_friction_backdriven
    curved = joint.damping - joint.fast_damping
    return (joint.fast_damping * v + curved * v / (1.0 + abs(v) / joint.damping_speed)
            + joint.friction_offset
            + np.sign(v) * (coulomb + excess + fraction * abs(load)))


def with_law(model, seed=0, **changes):
    """Return a model whose joints with drives have all terms of the law."""
    rng = np.random.default_rng(seed)
    drives = set(model.joint_names)
    bodies = []
    for body in model.bodies:
        values = {name: value * rng.uniform(0.7, 1.3) for name, value in LAW.items()}
        values['breakaway_friction'] = values['friction'] + rng.uniform(0.1, 0.4)
        values |= changes
        if body.joint.name not in drives:
            values |= {'load_friction': 0.0, 'load_friction_backdriven': None}
        bodies.append(replace(body, joint=replace(body.joint, **values)))
    return replace(model, bodies=tuple(bodies))


@pytest.mark.parametrize('v', [-1.3, -0.4, 0.5, 1.7])
@pytest.mark.parametrize('load', [-2.0, 0.0, 3.0])
def test_every_term_has_its_formula_in_sliding(v, load):
    joint = Joint('j', 'revolute', AXIS, **LAW)
    expected = formula(joint, v, load)
    assert friction.friction_torque(joint, v, load) == pytest.approx(expected, rel=1e-6)
    exact = friction.friction_torque(joint, v, load, np.sign(v))
    assert exact == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize('v', [-0.7, -0.03, 0.01, 0.04, 0.9])
@pytest.mark.parametrize('load', [-2.0, 3.0])
def test_slopes_are_derivatives_of_the_law(v, load):
    joint = Joint('j', 'revolute', AXIS, **LAW)
    h = 1e-6
    by_rate = (friction.friction_torque(joint, v + h, load)
               - friction.friction_torque(joint, v - h, load)) / (2 * h)
    assert friction.friction_slope(joint, v, load) == pytest.approx(by_rate, rel=1e-6)
    by_load = (friction.friction_torque(joint, v, load + h)
               - friction.friction_torque(joint, v, load - h)) / (2 * h)
    assert friction.load_slope(joint, v, load) == pytest.approx(by_load, rel=1e-6)


@pytest.mark.parametrize('v', [-0.7, -0.03, 0.0, 0.04, 0.9])
@pytest.mark.parametrize('load', [-2.0, 0.0, 3.0])
@pytest.mark.parametrize('fractions',
                         [(0.2, 0.35), (0.2, None), (2.5, 0.0), (0.1, 0.99)])
def test_the_load_of_a_drive_is_the_one_that_gives_the_torque(v, load, fractions):
    joint = Joint('j', 'revolute', AXIS, **LAW | {
        'load_friction': fractions[0], 'load_friction_backdriven': fractions[1]})
    torque = load + friction.friction_torque(joint, v, load)
    assert friction.load_of_drive(joint, v, torque) == pytest.approx(load, abs=1e-12)


def test_friction_over_rate_is_within_8_percent_of_the_law_without_offset():
    joint = Joint('j', 'revolute', AXIS, friction=1.2, damping=0.3, load_friction=0.2)
    for v in np.geomspace(1e-3, 3.0, 30):
        over_rate = friction.friction_over_rate(joint, v, -2.0)
        assert over_rate == pytest.approx(friction.friction_torque(joint, v, -2.0) / v,
                                          rel=0.08)


@pytest.mark.parametrize('dampings', [(0.7, 0.25), (0.7, 0.0), (0.0, 0.9)])
def test_power_of_friction_is_never_negative(dampings):
    slow, fast = dampings
    joint = Joint('j', 'revolute', AXIS, **LAW | {
        'friction_offset': 0.0, 'damping': slow, 'fast_damping': fast})
    for v in np.linspace(-2.0, 2.0, 401):
        for load in (-5.0, 0.0, 5.0):
            assert friction.friction_torque(joint, v, load) * v >= 0.0


@pytest.mark.parametrize('seed', range(4))
def test_formulations_agree_with_all_terms_of_the_law(seed):
    model = with_law(random_model(seed, 3, mimics=1), seed)
    robot = Robot(model)
    by_definition = Definition(model)
    q, u, udot = random_state(model, seed)
    tau = robot.inverse_dynamics(q, u, udot)
    size = np.abs(robot.torque_terms(q, u, udot)).max()
    np.testing.assert_allclose(tau, by_definition.inverse_dynamics(q, u, udot),
                               atol=1e-12 * size)
    np.testing.assert_allclose(robot.torque_terms(q, u, udot).sum(axis=0), tau,
                               atol=1e-12 * size)

    # The load is the torque of the energies, and forward dynamics undoes inverse
    # dynamics.
    load = -(energies.generalized_inertia_force(model, q, u, udot)
             + energies.conservative_force(model, q))
    np.testing.assert_allclose(tau, load - energies.friction_force(model, u, load),
                               atol=1e-11 * size)
    np.testing.assert_allclose(robot.forward_dynamics(q, u, tau), udot, atol=1e-9)
    np.testing.assert_allclose(by_definition.forward_dynamics(q, u, tau), udot,
                               atol=1e-9)
    assert robot.verify() < 1e-9


@pytest.mark.parametrize('seed', range(2))
def test_derivatives_are_those_of_the_law(seed):
    robot = Robot(with_law(random_model(seed, 3), seed))
    q, u, udot = random_state(robot.model, seed)
    tau = robot.inverse_dynamics(q, u, udot)

    def differences(function, *at):
        columns = []
        for k in range(3):
            h = 1e-6 * np.eye(3)
            rows = []
            for unit in h:
                ends = [list(at), list(at)]
                ends[0][k] = at[k] + unit
                ends[1][k] = at[k] - unit
                rows.append((function(*ends[0]) - function(*ends[1])) / 2e-6)
            columns.append(np.stack(rows, axis=1))
        return columns
    for name, at in (('inverse_dynamics', (q, u, udot)),
                     ('forward_dynamics', (q, u, tau))):
        analytic = getattr(robot, f'{name}_derivatives')(*at)
        for matrix, expected in zip(analytic, differences(getattr(robot, name), *at)):
            np.testing.assert_allclose(matrix, expected,
                                       atol=1e-6 * (1.0 + np.abs(expected).max()))


def worm(driving=0.3, backdriven=0.6, **law):
    """Return a wheel of 1 kg m^2 on a drive with load friction."""
    return wheel(load_friction=driving, load_friction_backdriven=backdriven, **law)


def test_a_loaded_wheel_moves_with_the_efficiency_of_its_drive():
    robot = worm()
    for tau, u, expected in ((2.0, 1.0, 2.0 / 1.3), (-2.0, 1.0, -2.0 / 0.4),
                             (2.0, -1.0, 2.0 / 0.4), (-2.0, -1.0, -2.0 / 1.3)):
        assert robot.forward_dynamics([0.0], [u], [tau])[0] == pytest.approx(
            expected, rel=1e-12)


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_simulations_with_load_friction_balance_their_energy(integrator):
    robot = Robot(with_law(random_model(1, 3), 1))
    q0, u0, _ = random_state(robot.model, 1)
    run = simulate(robot, q0, u0, 0.5, step=1e-4, torque=[3.0, -2.0, 1.0],
                   integrator=integrator)
    assert run.warnings == ()
    reference = simulate(robot, q0, u0, 0.5, step=2e-5, torque=[3.0, -2.0, 1.0])
    np.testing.assert_allclose(run.q[-1], reference.q[-1], atol=2e-5)


def test_computed_torque_with_load_friction_follows_its_motion():
    robot = Robot(with_law(random_model(2, 3), 2))
    motion = Motion.from_points([0.0, 1.0], [[0.0, 0.0, 0.0], [0.5, -0.3, 0.2]],
                                joint_names=robot.joint_names)
    law = ComputedTorque(robot, motion, 100.0, 20.0)
    run = simulate(robot, [0.0] * 3, [0.0] * 3, 1.0,
                   step=1e-3, torque=law, integrator='implicit')
    assert run.warnings == ()
    np.testing.assert_allclose(run.q[-1], [0.5, -0.3, 0.2], atol=2e-3)


def loaded_four_bar(actuated=('crank',), joint='crank', independent='crank'):
    """Return a four-bar linkage with load friction at a joint."""
    model = four_bar_model()
    rows = []
    for body in model.bodies:
        rows.append(replace(body, joint=replace(body.joint, **LAW)) if body.name == joint
                    else body)
    bodies = tuple(rows)
    return Robot(replace(model, bodies=bodies),
                 constraints=[PIN], independent=[independent], actuated=actuated)


@pytest.mark.parametrize('independent', ['crank', 'rocker'])
def test_load_friction_of_a_closed_loop_is_that_of_its_motor(independent):
    robot = loaded_four_bar(independent=independent)
    q = at_angle(1.1)
    tau = robot.inverse_dynamics(q, [0.9], [-1.2])
    assert robot.forward_dynamics(q, [0.9], tau)[0] == pytest.approx(-1.2, abs=1e-10)
    assert robot.torque_terms(q, [0.9], [-1.2]).sum() == pytest.approx(tau[0], rel=1e-12)

    # The motor's torque is its load and the friction of the law, by hand.
    plain = Robot(four_bar_model(), constraints=[PIN], independent=[independent],
                  actuated=['crank'])
    load = plain.joint_torques(plain.inverse_dynamics(q, [0.9], [-1.2]), q)[0]
    rate = robot.joint_rates(q, [0.9])[0]
    torque = load + friction.friction_torque(robot.model.bodies[0].joint, rate, load)
    assert robot.joint_torques(tau, q)[0] == pytest.approx(torque, rel=1e-12)


def loaded_arm(backdriven, **choice):
    """Return a two-link arm with load friction in both joints."""
    model = random_model(3, 2)
    law = {'load_friction': 0.1, 'load_friction_backdriven': backdriven}
    bodies = tuple(replace(body, joint=replace(body.joint, **law))
                   for body in model.bodies)
    return Robot(replace(model, bodies=bodies), **choice)


def test_a_closed_loop_with_load_friction_is_verified():
    assert loaded_four_bar(independent='rocker').verify() < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize('make', [
    lambda: loaded_four_bar(independent='rocker'), lambda: loaded_arm(0.3),
    lambda: loaded_arm(1.2), lambda: loaded_arm(0.3, speeds=absolute_rates),
    lambda: loaded_arm(1.2, speeds=absolute_rates)],
                         ids=['closed loop', 'tree', 'self-locking', 'chosen speeds',
                              'self-locking, chosen speeds'])
def test_all_quantities_with_load_friction_are_verified(make):
    robot = make()
    robot.compile()
    assert robot.verify() < 1e-11


def test_an_arm_without_coriolis_forces_is_verified():
    robot = Robot(random_model(3, 2))  # they vanish but for rounding
    robot.compile('coriolis_matrix')
    assert np.abs(robot.coriolis_matrix([0.3, 0.4], [1.0, 2.0])).max() < 1e-12
    assert robot.verify() < 1e-11


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_a_closed_loop_with_load_friction_balances_its_energy(integrator):
    robot = loaded_four_bar()
    run = simulate(robot, at_angle(1.1), [0.9], 0.5, step=2e-4, torque=[9.0],
                   integrator=integrator)
    assert run.warnings == ()
    # With the constraint forces of a motion under the motor's torque, the joints
    # balance.
    forces = robot.constraint_forces(run.q, run.u, run.tau)
    np.testing.assert_allclose(run.constraint_forces, forces,
                               atol=1e-9 * np.abs(forces).max())


def test_drives_whose_load_is_not_determined_are_refused():
    with pytest.raises(ConstraintError,
                       match="joint 'crank': load friction in a mechanism"):
        loaded_four_bar(actuated=None)
    with pytest.raises(ConstraintError, match='2 motors for 1 independent speeds'):
        loaded_four_bar(actuated=['crank', 'rocker'])
    with pytest.raises(ConstraintError, match="joint 'coupler'"):
        loaded_four_bar(joint='coupler')
    model = random_model(0, 2, mimics=1)
    bodies = [*model.bodies[:2], replace(model.bodies[2], joint=replace(
        model.bodies[2].joint, load_friction=0.1))]
    with pytest.raises(ModelError, match='of a joint that mimics another'):
        replace(model, bodies=tuple(bodies))


def test_forward_dynamics_of_a_self_locking_drive_is_refused():
    robot = worm(backdriven=1.2)
    assert robot.inverse_dynamics([0.0], [1.0], [-1.0])[0] == pytest.approx(-1.0 + 1.2)
    with pytest.raises(InputError, match='not self-locking'):
        robot.forward_dynamics([0.0], [1.0], [1.0])


@pytest.mark.parametrize('field, value', [
    ('fast_damping', -1.0), ('damping_speed', 0.0), ('friction_backward', -0.1),
    ('breakaway_friction', 0.5),
    ('stribeck_speed', float('nan')), ('load_friction', 'x'),
    ('load_friction_backdriven', -1)])
def test_a_bad_parameter_of_the_law_is_refused_by_name(field, value):
    with pytest.raises(ModelError, match=f"joint 'j': {field}"):
        Joint('j', 'revolute', AXIS, friction=1.0, **{field: value})


def test_a_joint_without_friction_backward_says_so():
    joint = Joint('j', 'revolute', (0, 0, 1), friction=1.0, friction_backward=0.0)
    assert repr(joint).endswith('friction 1, friction_backward 0>')
    assert repr(replace(joint, friction_backward=None)).endswith('friction 1>')


def test_the_other_direction_is_as_the_first_by_default():
    joint = Joint('j', 'revolute', AXIS, friction=1.0, load_friction=0.1)
    assert friction.coulomb_levels(replace(joint, friction=2.0)) == (2.0, 2.0)
    assert friction.load_fractions(joint) == (0.1, 0.1)
    assert friction.holding_interval(joint, -5.0) == pytest.approx((-1.5, 1.5))


def test_drives_that_the_refusal_of_others_asks_for_are_solvable():
    for driving in np.linspace(0.0, 3.0, 31):
        for backdriven in np.linspace(0.0, 0.999, 31):
            assert friction.least_load_slope(driving, backdriven) > 0.0


@pytest.mark.parametrize('fractions', [(0.2, 0.3), (0.3, 1.4), (0.0, None)])
def test_torques_that_hold_are_those_with_which_nothing_moves(fractions):
    law = {'friction': 1.0, 'friction_backward': 0.6, 'breakaway_friction': 1.3,
           'friction_offset': 0.2, 'load_friction': fractions[0],
           'load_friction_backdriven': fractions[1]}
    builder = ModelBuilder('arm')
    for name, on, at in (('one', 'world', (0, 0, 0)), ('two', 'one', (0.7, 0, 0))):
        builder.body(name, on, axis=(0, -1, 0), at=at,
                     inertial=rod(2.0, (0, 0, 0), (0.7, 0, 0)), **law)
    robot = Robot(builder.model())
    q = [0.4, -0.9]
    least, largest = robot.holding_torques(q)
    load = Robot(robot.model, friction=False).gravity_force(q)
    for j in range(2):
        # The load pulls down: upward it is driven, downward it drives the motor.
        up = fractions[0]
        down = fractions[0] if fractions[1] is None else fractions[1]
        assert load[j] > 0.0
        assert largest[j] == pytest.approx(0.2 + load[j] * (1.0 + up) + 1.3)
        assert least[j] == pytest.approx(0.2 + load[j] * (1.0 - down) - 0.9)
    ends = [(largest, 1e-3, 1.0)]
    if max(x or 0.0 for x in fractions) < 1.0:
        ends.append((least, -1e-3, -1.0))
    for end, beyond, direction in ends:
        for j in range(2):
            tau = 0.5 * (np.maximum(least, 0.3 * load) + largest)
            tau[j] = end[j] - beyond
            held = simulate(robot, q, [0.0, 0.0], 0.01, torque=tau, sticking=True)
            assert held.sticking.all()
            tau[j] = end[j] + beyond
            moved = simulate(robot, q, [0.0, 0.0], 0.01, torque=tau, sticking=True)
            assert direction * moved.u[-1, j] > 0.0
    batch = robot.holding_torques([q, q])
    assert_same_numbers(batch[0][1], least)
    with pytest.raises(InputError,
                       match='holding_torques: of a robot with chosen speeds'):
        loaded_four_bar().holding_torques(at_angle(1.1))


def test_the_observer_sees_no_contact_in_a_motion_with_load_friction():
    robot = Robot(with_law(random_model(3, 2), 3))
    run = simulate(robot, [0.1, 0.2], [0.5, -0.4], 0.5, step=1e-4, sample=1e-3,
                   torque=[3.0, -2.0])
    observer = MomentumObserver(robot, gain=50.0, held=False)
    for t, q, u, tau in zip(run.t, run.q, run.u, run.tau):
        residual = observer.update(t, q, u, tau)
    assert np.abs(residual).max() < 2e-3 * np.abs(run.tau).max()


def test_derivations_have_all_terms_but_load_friction():
    b = ModelBuilder('wheel')
    law = {name: value for name, value in LAW.items() if 'load' not in name}
    b.body('wheel', inertial=rod(3.0, (-1, 0, 0), (1, 0, 0)), **law)
    robot = Robot(b.model())
    form = derivation(robot)
    values = {p.symbol: p.value for p in form.parameters}
    for u in (-0.7, 0.02, 1.3):
        bias = float(form.bias[0].subs(values).subs(form.u[0], u))
        assert bias == pytest.approx(robot.bias_force([0.0], [u])[0], rel=1e-12)
    b.joint('wheel', load_friction=0.1)
    with pytest.raises(InputError, match=r'load friction 0\.1'):
        derivation(Robot(b.model()))


def test_supplement_states_all_terms(tmp_path):
    urdf = """<robot name='r'><link name='a'/><link name='b'><inertial><mass value='1'/>
        <inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>
        <joint name='j' type='continuous'><parent link='a'/><child link='b'/>
        <axis xyz='0 0 1'/></joint></robot>"""
    joint = load_urdf(urdf, supplement={'joints': {'j': LAW}}).bodies[0].joint
    assert {name: getattr(joint, name) for name in LAW} == LAW


def test_timing_refuses_load_friction():
    with pytest.raises(InputError, match=r"joint 'wheel' has load friction 0\.3"):
        time_optimal(worm(), [[0.0], [1.0]])


def test_at_the_highest_speed_a_torque_with_load_friction_is_at_its_limit():
    robot = worm()
    robot.limits = replace(robot.limits, effort=np.array([10.0]))
    motion = Motion.from_points([0.0, 1.0], [[0.0], [1.0]],
                                joint_names=robot.joint_names)
    speed = fastest(robot, motion, step=1e-3).speed
    q, u, udot = motion.sample(np.linspace(0.0, 1.0, 20001))

    def largest_torque(factor):
        tau = robot.inverse_dynamics(q, factor * u, factor**2 * udot)
        return np.abs(tau).max()

    assert largest_torque(speed) == pytest.approx(10.0, rel=1e-5)
    assert largest_torque(1.001 * speed) > 10.01


def test_a_robot_is_verified_though_a_quantity_has_no_kernel():
    builder = ModelBuilder('a worm gear')
    beam = rod(1.0, (0, 0, 0), (0.3, 0, 0))
    builder.body('arm', axis=(0, 1, 0), inertial=beam, load_friction=0.6,
                 load_friction_backdriven=2.0)
    robot = Robot(builder.model())
    robot.compile()  # forward dynamics has no code: the motion does not follow from it
    assert robot.verify() < 1e-12
    with pytest.raises(InputError, match='expected a drive that is not self-locking'):
        robot.forward_dynamics([0.0], [0.0], [0.0])
    assert robot.verify() < 1e-12


@pytest.mark.parametrize('dampings', [(60.0, 2.0), (2.0, 60.0)])
def test_the_fastest_speed_with_curved_damping_is_where_a_torque_reaches_its_limit(
        dampings):
    slow, fast = dampings
    builder = ModelBuilder('slide', gravity=(0, 0, 0))
    builder.body('slide', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(2.0),
                 damping=slow, fast_damping=fast, damping_speed=0.4, friction=1.0,
                 friction_speed=0.01, limits=Limits(effort=40.0))
    robot = Robot(builder.model())
    times = np.linspace(0.0, 2.0, 5)
    motion = Motion.from_points(times, [[0.0], [0.5], [0.2], [0.9], [0.4]],
                                joint_names=robot.joint_names)
    speed = fastest(robot, motion, step=1e-3).speed
    t = np.arange(0.0, 2.0, 1e-3)
    q, u, udot = motion.sample(t)
    peaks = {}
    for factor in (0.5 * speed, 0.999 * speed, 1.002 * speed):
        tau = robot.inverse_dynamics(q, factor * u, factor**2 * udot)
        peaks[factor] = np.abs(tau).max()
    below, near, above = peaks.values()
    assert below < 40.0 and near < 40.0 < above
    timing = time_optimal(robot, [[0.0], [0.7]])
    assert 0.98 < timing.demand.uses['effort'].max() <= 1.001
