"""
Watch over a model: which of its parameters no longer fits the arm, and of which joint.

The residual is the measured torque less that of the model. Each possible cause adds a
known torque to it:

    payload           the columns of mass and center of mass of an outermost body
    friction          the friction of a joint
    offset            a constant torque of a joint
    torque constant   the torque of a joint

times a size, which is fitted by least squares, one cause at a time. The model's own errors
have sizes too: the mean of those in recordings of the sound arm, the references, is
subtracted. Rows in which a joint rests say nothing of it, because static friction is unknown.

A delay of all torques comes first: `torque_delays` estimates it without the model's masses
and friction, so that no other change is taken for one. The other causes are judged on the
torques without the delay.

Sound arms change from day to day, friction most of all. The torque of a change is therefore
measured in units of what is uncertain of a joint: the RMS of its friction and of the residual
of the references. A change is an alarm if the torque that it explains, of all joints
together, is at least a smallest number of these units, and its size beyond four standard
errors (jackknife over blocks of rows). Several references state how much a sound arm changes;
with one, a usual change of friction is assumed.

The cause that explains most is named first; the others are judged on what it leaves. A
residual that is several times that of the references and that no cause explains is an alarm
too, of an unknown cause.
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
from kane_dynamics.identification.recordings.torque_delay import torque_delays
from kane_dynamics.identification.regression import rms
from kane_dynamics.identification.solvers import on_one_processor, scientific
from kane_dynamics.mechanics.friction import load_slope
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np

BLOCKS = 16
FEWEST_ROWS = 10 * BLOCKS
SURE = 4.0  # standard errors
SURE_OF_DELAY = 3.0  # standard deviations; `torque_delays` widens them by what is correlated
MOST_ALARMS = 3  # that are named, one after the other
ROUNDING = 1e-6  # of the torque: a smaller residual is none
UNCERTAIN = 0.1  # of the torque of a cause that was named: its law is not exact
SMALLEST = 0.42  # with one reference; friction of sound arms differs by less
BEYOND = 1.5  # times the largest change between references
LEAST = 0.1  # of what is uncertain of a joint: no smaller change matters by default
UNEXPLAINED = 3.0  # times the residual of the reference
RATE_SPAN = 0.02  # s, of means of speeds and accelerations
ALL_JOINTS = 'all joints'
UNKNOWN = 'unknown'
DELAY = 'delay'


class ModelChange(NamedTuple):
    """
    A change of the arm that its model does not have.

    Attributes
    ----------
    joint : str
        The joint, or 'all joints' for a delay; the body for a payload.
    cause : str
        'payload', 'friction', 'offset', 'torque constant', 'delay' or 'unknown'.
    size, deviation : float
        How large it is, and its standard deviation: kg; relative; N m or N; relative; s;
        the residual that no cause explains, relative to that of the reference.
    share : float
        RMS of the torque that it explains, relative to the friction and the residual of the
        reference, root of the sum of squares over joints.

    """

    joint: str
    cause: str
    size: float
    deviation: float
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
        if self.cause == DELAY:
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
        RMS of the residuals of the recording and of the references, N m or N.
    alarms : tuple of ModelChange
        Empty for a sound recording.
    judged : (n,) array of bool
        Joints that move enough, in the recording and in the references; nothing is said of
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


class ModelWatch:
    """
    Compares recordings with a model and with recordings of the sound arm.

    Parameters
    ----------
    model : Model
        Of the arm, as identified.
    reference : Recording or sequence of Recording
        Of the sound arm; not that of another payload. Several ones, as of other days, state
        by how much a sound arm changes.
    smallest : float, optional
        Smallest torque of a change that is an alarm, relative to what is uncertain of a
        joint: its friction, and the residual of the references. Default: 1.5 times the
        largest change between references, at least 0.1; 0.42 with one.

    Raises
    ------
    InputError
        The recording has other joints or too few rows, or `smallest` is out of range.

    """

    def __init__(self, model: Model, reference: Recording | Sequence[Recording], *,
                 smallest: float | None = None) -> None:
        references = [reference] if isinstance(reference, Recording) else list(reference)
        if not references:
            raise InputError('reference: none; expected a recording, or several')
        self._robot = Robot(model)
        motions = [_Motion(self._robot, recording) for recording in references]
        delays = [torque_delays(model, recording) for recording in references]
        self._delay = float(np.mean([delay.common if delay.known else np.nan
                                     for delay in delays]))
        self._delay_deviation = float(rms(np.array([delay.common_deviation
                                                    for delay in delays])))
        of_friction = np.mean([motion.friction_rms for motion in motions], axis=0)
        self._residual = np.mean([rms(motion.residual) for motion in motions], axis=0)
        in_motion = np.mean([motion.residual_rms for motion in motions], axis=0)
        least = ROUNDING * rms(references[0].tau) + 1e-12
        self._sigma = np.maximum(in_motion, least)
        self._unit = np.maximum(np.hypot(of_friction, in_motion), least)
        self._moved = np.all([motion.moves for motion in motions], axis=0)
        # Sizes of each cause in the references, the mean of which is the model's own error.
        self._sound = [np.mean(sizes, axis=0) for sizes in zip(
            *([cause.sizes(motion.in_motion, self._unit) for cause in motion.causes]
              for motion in motions), strict=True)]
        self._smallest = 0.0
        if smallest is not None:
            self._smallest = number(smallest, 'smallest', 'a finite number >= 0',
                                    lambda x: 0.0 <= x < np.inf)
        elif len(references) == 1:
            self._smallest = SMALLEST
        else:
            shares = [alarm.share for recording in references
                      for alarm in self.report(recording).alarms]
            self._smallest = max(BEYOND * max(shares, default=0.0), LEAST)

    @property
    def smallest(self) -> float:
        """Return the smallest torque of an alarm, relative to what is uncertain of a joint."""
        return self._smallest

    @on_one_processor
    def report(self, recording: Recording) -> WatchReport:
        """
        Return the residuals of a recording, and the causes of residuals that are too large.

        Raises
        ------
        InputError
            The recording has other joints or too few rows.

        """
        _require_rows(self._robot.model, recording)
        alarms, recording = self._without_delay(recording)
        motion = _Motion(self._robot, recording)
        judged = self._moved & motion.moves
        remaining = np.where(judged, motion.in_motion, 0.0)
        # The largest cause is taken away, and the others are judged again.
        named = np.zeros_like(remaining)
        for _ in range(MOST_ALARMS - len(alarms)):
            change, torque = self._largest(motion, remaining, named, alarms)
            if change is None:
                break
            alarms.append(change)
            remaining = remaining - torque
            named = named + torque
        alarms += self._unexplained(motion, remaining, named, judged)
        return WatchReport(self._robot.joint_names, rms(motion.residual), self._residual,
                           tuple(alarms), judged)

    def _without_delay(self, recording: Recording) -> tuple[list[ModelChange], Recording]:
        """Return an alarm of a delay, if there is one, and the recording without it."""
        delays = torque_delays(self._robot.model, recording)
        change = delays.common - self._delay
        deviation = float(np.hypot(delays.common_deviation, self._delay_deviation))
        if not (delays.known and abs(change) > SURE_OF_DELAY * deviation):
            return [], recording
        tau = np.column_stack([np.interp(recording.t + change, recording.t, of_joint)
                               for of_joint in recording.tau.T])
        moving = np.abs(recording.u) > STANDSTILL
        torque = np.nan_to_num(moving_rms(recording.tau - tau, moving))
        share = float(np.linalg.norm(torque / self._unit))
        if share <= self._smallest:
            return [], recording
        alarm = ModelChange(ALL_JOINTS, DELAY, change, deviation, share)
        return [alarm], replace(recording, tau=tau)

    def _largest(self, motion: '_Motion', residual: Array, named: Array,
                 alarms: Sequence[ModelChange]) -> tuple[ModelChange | None, Array]:
        """Return the cause that explains most, if it is an alarm, and its torque."""
        largest: ModelChange | None = None
        torque = np.zeros_like(residual)
        for cause, sound in zip(motion.causes, self._sound, strict=True):
            if (cause.name, cause.joint) in [(alarm.cause, alarm.joint) for alarm in alarms]:
                continue
            sizes = cause.sizes(residual, self._unit)
            change = float(sizes[0, 0] - sound[0, 0])
            deviation = float(np.hypot(_spread(sizes), _spread(sound)))
            if not abs(change) > SURE * deviation:
                continue
            # What the cause explains of each joint's squares, beyond what is uncertain of
            # the laws of those that were named.
            fallen = cause.squares(residual, sound[0]) - cause.squares(residual, sizes[0])
            fallen = fallen - UNCERTAIN**2 * np.sum(named**2, axis=0) * (fallen > 0.0)
            mean = fallen / np.maximum(motion.counts, 1) / self._unit**2
            share = float(np.sqrt(max(mean.sum(), 0.0)))
            if share > max(self._smallest, largest.share if largest else 0.0):
                largest = ModelChange(cause.joint, cause.name, change, deviation, share)
                torque = cause.torque(sizes[0]) - cause.torque(sound[0])
        return largest, torque

    def _unexplained(self, motion: '_Motion', remaining: Array, named: Array,
                     judged: Flags) -> list[ModelChange]:
        """Return an alarm of each joint whose residual is large without a known cause."""
        # A few large residuals, such as those of a contact, are no change of the arm: the
        # median of blocks counts.
        blocks = _rms_of_blocks(remaining, motion.moving)
        median = np.median(blocks, axis=0)
        deviation = blocks.std(axis=0) / np.sqrt(BLOCKS) / self._sigma
        # Where named causes explain most, the remainder is an error of their laws.
        of_causes = np.nan_to_num(moving_rms(named, motion.moving))
        is_large = judged & (median > np.maximum(UNEXPLAINED * self._sigma, of_causes))
        share = median / self._unit
        alarms = []
        for j in np.flatnonzero(is_large & (share > self._smallest)):
            alarms.append(ModelChange(self._robot.joint_names[j], UNKNOWN,
                                      float(median[j] / self._sigma[j]),
                                      float(deviation[j]), float(share[j])))
        return alarms


class _Motion:
    """Residuals of a recording, and what each possible cause adds to its torques."""

    def __init__(self, robot: Robot, recording: Recording) -> None:
        _require_rows(robot.model, recording)
        # Noise of differences grows with the rate of the rows: means over a short time are
        # alike in all recordings.
        rows = round(0.5 * RATE_SPAN / float(np.median(np.diff(recording.t))))
        recording = replace(recording, u=_mean(recording.u, rows),
                            udot=_mean(recording.udot, rows))
        self._robot, self._recording = robot, recording
        q, u, udot = recording.q, recording.u, recording.udot
        self.moving: Flags = np.asarray(np.abs(u) > STANDSTILL)
        self.counts = self.moving.sum(axis=0)
        self.moves: Flags = self.counts >= FEWEST_ROWS
        self._torque = robot.inverse_dynamics(q, u, udot)
        self.residual = recording.tau - self._torque
        self.in_motion = np.where(self.moving, self.residual, 0.0)
        self.residual_rms = np.nan_to_num(moving_rms(self.residual, self.moving))
        terms = robot.torque_terms(q, u, udot)
        offsets = [joint.friction_offset for joint in robot.model.coordinate_joints]
        self._all_friction = terms[:, TORQUE_TERMS.index('friction')]
        self._friction = self._all_friction - offsets
        self.friction_rms = np.nan_to_num(moving_rms(self._friction, self.moving))
        self.causes = [*self._payloads(), *self._of_joints()]

    def _payloads(self) -> list['_LinearCause']:
        """Return a payload of each outermost body."""
        recording, model = self._recording, self._robot.model
        # A payload is a load on the drives, too, and increases their friction.
        load = self._torque - self._all_friction
        drives = np.ones_like(load)
        for j, joint in enumerate(model.coordinate_joints):
            drives[:, j] += load_slope(joint, recording.u[:, j], load[:, j])
        Y = self._robot.regressor(recording.q, recording.u, recording.udot)
        Y = Y * (drives * self.moving)[..., None]
        parents = {body.parent for body in model.bodies} - {WORLD}
        # Mass, and mass times its center: the inertia of a payload is small.
        return [_LinearCause('payload', body.name, Y[:, :, 10 * k:10 * k + 4])
                for k, body in enumerate(model.bodies) if k not in parents]

    def _of_joints(self) -> list['_LinearCause']:
        """Return friction, offset and torque constant of each joint."""
        causes = []
        for j, name in enumerate(self._robot.joint_names):
            columns = {'friction': self._friction[:, j], 'offset': np.ones(len(self.moving)),
                       'torque constant': self._torque[:, j]}
            for cause, column in columns.items():
                directions = np.zeros((*self._torque.shape, 1))
                directions[:, j, 0] = column * self.moving[:, j]
                causes.append(_LinearCause(cause, name, directions))
        return causes


class _LinearCause:
    """A possible change, whose torque is `directions`, (N, n, k), times its sizes."""

    def __init__(self, name: str, joint: str, directions: Array) -> None:
        self.name, self.joint = name, joint
        self._directions = directions

    def sizes(self, residual: Array, unit: Array) -> Array:
        """Return the sizes, (1 + blocks, k), of all rows, then without each block."""
        A = self._directions / unit[:, None]
        b = residual / unit
        products = []
        for rows in np.array_split(np.arange(len(b)), BLOCKS):
            block = A[rows].reshape(-1, A.shape[2])
            products.append(block.T @ np.column_stack([block, b[rows].ravel()]))
        total = np.sum(products, axis=0)
        equations = np.array([total, *(total - np.array(products))])
        # Columns of one length: kg and kg m have no common measure.
        length = np.sqrt(np.maximum(np.diag(total), 1e-300))
        scaled = equations[:, :, :-1] / np.outer(length, length)
        inverse = np.linalg.pinv(scaled, rcond=1e-8, hermitian=True)
        return np.asarray((inverse @ (equations[:, :, -1] / length)[..., None])[..., 0]
                          / length)

    def torque(self, size: Array) -> Array:
        """Return the torque of sizes, (N, n)."""
        return np.asarray(self._directions @ size)

    def squares(self, residual: Array, size: Array) -> Array:
        """Return the sum of squares that sizes leave of each joint's residual, (n,)."""
        return np.asarray(np.sum((residual - self.torque(size))**2, axis=0))


def _require_rows(model: Model, recording: Recording) -> None:
    """Raise InputError unless a recording is of the model and long enough."""
    check_recording(model, recording, FEWEST_ROWS)
    if not recording.tau.any():
        raise InputError('recording: the efforts are all 0; expected measured ones')
    require_rigid_links(model)


def _mean(values: Array, rows: int) -> Array:
    """Return the mean of each row and some rows before and after it, (N, n)."""
    mean = scientific('scipy.ndimage').uniform_filter1d
    return np.asarray(mean(values, 2 * rows + 1, axis=0, mode='nearest'))


def _rms_of_blocks(values: Array, moving: Flags) -> Array:
    """Return the RMS of each joint's rows in motion of each block, (blocks, n); 0 at rest."""
    parts = zip(np.array_split(values, BLOCKS), np.array_split(moving, BLOCKS), strict=True)
    return np.nan_to_num([moving_rms(*part) for part in parts])


def _spread(sizes: Array) -> float:
    """Return the standard error of the first size, from those without each block."""
    first = sizes[1:, 0]
    return float(np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((first - first.mean())**2)))
