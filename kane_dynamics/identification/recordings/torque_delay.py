"""
Delays between measured torques and the motion of a recording.

The torque of each joint, shifted by a number of rows, is fitted by all terms of the
equations of motion: base parameters, friction, armature, offset. The masses of the model
have no influence. The sum of squares is a parabola in the shift near its minimum, at the
delay.

Torque that the equations lack (play, elasticity) shifts the minimum too. It is correlated
in time, which noise is not, so its part of the residual is known, and widens the standard
deviation.

Friction does not follow the speed at once: it reverses over a short travel (presliding).
It is most of the torque of a small joint behind a gear, and lags the speed as if the
torque came late. The delays are therefore fitted a second time with Dahl friction
(P. Dahl, "A solid friction model", 1968) among the terms, for four lengths of that
travel. Where friction alone tells the delay, the sum of squares is then flat. A joint has
a delay of its own only if both fits say so.
"""

from dataclasses import dataclass

from kane_dynamics._util.attribute_hints import hinting
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.identification.presliding import dahl_friction
from kane_dynamics.identification.recordings.recording import check_recording, Recording
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np

NOISE = 0.3  # largest fraction of accelerations that are used unfiltered
LONGEST = 0.2  # s, either way
MOST_LAGS = 81
MOST_ROWS = 1500  # used rows, evenly distributed
NEAR = 0.03  # s, of the minimum: where the sum of squares is fitted by a parabola
BLOCKS = 8  # of consecutive rows, for the jackknife
FRICTION_SPEEDS = (0.02, 0.1)  # rad/s or m/s
DAHL_LENGTHS = (0.002, 0.007, 0.02, 0.06)  # rad or m, over which friction reverses
RANK = 1e-4  # relative size of singular values that are regarded as zero
LIKENESS = 0.25  # assumed correlation of missing torque with that of a delay; RMS of real arms
JUDGED = 0.025  # s, largest standard deviation of a known delay
EXACT = 1e-5  # s, no standard deviation is smaller
SHORTEST = 0.003  # s, of a delay that is reported
SURE, DIFFERENT = 2.0, 3.0  # standard deviations: of a common delay, of a joint's from the common


@hinting
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
        Whether the joint's delay may be that of friction with a memory: with this friction
        among the terms it does not clearly differ from the common one.

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
    def delayed(self) -> bool:
        """Return whether the common delay differs from zero, by two standard deviations."""
        return abs(self.common) > max(SURE * self.common_deviation, SHORTEST)

    @property
    def different(self) -> Flags:
        """Return for each joint whether its delay is not the common one, (n,)."""
        outlying = _outlying(self.delay, self.deviation, self.common)
        return self.judged & outlying & ~self.friction_memory


@hinting
def torque_delays(model: Model, recording: Recording) -> TorqueDelays:
    """Return the delays of the torques of a recording; noisy accelerations are filtered first."""
    check_recording(model, recording)
    recording = smoothed(recording)
    if recording.uneven:
        recording = recording.resampled()
    n = recording.tau.shape[1]
    # Columns: without friction with a memory, and with it.
    delay = np.zeros((n, 2))
    deviation = np.full((n, 2), np.inf)
    step = float(np.median(np.diff(recording.t)))
    longest = min(int(np.ceil(LONGEST / step)), len(recording) // 4)
    count = min(2 * longest + 1, MOST_LAGS)
    lags = np.unique(np.linspace(-longest, longest, count).round().astype(int))
    if len(lags) >= 3 and not model.flexible:  # beams have no regressor
        # Rows whose torques exist for every lag.
        inner = np.arange(longest, len(recording) - longest,
                          max(1, len(recording) // MOST_ROWS))
        robot = Robot(model, friction=False)
        q, u, udot = recording.q[inner], recording.u[inner], recording.udot[inner]
        Y = robot.regressor(q, u, udot)
        rigid = robot.inverse_dynamics(q, u, udot)
        presliding = dahl_friction(recording.q, DAHL_LENGTHS)[inner]
        for j in np.flatnonzero(np.ptp(u, axis=0) > 0.0):
            coulomb_friction = [coulomb(u[:, j], speed) for speed in FRICTION_SPEEDS]
            A = np.column_stack([Y[:, j], u[:, j], *coulomb_friction, udot[:, j],
                                 np.ones(len(u))])
            with_memory = np.column_stack([A, presliding[:, :, j]])
            torques = recording.tau[inner[:, None] + lags, j] - rigid[:, j, None]
            for k, columns in enumerate((A, with_memory)):
                residuals = _residuals(columns, torques)
                delay[j, k], deviation[j, k] = _vertex(step * lags, residuals)
    common, common_deviation = _common(delay[:, 0], deviation[:, 0])
    # A delay of the joint's own has the same side of the common one in both fits.
    apart = delay - common
    own = _outlying(delay[:, 1], deviation[:, 1], common) & (deviation[:, 1] <= JUDGED)
    own &= apart[:, 0] * apart[:, 1] > 0.0
    return TorqueDelays(delay[:, 0], deviation[:, 0], common, common_deviation, ~own)


def smoothed(recording: Recording) -> Recording:
    """Return the recording, filtered at up to 10 Hz if its accelerations are noise."""
    if len(recording) <= 100 or not (recording.acceleration_noise() > NOISE).any():
        return recording
    # Up to a fifth of the sampling rate.
    mean_step = float(np.diff(recording.t).mean())
    return recording.filtered(min(10.0, 0.2 / mean_step))


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
    weight = deviation[agree]**-2.0
    return float(np.average(delay[agree], weights=weight)), float(weight.sum()**-0.5)


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


def _vertex(lags: Array, residuals: Array) -> tuple[float, float]:
    """Return the lag of the least residual, and its standard deviation, s."""
    squares = residuals**2
    sums = squares.sum(axis=0)
    best = int(np.argmin(sums))
    # A minimum at the end of the range is none.
    if best in (0, len(lags) - 1):
        return 0.0, np.inf
    # The vertex of a parabola through the sums near the least one.
    near = np.abs(lags - lags[best]) <= max(NEAR, 1.01 * float(np.diff(lags).max()))
    x = lags[near] - lags[best]
    parabola = np.linalg.pinv(np.column_stack([x * x, x, np.ones(len(x))]))
    # The spread of the vertex without each block (jackknife) gives its deviation.
    parts = np.array([part.sum(axis=0) for part in np.array_split(squares[:, near],
                                                                  BLOCKS)])
    steep, slope, _ = parabola @ np.column_stack([sums[near], (sums[near] - parts).T])
    if not (steep > 0.0).all():
        return 0.0, np.inf
    at = -0.5 * slope / steep
    spread = (BLOCKS - 1) / BLOCKS * float(np.sum((at[1:] - at[1:].mean())**2))
    error = residuals[:, best]
    # Residuals that follow each other show an error that is no noise.
    missing = max(float(error[1:] @ error[:-1]), 0.0)
    return float(lags[best] + at[0]), float(np.sqrt(spread + LIKENESS**2 * missing / steep[0]))
