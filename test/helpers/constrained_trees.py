"""Random trees and closed loops with chosen speeds and a constraint of each kind, for tests."""

from functools import cache

from kane_dynamics import ModelBuilder
from kane_dynamics.mechanics.constraints import (Coupling, DependentSpeeds, knife_edge,
                                                 PointVelocity, Prescribed)
from kane_dynamics.mechanics.constraints.independent_speeds import (choose_independent,
                                                                    closed_posture)
from kane_dynamics.mechanics.constraints.speeds import absolute_rates, momenta, Speeds
from kane_dynamics.model.primitive_inertias import disc, rod
from mechanisms import random_model
import numpy as np

T = 0.7  # s: where rheonomic choices are looked at


def wavy(n, seed):
    """Return smooth speeds of everything, u = Y(q, t) q' + Z(q, t), never singular here."""
    rng = np.random.default_rng(seed)
    constant, wave = rng.normal(size=(2, n, n)) * 0.2

    def Y(q, t):
        return np.array([[constant[r, s] + (2.0 if r == s else 0.0)
                          + wave[r, s] * np.sin(q[s] + 0.3 * t) for s in range(n)]
                         for r in range(n)])

    def Z(q, t):
        return np.array([np.cos(t) * q[r] for r in range(n)])
    return Speeds(Y, Z)


def tree_constraints(frame, base):
    """Return a constraint of each kind that any tree can meet anywhere."""
    return {
        'a point in the world': PointVelocity(frame, (1, 2, 3)),
        'a point in time': PointVelocity(frame, (1, 0, 1), value=lambda t: np.sin(2.0 * t)),
        'a point seen from a body': PointVelocity(frame, (0, 1, 1), axes=base, relative_to=base),
        'an angular velocity': PointVelocity(frame, (0, 0, 1), angular=True, value=0.3),
        'a knife edge': knife_edge(frame, (0, 1, 0)),
        'a coupling': Coupling('joint0', {'joint1': -2.0}, 0.1),
        'a prescribed joint': Prescribed('joint1', lambda t: 0.3 * np.sin(2.0 * t)),
    }


KINDS = [*tree_constraints('', ''), 'speeds of others']


@cache
def tree(seed, kind, speeds):
    """Return a random tree with a constraint, and two of its frames."""
    model = random_model(seed, 5, branching=0.0, prismatic=0.2)
    frame, base = model.frames[-1].name, model.frames[1].name
    chosen = {'rates': None, 'absolute': absolute_rates, 'momenta': momenta,
              'wavy': wavy(5, seed)}[speeds]
    if kind == 'speeds of others':
        names = choose_independent(model, chosen, ()).speed_names
        constraint = DependentSpeeds(names[3:], lambda q, t: np.array(
            [[np.sin(q[0]), 0.5, t], [0.2, np.cos(q[1]), 1.0]]), lambda q, t: np.array([t, q[2]]))
    else:
        constraint = tree_constraints(frame, base)[kind]
    return choose_independent(model, chosen, (constraint,))


def linkage_of_four_bars():
    """Return crank, coupler and rocker of a planar four-bar, its loop cut at the last pin."""
    b = ModelBuilder('four_bar')
    b.body('crank', 'world', axis=(0, 1, 0), matter=rod(1.0, (0, 0, 0), (1, 0, 0)))
    b.body('coupler', 'crank', axis=(0, 1, 0), at=(1, 0, 0), matter=rod(2.0, (0, 0, 0), (3, 0, 0)))
    b.body('rocker', 'world', axis=(0, 1, 0), at=(3, 0, 0),
           matter=rod(1.5, (0, 0, 0), (2.5, 0, 0)))
    b.frame('pin_coupler', 'coupler', at=(3, 0, 0))
    b.frame('pin_rocker', 'rocker', at=(2.5, 0, 0))
    return b.model()


def rolling_disc():
    """Return a thin disc that is free to move anywhere."""
    b = ModelBuilder('disc')
    b.body('disc', 'world', 'floating', turns='zxy', matter=disc(1.0, 0.3, axis=(0, 1, 0)))
    return b.model()


def states(mechanism, seed):
    """Return q, u, udot of a mechanism that moves as it may."""
    rng = np.random.default_rng(seed)
    q = closed_posture(mechanism, rng.uniform(-1.0, 1.0, mechanism.model.n), t=T)
    return q, *rng.uniform(-1.0, 1.0, (2, mechanism.n))
