"""Wheels and blades: forces of constraints do not depend on the heading."""

import functools

from kane_dynamics import box, disc, ModelBuilder, PointVelocity, Robot, rod, Rolling
import numpy as np
import pytest

HEADINGS = (0.3, np.pi / 4, np.pi / 2 - 1e-4, np.pi / 2, 2.0, np.pi, -2.5)


@functools.cache
def vehicle(kind):
    """Return a cart on two wheels or a blade, on ground or turntable; and q."""
    b = ModelBuilder(kind)
    on_table = kind != 'ground'
    base = 'table' if on_table else 'world'
    if on_table:
        b.body('table', axis=(0, 0, 1), inertial=disc(10.0, 1.0))
    b.body('cart', base, kind='planar',
           inertial=box(5.0, (0.6, 0.4, 0.2), at=(0.1, 0, 0.2)))
    constraints = []
    q = [*[0.7] * on_table, 0.2, -0.1, 0.3]
    if kind == 'blade':
        constraints.append(
            PointVelocity('cart', (0, 1, 0), axes='cart', relative_to='table'))
    else:
        for side, y in (('left', 0.25), ('right', -0.25)):
            b.body(side, 'cart', axis=(0, 1, 0), at=(0, y, 0.1),
                   inertial=disc(0.5, 0.1, axis=(0, 1, 0)))
            constraints.append(Rolling(side, 0.1, axis=(0, 1, 0),
                                       surface_frame='table' if on_table else None))
            q.append(0.4)
    b.body('arm', 'cart', axis=(0, -1, 0), at=(0.2, 0, 0.3),
           inertial=rod(1.0, (0, 0, 0), (0.4, 0.1, 0)))
    wheels = ('cart/x', 'cart/rz') if kind == 'blade' else ('left', 'right')
    return Robot(b.model(), constraints=constraints, configuration=[*q, 0.5],
                 independent=('table',) * on_table + wheels + ('arm',)), np.array(
                     [*q, 0.5])


def figures(kind, heading):
    """Return forces, reactions in axes that turn, udot, residuals of one motion."""
    robot, q = vehicle(kind)
    q = q.copy()
    n = robot.n
    c = np.cos(heading)
    s = np.sin(heading)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    if kind == 'ground':
        q[:2], q[2] = R[:2, :2] @ q[:2], q[2] + heading
    else:
        q[0] += heading
    u = np.linspace(0.5, 1.5, n)
    tau = np.linspace(-1.0, 2.0, n)
    udot = robot.forward_dynamics(q, u, tau)
    reactions = robot.joint_reactions(q, u, udot)[-2:].reshape(2, 2, 3)  # world axes
    return {'force': robot.constraint_forces(q, u, tau), 'reaction': reactions @ R,
            'udot': udot, 'residual': robot.constraint_residual(q),
            'velocity': robot.constraint_velocity_residual(q, u)}


@pytest.mark.parametrize('kind', ['ground', 'turntable', 'blade'])
def test_forces_of_wheels_and_blades_do_not_depend_on_the_heading(kind):
    at_zero = figures(kind, 0.0)
    assert np.abs(at_zero['force']).max() > 0.1
    assert np.abs(at_zero['reaction']).max() > 1.0
    for heading in HEADINGS:
        for name, x in figures(kind, heading).items():
            np.testing.assert_allclose(x, at_zero[name],
                                       rtol=0.0, atol=1e-9, err_msg=name)
