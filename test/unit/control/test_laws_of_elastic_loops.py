"""Link-side control and torque feedback of elastic joints in loops and speeds."""

from dataclasses import replace
import pickle

from kane_dynamics import (absolute_rates, Drive, ElasticFeedforward, InputError,
                           JointTorqueFeedback, LinkSideControl, load_urdf, Robot,
                           simulate, SmoothMotion, StiffnessCurve, with_drives)
from kane_dynamics._util.resources import resource_path
from linkages import four_bar_model, PIN
import numpy as np
import pytest

SMOOTH = {'damping': 0.7, 'friction': 1.2, 'friction_speed': 2.0, 'friction_offset': 0.1}
CURVE = StiffnessCurve([0.01, 0.03], [6.0, 40.0], rounding=0.01)
DRIVES = {'table': Drive(900.0, rotor_inertia=0.3, friction=SMOOTH),
          'crank': Drive(CURVE, rotor_inertia=0.2)}
TURN = SmoothMotion.from_points([0.0, 0.8], [[0.3, 0.9], [0.9, 1.6]],
                                joint_names=('table', 'crank'))


def turning_four_bar(drives=DRIVES, **options):
    """Return a four-bar on a turntable, elastic drives, slowly changing friction."""
    bodies = []
    for body in four_bar_model(turntable=True).bodies:
        law = {'damping': 0.2, 'friction': 0.4, 'friction_speed': 2.0}
        bodies.append(replace(body, joint=replace(body.joint, **law)))
    model = replace(four_bar_model(turntable=True), bodies=tuple(bodies))
    return Robot(with_drives(model, drives), constraints=[PIN], **options)


def closed(robot, table, crank):
    """Return the closed configuration at two positions, with motors near their links."""
    q = robot.neutral()
    q[places_of(robot)] = table, crank
    motors = [elastic.motor for elastic in robot.drives]
    q[motors] = table + 0.006, crank + 0.012
    fixed = (*TURN.joint_names, *(elastic.drive.motor for elastic in robot.drives))
    return robot.closed_configuration(q, fixed=fixed)


def places_of(robot):
    """Return the indices of table and crank."""
    return [robot.joint_names.index(name) for name in TURN.joint_names]


def accelerations_after(robot, q, u, tau, time):
    """Return the accelerations of table and crank after a time, or before."""
    def rates(q, u):
        return robot.joint_rates(q, u), robot.forward_dynamics(q, u, tau)
    steps = 20
    h = time / steps
    for _ in range(steps):  # of the classical Runge-Kutta method
        first = rates(q, u)
        second = rates(q + 0.5 * h * first[0], u + 0.5 * h * first[1])
        third = rates(q + 0.5 * h * second[0], u + 0.5 * h * second[1])
        fourth = rates(q + h * third[0], u + h * third[1])
        q = q + h / 6.0 * (first[0] + 2.0 * second[0] + 2.0 * third[0] + fourth[0])
        u = u + h / 6.0 * (first[1] + 2.0 * second[1] + 2.0 * third[1] + fourth[1])
    udot = robot.forward_dynamics(q, u, tau)
    return robot.joint_accelerations(q, u, udot)[places_of(robot)]


@pytest.mark.parametrize('independent', [
    None, pytest.param(('table', 'rocker', 'table_motor', 'crank_motor'),
                       marks=pytest.mark.slow)])
def test_joints_of_a_loop_get_the_fourth_derivative_that_is_wanted(independent):
    robot = turning_four_bar(**({'independent': independent} if independent else {}))
    w = 20.0
    control = LinkSideControl(robot, TURN, bandwidth=w)
    q = closed(robot, 0.5, 1.2)
    u = 0.3 * np.random.default_rng(0).normal(size=robot.n)
    t = 0.3
    tau = control(t, q, u)
    # Derivatives of the joints' accelerations while the torque is held.
    h = 3e-4
    back = accelerations_after(robot, q, u, tau, -h)
    present = accelerations_after(robot, q, u, tau, 0.0)
    ahead = accelerations_after(robot, q, u, tau, h)
    jerk = (ahead - back) / (2.0 * h)
    snap = (ahead - 2.0 * present + back) / h**2
    position = q[places_of(robot)]
    rate = robot.joint_rates(q, u)[places_of(robot)]
    desired = TURN.sample(t)
    commanded = (
        desired.snap + w**4 * (desired.q - position) + 4.0 * w**3 * (desired.u - rate)
        + 6.0 * w**2 * (desired.udot - present) + 4.0 * w * (desired.jerk - jerk))
    np.testing.assert_allclose(snap, commanded,
                               rtol=0, atol=1e-3 * np.abs(commanded).max())


def test_a_copy_by_pickle_has_the_same_law():
    robot = turning_four_bar()
    control = LinkSideControl(robot, TURN, bandwidth=[20.0, 30.0])
    copy = pickle.loads(pickle.dumps(control))
    state = closed(robot, 0.5, 1.2), 0.3 * np.random.default_rng(0).normal(size=robot.n)
    np.testing.assert_array_equal(copy(0.3, *state), control(0.3, *state))


@pytest.mark.slow
def test_errors_of_a_loop_decay_with_four_equal_poles():
    robot = turning_four_bar()
    w = 20.0
    e0 = 0.01
    resting = SmoothMotion.from_points([0.0, 1.0], [[0.5, 1.2], [0.5, 1.2]],
                                       joint_names=('table', 'crank'))
    control = LinkSideControl(robot, resting, bandwidth=w)
    q = closed(robot, 0.5 - e0, 1.2 - e0)
    # The deflections that hold the links there.
    feedforward = ElasticFeedforward(robot)
    links = [robot.coordinate_names.index(name) for name in feedforward.joint_names]
    rows = feedforward(q[links], *np.zeros((4, 2)))
    for elastic in robot.drives:
        q[elastic.motor] = rows[3, feedforward.joint_names.index(elastic.name)]
    run = simulate(robot, q, np.zeros(robot.n), 0.3,
                   step=1e-4, torque=control, sample=0.01)
    x = w * run.t
    expected = e0 * np.exp(-x) * (1.0 + x + x**2 / 2.0 + x**3 / 6.0)
    error = np.array([0.5, 1.2]) - run.q[:, places_of(robot)]
    np.testing.assert_allclose(error, np.tile(expected, (2, 1)).T, atol=0.02 * e0)


def test_trees_with_chosen_speeds_have_the_torques_of_joint_rates():
    rigid = load_urdf(resource_path('urdf', 'two_link.urdf'))
    names = rigid.joint_names
    model = with_drives(rigid,
                        {name: Drive(300.0, rotor_inertia=0.05) for name in names})
    plain = Robot(model)
    chosen = Robot(model, speeds=absolute_rates)
    motion = SmoothMotion.from_points([0.0, 0.5], [[0.3, -0.8], [0.8, -0.1]],
                                      joint_names=names)
    rng = np.random.default_rng(1)
    q = np.tile([0.4, -0.7], 2) + 0.01 * rng.normal(size=4)
    rates = rng.normal(size=4)
    Y, Z = chosen.mechanism.speeds.of(q, 0.0)
    u = np.asarray(Y, dtype=float) @ rates + Z
    laws = [LinkSideControl(robot, motion, bandwidth=20.0) for robot in (plain, chosen)]
    expected = laws[0](0.2, q, rates)
    np.testing.assert_allclose(chosen.joint_torques(laws[1](0.2, q, u), q), expected,
                               rtol=1e-10, atol=1e-10 * np.abs(expected).max())


RIGID_ROCKER = 'table_motor', 'crank_motor', 'table', 'rocker'


@pytest.mark.parametrize('actuated', [None, RIGID_ROCKER])
def test_torque_feedback_of_a_loop_gives_the_motors_the_stated_inertia(actuated):
    drives = {name: replace(drive, friction={}, damping=0.5)
              for name, drive in DRIVES.items()}
    robot = turning_four_bar(drives, actuated=actuated)
    inertia = {'table': 0.05, 'crank': 0.4, 'rocker': 1.0}
    names = ('table', 'crank', 'rocker') if actuated else TURN.joint_names
    feedback = JointTorqueFeedback(robot, inertia=[inertia[name] for name in names])
    assert feedback.joint_names == names
    shaped = turning_four_bar({name: replace(drive, rotor_inertia=inertia[name])
                               for name, drive in drives.items()})
    q = closed(robot, 0.5, 1.2)
    rng = np.random.default_rng(2)
    u = rng.normal(size=robot.n)
    torque = rng.normal(size=len(names))
    actual = robot.forward_dynamics(q, u, feedback.torque(q, u, torque))
    torques = np.zeros(robot.model.n)
    torques[[elastic.motor for elastic in robot.drives]] = torque[:2]
    if actuated:
        torques[robot.joint_names.index('rocker')] = torque[2]
    expected = shaped.forward_dynamics(q, u, shaped.generalized_force(torques, q))
    np.testing.assert_allclose(actual, expected, rtol=1e-9)


def test_loops_whose_links_the_drives_do_not_determine_are_refused():
    further = {**DRIVES, 'rocker': Drive(500.0, rotor_inertia=0.1)}
    with pytest.raises(InputError, match='expected 2, as many as independent speeds'):
        LinkSideControl(turning_four_bar(further), TURN)
    with pytest.raises(InputError, match=r"rigid joints \['rocker'\]; expected a drive"):
        LinkSideControl(turning_four_bar(actuated=RIGID_ROCKER), TURN)
    with pytest.raises(InputError, match='motion: of rocker; expected 2 of'):
        LinkSideControl(turning_four_bar(), SmoothMotion.from_points(
            [0.0, 1.0], [[0.0], [0.1]], joint_names=['rocker']))
