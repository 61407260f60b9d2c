"""Limits that hold for every robot within a box of uncertain parameters."""

from dataclasses import replace

from kane_dynamics import (Inertial, InputError, Limits, ModelBuilder, Motion,
                           point_mass, Robot, Uncertainty)
from kane_dynamics.feasibility import demand, fastest, time_optimal
from kane_dynamics.mechanics.recursive.regressor import (inertial_parameters,
                                                         pseudo_inertia_of)
from kane_dynamics.robot.parameters import JointLimits
from linkages import at_angle, four_bar_model, PIN
from mechanisms import random_model
import numpy as np
import pytest


def arm(effort=150.0):
    """Return an arm with friction and limits of effort."""
    model = random_model(5, 3, branching=0.0)
    bodies = [replace(body, joint=replace(body.joint, limits=Limits(effort=effort)))
              for body in model.bodies]
    return Robot(replace(model, bodies=tuple(bodies)))


def course(robot, seed=0):
    """Return a random motion through five points."""
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (5, 3))
    return Motion.from_points(np.linspace(0.0, 2.0, 5), points,
                              joint_names=robot.joint_names)


def other_robots(robot, uncertainty, count):
    """Yield robots at random vertices of a small box around the inertial parameters."""
    rng = np.random.default_rng(3)
    for _ in range(count):
        sign = rng.choice([-1.0, 1.0], uncertainty.inertial.shape)
        parameters = inertial_parameters(robot.model).reshape(-1, 10)
        parameters = parameters + sign * uncertainty.inertial
        bodies = []
        for body, numbers in zip(robot.model.bodies, parameters, strict=True):
            inertial = Inertial.from_pseudo_inertia(pseudo_inertia_of(numbers))
            bodies.append(replace(body, inertial=inertial))
        yield Robot(replace(robot.model, bodies=tuple(bodies)), **robot.options)


def box(robot, share=1e-3):
    """Return a small box of inertial parameters; each vertex is a robot."""
    inertial = share * np.abs(inertial_parameters(robot.model).reshape(-1, 10))
    nothing = np.zeros(len(robot.model.bodies))
    return Uncertainty(inertial, nothing, nothing, nothing, nothing)


def test_demand_with_uncertainty_is_that_of_the_worst_robot():
    robot = arm()
    motion = course(robot)
    uncertain = box(robot)
    needed = demand(robot, motion, uncertainty=uncertain)
    np.testing.assert_array_equal(needed.tau, demand(robot, motion).tau)
    bounds = robot.torque_bounds(needed.q, needed.u, needed.udot, uncertain)
    np.testing.assert_allclose(needed.tau + needed.deviation, bounds.upper, rtol=1e-12)
    largest = np.abs(needed.tau) + needed.deviation
    np.testing.assert_allclose(needed.uses['effort'], largest.max(axis=0) / 150.0)
    for drawn_robot in other_robots(robot, uncertain, 5):
        tau = drawn_robot.inverse_dynamics(needed.q, needed.u, needed.udot)
        assert (np.abs(tau) <= largest + 1e-9).all()


def test_the_highest_speed_with_uncertainty_is_where_the_largest_torque_is_the_limit():
    robot = arm()
    motion = course(robot)
    uncertain = Uncertainty.of(robot.model, mass=0.1, com=0.02, inertia=0.1,
                               friction=0.3)
    sure = fastest(robot, motion)
    time_scale = fastest(robot, motion, uncertainty=uncertain)
    assert time_scale.speed < sure.speed
    assert time_scale.limit == 'effort'
    at_limit = demand(robot, motion, speed=time_scale.speed, uncertainty=uncertain)
    assert at_limit.fits
    assert at_limit.uses['effort'].max() == pytest.approx(1.0, abs=1e-7)
    assert not demand(
        robot, motion, speed=1.001 * time_scale.speed, uncertainty=uncertain).fits
    none = Uncertainty.of(robot.model)
    assert fastest(robot, motion, uncertainty=none).speed == pytest.approx(
        sure.speed, rel=1e-9)


def test_demand_of_a_loop_bounds_the_torques_of_its_actuators():
    robot = Robot(four_bar_model(), constraints=[PIN], configuration=at_angle(0.9))
    motion = Motion.from_points([0.0, 1.0, 2.0], [[0.9], [1.2], [1.0]],
                                joint_names=robot.joint_names[:1])
    uncertain = box(robot)
    needed = demand(robot, motion, uncertainty=uncertain)
    assert needed.deviation.shape == needed.tau.shape
    assert (needed.deviation.max(axis=1) > 0.0).all()
    largest = np.abs(needed.tau) + needed.deviation
    for drawn_robot in other_robots(robot, uncertain, 4):
        assert (np.abs(demand(drawn_robot, motion).tau) <= largest + 1e-9).all()


def test_uncertainty_with_bending_is_refused():
    robot = arm()
    with pytest.raises(InputError,
                       match='uncertainty: given with bending; expected one'):
        fastest(robot, course(robot), bending=object(), uncertainty=box(robot))


def test_the_fastest_timing_of_an_uncertain_slide_is_that_of_the_heaviest_one():
    builder = ModelBuilder('slide', gravity=(0, 0, 0))
    builder.body('block', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(2.0),
                 limits=Limits(effort=10.0))
    robot = Robot(builder.model())
    uncertain = Uncertainty.of(robot.model, mass=0.25)
    timing = time_optimal(robot, [[0.0], [1.0]], uncertainty=uncertain)
    # Full force of the heaviest block there, and as much back: s = F / (4 m) T^2.
    assert timing.duration == pytest.approx(np.sqrt(4.0 * 2.5 / 10.0), rel=1e-3)
    np.testing.assert_allclose(np.abs(timing.tau[5:20]), 8.0, rtol=2e-3)
    np.testing.assert_allclose(timing.deviation[5:20], 2.0, rtol=2e-3)


def test_the_fastest_timing_keeps_the_limits_of_every_robot_in_the_box():
    robot = arm(effort=60.0)
    path = course(robot)
    uncertain = box(robot, share=0.02)
    sure = time_optimal(robot, path)
    timing = time_optimal(robot, path, uncertainty=uncertain)
    scaled = fastest(robot, path, uncertainty=uncertain)
    assert sure.duration < timing.duration < path.duration / scaled.speed
    # Between the points too, by the definition of the bounds: as much as possible, no
    # more.
    needed = timing.demand
    assert needed.deviation.any()
    assert max(use.max() for use in needed.uses.values()) == pytest.approx(1.0, abs=1e-3)
    within = np.abs(needed.tau) + needed.deviation
    for drawn_robot in other_robots(robot, uncertain, 3):
        tau = drawn_robot.inverse_dynamics(needed.q, needed.u, needed.udot)
        assert (np.abs(tau) <= within + 1e-9).all()
    # Nearly always one limit is used, as without uncertain parameters.
    largest = np.max([use.max(axis=1) for use in timing.uses.values()], axis=0)
    assert (largest > 0.99).mean() > 0.95


def test_the_fastest_timing_of_a_loop_keeps_the_bounds_of_its_actuators():
    robot = Robot(four_bar_model(), constraints=[PIN], configuration=at_angle(0.9))
    largest = 1.3 * np.abs(demand(robot, slow_crank(robot)).tau).max(axis=0)
    robot.limits = JointLimits(robot.limits.lower, robot.limits.upper,
                               robot.limits.velocity, np.maximum(largest, 1e-3))
    uncertain = box(robot, share=0.05)
    timing = time_optimal(robot, slow_crank(robot), uncertainty=uncertain)
    assert timing.duration > time_optimal(robot, slow_crank(robot)).duration
    uses = timing.demand.uses['effort']
    assert uses.max() == pytest.approx(1.0, abs=1e-3)


def slow_crank(robot):
    """Return a slow motion of a crank."""
    return Motion.from_points([0.0, 30.0, 60.0], [[0.9], [1.2], [1.0]],
                              joint_names=robot.joint_names[:1])


def test_a_box_that_the_motors_cannot_hold_has_no_timing():
    robot = arm(effort=60.0)
    uncertain = box(robot, share=3.0)
    with pytest.raises(InputError,
                       match=r'torque .* at rest .* at most its effort limit 60'):
        time_optimal(robot, course(robot), uncertainty=uncertain)


@pytest.mark.parametrize('limit', ['jerk', 'torque_rate', 'power'])
def test_limits_that_do_not_know_uncertain_parameters_are_refused(limit):
    robot = arm()
    with pytest.raises(InputError,
                       match='uncertainty: given with a limit of power, jerk'):
        time_optimal(robot, course(robot), uncertainty=box(robot), **{limit: 100.0})


def test_an_uncertainty_is_a_box():
    robot = arm()
    with pytest.raises(InputError, match='uncertainty: a float; expected a'):
        time_optimal(robot, course(robot), uncertainty=0.1)
