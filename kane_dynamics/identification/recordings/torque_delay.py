"""
Delays between measured torques and the motion of a recording.

The torque of each joint, shifted by a number of rows, is fitted by all terms of the
equations of motion: base parameters, friction, armature, offset. The masses of the model
have no influence. The sum of squares is a parabola in the shift near its minimum, at the
delay.

Friction shifts the minimum most, because it depends on the speed, as the rate of gravity
torques and of inertial torques does. Friction of gears grows with the load, and it does
not follow the speed at once: it reverses over a short travel (presliding), as if the
torque came late. Dahl friction (P. Dahl, "A solid friction model", 1968) for four lengths
of that travel and load friction are therefore among the terms. The load is that of a
first fit without them. Where friction alone shows the delay, the sum of squares is then
flat, and the delay is unknown.

Torque that the equations lack even so (play, elasticity) shifts the minimum too. It is
correlated in time, which noise is not, so its part of the residual is known, and widens
the standard deviation. Joints of one arm lack alike torques, so that this part of their
errors does not average out, and joints that contradict each other widen the deviation of
their common delay.

A joint has a delay of its own only if both fits say so, and if the common delay fits its
torques clearly worse.
"""

from dataclasses import dataclass
from typing import NamedTuple

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.identification.presliding import dahl_friction
from kane_dynamics.identification.recordings.recording import (check_recording, low_pass,
                                                               Recording)
from kane_dynamics.identification.solvers import on_one_processor, scientific
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np

NOISE = 0.3  # largest fraction of accelerations that are used unfiltered
LONGEST = 0.2  # s, either way
MOST_LAGS = 81
MOST_ROWS = 1500  # used rows, evenly distributed
INTERRUPTION = 5.0  # steps of time
NEAR, WIDE = 0.01, 0.03  # s, of the minimum: where sums of squares are fitted by parabolas
BLOCKS = 8  # of consecutive rows, for the jackknife
FEWEST_REVERSALS = 4  # of a joint: bodies and friction explain any torque of a shorter motion
REVERSED = 0.05  # of the highest speed: lower ones are no motion in a direction
FRICTION_SPEEDS = (0.005, 0.02, 0.1)  # rad/s or m/s
LOAD_FRICTION_SPEEDS = (0.005, 0.05)
DAHL_LENGTHS = (0.002, 0.007, 0.02, 0.06)  # rad or m, over which friction reverses
RANK = 1e-4  # relative size of singular values that are regarded as zero
LIKENESS = 0.25  # assumed correlation of missing torque with that of a delay; RMS of real arms
ALIKE = 0.25  # assumed correlation of the errors of two joints
OFF_LAG = 0.1  # of the distance of lags: least standard deviation
JUDGED = 0.025  # s, largest standard deviation of a known delay
EXACT = 1e-5  # s, no standard deviation is smaller
SHORTEST = 0.004  # s, of a delay that is reported
SURE, DIFFERENT = 2.0, 3.0  # standard deviations: of a common delay, of a joint's from the common


@dataclass(frozen=True, eq=False)
class TorqueDelays:
    """
    Delays of torques after the motion, negative for torques before it.

    Attributes
    ----------
    delay, deviation : (n,) arrays
        Of each joint, s. The deviation is infinite where there is no minimum within 0.2
        s.
    common, common_deviation : float
        Of the joints that agree with each other, s; NaN and infinite if none can be
        judged.
    friction_memory : (n,) array of bool
        Whether the joint's friction may explain why its torque seems to have a delay that
        is not the common one: a fit with or without presliding friction and load friction
        does not clearly show a delay of the joint's own.

    """

    delay: Array
    deviation: Array
    common: float
    common_deviation: float
    friction_memory: Flags

    @property
    def judged(self) -> Flags:
        """Return for each joint whether its standard deviation is at most 25 ms, (n,)."""
        return self.deviation <= JUDGED

    @property
    def known(self) -> bool:
        """Return whether at least half of the joints can be judged: the arm has one delay."""
        return 2 * int(np.count_nonzero(self.judged)) >= len(self.delay)

    @property
    def delayed(self) -> bool:
        """Return whether the common delay differs from zero, by two standard deviations."""
        if not self.known:
            return False
        return abs(self.common) > max(SURE * self.common_deviation, SHORTEST)

    @property
    def different(self) -> Flags:
        """Return for each joint whether its delay is not the common one, (n,)."""
        outlying = _outlying(self.delay, self.deviation, self.common)
        return self.judged & outlying & ~self.friction_memory


@on_one_processor
def torque_delays(model: Model, recording: Recording) -> TorqueDelays:
    """
    Return the delays of the torques of a recording; noisy accelerations are filtered first.

    The delay of a joint that reverses less than four times is unknown.
    """
    check_recording(model, recording)
    measured = recording.t
    cutoff = _cutoff(recording)
    recording = smoothed(recording)
    if recording.uneven:
        recording = recording.resampled()
    n = recording.tau.shape[1]
    # Of each joint: the minimum of a fit with plain friction, and of one with all terms.
    plain = [NO_MINIMUM] * n
    with_all_terms = [NO_MINIMUM] * n
    step = float(np.median(np.diff(recording.t)))
    longest = min(int(np.ceil(LONGEST / step)), len(recording) // 4)
    count = min(2 * longest + 1, MOST_LAGS)
    lags = np.unique(np.linspace(-longest, longest, count).round().astype(int))
    if len(lags) >= 3 and not model.flexible:  # beams have no regressor
        # Rows whose torques exist for every lag.
        inner = np.arange(longest, len(recording) - longest,
                          max(1, len(recording) // MOST_ROWS))
        # Rows that were interpolated over an interruption are no measurement.
        uninterrupted = ~_interrupted(recording.t[inner], measured)
        if 2 * np.count_nonzero(uninterrupted) >= len(inner):
            inner = inner[uninterrupted]
        robot = Robot(model, friction=False)
        q, u, udot = recording.q[inner], recording.u[inner], recording.udot[inner]
        Y = robot.regressor(q, u, udot)
        rigid = robot.inverse_dynamics(q, u, udot)
        # Sharp friction is filtered as the torques are.
        speeds = [*FRICTION_SPEEDS, *LOAD_FRICTION_SPEEDS]
        sliding = np.stack([coulomb(recording.u, speed) for speed in speeds], axis=1)
        presliding = dahl_friction(recording.q, DAHL_LENGTHS)
        if cutoff is not None:
            sliding = low_pass(sliding, cutoff, step)
            presliding = low_pass(presliding, cutoff, step)
        sliding, presliding = sliding[inner], presliding[inner]
        for j in range(n):
            if _reversals(u[:, j]) < FEWEST_REVERSALS:
                continue
            # Bodies and rotor are what the motor drives; friction and offset are not.
            driven = np.column_stack([Y[:, j], udot[:, j]])
            torques = recording.tau[inner[:, None] + lags, j] - rigid[:, j, None]
            plain[j], with_all_terms[j] = _fits(step * lags, torques, driven, rigid[:, j],
                                                u[:, j], sliding[:, :, j],
                                                presliding[:, :, j])
    delay = np.array([minimum.delay for minimum in with_all_terms])
    deviation = np.array([minimum.deviation for minimum in with_all_terms])
    common, common_deviation = _common(delay, deviation)
    # Both fits agree about a delay of the joint's own.
    own = np.zeros(n, dtype=bool)
    for j in range(n):
        agreement = DIFFERENT * np.hypot(plain[j].deviation, deviation[j])
        own[j] = (abs(plain[j].delay - delay[j]) <= agreement
                  and plain[j].excludes(common) and with_all_terms[j].excludes(common))
    return TorqueDelays(delay, deviation, common, common_deviation, ~own)


class _Minimum(NamedTuple):
    """
    Least sum of squares of a joint's fit over the lags.

    The variance is that of the sum of squares; divided by the curvature of the sums it is
    the variance of the delay.
    """

    delay: float
    deviation: float
    variance: float
    lags: Array
    sums: Array

    def excludes(self, delay: float) -> bool:
        """Return whether another delay fits clearly worse."""
        if not np.isfinite(self.deviation):
            return False
        # Far from the minimum the sums are no parabola: they may be flat.
        increase = float(np.interp(delay, self.lags, self.sums)) - float(self.sums.min())
        is_apart = abs(self.delay - delay) > max(DIFFERENT * self.deviation, SHORTEST)
        return is_apart and increase > DIFFERENT**2 * self.variance


NO_MINIMUM = _Minimum(0.0, np.inf, np.inf, np.zeros(1), np.zeros(1))


def _fits(lags: Array, torques: Array, driven: Array, rigid: Array, u: Array,
          sliding: Array, presliding: Array) -> tuple[_Minimum, _Minimum]:
    """
    Return the minima of a joint's fits with plain friction and with all terms.

    Parameters
    ----------
    lags : (k,) array
        s.
    torques : (N, k) array
        Of the joint for each lag, less those of the given model.
    driven : (N, m) array
        Columns of bodies and rotor.
    rigid, u : (N,) arrays
        Torque of the given model, and speeds.
    sliding, presliding : (N, speeds), (N, lengths) arrays
        Coulomb and Dahl friction of coefficient 1.

    """
    count = len(FRICTION_SPEEDS)
    A = np.column_stack([driven, u, sliding[:, :count], np.ones(len(u))])
    residuals = _residuals(A, torques)
    plain = _minimum(lags, residuals)

    # Load friction follows from the load at the lag that fits best.
    best = int(np.argmin(np.sum(residuals**2, axis=0)))
    solution = _solution(A, torques[:, best])
    load = np.abs(rigid + driven @ solution[:driven.shape[1]])
    load_friction = load[:, None] * sliding[:, count:]
    A = np.column_stack([A, u * np.abs(u), load_friction, presliding])
    return plain, _minimum(lags, _residuals(A, torques))


def _reversals(u: Array) -> int:
    """Return how often a joint changes its direction."""
    speed = np.abs(u)
    directions = np.sign(u[speed > REVERSED * speed.max()])
    return int(np.count_nonzero(np.diff(directions)))


def _interrupted(t: Array, measured: Array) -> Flags:
    """Return where torques of some lag are at an interruption of the measured times, (N,)."""
    steps = np.diff(measured)
    after = np.flatnonzero(steps > INTERRUPTION * np.median(steps))
    interrupted = np.zeros(len(t), dtype=bool)
    for k in after:
        interrupted |= (t > measured[k] - LONGEST) & (t < measured[k + 1] + LONGEST)
    return interrupted


def _cutoff(recording: Recording) -> float | None:
    """Return a cutoff of up to 10 Hz if accelerations are noise, a fifth of the rate; or None."""
    if len(recording) <= 100 or not (recording.acceleration_noise() > NOISE).any():
        return None
    return min(10.0, 0.2 / float(np.diff(recording.t).mean()))


def smoothed(recording: Recording) -> Recording:
    """Return the recording, filtered at up to 10 Hz if its accelerations are noise."""
    cutoff = _cutoff(recording)
    return recording if cutoff is None else recording.filtered(cutoff)


def _common(delay: Array, deviation: Array) -> tuple[float, float]:
    """Return the mean delay of the joints that agree, and its deviation; NaN, inf of none."""
    known = np.flatnonzero(deviation <= JUDGED)
    if not len(known):
        return np.nan, np.inf
    delay = delay[known]
    deviation = np.maximum(deviation[known], EXACT)
    # The delay that most joints are near to; of equal candidates the smallest.
    candidates = delay[np.argsort(np.abs(delay), kind='stable')]
    cost = np.minimum(np.abs(delay - candidates[:, None]) / deviation, DIFFERENT)**2
    best = float(candidates[np.argmin(cost.sum(axis=1))])
    agree = ~_outlying(delay, deviation, best)
    # Their mean, weighted by the inverse variances.
    delay, deviation = delay[agree], deviation[agree]
    weight = deviation**-2.0
    common = float(np.average(delay, weights=weight))
    # Errors of joints are correlated: that part of their mean does not average out.
    independent = 1.0 / float(weight.sum())
    alike = float(np.average(deviation, weights=weight))**2
    variance = (1.0 - ALIKE) * independent + ALIKE * alike
    # Joints that differ by more than their deviations have too small ones.
    if len(delay) > 1:
        squared_ratio = float(np.sum(weight * (delay - common)**2)) / (len(delay) - 1)
        variance *= max(squared_ratio, 1.0)
    return common, float(np.sqrt(variance))


def _outlying(delay: Array, deviation: Array, from_delay: float) -> Flags:
    """Return where a delay clearly differs from another."""
    differs: Flags = np.abs(delay - from_delay) > np.maximum(DIFFERENT * deviation,
                                                             SHORTEST)
    return differs


def _residuals(A: Array, torques: Array) -> Array:
    """Return the residuals of each column of torques in a least-squares fit by A."""
    size = np.linalg.norm(A, axis=0)
    # Columns pivoted by length: the diagonal of R falls like the singular values.
    U, R, _ = scientific('scipy.linalg').qr(A[:, size > 0.0] / size[size > 0.0],
                                            mode='economic', pivoting=True)
    diagonal = np.abs(np.diag(R))
    U = U[:, diagonal > RANK * diagonal[0]]
    residuals: Array = torques - U @ (U.T @ torques)
    return residuals


def _solution(A: Array, torque: Array) -> Array:
    """Return the least-squares solution of least length, columns scaled to one length."""
    size = np.linalg.norm(A, axis=0)
    size[size == 0.0] = 1.0
    scaled = scientific('scipy.linalg').lstsq(A / size, torque, cond=RANK,
                                              lapack_driver='gelsy')[0]
    return np.asarray(scaled / size)


def _minimum(lags: Array, residuals: Array) -> _Minimum:
    """Return the lag of the least residual, with its standard deviation, s."""
    squares = residuals**2
    sums = squares.sum(axis=0)
    best = int(np.argmin(sums))
    # A minimum at the end of the range is none.
    if best in (0, len(lags) - 1):
        return NO_MINIMUM
    # Friction that reverses makes the sums asymmetric: the minimum is that of a narrow
    # parabola. Noise makes narrow minima anywhere: a wide parabola must have one too.
    narrow = _vertex(lags, squares, best, NEAR)
    wide = _vertex(lags, squares, best, WIDE)
    if narrow is None or wide is None:
        return NO_MINIMUM
    error = residuals[:, best]
    # Residuals that follow each other show an error that is no noise.
    missing = max(float(error[1:] @ error[:-1]), 0.0)
    variance = 0.0
    deviation = OFF_LAG * float(np.diff(lags).min())
    for vertex in (narrow, wide):
        of_sums = vertex.spread * vertex.curvature + LIKENESS**2 * missing
        variance = max(variance, of_sums)
        deviation = max(deviation, float(np.sqrt(of_sums / vertex.curvature)))
    return _Minimum(narrow.lag, deviation, variance, lags, sums)


class _Vertex(NamedTuple):
    """Vertex of a parabola through sums of squares: lag, its variance (jackknife), curvature."""

    lag: float
    spread: float
    curvature: float


def _vertex(lags: Array, squares: Array, best: int, reach: float) -> _Vertex | None:
    """Return the vertex of a parabola through the sums near the best lag; None without any."""
    near = np.abs(lags - lags[best]) <= max(reach, 1.01 * float(np.diff(lags).max()))
    x = lags[near] - lags[best]
    parabola = np.linalg.pinv(np.column_stack([x * x, x, np.ones(len(x))]))
    # The spread of the vertex without each block (jackknife) gives its deviation.
    parts = np.array([part.sum(axis=0) for part in np.array_split(squares[:, near],
                                                                  BLOCKS)])
    total = squares[:, near].sum(axis=0)
    steep, slope, _ = parabola @ np.column_stack([total, (total - parts).T])
    if not (steep > 0.0).all():
        return None
    at = -0.5 * slope / steep
    spread = (BLOCKS - 1) / BLOCKS * float(np.sum((at[1:] - at[1:].mean())**2))
    return _Vertex(float(lags[best] + at[0]), spread, float(steep[0]))
