"""
A motion that shows the friction of the joints: slow reversals under several loads.

Bodies that move slowly have torques of gravity alone, which a model knows well: what is
left of the measured torques is friction. At each of several configurations, which load
the joints differently, all joints go back and forth between two positions, once or more
with each of several speeds. Each stroke is a quintic between rests, so that it passes all
rates up to its speed, and every joint reverses under every load.

The configurations are random ones within the limits. The first has the largest loads, each
further one the loads that differ most from those before (farthest-point design).
"""

from collections import Counter
from collections.abc import Sequence
import math
from typing import NamedTuple

from kane_dynamics._util.checks import instance, integer, number, real_numbers
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.excitation.clearance import (AIM, Clearance,
                                                               clearance_of, DISTANCE)
from kane_dynamics.identification.recordings.recording import require_rigid_links
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.model.elastic_model import require_rigid_joints
from kane_dynamics.model.link_shapes import LinkShape
from kane_dynamics.model.model import Model
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.methods.configuration_methods import sampling_range
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

CANDIDATES = 400  # configurations about which strokes are tried
DRAWS = 8000  # random configurations, of which the clear ones are candidates
MOST_LOADS, MOST_STROKES = 20, 100
LEAST = 1e-6  # share of limits; reach, rad or m; limits of speed, rad/s or m/s
PEAK = 1.875  # largest speed of a quintic between rests, over the mean speed
ON_THE_WAY = 0.3  # speed between configurations, relative to the limits
SAMPLES = 25  # of a stroke, at which limits and distances are checked
BETWEEN = 100  # of the way between two configurations
SPACE = 'the floor or the distance of links'


class _Limits(NamedTuple):
    """Limits of a motion: of speed, (n,), rad/s or m/s, of the effort's share, of space."""

    robot: Robot
    velocity: Array
    share: float
    clearance: Clearance | None

    def duration(self, begin: Array, end: Array, speed: float) -> float:
        """Return the time of a stroke with a share of the limits of speed, s."""
        # The joint that needs the longest time decides.
        return PEAK * float((np.abs(end - begin) / (speed * self.velocity)).max())

    def broken(self, begin: Array, end: Array, speed: float, samples: int) -> str | None:
        """Return which limit a stroke breaks, None if it keeps them."""
        duration = self.duration(begin, end, speed)
        s = np.linspace(0.0, 1.0, samples)[:, None]
        # A quintic between rests, and its derivatives.
        q = begin + (end - begin) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        u = (end - begin) / duration * 30.0 * s**2 * (1.0 - s)**2
        udot = (end - begin) / duration**2 * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
        # The largest torque on the way, and the place that the links need.
        torque = np.abs(self.robot.inverse_dynamics(q, u, udot)).max(axis=0)
        too_large = torque > self.share * self.robot.limits.effort
        if too_large.any():
            return f"the effort of '{self.robot.joint_names[int(too_large.argmax())]}'"
        return None if len(self.clear(q)) == len(q) else SPACE

    def clear(self, q: Array) -> Array:
        """Return the configurations, (K, n), above the floor and with links apart."""
        if self.clearance is None:
            return q
        return q[(self.clearance.room(q) > AIM).all(axis=1)]


def friction_motion(model: Model, *, loads: int = 3, strokes: int = 2,
                    speeds: ArrayLike = (0.01, 0.05, 0.25), reach: float = 0.1,
                    share: float = 0.9, seed: int = 0, floor: float | None = None,
                    shapes: Sequence[LinkShape] | None = None,
                    distance: float | None = DISTANCE) -> Motion:
    """
    Return a motion of slow reversals, to identify friction with.

    It starts and ends at rest, and rests at each reversal. `identify(...,
    friction_only=True)` fits friction to its recording. The same arguments give the same
    motion.

    Parameters
    ----------
    model : Model
        The arm, with limits of speed; its masses count for limits of effort.
    loads : int
        Number of configurations, from 1 to 20.
    strokes : int
        How often all joints go back and forth at a configuration with one speed, from 1
        to 100.
    speeds : (k,) array_like
        Largest speeds of the strokes, relative to the limits of the joints, up to 1.
    reach : float
        Of a stroke to either side of a configuration, rad or m; less where a quarter of a
        joint's range is.
    share : float
        Of the limits of position and effort that the motion may use, up to 1.
    seed : int
        Of the configurations from which it chooses.
    floor, shapes, distance
        As in `excite`.

    Raises
    ------
    InputError
        An argument is out of range, a joint has no limit of speed, or too few
        configurations keep the limits.

    Warns
    -----
    ModelWarning
        There is a distance, but there are no shapes.

    """
    # Arguments, and the limits that every stroke and every way must keep.
    instance(model, Model, 'model')
    require_angles(model, 'friction_motion')
    require_rigid_joints(model)
    require_rigid_links(model)
    loads = integer(loads, 'loads', 1, MOST_LOADS)
    strokes = integer(strokes, 'strokes', 1, MOST_STROKES)
    shares = _speeds(speeds)
    reach = number(reach, 'reach', f'a finite number of at least {LEAST:g}, rad or m',
                   lambda x: LEAST <= x < math.inf)
    share = number(share, 'share', f'a number from {LEAST:g} to 1',
                   lambda x: LEAST <= x <= 1.0)
    rng = np.random.default_rng(integer(seed, 'seed', 0))
    clearance = clearance_of(model, shapes, floor, distance)
    robot = Robot(model)
    limits = _Limits(robot, _velocity_limits(robot), share, clearance)

    # Random configurations about which all strokes keep the limits.
    lower, upper = _position_limits(robot, share)
    half_stroke = np.minimum(reach, 0.25 * (upper - lower))
    draws = rng.uniform(lower + half_stroke, upper - half_stroke, (DRAWS, model.n))
    candidates = limits.clear(draws)[:CANDIDATES]
    usable = []
    reasons = Counter[str]()
    if not len(candidates):
        reasons[SPACE] = DRAWS
    for center in candidates:
        reason = _broken_about(limits, center, half_stroke, shares)
        if reason is None:
            usable.append(center)
        else:
            reasons[reason] += 1

    # Of these, those whose loads differ most.
    chosen = _spread(np.reshape(usable, (-1, model.n)), loads, limits)
    if len(chosen) < loads:
        common_reason = ''
        if reasons:
            common_reason = f'; most others exceed {reasons.most_common(1)[0][0]}'
        raise InputError(f'loads: {loads}; expected at most {len(chosen)}, the number of '
                         f'configurations found that keep the limits{common_reason}: lower '
                         'speeds, another share, reach or seed, or no floor and '
                         'distance=None')

    # Strokes from rest to rest, through points without velocity and acceleration.
    times, positions = _strokes(chosen, half_stroke, limits, shares, strokes)
    at_rest = np.zeros_like(positions)
    return Motion.from_points(times, positions, at_rest, at_rest,
                              joint_names=model.joint_names)


def _speeds(speeds: ArrayLike) -> Array:
    """Return checked relative speeds, (k,)."""
    try:
        shares: Array = real_numbers(speeds)
    except (TypeError, ValueError):
        shares = np.empty(0)
    within = (shares >= LEAST) & (shares <= 1.0)
    if shares.ndim != 1 or not len(shares) or not within.all():
        raise InputError(f'speeds: {speeds!r}; expected numbers from {LEAST:g} to 1')
    return shares


def _position_limits(robot: Robot, share: float) -> tuple[Array, Array]:
    """Return the limits of position that the motion keeps, (n,) each, rad or m."""
    # A joint without a limit moves in the range of random configurations.
    lower, upper = sampling_range(robot)
    for name, least, most in zip(robot.joint_names, lower, upper):
        if most - least < 4.0 * LEAST:
            raise InputError(f"joint '{name}': limits of position {least:g} and {most:g}; "
                             f'expected a range of at least {4.0 * LEAST:g} rad or m, or a '
                             'locked joint')
    middle = 0.5 * (lower + upper)
    half_range = 0.5 * share * (upper - lower)
    return middle - half_range, middle + half_range


def _velocity_limits(robot: Robot) -> Array:
    """Return the limits of speed, (n,); InputError for a joint without one."""
    velocity: Array = robot.limits.velocity
    for name, limit in zip(robot.joint_names, velocity):
        if not LEAST <= limit < math.inf:
            raise InputError(f"joint '{name}': limit of speed {limit:g}; expected a finite "
                             f'one of at least {LEAST:g} rad/s or m/s')
    return velocity


def _broken_about(limits: _Limits, center: Array, half: Array, speeds: Array) -> str | None:
    """Return which limit strokes about a configuration break, None if they keep them."""
    begin = center
    for end, speed in _ends_of_strokes(center, half, speeds, 2):
        reason = limits.broken(begin, end, speed, SAMPLES)
        if reason is not None:
            return reason
        begin = end
    return None


def _spread(usable: Array, count: int, limits: _Limits) -> Array:
    """Return configurations, (K, n), whose loads differ most, with free ways between them."""
    if not len(usable):
        return usable
    # Loads count relative to the largest of each joint, so that all joints count alike.
    loads = limits.robot.gravity_force(usable)
    largest = np.abs(loads).max(axis=0)
    relative = loads / np.where(largest > 0.0, largest, 1.0)
    chosen = [int(np.argmax(np.sum(relative**2, axis=1)))]
    left = [k for k in range(len(usable)) if k != chosen[0]]
    # Farthest-point selection, which begins with the largest loads.
    while left and len(chosen) < count:
        differences = relative[left][:, None] - relative[chosen]
        nearest = np.sum(differences**2, axis=2).min(axis=1)
        farthest = left.pop(int(np.argmax(nearest)))
        way = usable[chosen[-1]], usable[farthest]
        if limits.broken(*way, ON_THE_WAY, BETWEEN) is None:
            chosen.append(farthest)
    return usable[chosen]


def _ends_of_strokes(center: Array, half: Array, speeds: Array,
                     strokes: int) -> list[tuple[Array, float]]:
    """Return the ends of the strokes about a configuration, and their relative speeds."""
    ends = []
    for speed in speeds.tolist():
        # Half a stroke takes the time of a whole one, so that it accelerates less.
        ends.append((center + half, 0.5 * speed))
        for _ in range(strokes - 1):
            ends += [(center - half, speed), (center + half, speed)]
        ends += [(center - half, speed), (center, 0.5 * speed)]
    return ends


def _strokes(centers: Array, half: Array, limits: _Limits, speeds: Array,
             strokes: int) -> tuple[Array, Array]:
    """Return times, (K,), and positions, (K, n), of all ends of strokes."""
    # To each center on the way, then its strokes; the first center is where the motion
    # begins.
    moves = []
    for center in centers:
        moves += [(center, ON_THE_WAY), *_ends_of_strokes(center, half, speeds, strokes)]
    times = [0.0]
    positions = [centers[0]]
    for end, speed in moves[1:]:
        times.append(times[-1] + limits.duration(positions[-1], end, speed))
        positions.append(end)
    return np.array(times), np.array(positions)
