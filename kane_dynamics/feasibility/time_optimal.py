"""Fastest motion along a path within limits of torque, power, speed and acceleration."""

from dataclasses import dataclass
import math
from typing import NamedTuple

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.path_geometry import path_of, Section, sections
from kane_dynamics.feasibility.path_limits import Bounds, PathLimits
from kane_dynamics.feasibility.path_timing import timed
from kane_dynamics.feasibility.reachability import (controllable_sets, fastest_profile,
                                                    Infeasible)
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

POINTS = 1000
CONVERGED = 1e-5  # relative change of x of the last linear program
PROGRAMS = 40  # linear programs at most
EXCESS = 3e-4  # relative, of a limit between vertices, that is accepted
ROUNDS = 8  # in which limits are tightened
INSIDE = np.array([0.25, 0.5, 0.75])


def solve(limits, first, last, x=None):
    limited = limits.at(x)
    for k in range(PROGRAMS):
        sets = controllable_sets(limited, (0.0, limited.most[-1]) if last is None else (last, last))
        new = fastest_profile(limited, sets, sets[0, 1] if first is None else first)
        if limits.linear or (x is not None and (np.abs(new - x) <= CONVERGED * new).all()):
            return new
        x = new if x is None or k < 10 else np.sqrt(x*new)
        limited = limits.at(x)
    print('not converged', np.abs(new/x-1).max())
    return new
