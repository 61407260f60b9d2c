"""Constraint rows in the axes of least arithmetic: same numbers, fewer products."""

from kane_dynamics import box, disc, knife_edge, ModelBuilder, Robot, Rolling
import numpy as np
import pytest


def rolling_disc():
    b = ModelBuilder('disc')
    b.body('disc', kind='floating', turns='zxy', at=(0, 0, 0.5),
           inertial=disc(1.0, 0.5, axis=(0, 1, 0)))
    return Robot(b.model(), constraints=[Rolling('disc', 0.5, axis=(0, 1, 0))])


def wheeled_base():
    b = ModelBuilder('base')
    b.body('chassis', kind='planar', inertial=box(10.0, (0.5, 0.3, 0.1)))
    for name, y in (('left', 0.2), ('right', -0.2)):
        b.body(name, 'chassis', axis=(0, 1, 0), at=(0, y, 0.1),
               inertial=disc(0.5, 0.1, axis=(0, 1, 0)))
    return Robot(b.model(), constraints=[Rolling(name, 0.1, axis=(0, 1, 0))
                                         for name in ('left', 'right')])


def sleigh():
    b = ModelBuilder('sleigh')
    b.body('body', kind='planar', inertial=box(1.0, (0.5, 0.3, 0.1)))
    b.frame('runner', 'body', at=(-0.1, 0, 0))
    return Robot(b.model(), constraints=[knife_edge('runner', (0, 1, 0))])


@pytest.mark.parametrize('make', [rolling_disc, wheeled_base, sleigh])
def test_rows_are_those_of_the_definition_and_inverse_to_n(make):
    robot = make()
    rng = np.random.default_rng(3)
    mechanism = robot.mechanism
    links = robot.equations.tree.geometry
    for _ in range(5):
        q = robot.closed_configuration(rng.uniform(-0.8, 0.8, robot.n_q))
        u, udot = rng.uniform(-1.0, 1.0, (2, robot.n))
        defined = np.array(mechanism.rows(mechanism.state(q)).J, float)
        compiled = np.array(mechanism.rows(mechanism.state(q, links=links)).J, float)
        np.testing.assert_allclose(compiled, defined, atol=1e-14)
        for compiled_links in (None, links):
            N = np.array(mechanism.joint_motion(q, u, udot, links=compiled_links).N,
                         float)
            np.testing.assert_allclose(defined[mechanism.kept] @ N,
                                       np.eye(len(mechanism.kept)), atol=1e-12)


# Multiplications with rows in world axes and no watch, which fixed rows need not turn: a
# wheel that rolls freely 148, the base 83, the sleigh 31.
@pytest.mark.parametrize('make, most',
                         [(rolling_disc, 170), (wheeled_base, 95), (sleigh, 31)])
def test_forward_dynamics_takes_at_most_a_fraction_more_than_in_world_axes(make, most):
    program = make().kernels.program('forward_dynamics')
    assert program.operation_count().multiplications <= most
