"""Linear equations of motion, and equilibria."""

from kane_dynamics import (disc, equilibrium, FlexibleLink, InputError, Linearization,
                           linearized, ModelBuilder, Prescribed, Robot, rod)
from kane_dynamics.mechanics.ball_joints import difference, joint_speeds, moved
from kinds_of_mechanism import case
import numpy as np
import pytest

KINDS = [('tree',), ('chosen speeds',), ('closed loop',), ('nonholonomic',),
         ('time-dependent',), ('flexible',), ('free and ball joints',),
         ('closed loop', 'chosen speeds')]


@pytest.mark.parametrize('kinds', KINDS, ids=' and '.join)
def test_the_linear_equations_are_the_slopes_of_the_motion(kinds):
    mechanism = case(*kinds)
    robot = mechanism.robot
    model = robot.model
    q, u, t = mechanism.q, mechanism.u, mechanism.time
    tau = robot.inverse_dynamics(q, u, mechanism.udot, t=t)
    linear = linearized(robot, q, u, tau, t=t)
    assert isinstance(linear, Linearization)
    k = linear.positions.shape[1]
    step = 1e-6
    instant = 1e-3
    reference = joint_speeds(model, q, robot.joint_rates(q, u, t=t))
    later = moved(model, q, instant * reference)

    def rates(x, dtau):
        """Return the rates of deviations x, dtau of size `step`."""
        near = moved(model, q, step * (linear.positions @ x[:k]))
        speeds = u + step * x[k:]
        qdot = robot.joint_rates(near, speeds, t=t)
        speeds_of_joints = joint_speeds(model, near, qdot)
        apart = difference(model, later, moved(model, near, instant * speeds_of_joints))
        rate = (apart - difference(model, q, near)) / (instant * step)
        udot = robot.forward_dynamics(near, speeds, tau + step * dtau, t=t)
        independent = [model.joint_names.index(name) for name in linear.names[:k]]
        return np.concatenate([rate[independent], udot / step])
    n = robot.n
    inputs = [(x, np.zeros(n)) for x in np.eye(k + n)]
    inputs += [(np.zeros(k + n), dtau) for dtau in np.eye(n)]
    for column, (x, dtau) in enumerate(inputs):
        slope = 0.5 * (rates(x, dtau) - rates(-x, -dtau))
        expected = np.concatenate([linear.A, linear.B], axis=1)[:, column]
        # The rates of positions are taken over a finite instant.
        np.testing.assert_allclose(slope, expected, rtol=2e-3,
                                   atol=2e-3 * (1.0 + np.abs(expected).max()))


@pytest.mark.parametrize(('speed', 'frequency'), [
    (0.0, 3.5160), (1.0, 3.6816), (2.0, 4.1373), (3.0, 4.7973), (6.0, 7.3604)])
def test_a_spinning_beam_has_the_published_flapping_frequencies(speed, frequency):
    b = ModelBuilder('blade')
    b.body('hub', axis=(0, 0, 1), inertial=disc(1.0, 0.1))
    b.beam('blade', 'hub', FlexibleLink(1.0, 1.0, 1.0, (3, 0), up=(0, 0, 1)),
           kind='fixed')
    robot = Robot(b.model(), constraints=[Prescribed('hub', lambda t: speed * t)])
    modes = linearized(robot, np.zeros(robot.n_q)).modes()
    lowest = min(value.imag for value, _ in modes if value.imag > 0.0)
    assert lowest == pytest.approx(frequency, rel=1e-3)


def test_modes_have_the_name_of_the_largest_part():
    b = ModelBuilder('two')
    for name, stiffness in (('soft', 1.0), ('stiff', 100.0)):
        b.body(name, axis=(0, 0, 1), stiffness=stiffness,
               inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    modes = linearized(Robot(b.model()), np.zeros(2)).modes()
    names = {round(abs(value), 3): name.removeprefix('rate of ')
             for value, name in modes}
    assert list(names.values()) in (['soft', 'stiff'], ['stiff', 'soft'])
    assert names[round(np.sqrt(3.0), 3)] == 'soft'


def pendulum():
    """Return a double pendulum under gravity, a spring at its second joint."""
    b = ModelBuilder('pendulum')
    b.body('upper', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (0, 0, -1)))
    b.body('lower', 'upper', axis=(0, 1, 0), at=(0, 0, -1), stiffness=2.0, rest=1.0,
           inertial=rod(2.0, (0, 0, 0), (0, 0, -0.7)))
    return Robot(b.model())


@pytest.mark.parametrize('tau', [(0.0, 0.0), (2.0, -1.0)])
def test_newtons_method_finds_the_configuration_that_torques_hold(tau):
    robot = pendulum()
    q, torque = equilibrium(robot, [0.5, -1.0], tau)
    np.testing.assert_array_equal(torque, tau)
    np.testing.assert_allclose(robot.bias_force(q, np.zeros(2)), tau, atol=1e-9)
    assert max(value.real for value, _ in linearized(robot, q).modes()) < 1e-8


def test_a_closed_loop_hangs_in_its_equilibrium():
    robot = case('closed loop').robot
    start = robot.closed_configuration([-1.2, 1.0, 1.5], fixed=['crank'])
    q, _ = equilibrium(robot, start, np.zeros(robot.n))
    residual = robot.bias_force(q, np.zeros(robot.n))
    assert np.abs(residual).max() < 1e-8 * 9.81 * 10.0
    assert np.abs(robot.constraint_residual(q)).max() < 1e-9


def test_torques_hold_a_given_configuration():
    robot = pendulum()
    q, tau = equilibrium(robot, [0.5, -1.0])
    np.testing.assert_array_equal(q, [0.5, -1.0])
    assert np.abs(robot.forward_dynamics(q, np.zeros(2), tau)).max() < 1e-12


def test_torques_that_nothing_holds_are_refused():
    with pytest.raises(InputError, match=r'remain at q = .*expected torques that can'):
        equilibrium(pendulum(), [0.5, -1.0], [1e3, 0.0])
