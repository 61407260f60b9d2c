"""Linkages whose motion is known, for tests of what is watched under constraints."""

from functools import cache

from kane_dynamics import Closure, disc, Inertial, knife_edge, ModelBuilder, Robot, rod
import numpy as np

PIN = Closure('end', 'ground', 'revolute', axis=(0, 1, 0), name='pin')
# rad, rad/s
SLOPE = 0.3
SPIN = 1.7
# m, bars of each arm of the five-bar, and between the arms
ARM = (0.4, 0.7)
SPAN = 0.5


@cache
def four_bar_model(turntable=False, bars=(0.3, 0.9, 0.7), span=1.0):
    """Return crank, coupler and rocker, on a turntable or not, with closing frames."""
    b = ModelBuilder('four-bar')
    base = 'world'
    if turntable:
        b.body('table', axis=(0, 0, 1), inertial=disc(20.0, 0.5))
        base = 'table'
    b.frame('base', base)
    on = 'base'
    at = (0, 0, 0)
    for name, length in zip(('crank', 'coupler', 'rocker'), bars):
        b.body(name, on, axis=(0, -1, 0), at=at,
               inertial=rod(2.0 * length, (0, 0, 0), (length, 0, 0)))
        on = name
        at = (length, 0, 0)
    b.frame('end', on, at=at)
    b.frame('ground', 'base', at=(span, 0, 0))
    b.frame('middle', 'coupler', at=(0.45, 0, 0.1))
    return b.model()


@cache
def four_bar(*independent, turntable=False):
    """Return the linkage with these independent speeds, or by default."""
    return Robot(four_bar_model(turntable), constraints=[PIN],
                 independent=independent or None)


@cache
def at_angle(angle):
    """Return the closed configuration of the four-bar at a crank angle, rad."""
    return four_bar('crank').closed_configuration((angle, 0.0, -1.5), fixed=['crank'])


@cache
def sleigh(*independent):
    """Return a body on a runner that slides down (Kane & Levinson's knife edge)."""
    b = ModelBuilder('sleigh', gravity=(0, 9.81 * np.sin(SLOPE), -9.81 * np.cos(SLOPE)))
    b.body('body', kind='planar', inertial=Inertial(2.0, (0, 0, 0), 0.4 * np.eye(3)))
    return Robot(b.model(), constraints=[knife_edge('body', (0, 1, 0), name='runner')],
                 independent=independent or None)


def sleigh_path(t):
    """Return where the sleigh is at times, (K, 2), m, in closed form."""
    c = 9.81 * np.sin(SLOPE) / SPIN
    w = SPIN
    return np.array([c * (np.sin(w * t) / w - t / 2 - np.sin(2 * w * t) / (4 * w)),
                     c * ((1 - np.cos(w * t)) / w - np.sin(w * t)**2 / (2 * w))]).T


@cache
def five_bar(*actuated, weights=(), wrench_frames=()):
    """Return two arms of two bars each, joined at their tips: two degrees of freedom."""
    b = ModelBuilder('five-bar')
    for arm, x in (('left', 0.0), ('right', SPAN)):
        on = 'world'
        at = (x, 0, 0)
        for name, length in zip(('crank', 'bar'), ARM):
            b.body(f'{arm}_{name}', on, axis=(0, -1, 0), at=at,
                   inertial=rod(2.0 * length, (0, 0, 0), (length, 0, 0)))
            on = f'{arm}_{name}'
            at = (length, 0, 0)
        b.frame(f'{arm}_tip', on, at=at)
    tip = Closure('left_tip', 'right_tip', 'revolute', axis=(0, 1, 0), name='tip')
    names = dict(zip(actuated, weights)) if weights else actuated or None
    return Robot(b.model(), constraints=[tip], actuated=names, friction=False,
                 independent=('left_crank', 'right_crank'), wrench_frames=wrench_frames)


def five_bar_at(left, right):
    """Return the closed configuration with the tip above, (4,), by two circles."""
    ends = [np.array([x + ARM[0] * np.cos(a), ARM[0] * np.sin(a)])
            for x, a in ((0.0, left), (SPAN, right))]
    across = ends[1] - ends[0]
    half = 0.5 * np.linalg.norm(across)
    up = np.array([-across[1], across[0]]) / (2.0 * half)
    tip = ends[0] + 0.5 * across + np.sqrt(ARM[1]**2 - half**2) * up
    angles = [np.arctan2(*(tip - end)[::-1]) for end in ends]
    return np.array([left, angles[0] - left, right, angles[1] - right])


def five_bar_partial_rates(q):
    """Return T, (4, 2), from the velocities of the two tips."""
    columns = []
    for first, second in (q[:2], q[2:]):
        outer = first + second
        both = ARM[1] * np.array([-np.sin(outer), np.cos(outer)])
        columns += [both + ARM[0] * np.array([-np.sin(first), np.cos(first)]), both]
    J = np.array([columns[0], columns[1], -columns[2], -columns[3]]).T
    dependent = -np.linalg.solve(J[:, [1, 3]], J[:, [0, 2]])
    T = np.zeros((4, 2))
    T[[0, 2]] = np.eye(2)
    T[[1, 3]] = dependent
    return T
