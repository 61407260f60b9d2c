"""Linkages whose motion is known, for tests of what is watched under constraints."""

from functools import cache

from kane_dynamics import Closure, disc, Inertial, knife_edge, ModelBuilder, Robot, rod
import numpy as np

PIN = Closure('end', 'ground', 'revolute', axis=(0, 1, 0), name='pin')
SLOPE, SPIN = 0.3, 1.7  # rad, rad/s


@cache
def four_bar_model(turntable=False, bars=(0.3, 0.9, 0.7), span=1.0):
    """Return crank, coupler and rocker, on a turntable or not, with frames to close the loop."""
    b = ModelBuilder('four-bar')
    base = 'world'
    if turntable:
        b.body('table', axis=(0, 0, 1), matter=disc(20.0, 0.5))
        base = 'table'
    b.frame('base', base)
    on, at = 'base', (0, 0, 0)
    for name, length in zip(('crank', 'coupler', 'rocker'), bars):
        b.body(name, on, axis=(0, -1, 0), at=at,
               matter=rod(2.0 * length, (0, 0, 0), (length, 0, 0)))
        on, at = name, (length, 0, 0)
    b.frame('end', on, at=at)
    b.frame('ground', 'base', at=(span, 0, 0))
    b.frame('middle', 'coupler', at=(0.45, 0, 0.1))
    return b.model()


@cache
def four_bar(*independent, turntable=False, redundant='minimum_norm'):
    """Return the linkage with these independent speeds, or by default."""
    return Robot(four_bar_model(turntable), constraints=[PIN], redundant=redundant,
                 independent=independent or None)


@cache
def at_angle(angle):
    """Return the closed configuration of the four-bar at a crank angle, rad."""
    return four_bar('crank').closed_posture((angle, 0.0, -1.5), fixed=['crank'])


@cache
def sleigh(*independent):
    """Return a body on a runner that slides down a slope (Kane & Levinson's knife edge)."""
    b = ModelBuilder('sleigh', gravity=(0, 9.81 * np.sin(SLOPE), -9.81 * np.cos(SLOPE)))
    b.body('body', kind='planar', matter=Inertial(2.0, (0, 0, 0), 0.4 * np.eye(3)))
    return Robot(b.model(), constraints=[knife_edge('body', (0, 1, 0), name='runner')],
                 independent=independent or None)


def sleigh_path(t):
    """Return where the sleigh is at times, (K, 2), m, in closed form."""
    c, w = 9.81 * np.sin(SLOPE) / SPIN, SPIN
    return np.array([c * (np.sin(w * t) / w - t / 2 - np.sin(2 * w * t) / (4 * w)),
                     c * ((1 - np.cos(w * t)) / w - np.sin(w * t)**2 / (2 * w))]).T
