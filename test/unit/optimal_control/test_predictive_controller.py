"""Predictive control: a target is reached, a motion is tracked, friction in the model helps."""

from functools import cache

from kane_dynamics import load_urdf, Motion, Robot, simulate
from kane_dynamics._util.resources import resource_path
from kane_dynamics.optimal_control import CostWeights, PredictiveController, TrajectoryOptimizer
import numpy as np

CYCLE, INTERVAL, NODES = 0.004, 0.02, 15
FRICTION = {'friction': 3.0, 'friction_speed': 0.05, 'damping': 1.0}
START, GOAL = np.array([0.2, 0.4]), np.array([0.8, -0.4])
LIMITS = np.array([60.0, 20.0])


@cache
def arm(friction=True):
    """Return a two-link arm with Coulomb friction, and its model without."""
    path = resource_path('urdf', 'two_link.urdf')
    joints = dict.fromkeys(load_urdf(path).joint_names, FRICTION)
    return Robot(load_urdf(path, supplement={'joints': joints}), friction=friction)


def controlled(robot, target, seconds, **weights):
    """Return the trajectory of the arm with friction, and the controller with this model."""
    controller = PredictiveController(TrajectoryOptimizer(
        robot, nodes=NODES, interval=INTERVAL, torque_limits=LIMITS, speed_limits=4.0,
        weights=CostWeights(**weights)))
    controller.set_target(target)
    path = simulate(arm(), START, [0.0, 0.0], seconds, step=CYCLE, sample=CYCLE,
                    integrator='implicit',
                    torque=lambda t, q, u: controller.torque(q, u, CYCLE))
    return path, controller


def test_a_target_is_reached_within_the_limits():
    path, controller = controlled(arm(), GOAL, 1.5)
    assert np.abs(path.q[-1] - GOAL).max() < 2e-3
    assert (np.abs(path.tau) <= LIMITS).all()
    assert (np.abs(path.tau) == LIMITS).any()
    assert np.abs(path.u).max() < 4.0 * 1.05
    assert controller.solution.tau.shape == (NODES, 2)


def test_friction_in_the_model_tracks_better_on_the_arm_with_friction():
    motion = Motion.from_points([0.0, 0.7, 1.4], [START, GOAL, START],
                                joint_names=arm().joint_names)
    errors = []
    for robot in (arm(), arm(friction=False)):
        path, _ = controlled(robot, motion, 1.4)
        q = motion.sample(path.t)[0]
        errors.append(np.sqrt(np.mean((path.q - q)**2)))
    assert errors[0] < 0.5 * errors[1], errors


def test_a_new_target_counts_in_the_next_cycle():
    path, controller = controlled(arm(), START, 0.1)
    before = controller.torque(path.q[-1], path.u[-1], CYCLE)
    controller.set_target(GOAL)
    assert np.abs(controller.torque(path.q[-1], path.u[-1], CYCLE) - before).max() > 1.0
