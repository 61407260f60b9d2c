"""Promises of the simulated robot that need no graph: its physics, its lines, its time."""

from dataclasses import replace
from functools import cache
import math

from kane_dynamics import load_urdf, QuasiStatic, Robot, simulate
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import InputError
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.ros.parameters.parameter_checks import read
from kane_dynamics.ros.plant.delay_line import DelayLine, MOST
from kane_dynamics.ros.plant.joint_stops import pushed_back
from kane_dynamics.ros.plant.plant_parameters import SPECS
from kane_dynamics.ros.plant.plant_state import PlantState
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
    """Return a robot that is nobody's plant."""
    return Robot(MODEL, wrench_frames=('tip',))


def arm(step=1e-3, frames=(), **limits):
    robot = Robot(MODEL, wrench_frames=frames)
    robot.__dict__['limits'] = JointLimits(**{
        name: np.broadcast_to(limits.get(name, getattr(robot.limits, name)), 2).astype(float)
        for name in ('lower', 'upper', 'velocity', 'effort')})
    return SimulatedArm(robot, step)


def values(**changes):
    given = {spec.name: spec.default for spec in SPECS} | {
        name.replace('__', '.'): value for name, value in changes.items()}
    return {name: read(BY_NAME[name], value) for name, value in given.items()}


def plant(**changes):
    robot = Robot(MODEL, payload_frame=changes.get('payload__frame'),
                  wrench_frames=changes.get('wrench__frames', ()))
    return PlantState(robot, values(**changes))


@cache
def flexible():
    return load_urdf(URDF, supplement=resource_path('urdf', 'two_link.bending.yaml'))


def run(which, ticks):
    """Do ticks; return the measurements that came in each."""
    return [list(which.tick(which.time)) for _ in range(ticks)]


def energy(q, u):
    return peer().kinetic_energy(q, u) + peer().potential_energy(q)


# ---------------------------------------------------------------------- stops


def test_a_stop_pushes_only_what_goes_into_it_and_adds_no_energy():
    random = np.random.default_rng(1)
    for _ in range(300):
        n = int(random.integers(1, 7))
        B = random.normal(size=(n, n + 1))
        W = B @ B.T
        u, side = random.normal(size=n), random.choice([-1.0, 0.0, 1.0], n)
        after = pushed_back(u, side, W)
        impulse = np.linalg.solve(W, after - u)
        scale = np.abs(impulse).max(initial=1.0)
        assert (side * after <= 1e-12 * np.abs(u).max()).all(), 'none goes on into its stop'
        assert (side * impulse <= 1e-9 * scale).all(), 'a stop only pushes'
        assert np.abs(impulse[side == 0.0]).max(initial=0.0) <= 1e-9 * scale
        parting = side * after < -1e-9
        assert np.abs(impulse[parting]).max(initial=0.0) <= 1e-9 * scale
        before, since = (x @ np.linalg.solve(W, x) for x in (u, after))
        assert since <= before * (1.0 + 1e-9)


def test_an_arm_that_falls_comes_to_rest_on_its_stops_and_never_gains_energy():
    falling = arm(lower=[-1.2, -0.3], upper=[1.0, 0.3])
    falling.put(np.array([0.9, 0.2]))
    most = energy(falling.q, falling.u)
    for _ in range(4000):
        falling.step(np.zeros(2))
        now = energy(falling.q, falling.u)
        assert now <= most + 1e-3
        most = now
        assert (falling.q >= [-1.2, -0.3]).all() and (falling.q <= [1.0, 0.3]).all()
    assert falling.q.tolist() == [-1.2, -0.3]
    assert falling.u.tolist() == [0.0, 0.0]
    assert falling.at_stops == ['joint1', 'joint2']
    assert falling.blows > 100


def test_an_arm_on_its_stop_can_be_lifted_off_it():
    resting = arm(lower=[-0.5, -0.4])
    resting.put(np.array([-0.5, 0.0]))
    lift = peer().gravity_force(np.array([-0.5, 0.0])) + [1.0, 0.0]
    for _ in range(50):
        resting.step(lift)
    assert resting.q[0] > -0.5
    assert resting.blows == 0


# ---------------------------------------------------------------------- the arm


def test_between_its_stops_it_moves_as_simulate_says():
    moving, tau = arm(), np.array([12.0, 4.0])
    moving.put(np.array([0.3, -0.5]))
    for _ in range(400):
        moving.step(tau)
    expected = simulate(peer(), [0.3, -0.5], [0.0, 0.0], 0.4, step=1e-3, torque=tau)
    np.testing.assert_allclose(moving.q, expected.q[-1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(moving.u, expected.u[-1], rtol=0, atol=1e-12)


def test_motors_give_no_more_than_their_limit():
    weak = arm(effort=[5.0, 2.0])
    weak.step(np.array([100.0, -1.0]))
    assert weak.effort.tolist() == [5.0, -1.0]
    weak.step(np.array([1.0, -100.0]))
    assert weak.effort.tolist() == [1.0, -2.0]
    assert weak.clamped == 2


def test_a_wrench_is_in_the_axes_of_its_frame_and_acts_at_its_origin():
    q, wrench = np.array([0.4, -0.9]), np.array([3.0, -5.0, 2.0, 0.5, -0.2, 0.7])
    pushed = arm(frames=('tip',), step=1e-6)
    pushed.put(q)
    pushed.wrenches['tip'] = wrench
    pushed.step(np.zeros(2))
    R = peer().frame_pose('tip', q)[:3, :3]
    world = np.concatenate([R @ wrench[:3], R @ wrench[3:]])[None]
    udot = peer().forward_dynamics(q, np.zeros(2), np.zeros(2), wrench=world)
    np.testing.assert_allclose(pushed.u, 1e-6 * udot, rtol=1e-5)


# ---------------------------------------------------------------------- lines


def test_a_line_delays_in_order_and_a_shorter_delay_lets_nothing_overtake():
    line = DelayLine()
    line.settle(0.5, 0.0)
    line.put(0, 'a')
    line.settle(0.1, 0.0)
    line.put(NANO // 10, 'b')
    assert list(line.take(NANO // 2 - 1)) == []
    assert list(line.take(NANO // 2)) == ['a', 'b']


def test_a_line_on_which_nothing_arrives_keeps_a_bounded_number():
    line = DelayLine()
    for k in range(MOST + 10):
        line.put(0, k)
    assert list(line.take(0)) == list(range(10, MOST + 10))


def test_a_line_loses_the_share_that_it_is_told_to():
    line = DelayLine()
    line.settle(0.0, 0.25)
    for k in range(4000):
        line.put(k, k)
    arrived = list(line.take(4000))
    assert line.lost + len(arrived) == 4000
    assert line.lost == pytest.approx(1000, abs=120)
    line.settle(0.0, 1.0)
    line.put(5000, 0)
    assert not list(line.take(5000))


# ---------------------------------------------------------------------- ticks


def test_brakes_hold_it_until_the_first_command_and_then_the_command_moves_it():
    still = plant(initial__position=[0.3, 0.1])
    run(still, 100)
    assert (still.held, still.arm.q.tolist(), still.arm.u.any()) == (True, [0.3, 0.1], False)
    still.command(np.array([50.0, 0.0]))
    run(still, 10)
    assert not still.held
    assert still.arm.u[0] > 0.0
    falling = plant(initial__position=[0.3, 0.1], hold_until_command=False)
    run(falling, 10)
    assert falling.arm.u[0] < 0.0


@pytest.mark.parametrize(('after', 'torque'), [('zero', 0.0), ('hold', 7.0)])
def test_a_late_command_gives_no_torque_or_the_last_one_as_asked(after, torque):
    late = plant(after_timeout=after, command_timeout=0.02)
    late.command(np.array([7.0, 0.0]))
    run(late, 11)
    assert (late.late, late.arm.effort[0]) == (False, 7.0)
    run(late, 20)
    assert (late.late, late.timeouts, late.arm.effort[0]) == (True, 1, torque)
    late.command(np.array([3.0, 0.0]))
    run(late, 1)
    assert (late.late, late.arm.effort[0]) == (False, 3.0)


def test_states_tell_the_moment_of_their_stamp_even_when_they_come_late():
    prompt = plant(hold_until_command=False)
    late = plant(hold_until_command=False, delay__states=0.01)
    now, then = run(prompt, 20), run(late, 20)
    assert [len(each) for each in now] == [1] * 20
    assert [len(each) for each in then] == [0] * 5 + [1] * 15
    for k in range(15):
        assert then[k + 5][0].stamp == now[k][0].stamp == k * TICK
        np.testing.assert_array_equal(then[k + 5][0].q, now[k][0].q)


def test_commands_act_late_by_their_delay():
    late = plant(delay__commands=0.01)
    late.command(np.array([7.0, 0.0]))
    run(late, 5)
    assert late.held
    run(late, 1)
    assert late.arm.effort[0] == 7.0


def test_the_same_seed_gives_the_same_noise_and_losses_and_a_reset_begins_them_again():
    settings = {'noise__position': 0.01, 'noise__velocity': [0.1, 0.0], 'dropout__states': 0.3,
                'seed': 5, 'hold_until_command': False}
    noisy, again, other = plant(**settings), plant(**settings), plant(**settings | {'seed': 6})

    def sent(which):
        return [(m.stamp, *m.q, *m.u) for each in run(which, 200) for m in each]
    first = sent(noisy)
    assert first == sent(again)
    assert first != sent(other)
    noisy.rewind()
    assert first == sent(noisy)
    still = plant(noise__position=0.01, noise__velocity=[0.1, 0.0])
    rows = np.array([[*m.q, *m.u] for each in run(still, 2000) for m in each])
    np.testing.assert_allclose(rows.std(axis=0), [0.01, 0.01, 0.1, 0.0], rtol=0.1)


def test_a_push_ends_by_itself_and_reset_takes_it_away():
    pushed = plant(wrench__frames=['tip'], wrench__timeout=0.01)
    pushed.push('tip', np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    run(pushed, 5)
    assert list(pushed.arm.wrenches) == ['tip']
    run(pushed, 1)
    assert not pushed.arm.wrenches
    pushed.push('tip', np.ones(6))
    pushed.reset()
    assert not pushed.arm.wrenches


def test_gravity_payload_and_effort_limits_change_between_ticks():
    free = {'hold_until_command': False, 'payload__frame': 'tip'}
    loaded, robot = plant(**free), Robot(MODEL, payload_frame='tip')
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


def test_without_an_initial_position_it_starts_at_zero_or_at_the_limit_next_to_it():
    bodies = [replace(body, joint=replace(body.joint, limits=replace(
        body.joint.limits, upper=upper))) for body, upper in zip(MODEL.bodies, (3.0, -0.15))]
    which = PlantState(Robot(replace(MODEL, bodies=tuple(bodies))), values())
    assert which.arm.q.tolist() == [0.0, -0.15]


@pytest.mark.parametrize(('words', 'changes'), [
    (r"'initial.position' of joint 'joint2' is 4; valid: -2.8 to 2.8",
     {'initial__position': [0.0, 4.0]}),
    (r"'noise.position' has 3 entries for 2 joints", {'noise__position': [0.1] * 3}),
    (r"'rate_factor' is 2; valid: 1, unless publish_clock", {'rate_factor': 2.0}),
    (r"'dropout.states' is 1.5; valid: a number, at least 0, at most 1", {'dropout__states': 1.5}),
    (r"'after_timeout' is 'float'; valid: one of zero, hold", {'after_timeout': 'float'}),
    (r'payload.frame', {'payload__mass': 1.0}),
    (r"no frame 'hand'; valid: base_link", {'wrench__frames': ['hand']}),
    (r"'wrench.frames' holds 'base_link', which does not move", {'wrench__frames': ['base_link']}),
])
def test_what_does_not_fit_is_refused_by_name(words, changes):
    with pytest.raises(InputError, match=words):
        plant(**changes)


@pytest.mark.parametrize(('frame', 'wrench', 'words'), [
    ('link1', np.zeros(6), "frame_id is 'link1'; valid: tip"),
    ('tip', np.array([0.0, math.nan, 0.0, 0.0, 0.0, 0.0]), 'valid: finite numbers'),
    ('tip', np.full(6, 301.0), 'at most 1000 N and 300 N m'),
])
def test_a_push_that_cannot_be_is_refused(frame, wrench, words):
    pushed = plant(wrench__frames=['tip'])
    with pytest.raises(InputError, match=words):
        pushed.push(frame, wrench)
    assert not pushed.arm.wrenches


def test_a_motion_beyond_all_numbers_is_an_error_and_the_arm_stays_finite():
    wild = arm(effort=math.inf)
    with pytest.raises(InputError, match='not finite'):
        wild.step(np.full(2, 1e300))
    assert np.isfinite(wild.q).all() and np.isfinite(wild.u).all()


# ---------------------------------------------------------------------- pace


def test_a_late_tick_does_not_make_the_next_one_late():
    pace = TickSchedule(1000.0 / 3.0)
    pace.start(50)
    for now in (50, 383, 900, 1050):
        assert now >= pace.due
        pace.tick(now)
    assert pace.due == 50 + round(4000.0 / 3.0)
    assert (pace.overruns, pace.worst, pace.skipped) == (0, 183, 0.0)


def test_overruns_are_counted_and_what_cannot_be_caught_up_on_is_skipped():
    pace = TickSchedule(2e6)
    pace.start(0)
    pace.tick(0)
    pace.tick(5_000_000)
    assert (pace.overruns, pace.worst, pace.due) == (1, 3_000_000, 4_000_000)
    pace.tick(1_000_000_000)
    assert pace.overruns == 2
    assert pace.skipped == pytest.approx(0.996)
    assert pace.due == 1_002_000_000


def test_an_arm_that_bends_rests_where_its_weight_has_bent_it():
    start = [0.4, -0.3]
    bends = PlantState(Robot(flexible()), values(initial__position=start, after_timeout='hold'))
    assert bends.arm.joint_names == ('joint1', 'joint2')
    hold = QuasiStatic(Robot(flexible())).gravity_force(start)
    bends.command(hold)
    last, = run(bends, 300)[-1]
    assert [len(x) for x in last[1:]] == [2, 2, 2]
    np.testing.assert_allclose(last.q, start, atol=1e-7)
    np.testing.assert_allclose(last.effort, hold)
    with pytest.raises(InputError, match=r'initial\.position'):
        PlantState.check(bends.robot, values(initial__position=[0.0] * 7))


def test_an_arm_that_bends_moves_as_the_library_says_and_stops_take_its_joints_alone():
    start, tau = np.array([0.2, 0.1]), np.array([9.0, 2.0])
    bends = PlantState(Robot(flexible()),
                       values(initial__position=[0.2, 0.1], after_timeout='hold'))
    modes = QuasiStatic(Robot(flexible())).modes(start, np.zeros(2), np.zeros(2))
    bends.command(tau)
    moved = [m for (m,) in run(bends, 101)]
    whole = simulate(bends.robot, np.append(start, modes), np.zeros(7), 0.2, step=1e-3,
                     torque=np.tile(np.append(tau, np.zeros(5)), (200, 1)))
    np.testing.assert_allclose(moved[-1].q, whole.q[-1, :2], atol=1e-12)
    np.testing.assert_allclose(moved[-1].u, whole.u[-1, :2], atol=1e-12)
    bends.command(np.array([0.0, 20.0]))  # against the upper stop of joint2
    run(bends, 1500)
    assert bends.arm.blows > 0 and bends.arm.at_stops == ['joint2']
    assert bends.arm.q[1] == bends.arm.upper[1]


def test_with_friction_as_stiff_as_identified_the_implicit_integrator_stops_the_arm_as_it_should():
    joint = {'friction': 4.0, 'friction_speed': 1e-3}
    model = load_urdf(URDF, supplement={'joints': dict.fromkeys(MODEL.joint_names, joint)})

    def coasting(**changes):
        which = PlantState(Robot(model), values(hold_until_command=False, substeps=1, **changes))
        which.arm.u[:] = 1.0, -1.0
        for _ in range(200):
            which.arm.step(which.robot.gravity_force(which.arm.q))
        return which.arm
    stiff = coasting(integrator='implicit')
    assert stiff.doubt is None
    assert np.abs(stiff.u).max() < 1e-6
    alone = simulate(Robot(model), stiff.q, stiff.u, 0.1, step=1e-5,
                     torque=Robot(model).gravity_force(stiff.q))
    assert np.abs(alone.q - stiff.q).max() < 1e-6  # it stands by itself
    trembling = coasting()
    assert 'too long' in trembling.doubt and np.abs(trembling.u).max() > 1e-3
