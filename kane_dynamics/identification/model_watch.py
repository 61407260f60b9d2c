"""
Watch over a model: which of its parameters no longer fits the arm, and of which joint.

The residual is the measured torque less that of the model. Each possible cause adds a
known direction to it:

    payload           the columns of mass and center of mass of an outermost body
    friction          the friction of a joint
    offset            a constant torque of a joint
    torque constant   the torque of a joint
    delay             the rate of the torque, of one joint or of all

times a size, which is fitted, one cause at a time. Friction that
reverses is a step, so that delays of up to 50 ms are tried: the squares have their
minimum at the delay. The model's own errors have sizes too: those of a sound recording,
the reference, are subtracted; or the residuals themselves, if the motion is the same, so
that the errors of the model cancel. The standard error is that of the sizes of blocks of
rows (jackknife), since residuals of neighboring rows are alike. Rows in which a joint
rests say nothing of it, because static friction is unknown.

Noise of the motion is in the residual and in the directions, so that least squares would
make sizes less than they are, the more rows a second the more (errors in variables).
Instead the residual is correlated with instruments: the directions along the motion of the
rows before and after each row, whose noise is another one. A direction that is only noise
has no correlation with its instrument, and is not judged. In the same motion, the
directions are those of the mean of both recordings, whose noise has no correlation with
the difference of the residuals.

A cause is an alarm if its size is beyond the quantile of Student's distribution for the
stated rate of false alarms, divided among all causes (Bonferroni). Of several, the one
that explains most of the residuals, relative to those of the reference, is named first;
the others are judged on what it leaves. What is small beside the torque of an alarm at the
same joints (5 %) is an error of its law, and no cause. A residual that is several times
that of the reference and that no cause explains is an alarm too, of an unknown cause.

Sound arms change from day to day: friction with the temperature, offsets of sensors. Such a
change is real, but no alarm: one is left out whose torque is less than a smallest share of
the torques of its joints. Several references of the sound arm state by how much it changes;
with one, a usual share is assumed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from kane_dynamics._util.checks import number
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.identification.friction_laws import moving_rms
from kane_dynamics.identification.recordings.recording import (check_recording,
                                                               Recording,
                                                               require_rigid_links,
                                                               STANDSTILL)
from kane_dynamics.identification.regression import rms
from kane_dynamics.identification.solvers import on_one_processor, scientific
from kane_dynamics.mechanics.friction import load_slope
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np

BLOCKS = 16
FALSE_ALARMS = 0.01  # of a sound recording
FEWEST_ROWS = 10 * BLOCKS
SAME_MOTION = 0.01  # RMS distance of positions, relative to the range of each joint
MOST_ALARMS = 3  # that are named, one after the other
ROUNDING = 1e-9  # of the torque: a smaller residual has no cause
UNCERTAIN = 0.05  # of the torque of a cause: its law is not exact
LEAST_SIZE = 1e-4  # relative, of a change of friction or of a torque constant
INFORMED = 2.0  # standard errors of the correlation of measured and computed rates
STRONG = 10.0  # F of the first stage, of an instrument (Staiger and Stock 1997)
LONGEST_DELAY = 0.05  # s, but two rows at least
MOST_DELAYS = 20  # that are tried, either way
SMOOTHED = 0.05  # s, of accelerations in the rate of the model's torque
SMALLEST = 0.4  # share of a joint's torque, of a change that matters; of one reference
BEYOND = 1.5  # times the largest change between references
UNEXPLAINED = 3.0  # times the residual of the reference
RATE_SPAN = 0.02  # s, of speeds and accelerations in the model's torque
NEIGHBORS_OF_SPEEDS = 2  # rows, either way, whose accelerations share noise of speeds
NEIGHBORS_OF_POSITIONS = 4
ALL_JOINTS = 'all joints'
UNKNOWN = 'unknown'


class ModelChange(NamedTuple):
    """
    A change of the arm that its model does not have.

    Attributes
    ----------
    joint : str
        The joint, or 'all joints' for a delay of all; the body for a payload.
    cause : str
        'payload', 'friction', 'offset', 'torque constant', 'delay' or 'unknown'.
    size, deviation : float
        How large it is, and its standard deviation: kg; relative; N m or N; relative; s;
        the residual that no cause explains, relative to that of the reference.
    explained : float
        Share of the squared residual that it explains, joints weighted by the residuals of
        the reference.
    share : float
        RMS of its torque over that of the measured one, of the joint where it is largest.

    """

    joint: str
    cause: str
    size: float
    deviation: float
    explained: float
    share: float = 0.0

    def __str__(self) -> str:
        """Return the change in words."""
        deviation = f'+- {self.deviation:.1g}'
        # Numbers with their unit, as users say them; factors in percent.
        if self.cause == 'payload':
            return f"body '{self.joint}': {self.size:+.3g} kg ({deviation} kg) of payload"
        of = self.joint if self.joint == ALL_JOINTS else f"joint '{self.joint}'"
        if self.cause == 'offset':
            return f'{of}: offset of the torque {self.size:+.3g} ({deviation}) N m or N'
        if self.cause == 'delay':
            side = 'late' if self.size > 0.0 else 'early'
            return f'{of}: torque {abs(self.size):.3g} s {side} ({deviation} s)'
        if self.cause == UNKNOWN:
            return (f'{of}: a change of unknown cause, with a residual {self.size:.3g} times '
                    f'that of the reference ({deviation})')
        percent = f'{100.0 * self.size:+.3g} % (+- {100.0 * self.deviation:.1g} %)'
        if self.cause == 'torque constant':
            return f'{of}: torque constant {percent}'
        return f'{of}: friction {"up" if self.size > 0.0 else "down"}, {percent}'


@dataclass(frozen=True, eq=False)
class WatchReport:
    """
    Residuals of a recording, and the changes of the arm that they show.

    Attributes
    ----------
    joint_names : tuple of n str
    residual, reference : (n,) arrays
        RMS of the residuals of the recording and of the reference, N m or N.
    alarms : tuple of ModelChange
        Empty for a sound recording, but for the stated rate of false alarms.
    judged : (n,) array of bool
        Joints that move enough, in the recording and in the reference; nothing is said of
        others, nor of a payload in a recording at rest.

    """

    joint_names: tuple[str, ...]
    residual: Array
    reference: Array
    alarms: tuple[ModelChange, ...]
    judged: Flags

    @property
    def larger(self) -> Flags:
        """Return for each joint that moves whether its residual has grown several times."""
        return self.judged & (self.residual > UNEXPLAINED * self.reference)


class CauseSizes(NamedTuple):
    """Sizes of a cause, (k,), and those of fits without each block of rows, (blocks, k)."""

    all_rows: Array
    without_blocks: Array


class _Cause(NamedTuple):
    """
    A possible change of the arm, and what it adds to the torques.

    Attributes
    ----------
    name, joint : str
    directions, instruments : (N, n, k) arrays
        Torques of a size of 1, computed from the motion of the same rows, and from that of
        the rows around them. They are zero where joints rest.

    """

    name: str
    joint: str
    directions: Array
    instruments: Array


class _DelayScores(NamedTuple):
    """
    Derivatives of squared residuals by delays of the torques, which vanish at the delay.

    Residuals are not linear in a delay, because friction reverses. Noise of the torques
    would make them look shorter in a linear fit; it has no correlation with its own rate.

    delays : (k,) array
        s.
    of_blocks, information : (blocks, k, n) arrays
        Derivatives of each block of rows, and products of the rates of the measured and
        the model's torques, to which noise does not contribute.
    squares : (k, n) array
        Squared residuals.
    """

    delays: Array
    of_blocks: Array
    information: Array
    squares: Array

    def delay(self, joints: Flags) -> CauseSizes:
        """Return the delay of some joints; without any its jackknifed sizes are NaN."""
        of_blocks = self.of_blocks[..., joints].sum(axis=-1)
        total = of_blocks.sum(axis=0)
        squares = self.squares[:, joints].sum(axis=-1)
        # Minima of the squares: their derivative crosses zero. Several: the least.
        crossings = np.flatnonzero((total[:-1] <= 0.0) & (total[1:] > 0.0))
        unknown = CauseSizes(np.zeros(1), np.full((BLOCKS, 1), np.nan))
        if not len(crossings):
            return unknown
        near = squares[crossings] + squares[crossings + 1]
        k = int(crossings[np.argmin(near)])
        # A straight line between two delays.
        share = -total[k] / (total[k + 1] - total[k])
        distance = self.delays[k + 1] - self.delays[k]
        delay = self.delays[k] + share * distance
        # Noise has minima anywhere: torques that move together show a delay.
        of_rates = self.information[..., joints].sum(axis=-1)
        products = (1.0 - share) * of_rates[:, k] + share * of_rates[:, k + 1]
        information = float(products.sum())
        if information <= INFORMED * np.sqrt(BLOCKS) * products.std(ddof=1):
            return unknown
        # Without a block, the derivative changes by that of the block.
        changes = (1.0 - share) * of_blocks[:, k] + share * of_blocks[:, k + 1]
        slope = min((total[k + 1] - total[k]) / distance, information)
        without_blocks = delay + changes[:, None] / slope
        return CauseSizes(np.array([delay]), without_blocks)


class ModelWatch:
    """
    Compares recordings with a model and with a sound recording.

    Parameters
    ----------
    model : Model
        Of the arm, as identified.
    reference : Recording or sequence of Recording
        Of the sound arm; not that of another payload. The first one is compared with; the
        others, as of other days, state by how much a sound arm changes.
    false_alarms : float
        Rate of recordings of the sound arm with an alarm, at most, by the noise alone.
    smallest : float, optional
        Smallest torque of a change that is an alarm, as a share of the torque of a joint.
        Default: 1.5 times the largest change between references; 0.4 with one.

    Raises
    ------
    InputError
        The recording has other joints or too few rows, or the rate is none.

    """

    def __init__(self, model: Model, reference: Recording | Sequence[Recording], *,
                 false_alarms: float = FALSE_ALARMS, smallest: float | None = None) -> None:
        references = [reference] if isinstance(reference, Recording) else list(reference)
        if not references:
            raise InputError('reference: none; expected a recording, or several')
        reference, *others = references
        self._smallest = 0.0
        if smallest is not None:
            self._smallest = number(smallest, 'smallest', 'a number >= 0 and below 1',
                                    lambda x: 0.0 <= x < 1.0)
        self._rate = number(false_alarms, 'false_alarms', 'a number above 0 and below 0.5',
                            lambda x: 0.0 < x < 0.5)
        _require_rows(model, reference)
        self._robot = Robot(model)
        reference = _with_mean_rates(reference)
        self._reference = reference
        self._residual = _residual(self._robot, reference)
        scale = ROUNDING * rms(reference.tau)
        moving = _moving(reference)
        deviation = np.nan_to_num(moving_rms(self._residual, moving))
        self._sigma = np.maximum(deviation, np.maximum(scale, 1e-12))
        self._moved = moving.sum(axis=0) >= FEWEST_ROWS
        # Of each cause: its sizes in the reference, or None if the reference lacks the
        # motion that would show it.
        self._sound: list[CauseSizes | None] = []
        residual = self._residual * moving
        causes = _causes(self._robot, reference)
        scores = self._delay_scores(reference, causes, residual)
        for cause in causes:
            shown = cause.directions.any()
            self._sound.append(self._sizes(cause, residual, scores) if shown else None)
        self._quantile = self._largest_ratio(len(self._sound))
        if smallest is None:
            shares = [alarm.share for other in others for alarm in self.report(other).alarms]
            self._smallest = BEYOND * max(shares, default=0.0) if others else SMALLEST

    @property
    def smallest(self) -> float:
        """Return the smallest torque of an alarm, as a share of the torque of its joints."""
        return self._smallest

    @on_one_processor
    def report(self, recording: Recording) -> WatchReport:
        """
        Return the residuals of a recording, and the causes of those that are too large.

        Raises
        ------
        InputError
            The recording has other joints or too few rows.

        """
        robot = self._robot
        _require_rows(robot.model, recording)
        recording = _with_mean_rates(recording)
        residual = _residual(robot, recording)
        sound: list[CauseSizes | None] | None = self._sound
        remaining = residual
        motion = recording
        if _same_motion(recording, self._reference):
            # The errors of the model cancel. Noise of the motion is in the residual, too:
            # it has no correlation with that of the mean motion.
            remaining = residual - self._residual
            motion = _mean_motion(recording, self._reference)
            sound = None
        causes = _causes(robot, motion)
        remaining = remaining * _moving(recording)

        # The largest cause is taken away, and the others are judged again.
        alarms: list[ModelChange] = []
        named = np.zeros_like(remaining)
        for _ in range(MOST_ALARMS):
            change, torque = self._largest(recording, causes, sound, remaining, named,
                                           alarms)
            if change is None:
                break
            alarms.append(change)
            remaining = remaining - torque
            named = named + torque
        alarms += self._unexplained(recording, remaining, named)
        judged = self._moved & (_moving(recording).sum(axis=0) >= FEWEST_ROWS)
        return WatchReport(robot.joint_names, rms(residual), rms(self._residual),
                           tuple(alarms), judged)

    def _largest_ratio(self, causes: int) -> float:
        """Return the largest ratio of a size to its deviation that is no alarm."""
        # A difference of two sizes has between one and two times these degrees of
        # freedom, because the deviations of both motions differ (Welch).
        freedom = BLOCKS - 1
        share = self._rate / (2.0 * causes)
        return float(scientific('scipy.stats').t.ppf(1.0 - share, freedom))

    def _largest(self, recording: Recording, causes: Sequence[_Cause],
                 sound: Sequence[CauseSizes | None] | None, residual: Array, named: Array,
                 alarms: Sequence[ModelChange]) -> tuple[ModelChange | None, Array]:
        """
        Return the significant cause that explains most, and its torque.

        It is none of the alarms, and more than what `named`, their torque, may be wrong by.
        """
        largest: ModelChange | None = None
        torque = np.zeros_like(residual)
        most_explained = -np.inf
        # A cause counts if its size is beyond its own error, and that of the sound arm.
        whole = max(float(np.sum((residual / self._sigma)**2)), 1e-300)
        scores = self._delay_scores(recording, causes, residual)
        for k, cause in enumerate(causes):
            if any(_repeats(cause, alarm) for alarm in alarms):
                continue
            change, jackknifed = self._sizes(cause, residual, scores)
            deviation = _spread(jackknifed)
            if sound is not None:
                of_sound = sound[k]
                if of_sound is None:
                    continue
                change = change - of_sound.all_rows
                deviation = np.hypot(deviation, _spread(of_sound.without_blocks))
            least = max(self._quantile * float(deviation[0]), _floor(cause.name, self._sigma))
            if not abs(change[0]) > least:  # NaN: no delay fits
                continue
            of_cause = _added_torque(recording, cause, change)
            joints = of_cause.any(axis=0) / self._sigma
            if np.linalg.norm(of_cause * joints) <= UNCERTAIN * np.linalg.norm(named * joints):
                continue
            share = _share(of_cause, recording)
            if share < self._smallest:
                continue
            # Causes of like directions all have a size. That which explains more of the
            # residual goes first; the sound arm's own error may even make it less than 0.
            left = float(np.sum(((residual - of_cause) / self._sigma)**2))
            explained = whole - left
            if explained > most_explained:
                most_explained = explained
                torque = of_cause
                largest = ModelChange(cause.joint, cause.name, float(change[0]),
                                      float(deviation[0]), max(explained / whole, 0.0), share)
        return largest, torque

    def _unexplained(self, recording: Recording, remaining: Array,
                     named: Array) -> list[ModelChange]:
        """Return an alarm of each joint whose residual is large without a known cause."""
        moving = _moving(recording)
        ratios = moving_rms(remaining, moving) / self._sigma
        # Where named causes explain most, the remainder is an error of their laws.
        of_causes = moving_rms(named, moving) / self._sigma
        judged = self._moved & (moving.sum(axis=0) >= FEWEST_ROWS)
        alarms = []
        for j in np.flatnonzero(judged & (ratios > np.maximum(UNEXPLAINED, of_causes))):
            squares = np.where(moving[:, j], (remaining[:, j] / self._sigma[j])**2, 0.0)
            without_blocks = []
            for rows in np.array_split(np.arange(len(squares)), BLOCKS):
                others = np.delete(np.arange(len(squares)), rows)
                count = np.count_nonzero(moving[others, j])
                without_blocks.append([np.sqrt(squares[others].sum() / max(count, 1))])
            deviation = float(_spread(np.array(without_blocks))[0])
            # A few large residuals, such as those of a contact, are no change of the arm.
            share = _share(np.where(np.arange(len(ratios)) == j, remaining, 0.0), recording)
            if ratios[j] - 1.0 > self._quantile * deviation and share >= self._smallest:
                alarms.append(ModelChange(self._robot.joint_names[j], UNKNOWN,
                                          float(ratios[j]), deviation, 0.0, share))
        return alarms

    def _delay_scores(self, recording: Recording, causes: Sequence[_Cause],
                      residual: Array) -> '_DelayScores':
        """Return the derivatives of squared residuals by delays of the torques."""
        t = recording.t
        step = float(np.median(np.diff(t)))
        # Whole rows, so that noise is not averaged.
        distance = step * max(1, round(LONGEST_DELAY / (step * MOST_DELAYS)))
        count = max(round(LONGEST_DELAY / distance), 2)
        delays = np.linspace(-count * distance, count * distance, 2 * count + 1)
        moving = _moving(recording)
        rate_of_model = np.zeros_like(residual)
        for cause in causes:
            if (cause.name, cause.joint) == ('delay', ALL_JOINTS):
                rate_of_model = -cause.directions[..., 0]
        of_blocks: Array = np.zeros((BLOCKS, len(delays), residual.shape[1]))
        information: Array = np.zeros_like(of_blocks)
        squares = np.zeros((len(delays), residual.shape[1]))
        for k, delay in enumerate(delays):
            # The rate of the torque that belongs to the motion, if it is so late.
            on_time = _on_time(recording, delay)
            rate = np.where(moving, np.gradient(on_time, t, axis=0), 0.0)
            left = residual + np.where(moving, on_time - recording.tau, 0.0)
            squares[k] = np.sum(left**2, axis=0) / self._sigma**2
            weighted = rate / self._sigma**2
            for block, rows in enumerate(np.array_split(np.arange(len(t)), BLOCKS)):
                of_blocks[block, k] = np.sum(weighted[rows] * left[rows], axis=0)
                information[block, k] = np.sum(weighted[rows] * rate_of_model[rows], axis=0)
        return _DelayScores(delays, of_blocks, information, squares)

    def _sizes(self, cause: _Cause, residual: Array, scores: '_DelayScores') -> CauseSizes:
        """
        Return the sizes of a cause with which its instruments leave no correlation.

        Those of a direction that is only noise are 0, without blocks NaN.
        """
        directions = cause.directions
        if cause.name == 'delay':
            return scores.delay(np.asarray(directions.any(axis=(0, 2))))
        weighted = directions / self._sigma[:, None]
        # Columns of length 1: kg and N m have no common measure.
        length = np.sqrt(np.sum(weighted**2, axis=(0, 1)))
        length[length == 0.0] = 1.0
        weighted = weighted / length
        instruments = cause.instruments / (self._sigma[:, None] * length)
        target = residual / self._sigma
        count = directions.shape[2]
        information: Array = np.zeros((BLOCKS, count, count))
        products = np.zeros((BLOCKS, count))
        for k, rows in enumerate(np.array_split(np.arange(len(residual)), BLOCKS)):
            # All rows and joints of a block below each other.
            A = weighted[rows].reshape(-1, count)
            Z = instruments[rows].reshape(-1, count)
            information[k] = Z.T @ A
            products[k] = Z.T @ target[rows].ravel()
        # Rows far enough apart have no noise in common: a direction that is noise has no
        # size. Its instrument is strong if F of the first stage is above 10.
        correlation = np.sum(instruments[..., 0] * weighted[..., 0], axis=1)
        if correlation.sum() <= np.sqrt(STRONG * np.sum(correlation**2)):
            return CauseSizes(np.zeros(count), np.full((BLOCKS, count), np.nan))
        # Of all blocks, then of all but one.
        without = information.sum(axis=0) - information, products.sum(axis=0) - products
        information = np.concatenate([[information.sum(axis=0)], without[0]])
        products = np.concatenate([[products.sum(axis=0)], without[1]])
        # A direction that vanishes has no size. The matrix of instruments and directions
        # is not symmetric.
        inverse = np.linalg.pinv(information, rcond=1e-8)
        sizes = (inverse @ products[..., None])[..., 0] / length
        return CauseSizes(sizes[0], sizes[1:])


def _require_rows(model: Model, recording: Recording) -> None:
    """Raise InputError unless a recording is of the model and long enough."""
    check_recording(model, recording, FEWEST_ROWS)
    if not recording.tau.any():
        raise InputError('recording: the efforts are all 0; expected measured ones')
    require_rigid_links(model)


def _residual(robot: Robot, recording: Recording) -> Array:
    """Return measured minus computed torques, (N, n), N m or N."""
    computed = robot.inverse_dynamics(recording.q, recording.u, recording.udot)
    return np.asarray(recording.tau - computed)


def _mean_motion(recording: Recording, other: Recording) -> Recording:
    """Return the mean of two recordings of the same motion, with the torques of the first."""
    columns = {}
    for name in ('q', 'u', 'udot'):
        columns[name] = 0.5 * (getattr(recording, name) + getattr(other, name))
    return replace(recording, **columns)


def _with_mean_rates(recording: Recording) -> Recording:
    """
    Return the recording with means of speeds and accelerations over a short time.

    Noise of differences grows with the rate of the rows. Where the model is not linear,
    as in friction that grows with the load, noise changes the mean torque: it has to be
    alike in all recordings.
    """
    rows = _rows_of(RATE_SPAN, recording.t)
    return replace(recording, u=_mean(recording.u, rows), udot=_mean(recording.udot, rows))


def _share(torque: Array, recording: Recording) -> float:
    """Return the RMS of a torque over that of the measured one, of the joint with the largest."""
    moving = _moving(recording)
    measured = np.nan_to_num(moving_rms(recording.tau, moving), nan=np.inf)
    return float((np.nan_to_num(moving_rms(torque, moving)) / np.maximum(measured, 1e-12)).max())


def _moving(recording: Recording) -> Flags:
    """Return where a joint moves, (N, n)."""
    return np.asarray(np.abs(recording.u) > STANDSTILL)


def _same_motion(recording: Recording, other: Recording) -> bool:
    """Return whether two recordings are of the same motion, row by row."""
    if len(recording) != len(other):
        return False
    reach = np.maximum(np.ptp(other.q, axis=0), 1e-6)
    distance = np.sqrt(np.mean((recording.q - other.q)**2, axis=0)) / reach
    return bool((distance < SAME_MOTION).all())


def _causes(robot: Robot, recording: Recording) -> list[_Cause]:
    """Return the possible causes with their directions and instruments."""
    moving = _moving(recording)
    causes = []
    around = _motion_around(recording)
    for (name, joint, directions), (_, _, instruments) in zip(
            _directions(robot, recording, moving), _directions(robot, around, moving),
            strict=True):
        causes.append(_Cause(name, joint, directions, instruments))
    return causes


def _motion_around(recording: Recording) -> Recording:
    """
    Return the motion of the rows before and after each row, without the row.

    Accelerations are differences of the speeds of two rows, which may be differences of
    positions: rows as near as these have noise in common, and are left out, too.
    """
    neighbors = NEIGHBORS_OF_SPEEDS
    if 'u' in recording.derived:
        neighbors = NEIGHBORS_OF_POSITIONS
    left_out = neighbors + _rows_of(RATE_SPAN, recording.t)
    reach = left_out + max(neighbors, _rows_of(SMOOTHED, recording.t))
    return replace(recording, q=_mean_around(recording.q, left_out, reach),
                   u=_mean_around(recording.u, left_out, reach),
                   udot=_mean_around(recording.udot, left_out, reach))


def _directions(robot: Robot, recording: Recording,
                moving: Flags) -> list[tuple[str, str, Array]]:
    """Return name, joint and directions of the torque, (N, n, k), of each cause."""
    # Each cause changes the torque in a direction that follows from the recording.
    q, u, udot = recording.q, recording.u, recording.udot
    torque = robot.inverse_dynamics(q, u, udot)
    offsets = np.array([joint.friction_offset for joint in robot.model.coordinate_joints])
    terms = robot.torque_terms(q, u, udot)
    friction = terms[:, TORQUE_TERMS.index('friction')] - offsets
    smooth = robot.inverse_dynamics(q, u, _mean(udot, _rows_of(SMOOTHED, recording.t)))
    rate = np.gradient(smooth, recording.t, axis=0)
    causes = []
    # A payload is a load on the drives, too, and increases their friction.
    load = torque - terms[:, TORQUE_TERMS.index('friction')]
    drives = 1.0 + _load_slopes(robot, u, load)
    Y = robot.regressor(q, u, udot) * (drives * moving)[..., None]
    parents = {body.parent for body in robot.model.bodies}
    for k, body in enumerate(robot.model.bodies):
        if k not in parents - {WORLD}:
            # Mass, and mass times its center: the inertia of a payload is small.
            causes.append(('payload', body.name, Y[:, :, 10 * k:10 * k + 4]))
    causes.append(('delay', ALL_JOINTS, -(rate * moving)[..., None]))
    # Causes of one joint: a column of it alone, where it moves.
    for j, name in enumerate(robot.joint_names):
        of_joint = {'friction': friction[:, j], 'offset': np.ones(len(q)),
                    'torque constant': torque[:, j], 'delay': -rate[:, j]}
        for cause, column in of_joint.items():
            directions = np.zeros((*torque.shape, 1))
            directions[:, j, 0] = column * moving[:, j]
            causes.append((cause, name, directions))
    return causes


def _rows_of(span: float, t: Array) -> int:
    """Return how many rows either way make up a time."""
    return round(0.5 * span / float(np.median(np.diff(t))))


def _mean(values: Array, rows: int) -> Array:
    """Return the mean of each row and some rows before and after it, (N, n)."""
    mean = scientific('scipy.ndimage').uniform_filter1d
    return np.asarray(mean(values, 2 * rows + 1, axis=0, mode='nearest'))


def _mean_around(values: Array, left_out: int, reach: int) -> Array:
    """Return the mean of the rows up to a reach, without the nearest ones, (N, n)."""
    near = (2 * left_out + 1) * _mean(values, left_out)
    total = (2 * reach + 1) * _mean(values, reach)
    return (total - near) / (2.0 * (reach - left_out))


def _load_slopes(robot: Robot, u: Array, load: Array) -> Array:
    """Return the derivative of friction by the loads on the drives, (N, n)."""
    slopes = np.zeros_like(load)
    for j, joint in enumerate(robot.model.coordinate_joints):
        slopes[:, j] = load_slope(joint, u[:, j], load[:, j])
    return slopes


def _repeats(cause: _Cause, alarm: ModelChange) -> bool:
    """Return whether an alarm has named a cause; a common delay is one of each joint."""
    if cause.name != alarm.cause:
        return False
    common = cause.name == 'delay' and ALL_JOINTS in (cause.joint, alarm.joint)
    return common or cause.joint == alarm.joint


def _added_torque(recording: Recording, cause: _Cause, size: Array) -> Array:
    """Return the torque that a cause of a size adds, (N, n)."""
    if cause.name != 'delay':
        return np.asarray(cause.directions @ size)
    late = recording.tau - _on_time(recording, float(size[0]))
    delayed = cause.directions.any(axis=(0, 2))
    return np.where(_moving(recording) & delayed, late, 0.0)


def _on_time(recording: Recording, delay: float) -> Array:
    """Return the measured torques that belong to the motion if they are late, (N, n)."""
    t = recording.t
    return np.column_stack([np.interp(t + delay, t, tau) for tau in recording.tau.T])


def _floor(cause: str, sigma: Array) -> float:
    """Return the smallest size of a cause that is more than rounding."""
    if cause == 'offset':
        return LEAST_SIZE * float(sigma.min())
    return LEAST_SIZE


def _spread(jackknifed: Array) -> Array:
    """Return the standard error from the sizes without each block, (k,)."""
    count = len(jackknifed)
    apart = jackknifed - jackknifed.mean(axis=0)
    return np.asarray(np.sqrt((count - 1) / count * np.sum(apart**2, axis=0)))
