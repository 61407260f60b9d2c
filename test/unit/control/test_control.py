"""Promises of the controller, on a two-joint mechanism with closed-form dynamics."""

from types import SimpleNamespace

from kane_dynamics.control.computed_torque import ComputedTorque
from kane_dynamics.control.controller import Controller, Mode, OWN_MODES, Terms
from kane_dynamics.errors import InputError
from kane_dynamics.model.builder import ModelBuilder
from kane_dynamics.model.model import Body, Inertial, Joint, Limits, Model
from kane_dynamics.model.primitive_inertias import point_mass
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np
import pytest

NAMES = ('lift', 'slide')
MASS = 2.0
ARM = 0.5
SLIDE = 1.5
SPRING = 7.0


class ClosedForm:
    """A pendulum with a sprung radial slide: M, Coriolis, gravity by hand."""

    joint_names = coordinate_names = speed_names = NAMES
    n = n_q = len(NAMES)

    def __init__(self, effort=(np.inf, np.inf)):
        none = np.full(self.n, np.inf)
        self.limits = SimpleNamespace(effort=np.array(effort), lower=-none, upper=none)
        self.model = SimpleNamespace(coordinate_names=NAMES, sliding=NAMES[1:],
                                     modal_coordinates=(), drives=())
        self.equations = SimpleNamespace(
            model=self.model, in_joint_rates=True, timed=False,
            n=self.n, mechanism=None, tree=None, actuated=None,
            carries_loads=False, time_inputs=lambda t: ())
        law = SimpleNamespace(entry=lambda doc, fallback: self.computed_torque)
        self.kernels = SimpleNamespace(compiled=lambda *_: law, no_wrench=())
        self.parameters = SimpleNamespace(block=None, closure_tolerance=None)

    def computed_torque(self, q, u, q_d, u_d, udot_d, gains, t):
        """Return the law of computed torque with friction at the desired speed."""
        with np.errstate(over='ignore', invalid='ignore'):
            udot = udot_d + gains[:2] * (q_d - q) + gains[2:] * (u_d - u)
            return (self.inverse_dynamics(q, u, udot) - self.friction_force(u)
                    + self.friction_force(u_d))

    def torque_terms(self, q, u, udot):
        """Return inertia, Coriolis, gravity, friction and spring torques."""
        r = ARM + q[1]
        inertia = np.array([(MASS * r ** 2) * udot[0], SLIDE * udot[1]])
        coriolis = np.array([2 * MASS * r * u[0] * u[1], -MASS * r * u[0] ** 2])
        spring = np.array([0.0, SPRING * q[1]])
        return np.array(
            [inertia, coriolis, self.gravity_force(q), self.friction_force(u), spring])

    def inverse_dynamics(self, q, u, udot):
        """Return the sum of all terms."""
        return self.torque_terms(q, u, udot).sum(axis=0)

    def gravity_force(self, q):
        """Return the torque that holds the weight."""
        return 9.81 * MASS * np.array([(ARM + q[1]) * np.cos(q[0]), np.sin(q[0])])

    def friction_force(self, u):
        """Return viscous and smoothed Coulomb friction."""
        return 0.3 * u + 0.8 * np.tanh(u / 0.05)


ROBOT = ClosedForm()
MOTION = Motion.from_points([0.0, 1.0, 2.0], [[0.0, 0.0], [0.7, 0.2], [0.4, -0.1]],
                            joint_names=NAMES)
Q = np.array([0.3, 0.1])
U = np.array([0.9, -0.4])
T = 0.63
KP = np.array([80.0, 120.0])
KD = np.array([18.0, 22.0])
SWITCHES = [Terms(*(bool(bits >> k & 1) for k in range(4))) for bits in range(16)]


def compiled_robot(**options):
    """Return a real robot of two joints with friction, a spring and an effort limit."""
    inertial = Inertial(2.0, [0.1, 0.0, 0.2], np.diag([0.02, 0.03, 0.04]))
    joint = {'damping': 0.4, 'friction': 0.7, 'translation': [0.0, 0.1, 0.3]}
    return Robot(Model('arm', (
        Body('upper', -1, Joint(NAMES[0], 'revolute', [0.0, 1.0, 0.0], **joint),
             inertial),
        Body('fore', 0,
             Joint(NAMES[1], 'prismatic', [1.0, 0.0, 0.0], coordinate=1,
                   stiffness=9.0, limits=Limits(effort=1e3), **joint), inertial),
    ), NAMES), **options)


ROBOTS = {'closed form': ROBOT, 'compiled': compiled_robot(),
          'frictionless': compiled_robot(friction=False)}


def expected_terms(terms, q, u, udot, u_friction, feedback=(0.0, 0.0), robot=ROBOT):
    """Return the torque from the terms one by one, the springs always in."""
    inertia, coriolis, gravity, _, spring = robot.torque_terms(q, u, udot)
    back = robot.torque_terms(q, u, np.array(feedback))[0]
    return (terms.inertia * inertia + terms.coriolis * coriolis + terms.gravity * gravity
            + terms.friction * robot.friction_force(u_friction) + spring + back)


@pytest.mark.parametrize('robot', ROBOTS.values(), ids=ROBOTS)
@pytest.mark.parametrize('terms', SWITCHES)
def test_inverse_dynamics_is_the_torque_at_the_desired_state(terms, robot):
    tau = Controller(robot, compensate=terms).command(T, Q, U, MOTION).tau
    q_d, u_d, udot_d = MOTION.sample(T)
    expected = expected_terms(terms, q_d, u_d, udot_d, u_d, robot=robot)
    np.testing.assert_allclose(tau, expected, rtol=1e-13)


@pytest.mark.parametrize('robot', ROBOTS.values(), ids=ROBOTS)
@pytest.mark.parametrize('terms', SWITCHES)
def test_computed_torque_acts_at_the_measured_state_with_friction_at_the_desired_speed(
        terms, robot):
    control = Controller(robot, mode='computed_torque', compensate=terms, kp=KP, kd=KD)
    tau = control.command(T, Q, U, MOTION).tau
    q_d, u_d, udot_d = MOTION.sample(T)
    feedback = KD * (u_d - U) + KP * (q_d - Q)
    expected = expected_terms(terms, Q, U, udot_d, u_d, feedback, robot)
    np.testing.assert_allclose(tau, expected, rtol=1e-13)


@pytest.mark.parametrize('terms', SWITCHES)
@pytest.mark.parametrize('motion', [None, MOTION])
def test_gravity_compensation_is_gravity_at_the_measured_pose(terms, motion):
    control = Controller(ROBOT, mode='gravity_compensation', compensate=terms)
    expected = ROBOT.gravity_force(Q) if terms.gravity else np.zeros(2)
    np.testing.assert_array_equal(control.command(T, Q, U, motion).tau, expected)
    np.testing.assert_array_equal(control.command(T, Q, None, motion).tau, expected)


@pytest.mark.parametrize('terms', [Terms(), Terms(gravity=False)])
def test_inverse_dynamics_before_any_motion_is_gravity_at_the_measured_pose(terms):
    tau = Controller(ROBOT, compensate=terms).command(T, Q, U).tau
    np.testing.assert_array_equal(tau, ROBOT.gravity_force(Q) if terms.gravity
                                  else np.zeros(2))


def test_computed_torque_before_any_motion_holds_the_first_measured_pose():
    control = Controller(ROBOT, mode='computed_torque', kp=KP, kd=KD)
    first = Q.copy()
    control.command(0.0, first, np.zeros(2))
    first[:] = 9.0  # the caller's own array may change afterwards
    moved = Q + np.array([0.2, -0.1])
    tau = control.command(0.1, moved, U).tau
    expected = expected_terms(Terms(), moved, U, np.zeros(2), np.zeros(2),
                              -KD * U - KP * [0.2, -0.1])
    np.testing.assert_allclose(tau, expected, rtol=1e-13)


@pytest.mark.parametrize('between', [
    lambda control: control.command(0.1, Q, U, MOTION),
    lambda control: control.stop(),
    lambda control: (control.update(mode='gravity_compensation'),
                     control.update(mode='computed_torque')),
], ids=['a motion', 'a stop', 'another mode'])
def test_a_pose_held_before_is_not_held_again_after(between):
    control = Controller(ROBOT, mode='computed_torque', kp=KP, kd=KD)
    control.command(0.0, Q + 1.0, np.zeros(2))
    between(control)
    tau = control.command(0.2, Q, np.zeros(2)).tau
    np.testing.assert_allclose(tau, expected_terms(Terms(), Q, *[np.zeros(2)] * 3),
                               rtol=1e-14)


def test_motion_time_places_the_motion_on_another_clock():
    on_this_clock = Controller(ROBOT).command(1e6, Q, U, MOTION, motion_time=T).tau
    np.testing.assert_array_equal(on_this_clock,
                                  Controller(ROBOT).command(T, Q, U, MOTION).tau)


def test_computed_torque_closes_the_loop_on_its_own_plant():
    control = Controller(ROBOT, mode='computed_torque', kp=100.0, kd=20.0)
    q = np.array([0.3, -0.2])
    u = np.zeros(2)
    step = 1e-3
    for i in range(2500):
        tau = control.command(i * step, q, u, MOTION).tau
        M = np.diag([MASS * (ARM + q[1]) ** 2, SLIDE])
        terms_at_rest = ROBOT.torque_terms(q, u, np.zeros(2))
        u = u + step * np.linalg.solve(M, tau - terms_at_rest.sum(axis=0))
        q = q + step * u
    np.testing.assert_allclose(q, [0.4, -0.1], atol=5e-3)


def test_torque_is_clamped_to_the_tighter_of_two_limits_and_is_flagged():
    control = Controller(ClosedForm(effort=(1.0, 100.0)), effort_limit=[np.inf, 2.0])
    np.testing.assert_array_equal(control.effort_limit, [1.0, 2.0])
    command = control.command(0.0, np.array([-0.4, 0.0]), U)
    np.testing.assert_array_equal(command.tau, [1.0, -2.0])
    np.testing.assert_array_equal(command.clamped, [True, True])
    assert command.limited and not command.rate_limited.any()


@pytest.mark.parametrize('limit, words', [
    ([0.5, 200.0], "effort_limit: 200 of joint 'slide'; expected at most 100"),
    ([2.0, 50.0], "effort_limit: 2 of joint 'lift'; expected at most 1,"),
    (200.0, "'slide'; expected at most 100, the limit of the robot, or inf")])
def test_an_effort_limit_above_that_of_the_robot_is_refused(limit, words):
    robot = ClosedForm(effort=(1.0, 100.0))
    control = Controller(robot, effort_limit=50.0)  # one number lowers the larger limits
    np.testing.assert_array_equal(control.effort_limit, [1.0, 50.0])
    with pytest.raises(InputError, match=words):
        control.update(effort_limit=limit)
    np.testing.assert_array_equal(control.effort_limit, [1.0, 50.0])


def test_efforts_are_within_the_present_limits_of_the_robot():
    robot = ClosedForm(effort=(50.0, 50.0))
    control = Controller(robot, mode='gravity_compensation', effort_limit=1.0)
    control.command(0.0, Q)
    for effort, expected in ((0.3, 0.3), (50.0, 1.0)):
        robot.limits = ClosedForm(effort=(effort, effort)).limits
        assert np.abs(control.command(0.1, Q).tau).max() == expected
        np.testing.assert_array_equal(control.effort_limit, [expected] * 2)
    robot.limits = ClosedForm(effort=(0.2, 0.2)).limits
    np.testing.assert_array_equal(control.effort_limit, [0.2, 0.2])


def test_torque_changes_no_faster_than_the_rate_limit_and_is_flagged():
    control = Controller(ROBOT, mode='gravity_compensation', rate_limit=[10.0, np.inf])
    desired = ROBOT.gravity_force(Q)
    assert desired[0] > 0.7
    for t, limit in ((5.0, 0.0), (5.01, 0.1), (5.05, 0.5), (5.05, 0.5), (4.0, 0.5),
                     (4.02, 0.7)):
        command = control.command(t, Q)
        np.testing.assert_allclose(command.tau, [limit, desired[1]],
                                   rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(command.rate_limited, [True, False])
        assert not command.clamped.any()
    np.testing.assert_array_equal(control.command(60.0, Q).tau, desired)


def test_clamp_comes_before_the_rate_limit():
    control = Controller(ROBOT, mode='gravity_compensation', effort_limit=0.3,
                         rate_limit=1.0)
    control.command(0.0, Q)
    np.testing.assert_allclose(control.command(0.1, Q).tau, [0.1, 0.1])
    command = control.command(0.9, Q)
    np.testing.assert_allclose(command.tau, [0.3, 0.3])
    assert command.clamped.all() and not command.rate_limited.any()


def test_stop_gives_zeros_past_the_rate_limit_and_the_next_command_starts_from_them():
    control = Controller(ROBOT, mode='gravity_compensation', rate_limit=1.0)
    control.command(0.0, Q)
    control.command(0.5, Q)
    stop = control.stop()
    assert not stop.tau.any() and not stop.limited
    assert not control.command(100.0, Q).tau.any()
    np.testing.assert_allclose(control.command(100.1, Q).tau, [0.1, 0.1])


def test_a_tightened_effort_limit_holds_at_once_in_spite_of_the_rate_limit():
    control = Controller(ROBOT, mode='gravity_compensation', rate_limit=1.0)
    control.command(0.0, Q)
    control.command(2.0, Q)
    control.update(effort_limit=0.5)
    np.testing.assert_array_equal(control.command(2.0, Q).tau, [0.5, 0.5])


def test_an_effort_limit_that_is_lowered_and_raised_between_states_leaves_no_jump():
    control = Controller(ROBOT, mode='gravity_compensation', rate_limit=1.0)
    control.command(0.0, Q)
    torque_before = control.command(2.0, Q).tau.copy()
    control.update(effort_limit=0.1)
    control.update(effort_limit=100.0)
    change = np.abs(control.command(2.1, Q).tau - torque_before)
    assert torque_before.max() > 1.0 and change.max() < 0.1 + 1e-12


def test_a_refused_update_changes_nothing():
    control = Controller(ROBOT, kp=KP, effort_limit=5.0)
    with pytest.raises(InputError):
        control.update(mode='computed_torque', compensate=Terms(gravity=False), kp=1.0,
                       effort_limit=3.0, rate_limit=-1.0)
    assert control.mode is Mode.INVERSE_DYNAMICS and control.compensate == Terms()
    np.testing.assert_array_equal(control.kp, KP)
    np.testing.assert_array_equal(control.effort_limit, [5.0, 5.0])


@pytest.mark.parametrize('mode', OWN_MODES)
@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('which', ['q', 'u'])
def test_a_state_that_is_not_finite_never_makes_a_torque(mode, bad, which):
    control = Controller(ROBOT, mode=mode)
    state = {'q': Q.copy(), 'u': U.copy()}
    state[which][1] = bad
    with pytest.raises(InputError, match=f"'slide': {bad}"):
        control.command(T, **state, motion=MOTION)


def test_opposite_infinities_do_not_cancel():
    with pytest.raises(InputError, match="'lift': inf"):
        Controller(ROBOT).command(T, [np.inf, -np.inf], U)


def test_a_torque_that_overflows_is_refused():
    with pytest.raises(InputError, match='not finite'), np.errstate(over='ignore'):
        Controller(ROBOT, mode='computed_torque', kp=1e300).command(
            T, Q + 1e200, U, MOTION)


@pytest.mark.parametrize('terms', [Terms(), Terms(gravity=False)],
                         ids=['all', 'without gravity'])
def test_a_refused_state_is_no_pose_to_hold(terms):
    control = Controller(ROBOT, mode='computed_torque', compensate=terms)
    with pytest.raises(InputError,
                       match='finite'), np.errstate(over='ignore', invalid='ignore'):
        control.command(T, np.full(2, 1e308), U)
    fresh = Controller(ROBOT, mode='computed_torque', compensate=terms)
    np.testing.assert_array_equal(control.command(T, Q, U).tau,
                                  fresh.command(T, Q, U).tau)


OTHER = Motion.from_points([0.0], [[0.0, 0.0]], joint_names=NAMES[::-1])


@pytest.mark.parametrize(('arguments', 'words'), [
    ((np.nan, Q, U), ['t: nan']),
    ((T, ['a', 'b'], U), ['position', "['a', 'b']", 'lift']),
    ((T, Q[:1], U), ['position', '(1,)', '(2,)', 'slide']),
    ((T, Q, np.zeros((2, 2))), ['speed', '(2, 2)']),
    ((T, Q, None), ['u: missing', 'measured speeds', 'inverse_dynamics']),
    ((T, Q, U, OTHER), ["['slide', 'lift']", "['lift', 'slide']"]),
])
def test_a_bad_state_is_refused_with_the_reason(arguments, words):
    with pytest.raises(InputError) as caught:
        Controller(ROBOT).command(*arguments)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(('settings', 'words'), [
    ({'mode': 'pd'},
     ['pd', 'inverse_dynamics', 'computed_torque', 'gravity_compensation']),
    ({'kp': -1.0}, ['kp', "'lift'", '-1.0', '>= 0']),
    ({'kd': [1.0, np.inf]}, ['kd', "'slide'", 'inf', 'finite']),
    ({'kd': [1.0, 2.0, 3.0]}, ['kd', 'one number, or 2', 'lift']),
    ({'kd': 'stiff'}, ['kd', 'stiff']),
    ({'effort_limit': [np.nan, 1.0]}, ['effort_limit', "'lift'", 'nan']),
    ({'rate_limit': [1.0, -2.0]}, ['rate_limit', "'slide'", '-2.0']),
])
def test_bad_settings_are_refused_with_the_reason(settings, words):
    with pytest.raises(InputError) as caught:
        Controller(ROBOT, **settings)
    for word in words:
        assert word in str(caught.value)


def test_computed_torque_spreads_its_gains_over_the_joints_and_checks_them():
    builder = ModelBuilder()
    builder.body('lift', axis=(0, 1, 0), inertial=point_mass(1.0, (1, 0, 0)))
    builder.body('slide', 'lift', 'prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
    robot = Robot(builder.model())
    np.testing.assert_array_equal(ComputedTorque(robot, MOTION, 4.0, [1.0, 2.0]).kp,
                                  [4.0, 4.0])
    with pytest.raises(InputError, match=r"kd of joint 'slide': -2\.0"):
        ComputedTorque(robot, MOTION, 4.0, [1.0, -2.0])
