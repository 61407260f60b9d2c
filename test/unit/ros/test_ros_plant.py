"""The simulated robot without a ROS graph: physics, communication lines, schedule."""

from dataclasses import replace
from functools import cache
import math

from kane_dynamics import (Contact, Drive, Limits, load_urdf, ModelBuilder,
                           PlaneSurface, QuasiStatic, Robot, rod, simulate,
                           StiffnessCurve, with_drives)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.control.quasi_static import flexible_robot
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.yaml_file import load_constraints
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import TORQUE_TERMS
from kane_dynamics.ros.parameters.parameter_checks import read
from kane_dynamics.ros.parameters.parameter_table import CONSTANTS
from kane_dynamics.ros.plant.plant_parameters import SPECS
from kane_dynamics.ros.plant.plant_state import DelayLine, MAX_ITEMS, PlantState
from kane_dynamics.ros.plant.simulated_arm import SimulatedArm
from kane_dynamics.ros.plant.tick_schedule import TickSchedule
import numpy as np
import pytest

URDF = resource_path('urdf', 'two_link.urdf')
MODEL = load_urdf(URDF)
BY_NAME = {spec.name: spec for spec in SPECS}
NANO = 10**9
TICK = 2_000_000  # ns at the default rate


@cache
def peer():
    """Return a robot that is not part of a plant."""
    return Robot(MODEL, wrench_frames=('tip',))


def arm(step=1e-3, frames=(), **limits):
    robot = Robot(MODEL, wrench_frames=frames)
    stated = {}
    for name in ('lower', 'upper', 'velocity', 'effort'):
        limit = limits.get(name, getattr(robot.limits, name))
        stated[name] = np.broadcast_to(limit, 2).astype(float)
    robot.__dict__['limits'] = JointLimits(**stated)
    return SimulatedArm(robot, step)


def values(**changes):
    arguments = {spec.name: spec.default for spec in SPECS} | {
        name.replace('__', '.'): value for name, value in changes.items()}
    return CONSTANTS | {name: read(BY_NAME[name], value)
                        for name, value in arguments.items()}


def plant(**changes):
    robot = Robot(MODEL, payload_frame=changes.get('payload__frame'),
                  wrench_frames=changes.get('wrench__frames', ()))
    return PlantState(robot, values(**changes))


@cache
def flexible():
    return load_urdf(URDF, supplement=resource_path('urdf', 'two_link.bending.yaml'))


def run(which, ticks):
    """Run ticks; return the measurements that arrive in each."""
    return [list(which.tick(which.time)) for _ in range(ticks)]


def energy(q, u):
    return peer().kinetic_energy(q, u) + peer().potential_energy(q)


# ------------------------------------------------------------ what the arm adds itself


def test_an_arm_that_compensates_gravity_stays_without_torque_and_reports_none():
    robot = Robot(MODEL)
    held = SimulatedArm(robot, 1e-3, arm_compensates=('gravity',))
    held.reset(np.array([0.3, 0.5]))
    for _ in range(500):
        held.step(np.zeros(2))
    np.testing.assert_allclose(held.q, [0.3, 0.5], atol=1e-12)
    assert not held.effort.any()


@pytest.mark.parametrize('term', ['gravity', 'friction', 'coriolis'])
def test_a_term_added_in_the_arm_equals_the_term_added_by_a_controller(term):
    """A step with the term inside equals a step with the term in the command."""
    supplement = {'joints': {name: {'damping': 0.5, 'friction': 0.3}
                             for name in MODEL.joint_names}}
    model = load_urdf(URDF, supplement=supplement)
    inside = SimulatedArm(Robot(model), 1e-3, arm_compensates=(term,))
    outside = SimulatedArm(Robot(model), 1e-3)
    q = np.array([0.3, 0.5])
    u = np.array([0.7, -1.1])
    command = np.array([0.4, -0.2])
    peer = Robot(model)
    added = peer.torque_terms(q, u, np.zeros(2))[TORQUE_TERMS.index(term)]
    assert np.abs(added).max() > 0.05
    for simulated, torque in ((inside, command), (outside, command + added)):
        simulated.reset(q)
        simulated.u[:] = u
        simulated.step(torque)
    np.testing.assert_allclose(inside.q, outside.q, rtol=1e-12)
    np.testing.assert_allclose(inside.u, outside.u, rtol=1e-12)
    np.testing.assert_array_equal(inside.effort, command)


def test_flexible_modes_are_not_driven_by_what_the_arm_adds():
    """The joints are held; only the beam swings, from straight to its sag."""
    robot = Robot(flexible())
    held = SimulatedArm(robot, 1e-4, arm_compensates=('gravity',))
    held.reset(np.zeros(2))
    state_before = held._q.copy()
    for _ in range(100):
        held.step(np.zeros(2))
    np.testing.assert_allclose(held._q, state_before, atol=1e-6)  # in its equilibrium
    assert np.abs(state_before[2:]).max() > 1e-4


def test_the_arm_cannot_add_inertia_without_a_desired_acceleration():
    with pytest.raises(InputError, match='expected no inertia'):
        plant(arm_compensates=['inertia'])


# ---------------------------------------------------------------------- stops


def test_a_falling_arm_comes_to_rest_on_its_stops_without_gaining_energy():
    falling = arm(lower=[-1.2, -0.3], upper=[1.0, 0.3])
    falling.reset(np.array([0.9, 0.2]))
    largest_energy = energy(falling.q, falling.u)
    for _ in range(4000):
        falling.step(np.zeros(2))
        now = energy(falling.q, falling.u)
        assert now <= largest_energy + 1e-3
        largest_energy = now
        assert (falling.q >= [-1.2, -0.3]).all() and (falling.q <= [1.0, 0.3]).all()
    assert falling.q.tolist() == [-1.2, -0.3]
    assert falling.u.tolist() == [0.0, 0.0]
    assert falling.at_stops == ['joint1', 'joint2']
    assert falling.stop_contacts > 100


def test_an_arm_at_a_stop_can_move_away_from_it():
    resting = arm(lower=[-0.5, -0.4])
    resting.reset(np.array([-0.5, 0.0]))
    lift = peer().gravity_force(np.array([-0.5, 0.0])) + [1.0, 0.0]
    for _ in range(50):
        resting.step(lift)
    assert resting.q[0] > -0.5
    assert resting.stop_contacts == 0


def test_a_pendulum_on_a_link_that_is_pressed_against_its_stop_keeps_its_energy():
    pressed = arm(lower=[-0.5, -np.inf], upper=[1.0, np.inf])
    pressed.reset(np.array([-0.5, 1.0]))
    energy_before = energy(pressed.q, pressed.u)
    fastest = 0.0
    for _ in range(2000):
        pressed.step(np.array([-60.0, 0.0]))
        fastest = max(fastest, abs(pressed.u[1]))
    assert pressed.at_stops == ['joint1']
    assert pressed.stop_contacts == 2000
    assert fastest > 1.0
    assert abs(energy(pressed.q, pressed.u) - energy_before) < 1e-9 * abs(energy_before)
    assert not pressed.energy.warning


# ---------------------------------------------------------------------- the arm


def test_between_its_stops_the_arm_moves_as_in_simulate():
    moving = arm()
    tau = np.array([12.0, 4.0])
    moving.reset(np.array([0.3, -0.5]))
    for _ in range(400):
        moving.step(tau)
    expected = simulate(peer(), [0.3, -0.5], [0.0, 0.0], 0.4, step=1e-3, torque=tau)
    np.testing.assert_allclose(moving.q, expected.q[-1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(moving.u, expected.u[-1], rtol=0, atol=1e-12)


def test_motors_respect_their_effort_limits():
    weak = arm(effort=[5.0, 2.0])
    weak.step(np.array([100.0, -1.0]))
    assert weak.effort.tolist() == [5.0, -1.0]
    weak.step(np.array([1.0, -100.0]))
    assert weak.effort.tolist() == [1.0, -2.0]
    assert weak.clamped == 2


def test_a_wrench_is_in_the_axes_of_its_frame_and_acts_at_its_origin():
    q = np.array([0.4, -0.9])
    wrench = np.array([3.0, -5.0, 2.0, 0.5, -0.2, 0.7])
    loaded_arm = arm(frames=('tip',), step=1e-6)
    loaded_arm.reset(q)
    loaded_arm.wrenches['tip'] = wrench
    loaded_arm.step(np.zeros(2))
    R = peer().frame_pose('tip', q)[:3, :3]
    world = np.concatenate([R @ wrench[:3], R @ wrench[3:]])[None]
    udot = peer().forward_dynamics(q, np.zeros(2), np.zeros(2), wrench=world)
    np.testing.assert_allclose(loaded_arm.u, 1e-6 * udot, rtol=1e-5)


# ---------------------------------------------------------------------- lines


def test_a_delay_line_keeps_the_order_when_its_delay_is_reduced():
    line = DelayLine()
    line.configure(0.5, 0.0)
    line.send(0, 'a')
    line.configure(0.1, 0.0)
    line.send(NANO // 10, 'b')
    assert list(line.receive(NANO // 2 - 1)) == []
    assert list(line.receive(NANO // 2)) == ['a', 'b']


def test_a_delay_line_is_bounded():
    line = DelayLine()
    for k in range(MAX_ITEMS + 10):
        line.send(0, k)
    assert list(line.receive(0)) == list(range(10, MAX_ITEMS + 10))


def test_a_delay_line_drops_the_configured_fraction():
    line = DelayLine()
    line.configure(0.0, 0.25)
    for k in range(4000):
        line.send(k, k)
    arrived = list(line.receive(4000))
    assert line.dropped + len(arrived) == 4000
    assert line.dropped == pytest.approx(1000, abs=120)
    line.configure(0.0, 1.0)
    line.send(5000, 0)
    assert not list(line.receive(5000))


# ---------------------------------------------------------------------- ticks


def test_brakes_hold_the_arm_until_the_first_command():
    still = plant(initial__position=[0.3, 0.1])
    run(still, 100)
    assert (still.braked, still.arm.q.tolist(), still.arm.u.any()) == (True, [0.3, 0.1],
                                                                       False)
    still.command(np.array([50.0, 0.0]))
    run(still, 10)
    assert not still.braked
    assert still.arm.u[0] > 0.0
    falling = plant(initial__position=[0.3, 0.1], hold_until_command=False)
    run(falling, 10)
    assert falling.arm.u[0] < 0.0


@pytest.mark.parametrize(('after', 'torque'), [('zero', 0.0), ('hold', 7.0)])
def test_after_a_command_timeout_the_torque_is_zero_or_held_as_configured(after, torque):
    late = plant(after_timeout=after, command_timeout=0.02)
    late.command(np.array([7.0, 0.0]))
    run(late, 11)
    assert (late.timed_out, late.arm.effort[0]) == (False, 7.0)
    run(late, 20)
    assert (late.timed_out, late.timeouts, late.arm.effort[0]) == (True, 1, torque)
    late.command(np.array([3.0, 0.0]))
    run(late, 1)
    assert (late.timed_out, late.arm.effort[0]) == (False, 3.0)


def test_delayed_states_are_those_of_their_stamp():
    prompt = plant(hold_until_command=False)
    late = plant(hold_until_command=False, delay__states=0.01)
    now = run(prompt, 20)
    then = run(late, 20)
    assert [len(states) for states in now] == [1] * 20
    assert [len(states) for states in then] == [0] * 5 + [1] * 15
    for k in range(15):
        assert then[k + 5][0].stamp == now[k][0].stamp == k * TICK
        np.testing.assert_array_equal(then[k + 5][0].q, now[k][0].q)


def test_commands_act_after_their_delay():
    late = plant(delay__commands=0.01)
    late.command(np.array([7.0, 0.0]))
    run(late, 5)
    assert late.braked
    run(late, 1)
    assert late.arm.effort[0] == 7.0


def test_noise_and_dropouts_repeat_with_the_seed_and_after_a_reset():
    settings = {'noise__position': 0.01, 'noise__velocity': [0.1, 0.0],
                'dropout__states': 0.3, 'seed': 5, 'hold_until_command': False}
    noisy = plant(**settings)
    again = plant(**settings)
    other_seed = plant(**settings | {'seed': 6})

    def sent(which):
        return [(m.stamp, *m.q, *m.u) for messages in run(which, 200) for m in messages]
    first = sent(noisy)
    assert first == sent(again)
    assert first != sent(other_seed)
    noisy.reset_time()
    assert first == sent(noisy)
    still = plant(noise__position=0.01, noise__velocity=[0.1, 0.0])
    rows = np.array([[*m.q, *m.u] for messages in run(still, 2000) for m in messages])
    np.testing.assert_allclose(rows.std(axis=0), [0.01, 0.01, 0.1, 0.0], rtol=0.1)


def test_a_wrench_ends_after_its_timeout_and_after_a_reset():
    loaded_arm = plant(wrench__frames=['tip'], wrench__timeout=0.01)
    loaded_arm.apply_wrench('tip', np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    run(loaded_arm, 5)
    assert list(loaded_arm.arm.wrenches) == ['tip']
    run(loaded_arm, 1)
    assert not loaded_arm.arm.wrenches
    loaded_arm.apply_wrench('tip', np.ones(6))
    loaded_arm.reset()
    assert not loaded_arm.arm.wrenches


def test_gravity_payload_and_effort_limits_change_between_ticks():
    free = {'hold_until_command': False, 'payload__frame': 'tip'}
    loaded = plant(**free)
    robot = Robot(MODEL, payload_frame='tip')
    loaded.update(values(**free, gravity=[0.0, 0.0, -1.6], payload__mass=3.0,
                         limits__effort=[4.0, 1.0]))
    robot.parameters.gravity = [0.0, 0.0, -1.6]
    robot.parameters.payload = loaded.robot.parameters.payload
    assert robot.parameters.payload.mass == 3.0
    run(loaded, 1)
    udot = robot.forward_dynamics(np.zeros(2), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(loaded.arm.u, 2e-3 * udot, rtol=1e-3)
    loaded.command(np.array([9.0, 9.0]))
    run(loaded, 1)
    assert loaded.arm.effort.tolist() == [4.0, 1.0]


def test_the_default_initial_position_is_zero_or_the_middle_of_limits_that_exclude_it():
    bodies = []
    for body, upper in zip(MODEL.bodies, (3.0, -0.15)):
        bodies.append(replace(body, joint=replace(
            body.joint, limits=replace(body.joint.limits, upper=upper))))
    which = PlantState(Robot(replace(MODEL, bodies=tuple(bodies))), values())
    lower = MODEL.bodies[1].joint.limits.lower
    assert which.arm.q.tolist() == [0.0, 0.5 * (lower - 0.15)]


@pytest.mark.parametrize(
    ('words', 'changes'), [
        (r"'initial.position' of joint 'joint2': 4; expected -2.8 to 2.8",
         {'initial__position': [0.0, 4.0]}),
        (("'noise.position': 3 entries; expected one number, or one for each of the "
          '2 joints'),
         {'noise__position': [0.1] * 3}),
        (r"'rate_factor': 2; expected 1 unless publish_clock", {'rate_factor': 2.0}),
        (r"'dropout.states': 1.5; expected a number, at least 0, at most 1",
         {'dropout__states': 1.5}),
        (r"'after_timeout': 'float'; expected one of zero, hold",
         {'after_timeout': 'float'}),
        (r'payload.frame', {'payload__mass': 1.0}),
        (r"no frame 'hand'; expected one of base_link", {'wrench__frames': ['hand']}),
        (r"'wrench.frames': 'base_link', a frame that does not move",
         {'wrench__frames': ['base_link']}),
    ])
def test_invalid_parameters_are_refused_by_name(words, changes):
    with pytest.raises(InputError, match=words):
        plant(**changes)


@pytest.mark.parametrize(('frame', 'wrench', 'words'), [
    ('link1', np.zeros(6), "frame_id: 'link1'; expected tip"),
    ('tip', np.array([0.0, math.nan, 0.0, 0.0, 0.0, 0.0]), 'expected finite numbers'),
    ('tip', np.full(6, 301.0), 'at most 1000 N and 300 N m'),
])
def test_an_invalid_wrench_is_refused(frame, wrench, words):
    loaded_arm = plant(wrench__frames=['tip'])
    with pytest.raises(InputError, match=words):
        loaded_arm.apply_wrench(frame, wrench)
    assert not loaded_arm.arm.wrenches


def test_a_diverged_step_is_an_error_and_the_state_stays_finite():
    wild = arm(effort=math.inf)
    with pytest.raises(InputError, match='not finite'):
        wild.step(np.full(2, 1e300))
    assert np.isfinite(wild.q).all() and np.isfinite(wild.u).all()


# ---------------------------------------------------------------------- schedule


def test_a_late_tick_does_not_delay_the_next_one():
    schedule = TickSchedule(1000.0 / 3.0)
    schedule.start(50)
    for now in (50, 383, 900, 1050):
        assert now >= schedule.due
        schedule.tick(now)
    assert schedule.due == 50 + round(4000.0 / 3.0)
    assert (schedule.overruns, schedule.worst, schedule.skipped) == (0, 183, 0.0)


def test_overruns_are_counted_and_a_large_lag_shifts_the_schedule():
    schedule = TickSchedule(2e6)
    schedule.start(0)
    schedule.tick(0)
    schedule.tick(5_000_000)
    assert (schedule.overruns, schedule.worst, schedule.due) == (1, 3_000_000, 4_000_000)
    schedule.tick(1_000_000_000)
    assert schedule.overruns == 2
    assert schedule.skipped == pytest.approx(0.996)
    assert schedule.due == 1_002_000_000


def test_a_flexible_arm_starts_with_the_deflection_under_its_weight():
    start = [0.4, -0.3]
    bends = PlantState(Robot(flexible()),
                       values(initial__position=start, after_timeout='hold'))
    assert bends.arm.joint_names == ('joint1', 'joint2')
    hold = QuasiStatic(Robot(flexible())).gravity_force(start)
    bends.command(hold)
    last, = run(bends, 300)[-1]
    assert [len(x) for x in last[1:]] == [2, 2, 2]
    np.testing.assert_allclose(last.q, start, atol=1e-7)
    np.testing.assert_allclose(last.effort, hold)
    with pytest.raises(InputError, match=r'initial\.position'):
        PlantState.check(bends.robot, values(initial__position=[0.0] * 7))


def test_a_flexible_arm_moves_as_in_simulate_and_stops_act_on_joints_only():
    start = np.array([0.2, 0.1])
    tau = np.array([9.0, 2.0])
    bends = PlantState(Robot(flexible()),
                       values(initial__position=[0.2, 0.1], after_timeout='hold'))
    modes = QuasiStatic(Robot(flexible())).modes(start, np.zeros(2), np.zeros(2))
    bends.command(tau)
    moved = [m for (m,) in run(bends, 101)]
    whole = simulate(bends.robot, np.append(start, modes), np.zeros(7), 0.2, step=1e-3,
                     torque=np.tile(np.append(tau, np.zeros(5)), (200, 1)))
    np.testing.assert_allclose(moved[-1].q, whole.q[-1, :2], atol=1e-12)
    np.testing.assert_allclose(moved[-1].u, whole.u[-1, :2], atol=1e-12)
    bends.command(np.array([0.0, 20.0]))  # towards the upper stop of joint2
    run(bends, 1500)
    assert bends.arm.stop_contacts > 0 and bends.arm.at_stops == ['joint2']
    assert bends.arm.q[1] == bends.arm.upper[1]


DRIVES = {'joint1': Drive(stiffness=900.0, damping=0.2, rotor_inertia=0.05),
          'joint2': Drive(StiffnessCurve([1e-3, 4e-3], [0.0, 2.0]), rotor_inertia=0.02)}


def test_motors_of_elastic_joints_hold_the_links_where_the_arm_starts():
    start = [0.4, -0.3]
    robot = Robot(with_drives(MODEL, DRIVES))
    elastic = PlantState(robot, values(initial__position=start, after_timeout='hold'))
    assert elastic.arm.joint_names == ('joint1', 'joint2')
    hold = peer().gravity_force(start)
    elastic.command(hold)
    last, = run(elastic, 300)[-1]
    np.testing.assert_allclose(elastic.arm.q, start, atol=1e-9)
    np.testing.assert_allclose(last.effort, hold)
    # The encoders are at the motors, which lead by the deflection: beyond the dead zone.
    ahead = last.q - start
    assert ahead[0] == pytest.approx(hold[0] / 900.0, rel=1e-6)
    assert abs(ahead[1]) > 1e-3 and ahead[1] * hold[1] > 0.0
    at_links = PlantState(robot,
                          values(initial__position=start, drives__sensor_side='link'))
    first, = run(at_links, 1)[0]
    np.testing.assert_allclose(first.q, start, atol=1e-12)


@pytest.mark.parametrize('side', ['motor', 'link'])
def test_an_elastic_arm_moves_as_in_simulate(side):
    robot = Robot(with_drives(MODEL, DRIVES))
    elastic = PlantState(robot, values(after_timeout='hold', drives__sensor_side=side))
    tau = np.array([14.0, 2.0])
    state_before = elastic.arm._q.copy()
    elastic.command(tau)
    moved = [m for (m,) in run(elastic, 101)]
    whole = simulate(robot, state_before, np.zeros(4), 0.2, step=1e-3,
                     torque=np.append(np.zeros(2), tau))
    columns = slice(2, 4) if side == 'motor' else slice(0, 2)
    np.testing.assert_allclose(moved[-1].q, whole.q[-1, columns], atol=1e-12)
    np.testing.assert_allclose(moved[-1].u, whole.u[-1, columns], atol=1e-12)
    assert not elastic.arm.energy.warning


def test_effort_limits_and_added_terms_are_those_of_the_motors():
    limited = {name: replace(drive, motor_effort=3.0) for name, drive in DRIVES.items()}
    robot = Robot(with_drives(MODEL, limited))
    elastic = SimulatedArm(robot, 1e-3, arm_compensates=('gravity', 'friction'))
    elastic.reset(np.array([0.4, -0.3]))
    elastic.step(np.array([5.0, -5.0]))
    assert elastic.effort.tolist() == [3.0, -3.0] and elastic.clamped == 1
    # The controller in the arm holds it by the motors; nothing acts on the links
    # directly.
    elastic.reset(np.array([0.4, -0.3]))
    for _ in range(300):
        elastic.step(np.zeros(2))
        assert not elastic._total[0, :2].any()
    np.testing.assert_allclose(elastic.q, [0.4, -0.3], atol=1e-9)


@pytest.mark.slow  # two kernels of steps
def test_the_stops_of_an_elastic_arm_are_those_of_the_links():
    elastic = PlantState(Robot(with_drives(MODEL, DRIVES)), values(after_timeout='hold'))
    elastic.command(np.array([10.0, 20.0]))
    run(elastic, 700)
    arm = elastic.arm
    assert arm.stop_contacts > 0 and (arm.q <= arm.upper).all()
    assert arm.measured[0][1] > arm.upper[1]  # the motor winds the spring up


@pytest.mark.slow
def test_an_elastic_arm_with_closed_loops_or_beams_starts_at_rest():
    loops = resource_path('urdf', 'palletizer.constraints.yaml')
    options = load_constraints(loops)
    driven = ('swivel', 'shoulder', 'lever_drive')
    model = with_drives(load_urdf(resource_path('urdf', 'palletizer.urdf')), {
        name: Drive(stiffness=3e5, rotor_inertia=5.0) for name in driven})
    palletizer = SimulatedArm(flexible_robot(model, options), 1e-3)
    bends = SimulatedArm(Robot(with_drives(flexible(), {'joint1': DRIVES['joint1']})),
                         1e-4)
    for arm, joints in ((palletizer, options['actuated']),
                        (bends, ('joint1', 'joint2'))):
        arm.reset(None)
        start = arm._q.copy()
        commanded = arm.commanded(joints)
        assert [arm.joint_names[k] for k in commanded] == sorted(
            joints, key=arm.joint_names.index)
        springs = arm.robot.potential_energy(start)
        hold = holding_torques(arm)
        for _ in range(200):
            arm.step(hold)
        np.testing.assert_allclose(arm._q, start, atol=1e-8)
        assert arm.robot.potential_energy(arm._q) == pytest.approx(springs, rel=1e-9)


def holding_torques(arm):
    """Return the torques at which an arm stays: its springs', or its bias."""
    robot = arm.robot
    at_rest = np.zeros(robot.n)
    bias = robot.bias_force(arm._q, at_rest)
    motors = {elastic.name: elastic.drive.motor for elastic in robot.drives}
    by_speed = dict(zip(robot.speed_names, bias))
    return np.array([by_speed.get(motors.get(name, name), 0.0)
                     for name in arm.joint_names])


def test_the_implicit_integrator_stops_an_arm_with_stiff_friction():
    joint = {'friction': 4.0, 'friction_speed': 1e-3}
    model = load_urdf(URDF,
                      supplement={'joints': dict.fromkeys(MODEL.joint_names, joint)})

    def coasting(**changes):
        which = PlantState(Robot(model),
                           values(hold_until_command=False, substeps=1, **changes))
        which.arm.u[:] = 1.0, -1.0
        for _ in range(200):
            which.arm.step(which.robot.gravity_force(which.arm.q))
        return which.arm
    stiff = coasting(integrator='implicit')
    assert stiff.step_warning() is None
    assert np.abs(stiff.u).max() < 1e-6
    alone = simulate(Robot(model), stiff.q, stiff.u, 0.1, step=1e-5,
                     torque=Robot(model).gravity_force(stiff.q))
    assert np.abs(alone.q - stiff.q).max() < 1e-6  # at rest
    chosen = coasting()
    assert "integrator 'implicit' is used: a step of 0.002 s is too long" in (
        chosen.integrator_choice)
    np.testing.assert_array_equal(chosen.q, stiff.q)
    oscillating = coasting(integrator='rk4')
    assert not oscillating.integrator_choice
    assert 'too long' in oscillating.step_warning()
    assert np.abs(oscillating.u).max() > 1e-3


def test_an_arm_with_exact_friction_sticks_and_hits_its_stops():
    builder = ModelBuilder('arm')
    builder.body('bar', axis=(0, -1, 0), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)),
                 friction=2.0, limits=Limits(-1.0, 1.0, effort=20.0))
    arm = SimulatedArm(Robot(builder.model()), 1e-3, sticking=True)
    weight = 0.5 * 9.81
    for _ in range(200):
        arm.step(np.array([weight - 1.9]))
    assert arm.q[0] == 0.0 and arm.u[0] == 0.0 and arm.stuck == ['bar']
    for _ in range(2000):
        arm.step(np.zeros(1))
    assert arm.q[0] == -1.0 and arm.u[0] == 0.0 and arm.stop_contacts > 0
    arm.energy.close()
    assert arm.energy.warning == ''


def test_an_arm_that_lands_on_a_table_moves_as_simulate_and_is_refused_inside_it():
    robot = Robot(MODEL)
    height = float(robot.frame_pose('tip', [0.3, 0.4])[2, 3]) - 0.1
    table = [Contact('tip', PlaneSurface((0.0, 0.0, height)), friction=0.3)]
    arm = SimulatedArm(robot, 1e-3, contacts=table)
    arm.reset(np.array([0.3, 0.4]))
    run = simulate(robot, [0.3, 0.4], [0.0, 0.0], 1.0, stops=True, contacts=table)
    for _ in range(1000):
        arm.step(np.zeros(2))
    np.testing.assert_allclose([arm.q, arm.u], [run.q[-1], run.u[-1]], atol=1e-9)
    assert arm.touching == ['tip'] and run.contact_events
    arm.energy.close()
    assert arm.energy.warning == ''
    with pytest.raises(InputError, match=r"contact 'tip' is .* inside its surface"):
        arm.reset(np.array([-1.0, 0.4]))


def test_an_arm_with_bristles_moves_as_simulate_and_rests_after_a_reset():
    builder = ModelBuilder('arm')
    builder.body('bar', axis=(0, -1, 0), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)),
                 friction=2.0, presliding_stiffness=800.0, presliding_damping=4.0,
                 limits=Limits(-1.0, 1.0, effort=20.0))
    robot = Robot(builder.model())
    arm = SimulatedArm(robot, 1e-3)
    run = simulate(robot, [0.0], [0.0], 0.3, step=1e-3, stops=True)
    for _ in range(300):
        arm.step(np.zeros(1))
    np.testing.assert_allclose([arm.q, arm.u], [run.q[-1], run.u[-1]], rtol=1e-12)
    arm.energy.close()
    assert arm.energy.warning == '' and arm.integrator_choice == ''
    arm.reset(np.zeros(1))
    arm.step(np.array([0.5 * 9.81]))
    np.testing.assert_allclose([arm.q, arm.u], 0.0, atol=1e-12)
    with pytest.raises(InputError,
                       match="sticking: joint 'bar' has presliding_stiffness 800"):
        SimulatedArm(robot, 1e-3, sticking=True)
