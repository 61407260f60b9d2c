"""Laws that take every coordinate for an actuated one refuse elastic joints."""

from kane_dynamics import (ComputedTorque, Controller, controller_kernels, Drive,
                           fill_trajectory, HandGuiding, InputError, JointImpedance,
                           ModelBuilder, Motion, Robot, rod, simulate, TaskSpace,
                           with_drives, with_rigid_joints)
from kane_dynamics.feasibility import demand
from kane_dynamics.identification import excite, identify, Recording
from kane_dynamics.optimal_control import TrajectoryOptimizer
import numpy as np
import pytest

TIMES = np.linspace(0.0, 1.0, 5)


def elastic():
    builder = ModelBuilder('arm')
    builder.body('upper', joint='shoulder', axis=(0, -1, 0),
                 inertial=rod(4.0, (0, 0, 0), (0.5, 0, 0)))
    return with_drives(builder.model(), {'shoulder': Drive(9e3, rotor_inertia=0.8)})


def motion(robot):
    return Motion.from_points(TIMES, np.outer(TIMES, np.ones(robot.n)),
                              joint_names=robot.joint_names)


@pytest.mark.parametrize('law', [
    Controller, controller_kernels, HandGuiding, TrajectoryOptimizer,
    lambda robot: JointImpedance(robot, stiffness=1.0, damping=1.0),
    lambda robot: TaskSpace(robot, 'upper', directions=['z']),
    lambda robot: ComputedTorque(robot, motion(robot)),
    lambda robot: fill_trajectory(robot, TIMES, np.zeros((5, robot.n))),
    lambda robot: excite(robot.model, velocity=1.0, acceleration=1.0, distance=None),
    lambda robot: identify(robot.model, Recording(TIMES, *np.ones((4, 5, 2)))),
])
def test_laws_of_rigid_joints_refuse_elastic_ones(law):
    with pytest.raises(InputError,
                       match='robot: with elastic joints shoulder; expected'):
        law(Robot(elastic()))


def test_computed_torque_that_states_no_robot_is_refused_by_the_simulation():
    robot = Robot(elastic())
    with pytest.warns(DeprecationWarning, match='is deprecated'):
        law = ComputedTorque(motion(robot), 1.0, 1.0)
    with pytest.raises(InputError,
                       match='robot: with elastic joints shoulder; expected'):
        simulate(robot, [0.0, 0.0], [0.0, 0.0], 0.01, torque=law)


def test_the_demand_of_joints_made_rigid_includes_the_rotor():
    robot = Robot(with_rigid_joints(elastic()))
    assert demand(robot, motion(robot)).joint_names == ('shoulder',)
    assert robot.mass_matrix([0.0])[0, 0] == pytest.approx(4.0 * 0.25 / 3.0 + 0.8)
