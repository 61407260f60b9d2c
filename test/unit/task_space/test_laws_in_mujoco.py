"""Laws in task space on arms in MuJoCo: the experiments whose table the docs show."""

from pathlib import Path
import sys

import numpy as np
import pytest
from scipy.optimize import minimize

pytest.importorskip('mujoco')
sys.path.append(str(Path(__file__).resolve().parents[3] / 'benchmarks'))

import task_space_laws as experiments  # noqa: E402, I100
from kane_dynamics import CartesianImpedance, load_urdf, Robot  # noqa: E402, I100

pytestmark = pytest.mark.filterwarnings('ignore::kane_dynamics.errors.ModelWarning')
ARMS = experiments.arms()


def robot_of(arm):
    return Robot(load_urdf(arm.urdf, tip=arm.frame), friction=False)


def check_passage(figures, returns=True):
    """Torques and speeds keep limits, no energy at rest, small errors."""
    assert figures.torque <= 1.0 + 1e-9
    assert figures.speed <= 1.0
    assert figures.energy_rise <= experiments.RISE
    if returns:
        assert figures.error_outside <= experiments.OUTSIDE
        assert figures.error_ordinary <= experiments.ORDINARY_ERROR


@pytest.mark.parametrize('name', ARMS)
def test_the_plant_is_the_model_of_the_law(name):
    arm = ARMS[name]
    robot = robot_of(arm)
    plant = experiments.Plant(robot, arm.urdf)
    plant.reset(arm.home)
    np.testing.assert_allclose(plant.data.qfrc_bias[plant.u_places],
                               robot.gravity_force(arm.home), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize('passage', experiments.PASSAGES,
                         ids=lambda passage: f'{passage.arm}-{passage.what}')
def test_an_arm_is_led_through_a_singular_configuration_within_its_limits(passage):
    arm = ARMS[passage.arm]
    desired = experiments.through(robot_of(arm), arm.frame, passage)
    check_passage(experiments.follow(arm, np.array(passage.start), desired))


@pytest.mark.slow
@pytest.mark.parametrize('name', ARMS)
def test_an_arm_follows_a_target_to_the_edge_of_its_reach_and_back(name):
    arm = ARMS[name]
    desired = experiments.to_the_edge(robot_of(arm), arm.frame, arm.home, 0.0)
    check_passage(experiments.follow(arm, arm.home, desired))


@pytest.mark.slow
@pytest.mark.parametrize('name', ARMS)
def test_an_arm_follows_a_target_beyond_its_reach_and_back_within_its_limits(name):
    arm = ARMS[name]
    desired = experiments.to_the_edge(robot_of(arm), arm.frame, arm.home,
                                      experiments.BEYOND)
    figures = experiments.follow(arm, arm.home, desired)
    # With the default walls the elbow of the FR3 bends to the other side.
    check_passage(figures, returns=name != 'FR3')
    assert figures.error_inside > 0.5 * experiments.BEYOND, 'the target was out of reach'


@pytest.mark.slow
@pytest.mark.parametrize('name', ARMS)
def test_under_a_target_beyond_its_reach_an_arm_rests_where_its_spring_is_shortest(name):
    arm = ARMS[name]
    robot = robot_of(arm)
    desired = experiments.to_the_edge(robot, arm.frame, arm.home, experiments.BEYOND)
    farthest = 0.5 * desired.duration
    target = desired.sample(farthest).pose
    law = CartesianImpedance(robot, arm.frame, stiffness=experiments.STIFFNESS)
    plant = experiments.Plant(robot, arm.urdf)
    plant.reset(arm.home)
    for k in range(int((farthest + 4.0) * experiments.RATE)):
        q, u = plant.state
        sample = desired.sample(min(k / experiments.RATE, farthest))
        plant.step(law.torque(q, u, sample.pose))
    q, u = plant.state
    assert np.abs(u).max() < 1e-4
    distance = np.linalg.norm(robot.frame_pose(arm.frame, q)[:3, 3] - target[:3, 3])
    assert 0.5 * experiments.BEYOND < distance < 1.01 * experiments.BEYOND
    # By another method: no configuration nearby has less energy.
    stored = law.energy(q, target)
    for seed in range(4):
        start = q + 0.05 * np.random.default_rng(seed).normal(size=robot.n)
        optimum = minimize(law.energy, start, (target,), method='L-BFGS-B',
                           options={'ftol': 1e-15, 'gtol': 1e-8, 'maxiter': 2000})
        assert stored == pytest.approx(optimum.fun, rel=1e-6)


@pytest.mark.slow
def test_an_elbow_with_a_wall_before_it_is_straight_comes_back_from_beyond_the_reach():
    arm = ARMS['FR3']
    robot = robot_of(arm)
    desired = experiments.to_the_edge(robot, arm.frame, arm.home, experiments.BEYOND)
    figures = experiments.follow(arm, arm.home, desired, experiments.ELBOW_MARGINS)
    check_passage(figures)
    assert figures.error_inside > 0.5 * experiments.BEYOND, 'the target was out of reach'


@pytest.mark.slow
@pytest.mark.parametrize('stiffness', experiments.STIFFNESSES)
@pytest.mark.parametrize('name', ARMS)
def test_a_press_on_a_stiff_table_does_not_bounce(name, stiffness):
    figures = experiments.press(ARMS[name], stiffness)
    assert figures.losses == 0
    assert figures.mean_error < 0.05
    assert figures.largest_error < 1.0


@pytest.mark.slow
@pytest.mark.parametrize('name', ARMS)
def test_a_force_is_kept_while_a_circle_is_drawn(name):
    figures = experiments.draw_circle(ARMS[name])
    assert figures.losses == 0
    assert figures.force_error <= experiments.FORCE_ERROR
    assert figures.circle_error < 1.5e-3  # the friction of the table over the stiffness


@pytest.mark.slow
@pytest.mark.parametrize('name', ARMS)
def test_a_guided_arm_without_speed_limits_is_not_thrown_past_its_joint_limits(name):
    figures = experiments.thrown_by_hand(ARMS[name])
    assert figures.fastest > 5.0
    assert figures.beyond <= 0.0


@pytest.mark.slow
def test_a_hand_needs_a_fifth_of_the_force_with_20_percent_wrong_friction():
    """As with more friction in the model; recordings without contact."""
    figures = experiments.guiding(ARMS['FR3'])
    assert figures.without > experiments.LIGHTER * figures.more
    for corrected in (figures.exact_recorded, figures.more_recorded,
                      figures.less_recorded):
        assert figures.without > experiments.LIGHTER * corrected
    assert figures.without > 3.0 * figures.exact > 3.0 * figures.more


@pytest.mark.slow
@pytest.mark.parametrize('corrected', [False, True])
@pytest.mark.parametrize('error', [experiments.ERROR, -experiments.ERROR])
def test_an_arm_that_a_hand_lets_go_comes_to_rest(error, corrected):
    arm = ARMS['FR3']
    if corrected:
        law = experiments.corrected_guiding(arm, 1.0 + error)
    else:
        law = experiments.HandGuiding(experiments.with_friction(arm, 1.0 + error))
    figures = experiments.let_go(arm, law)
    assert figures.released > 0.2
    assert figures.rested < experiments.STILL
    assert figures.energy_rise <= experiments.RISE


@pytest.mark.slow
def test_an_arm_at_rest_stays_there_with_a_fifth_too_much_compensation():
    arm = ARMS['FR3']
    law = experiments.HandGuiding(
        experiments.with_friction(arm, 1.0 + experiments.ERROR), friction=1.0)
    assert experiments.drift_at_rest(arm, law) < experiments.STILL


@pytest.mark.slow
def test_compensated_friction_leaves_a_twentieth_of_the_error_at_rest():
    arm = ARMS['FR3']
    model = experiments.with_friction(arm, 1.0)
    without = experiments.friction_errors(arm, model, compensated=False)
    exact = experiments.friction_errors(arm, model)
    assert exact.moving < experiments.OUTSIDE < 0.1 * without.moving
    assert exact.resting < experiments.REMAINING * without.resting
    # A brake of dry friction holds a load too, with and without compensation: at most
    # the whole deflection is missing.
    assert max(without.deflection, exact.deflection) < 20.0 / experiments.STIFFNESS[0]


@pytest.mark.slow
@pytest.mark.parametrize('choice', [{'feedforward': 'ahead'},
                                    {'friction_speed': experiments.NARROW}])
def test_friction_of_a_motion_that_begins_leaves_a_twentieth_of_the_error_in_motion(
        choice):
    arm = ARMS['FR3']
    without = experiments.friction_errors(arm, experiments.with_friction(arm, 1.0),
                                          compensated=False)
    model = experiments.with_friction(arm, 1.0, **choice)
    compensated = experiments.friction_errors(arm, model)
    assert compensated.moving < experiments.REMAINING * without.moving
    assert compensated.resting < experiments.REMAINING * without.resting
    # Likewise with encoders and a late command, and without chatter.
    sensed = experiments.sensed_friction(arm, model)
    assert sensed.moving < experiments.REMAINING * without.moving
    assert sensed.resting < experiments.REMAINING * without.resting
    assert sensed.chatter < experiments.CALM
