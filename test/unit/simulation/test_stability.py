"""Promises of the longest step: stable within it, refused beyond it."""

from dataclasses import replace
import math
import warnings

from examples.flexible_four_bar import flexible_four_bar
from kane_dynamics import (Closure, FlexibleLink, InputError, load_urdf, longest_step,
                           ModelBuilder, ModelWarning, natural_vibration, point_mass,
                           Robot, rod, simulate)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.cli import main
from kane_dynamics.simulation.step_size import is_clearly_stable, step_warning
from kane_dynamics.sweep import run_sweep, Sweep
from kinds_of_mechanism import case, KINDS
from mechanisms import wheel
import numpy as np
import pytest

Q = np.array([0.0, -1.0, 1.0, 0.0, 0.3, 0.0])
RUB = {'friction': 2.0, 'friction_speed': 0.04}


def growth(z):
    """Return what a Runge-Kutta step multiplies by."""
    return abs(1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0)


@pytest.fixture(scope='module')
def arm():
    """Return a UR10e without rotors, whose joints rub as identified ones do."""
    path = resource_path('urdf', 'ur10e.urdf')
    joint = {'damping': 1.0, 'friction': 3.0, 'friction_speed': 0.02}
    joints = dict.fromkeys(load_urdf(path).joint_names, joint)
    return Robot(load_urdf(path, supplement={'joints': joints}))


@pytest.mark.parametrize(('joint', 'rate'), [
    (RUB, -50.0), ({'damping': 8.0}, -8.0), ({'stiffness': 400.0}, 20.0j),
    ({**RUB, 'damping': 8.0, 'armature': 3.0}, -14.5)])
def test_a_step_grows_beyond_the_longest_and_not_before(joint, rate):
    step, name = longest_step(wheel(**joint), [0.0])
    assert name == 'wheel'
    assert growth(rate * step * (1.0 - 1e-4)) <= 1.0 + 1e-9
    assert growth(rate * step * (1.0 + 1e-3)) > 1.0


@pytest.mark.parametrize('q', ['x', [0.0, 0.0], [math.nan], None])
def test_longest_step_refuses_what_is_no_configuration_with_and_without_friction(q):
    for robot in (wheel(), wheel(**RUB)):
        with pytest.raises(InputError, match=r'q: .*; expected'):
            longest_step(robot, q)


def test_weight_alone_sets_no_longest_step():
    assert longest_step(wheel(), [0.0]).step == math.inf
    assert longest_step(Robot(wheel(**RUB).model,
                              friction=False), [0.0]).step == math.inf


@pytest.mark.parametrize('kind', KINDS)
def test_a_step_that_is_clearly_stable_is_below_the_longest(kind):
    state = case(kind)
    longest = longest_step(state.robot, state.q, **state.t).step
    steps = longest * np.geomspace(0.01, 3.0, 30)
    clear = [is_clearly_stable(state.robot, state.q, step, state.time) for step in steps]
    # The bound is within a factor of 20 of the eigenvalues of these mechanisms.
    assert clear[np.searchsorted(steps, longest / 20.0) - 1]
    assert not np.any(np.array(clear)[steps > longest])


def test_an_arm_stands_still_within_the_longest_step_and_creeps_or_oscillates_beyond(
        arm):
    step, name = longest_step(arm, Q)
    assert name == 'wrist_3_joint'
    tau = arm.gravity_force(Q)

    def speeds(h):
        count = round(0.05 / h)
        return simulate(arm, Q, np.full(6, 1e-4), count * h, step=h, torque=tau,
                        integrator='rk4').u[-1]
    assert abs(speeds(0.98 * step)[5]) < 1e-5
    with pytest.warns(ModelWarning,
                      match=r"too long for 'wrist_3_joint'.*at most 6.*'implicit'"):
        assert abs(speeds(4.0 * step)[5]) > 1e-3


def test_a_stiffer_beam_takes_a_shorter_step_that_follows_its_highest_vibration():
    b = ModelBuilder('beam')
    b.beam('arm', 'world',
           FlexibleLink(length=1.0, density=0.8, stiffness=120.0, modes=(3, 0)),
           axis=(0, -1, 0))
    b.load('arm/tip', point_mass(0.5))
    robot = Robot(b.model())
    highest = natural_vibration(robot, np.zeros(robot.n)).frequencies[-1]
    assert longest_step(robot, np.zeros(robot.n)).step == pytest.approx(
        2.0 * math.sqrt(2.0) / highest, rel=1e-3)


def test_friction_in_a_closed_loop_counts_by_the_speeds_that_remain():
    b = ModelBuilder('four-bar')
    for name, on, at, length in (('crank', 'world', 0.0, 0.3),
                                 ('coupler', 'crank', 0.3, 0.9),
                                 ('rocker', 'coupler', 0.9, 0.7)):
        b.body(name, on, axis=(0, -1, 0), at=(at, 0, 0),
               inertial=rod(1.0, (0, 0, 0), (length, 0, 0)), **RUB)
    b.frame('end', 'rocker', at=(0.7, 0, 0))
    b.frame('ground', 'world', at=(1, 0, 0))
    robot = Robot(b.model(), independent=['crank'],
                  constraints=[Closure('end', 'ground', 'revolute', axis=(0, 1, 0))])
    q = robot.closed_configuration((0.8, 0.0, -1.5), fixed=['crank'])
    step, name = longest_step(robot, q)
    assert name == 'crank'
    rates = robot.joint_rates(q, [1.0])
    rate = -50.0 * rates @ rates / robot.mass_matrix(q)[0, 0]
    assert growth(rate * step) == pytest.approx(1.0, abs=1e-3)
    assert step_warning(robot, q, 0.9 * step) is None
    text = step_warning(robot, q, 1.1 * step)
    assert "'crank'" in text and "'implicit'" in text


DAMPED = """<robot name="damped"><link name="base"/>
<link name="arm"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
<inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="wrist"><inertial><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/>
<axis xyz="0 1 0"/><limit lower="0.2" upper="2.2" velocity="3" effort="50"/>
<dynamics damping="10"/></joint>
<joint name="roll" type="revolute"><parent link="arm"/><child link="wrist"/><origin xyz="0.6 0 0"/>
<axis xyz="1 0 0"/><limit lower="-3" upper="3" velocity="3" effort="20"/>
<dynamics damping="10"/></joint></robot>"""  # noqa: E501


def test_a_urdf_with_strong_damping_simulates_with_the_defaults_and_says_how():
    robot = Robot(load_urdf(DAMPED))
    q0 = [1.0, 0.0]
    u0 = [0.0, 0.5]
    with pytest.warns(ModelWarning,
                      match="'implicit' is used: a step of 0.001 s is too long for "
                      "'roll'"):
        run = simulate(robot, q0, u0, 0.5)
    finely = simulate(robot, q0, u0, 0.5, step=2e-5, integrator='rk4')
    # The roll stops within a step, in which it moves by less than its speed times the
    # step.
    np.testing.assert_allclose(run.q[-1], finely.q[-1], atol=1e-3 * u0[1])
    assert run.warnings and 'implicit' in run.warnings[0]
    with pytest.warns(ModelWarning, match='too long'), pytest.raises(
            InputError, match=r"diverged.*integrator='implicit'"):
        simulate(robot, q0, u0, 0.5, integrator='rk4')


def test_the_default_is_runge_kutta_where_its_step_is_stable():
    robot = Robot(wheel().model)
    np.testing.assert_array_equal(simulate(robot, [0.1], [1.0], 0.1).q,
                                  simulate(robot, [0.1], [1.0], 0.1, integrator='rk4').q)
    assert np.abs(simulate(robot, [0.1], [1.0], 0.1, integrator='implicit').q
                  - simulate(robot, [0.1], [1.0], 0.1).q).max() < 1e-6


def test_commands_and_sweeps_warn_of_too_long_steps(tmp_path, capsys):
    urdf = str(resource_path('urdf', 'two_link.urdf'))
    supplement = tmp_path / 'rubs.yaml'
    supplement.write_text('joints: {joint2: {friction: 40.0, friction_speed: 0.01}}')
    assert main(['simulate', urdf, '--supplement', str(supplement), '--duration', '0.01',
                 '--step', '0.0005']) == 0
    printed = capsys.readouterr().err
    assert ("integrator 'implicit' is used: a step of 0.0005 s is too long for 'joint2'"
            in printed)
    supplement.write_text('joints: {joint2: {damping: 400.0}}')
    assert main(['simulate', urdf, '--supplement', str(supplement), '--duration', '10',
                 '--step', '0.01', '--u0', '1', '1', '--integrator', 'rk4']) == 2
    text = capsys.readouterr().err
    assert text.index('0.01 s is too long for') < text.index('the state diverged')
    assert "integrator='implicit' if" in text  # the advice is whole
    with pytest.warns(ModelWarning, match="0.0005 s is too long for 'joint2'"):
        run_sweep(Sweep(load_urdf(urdf, supplement=supplement), samples=2, duration=0.01,
                        step=0.0005), tmp_path / 'table', workers=1)


def test_the_simulated_arm_and_the_services_choose_an_integrator_or_warn_of_the_step():
    pytest.importorskip('rclpy')
    pytest.importorskip('kane_dynamics_interfaces')
    from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
    from kane_dynamics.ros.loads.wrench_input import WrenchFrames
    from kane_dynamics.ros.parameters.parameter_checks import read
    from kane_dynamics.ros.parameters.parameter_table import CONSTANTS, SPECS
    from kane_dynamics.ros.plant.simulated_arm import SimulatedArm
    from kane_dynamics.ros.services.served_robot import ServedRobot
    from kane_dynamics.ros.services.simulation_request import SimulationRequest
    from kane_dynamics_interfaces.srv import Simulate
    robot = wheel(**RUB)
    assert SimulatedArm(robot, 0.05).step_warning() is None
    chosen = SimulatedArm(robot, 0.06)
    assert "integrator 'implicit' is used" in chosen.integrator_choice
    assert chosen.step_warning() is None
    assert "'wheel'" in SimulatedArm(robot, 0.06, 'rk4').step_warning()
    assert SimulatedArm(robot, 0.06, 'implicit').step_warning() is None
    values = CONSTANTS | {spec.name: read(spec, spec.default) for spec in SPECS}
    answers = []
    for step, integrator in ((0.05, 'rk4'), (0.06, 'rk4'), (0.06, 'implicit'),
                             (0.05, 'auto'),
                             (0.06, 'auto')):
        served = ServedRobot(robot, robot, GravityAndPayload(robot.model.gravity),
                             values | {'simulation.integrator': integrator},
                             WrenchFrames(robot))
        request = Simulate.Request(position=[0.0], duration=0.3, step=step)
        answer = (Simulate.Response())
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', ModelWarning)
            SimulationRequest.from_request(request, served).run(answer, lambda t: True)
        answers.append(answer.message)
    assert answers[0] == answers[2] == answers[3] == ''
    assert "a step of 0.06 s is too long for 'wheel'" in answers[1]
    assert "integrator 'implicit' is used: a step of 0.06 s is too long" in answers[4]
    stiff = wheel(stiffness=1e6)
    served = replace(served, robot=stiff, simulated=stiff, values=values | {
        'simulation.max_duration': 10.0, 'simulation.max_steps': 200,
        'simulation.max_points': 200, 'trajectory.max_points': 20,
        'simulation.integrator': 'rk4'})
    request.step = 0.1
    request.duration = 10.0
    request.velocity = [1.0]
    with pytest.warns(ModelWarning), pytest.raises(
            InputError, match=r'the state diverged.*: a step of 0.1 s is too long'):
        SimulationRequest.from_request(request, served).run(Simulate.Response(),
                                                            lambda t: True)


def test_no_warning_where_there_is_nothing_to_warn_of(arm):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        simulate(Robot(load_urdf(resource_path('urdf', 'ur10e.urdf'))), Q, np.zeros(6),
                 0.01)
        simulate(arm, Q, np.zeros(6), 1e-3, step=5e-6)


def test_the_longest_step_holds_while_a_four_bar_bends_in_its_motion():
    robot = flexible_four_bar()
    q = robot.closed_configuration((0.8, 0, 0, 0, -1.5), fixed=robot.speed_names)
    u = np.array([10.0, 0.0, 0.0])
    run = simulate(robot, q, u, 0.5, step=1e-4, sample=0.004)
    deflected = np.abs(run.q[:, robot.coordinate_names.index('coupler/mode_1')])
    assert deflected.max() > 0.03  # m, of 0.9 m
    along = [longest_step(robot, *state).step for state in zip(run.q, run.u)]
    assert min(along) > 0.93 * longest_step(robot, q).step
    step = 0.95 * min(along)
    coarse = simulate(robot, q, u, 90 * step, step=step)
    assert coarse.t[-1] > 0.48
    assert coarse.drift < 1e-9
    assert np.abs(coarse.q).max() == pytest.approx(np.abs(run.q).max(), rel=0.05)


def test_the_longest_step_of_a_motion_counts_its_speeds():
    # Friction mu tanh(u / u_s) has the slope mu / u_s at rest and almost none in motion.
    robot = wheel(**RUB)
    assert longest_step(robot, [0.0], [1.0]).step > 1e3 * longest_step(robot, [0.0]).step
    with pytest.raises(InputError, match=r'u: .*; expected'):
        longest_step(robot, [0.0], [0.0, 1.0])


def test_divergence_in_a_users_torque_names_the_time_and_the_joint():
    robot = Robot(wheel().model)

    def away(t, q, u):
        return robot.gravity_force(q) + 50.0 * u
    with pytest.raises(InputError,
                       match=r'the state diverged \(is \d.*e\+12\) at 0\.\d+ s '
                       r"\('wheel' first\)"):
        simulate(robot, [0.1], [1.0], 2.0, torque=away)


@pytest.mark.slow
@pytest.mark.parametrize('speed, fine', [(0.05, 5e-5), (0.01, 5e-5)])
def test_an_fr3_with_its_frictions_is_integrated_well_at_a_millisecond(speed, fine):
    model = load_urdf(resource_path('urdf', 'fr3.urdf'),
                      supplement=resource_path('examples', 'fr3_friction.yaml'))
    bodies = [replace(body, joint=replace(body.joint, friction_speed=speed))
              for body in model.bodies]
    robot = Robot(replace(model, bodies=tuple(bodies)))
    q = robot.feasible_configuration()
    levels = np.array([joint.friction for joint in robot.model.coordinate_joints])
    torque = robot.gravity_force(q) + 0.5 * levels
    with pytest.warns(ModelWarning,
                      match="'implicit' is used: a step of 0.001 s is too long"):
        run = simulate(robot, q, np.zeros(robot.n), 0.5, torque=torque)
    # The smooth law creeps under half of the friction, as the fine steps do too.
    reference = simulate(robot, q, np.zeros(robot.n), 0.5, torque=torque, step=fine,
                         integrator='rk4')
    np.testing.assert_allclose(run.q[-1], reference.q[-1], atol=1e-5)
    assert np.abs(run.q[-1] - q).max() > 1e-3
    held = simulate(robot, q, np.zeros(robot.n), 0.5, torque=torque, sticking=True)
    np.testing.assert_array_equal(held.q[-1], q)
