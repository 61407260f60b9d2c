"""
Check that a recording matches the model: units, signs, exchanged joints, gravity, delay.

Positions, speeds and times are compared with each other. Torques are compared with those
of the model, plus fitted friction and armature of each joint. A correction of the
recording is a finding if it at least halves the residuals of its joints. Corrections are
applied one after the other, the most effective first. Errors of URDF masses are much
smaller.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
import math
from typing import Literal, NamedTuple

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.recording import check_recording, Recording
from kane_dynamics.identification.recordings.signal_faults import (beyond_limits, frozen_rows,
                                                                   interruptions, kept,
                                                                   longest_stretch,
                                                                   without_outliers)
from kane_dynamics.identification.recordings.torque_delay import (NOISE, smoothed,
                                                                  torque_delays, TorqueDelays)
from kane_dynamics.identification.solvers import on_one_processor, scientific
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import NDArray

CLEARLY = 0.5  # largest ratio of errors, with and without a correction, of a finding
MOST_ROWS = 1500  # used rows, evenly distributed
MOST_FAULTS = 8
MOST_PAUSES = 3  # of which the times are named
LARGE_UNITS = 1e3, 1e2, 10.0  # of efforts beyond limits
OFFSET = math.log(1.0 / 0.6)  # needed fall of the logarithm of errors, of a torque offset
ENCODER_OFFSET = 1.0  # needed fall, of all joints; wrong masses cause up to 0.7
LEAST_OFFSET = 0.05  # rad, of an encoder
LEAST_TORQUE_OFFSET = 0.02  # of the effort limit
ASYMMETRY = 0.5  # of the Coulomb friction, that is no offset of the sensor
RANK = 1e-3  # relative size of what is regarded as zero in the fit of inertial parameters
DIFFERENCE = 1e-4  # rad or m, of a derivative by differences
SLIP = 0.05  # assumed friction speed, rad/s or m/s
FLOOR = 0.03  # of the measured torque: smaller errors need no correction
WINDOWS = 200  # number of windows in which positions and speeds are compared
EXPECTED = 'expected it, in rad/s or m/s'
UNITS = ((math.degrees(1.0), 'are they in degrees a second?'),
         (math.radians(1.0), 'are the positions in degrees?'),
         (1e3, 'are the times in milliseconds?'), (1e6, 'are the times in microseconds?'),
         (1e9, 'are the times in nanoseconds?'), (1e-3, 'are they in units 1000 times as large?'))


@dataclass(frozen=True)
class RecordingFault:
    """
    Problem of a recording.

    Attributes
    ----------
    level : 'impossible', 'wrong' or 'remark'
        'impossible': positions, speeds and times contradict each other. 'wrong': torques
        contradict the model. 'remark': a fit is still possible.
    words : str

    """

    level: Literal['impossible', 'wrong', 'remark']
    words: str


class _Repair(NamedTuple):
    """Corrected recording, its joints, and the description of their error."""

    kind: str
    joints: tuple[int, ...]
    recording: Recording
    needed: float  # least fall of the sum of logarithms of errors
    factor: float = 1.0  # by which its efforts were divided


@on_one_processor
def diagnose(model: Model, recording: Recording, *, gravity_added: bool = False
             ) -> list[RecordingFault]:
    """
    Return the problems of a recording, most severe first.

    Parameters
    ----------
    model : Model
        The model of the arm.
    recording : Recording
        Of the joints of the model.
    gravity_added : bool
        Whether the gravity of the model was added to efforts that are stated to lack it.

    Raises
    ------
    InputError
        If the recording has another number of joints, or less than 3 rows.

    """
    check_recording(model, recording)
    found = [RecordingFault('impossible', words) for words in _motion(model, recording)]
    if not recording.tau.any():
        found.append(RecordingFault('wrong', 'the measured efforts are all 0: the '
                                    'recording has none'))
    elif not found:
        sound, signals = _signals(model, recording)
        found += signals
        found += _torques(model, sound, gravity_added, silent=bool(signals))
    found += _interruptions(recording)
    noise = recording.acceleration_noise()
    noisy = np.flatnonzero(noise > NOISE)
    if len(noisy):
        found.append(RecordingFault(
            'remark', f'accelerations of {_named(model, noisy)} are noise to '
            f'{100.0 * noise[noisy].max():.0f} %; expected filtered ones: --cutoff HZ'))
    return found


def refuse_faulty(model: Model, recording: Recording,
                  levels: tuple[str, ...] = ('impossible', 'wrong'), *,
                  gravity_added: bool = False) -> list[RecordingFault]:
    """Return the faults of a recording; raise InputError if one is of these levels."""
    found = diagnose(model, recording, gravity_added=gravity_added)
    worst = [finding.words for finding in found if finding.level in levels]
    if worst:
        raise InputError(f'recording: {"; ".join(worst)}')
    return found


def _named(model: Model, joints: Sequence[int] | NDArray[np.intp]) -> str:
    """Return names of joints as text."""
    if len(joints) == model.n:
        return 'all joints' if model.n > 1 else f"joint '{model.joint_names[0]}'"
    names = [f"'{model.joint_names[j]}'" for j in joints]
    return f'joint{"s" if len(names) > 1 else ""} {", ".join(names)}'


def _motion(model: Model, recording: Recording) -> Iterator[str]:
    """Yield contradictions of positions, speeds and times."""
    limits = Robot(model).limits
    turning = np.array([name not in model.sliding for name in model.joint_names])
    most = np.abs(recording.q).max(axis=0)
    reach = np.where(np.isfinite(limits.upper - limits.lower),
                     np.maximum(np.abs(limits.lower), np.abs(limits.upper)), 4.0 * math.pi)
    beyond = np.flatnonzero(turning & (most > 2.0 * reach))
    if len(beyond) and (np.radians(most) <= 1.1 * reach)[turning].all():
        yield (f'positions of {_named(model, beyond)} reach {most[beyond].max():.4g} '
               f'rad, limits {reach[beyond].max():.4g} rad; expected rad: are these '
               'degrees?')
        return
    step = float(np.median(np.diff(recording.t)))
    if 'u' in recording.derived:
        if step >= 0.5:
            yield (f'times: rows are {step:g} s apart; expected seconds: are the times '
                   'in milliseconds?')
        return
    width = max(1, len(recording) // WINDOWS)
    # Speeds are integrated over windows of rows; no window spans an interruption.
    missing = np.concatenate([[0.0], np.cumsum(_is_interruption(recording))])
    whole = missing[width:] == missing[:-width]
    mean = 0.5 * (recording.u[1:] + recording.u[:-1]) * np.diff(recording.t)[:, None]
    way = np.vstack([np.zeros(mean.shape[1]), np.cumsum(mean, axis=0)])
    D, W = ((x[width:] - x[:-width])[whole] for x in (recording.q, way))
    size = np.linalg.norm(D, axis=0)
    moves = np.flatnonzero(np.abs(recording.q - recording.q[0]).max(axis=0) > 0.02)
    with np.errstate(invalid='ignore', divide='ignore'):
        likeness = (W.T @ D) / np.outer(np.linalg.norm(W, axis=0), size)
        factor = np.sum(W * D, axis=0) / size**2
    reports: dict[str, list[int]] = {}
    for j in moves:
        own = likeness[j, j]
        other = int(np.nanargmax(np.where(np.arange(len(size)) == j, -1.0, likeness[j])))
        if own > 0.8 and 0.6 < factor[j] < 1.6:
            continue
        if own > 0.8:
            words = next((f'{value:.4g} times the derivative of the positions; {EXPECTED}: {unit}'
                          for value, unit in UNITS if 0.8 < factor[j] / value < 1.25),
                         f'{factor[j]:.2g} times the derivative of the positions; '
                         f'{EXPECTED}')
        elif own < -0.8:
            words = f'the negative derivative of the positions; {EXPECTED}'
        elif likeness[j, other] > 0.8:
            words = (f"the derivative of the positions of joint '{model.joint_names[other]}'; "
                     'expected those of their own joint')
        else:
            words = f'not the derivative of the positions; {EXPECTED}'
        reports.setdefault(words, []).append(int(j))
    for words, joints in reports.items():
        yield f'speeds of {_named(model, joints)} are {words}'


def _is_interruption(recording: Recording) -> Array:
    """Return for each step of time whether it is an interruption, 0 or 1, (N - 1,)."""
    steps = np.zeros(len(recording) - 1)
    steps[interruptions(recording)] = 1.0
    return steps


def _interruptions(recording: Recording) -> Iterator[RecordingFault]:
    """Yield the interruptions of the times."""
    after = interruptions(recording)
    if len(after):
        lengths = np.diff(recording.t)[after]
        where = ', '.join(f'{length:.3g} s after {recording.t[row]:.4g} s'
                          for row, length in zip(after[:MOST_PAUSES], lengths, strict=False))
        more = f' and {len(after) - MOST_PAUSES} more' if len(after) > MOST_PAUSES else ''
        yield RecordingFault('remark', f'times: interruption of {where}{more}; expected '
                             'a recording without interruptions, as filters and '
                             'differences need it')


def _signals(model: Model, recording: Recording) -> tuple[Recording, list[RecordingFault]]:
    """Return a recording without faults of single effort signals, and these faults."""
    found: dict[str, list[int]] = {}
    sound, flags = without_outliers(longest_stretch(recording))
    for j in np.flatnonzero(flags.any(axis=0)):
        row = int(np.flatnonzero(flags[:, j])[0])
        kind = (f'efforts of {{}} have {flags[:, j].sum()} outliers, the first at '
                f'{sound.t[row]:.4g} s: a spike or a lost message')
        found.setdefault(kind, []).append(int(j))
    frozen = frozen_rows(sound)
    for j in np.flatnonzero(frozen.any(axis=0)):
        stretch = np.flatnonzero(frozen[:, j])
        first, last = sound.t[stretch[0]], sound.t[stretch[-1]]
        kind = (f'efforts of {{}} are constant from {first:.4g} s to {last:.4g} s while '
                'the joint moves')
        found.setdefault(kind, []).append(int(j))
    # A joint without any sound row gets the model's torque, in which nothing is to be
    # corrected.
    dead = frozen.all(axis=0)
    sound_rows: Flags = ~np.asarray((frozen & ~dead).any(axis=1))
    sound = kept(sound, sound_rows)
    if dead.any():
        rigid = Robot(model, friction=False).inverse_dynamics(sound.q, sound.u, sound.udot)
        sound = replace(sound, tau=np.where(dead, rigid, sound.tau))
    return sound, [RecordingFault('wrong', kind.format(_named(model, joints)))
                   for kind, joints in found.items()]


def _torques(model: Model, recording: Recording, gravity_added: bool, *, silent: bool
             ) -> Iterator[RecordingFault]:
    """
    Yield errors of torques, found by the corrections that reduce the residual.

    Delays are judged only if there is no other error, `silent` says of a former one.
    """
    given = smoothed(recording)
    robot = Robot(model, friction=False)
    now = given.rows(slice(None, None, max(1, len(given) // MOST_ROWS)))
    found: dict[str, list[int]] = {}
    now, scaled = _within_limits(robot, now)
    for kind, joint in scaled:
        found.setdefault(kind, []).append(joint)
    errors = _errors(robot, now)
    for _ in range(MOST_FAULTS):
        best: tuple[float, _Repair, Array] | None = None
        for repair in _repairs(robot, now, errors, gravity_added):
            left = _errors(robot, repair.recording)
            own = list(repair.joints)
            as_measured = left.copy()
            as_measured[own] *= repair.factor
            fall = float(np.log(errors / as_measured).sum())
            if (fall > repair.needed and (as_measured[own] <= 1.01 * errors[own]).all()
                    and (best is None or fall > best[0] + 1e-3)):
                best = fall, repair, left
        if best is None:
            break
        _, repair, errors = best
        now = repair.recording
        found.setdefault(repair.kind, []).extend(repair.joints)
    for kind, joints in found.items():
        which = sorted(set(joints))
        yield RecordingFault('wrong', kind.format(_named(model, which)))
    if not found and not silent:
        yield from _delays(model, torque_delays(model, given))


def _within_limits(robot: Robot, r: Recording) -> tuple[Recording, list[tuple[str, int]]]:
    """Return the efforts in N m where they exceed the limits by far, with kind and joint."""
    rigid = robot.inverse_dynamics(r.q, r.u, r.udot)
    tau, found = r.tau.copy(), []
    for j in np.flatnonzero(beyond_limits(r, np.asarray(robot.limits.effort))):
        measured, computed = (float(np.linalg.norm(x[:, j])) for x in (tau, rigid))
        ratio = measured / max(computed, 1e-12)
        distances = np.abs(np.log(ratio / np.array(LARGE_UNITS)))
        value = LARGE_UNITS[int(np.argmin(distances))]
        tau[:, j] /= value
        found.append((_scale_words(value), int(j)))
    return replace(r, tau=tau), found


def _scale_words(factor: float) -> str:
    """Return the description of efforts of another unit."""
    unit = next((f': {name}?' for value, name in (
        (1e3, 'mN m'), (1e2, 'N cm'), (1e-3, 'kN m')) if 0.6 < factor / value < 1.6),
        ': another unit, a current, or torque before the gearbox?')
    return f'efforts of {{}} are about {factor:.3g} times the torques{unit}'


def _errors(robot: Robot, recording: Recording) -> Array:
    """Return the RMS of each joint's torque residual with fitted friction, (n,)."""
    rigid = robot.inverse_dynamics(recording.q, recording.u, recording.udot)
    return np.array([_fitted(recording, j, recording.tau[:, j] - rigid[:, j])[0]
                     for j in range(robot.n)])


def _fitted(recording: Recording, j: int, left: Array, model: Array | None = None
            ) -> tuple[float, float]:
    """Return the residual of a torque with fitted friction, and the factor of a model torque."""
    tau = recording.tau[:, j]
    torques = [] if model is None else [model]
    columns = np.column_stack([_friction_columns(recording, j), *torques, left])
    R: Array = np.asarray(np.linalg.qr(columns, mode='r'))
    x, missed = scientific('scipy.optimize').nnls(R[:, :-1], R[:, -1])
    root = math.sqrt(len(tau))
    return (max(float(missed), FLOOR * float(np.linalg.norm(tau)), 1e-9 * root) / root,
            float(x[-1]))


def _repairs(robot: Robot, r: Recording, errors: Array, gravity_added: bool
             ) -> Iterator[_Repair]:
    """Yield recordings with one correction each."""
    n, once = robot.n, math.log(1.0 / CLEARLY)
    q, tau, gravity = r.q, r.tau, robot.gravity_force(r.q)
    rigid = robot.inverse_dynamics(q, r.u, r.udot)
    weighty = np.flatnonzero(np.abs(gravity).max(axis=0) > 1e-6)
    sets = [tuple(range(n)), *((j,) for j in range(n))] if n > 1 else [(0,)]

    def with_tau(change: Callable[[Array], Array], joints: tuple[int, ...]) -> Recording:
        new = tau.copy()
        new[:, joints] = change(tau)[:, joints]
        return replace(r, tau=new)
    for joints in sets:
        heavy = [j for j in joints if j in weighty]
        yield _Repair('efforts of {} have the opposite sign of torques on the joints: '
                      'multiply them by -1', joints, with_tau(lambda tau: -tau, joints),
                      once * len(joints))
        if heavy:
            yield _Repair('efforts of {} fit the torques without gravity: the arm holds '
                          'its weight by itself, or reports efforts without it; '
                          'expected efforts with gravity, or a statement that they lack '
                          'it (--efforts-without-gravity)', joints,
                          with_tau(lambda tau: tau + gravity, joints), once * len(heavy))
            yield _Repair('efforts of {} have the opposite sign of torques on the '
                          'joints, and fit these without gravity', joints,
                          with_tau(lambda tau: gravity - tau, joints), once * len(joints))
        if heavy and gravity_added:  # else it is a payload that makes gravity larger
            yield _Repair('efforts of {} fit the torques with gravity twice: they hold '
                          'the weight already; expected no --efforts-without-gravity', joints,
                          with_tau(lambda tau: tau - gravity, joints), once * len(heavy))
    scaled = [_fitted(r, j, tau[:, j], rigid[:, j]) for j in range(n)]
    factors = np.array([factor for _, factor in scaled])
    # The factor is known where rigid bodies cause most of the torque, or where it
    # matters.
    clear = factors * np.abs(rigid).max(axis=0) > 0.5 * np.abs(tau).max(axis=0)
    clear |= (np.array([left for left, _ in scaled]) < CLEARLY * errors) & (factors > 0.0)
    for joints in sets:
        known = [j for j in joints if clear[j]]
        if not known:
            continue
        factor = float(np.median(factors[known]))
        if 0.4 < factor < 2.5:
            continue
        yield _Repair(_scale_words(factor), joints,
                      with_tau(lambda tau, factor=factor: tau / factor,  # type: ignore[misc]
                               joints), once * len(known), factor)
    for j in range(n):
        sign = np.ones(n)
        sign[j] = -1.0
        turned = replace(r, q=q * sign, u=r.u * sign, udot=r.udot * sign)
        yield _Repair('positions of {} have the opposite sign', (j,), turned, 2.0 * once)
        yield _Repair('positions and efforts of {} have the opposite sign', (j,),
                      replace(turned, tau=tau * sign), 2.0 * once)
    yield from _torque_offsets(robot, r, tau - rigid)
    yield from _encoder_offsets(robot, r, errors)
    for pair in combinations(range(n), 2):
        order = np.arange(n)
        order[list(pair)] = pair[::-1]
        moved = {name: getattr(r, name)[:, order] for name in ('q', 'u', 'udot')}
        exchanged = tau[:, order]
        yield _Repair('efforts of {} are exchanged', pair, replace(r, tau=exchanged), 2.0 * once)
        yield _Repair('positions of {} are exchanged', pair, replace(r, **moved), 3.0 * once)
        yield _Repair('{} are exchanged', pair, replace(r, **moved, tau=exchanged), 3.0 * once)


def _torque_offsets(robot: Robot, r: Recording, left: Array) -> Iterator[_Repair]:
    """
    Yield recordings without the constant offset of one joint's torques.

    Wrong masses cause a mean error too. The offset is therefore fitted together with all
    inertial parameters, and only then compared with the given ones.
    """
    if robot.model.flexible:  # beams have no regressor
        return
    Y = robot.regressor(r.q, r.u, r.udot)
    limits = np.asarray(robot.limits.effort)
    for j in range(robot.n):
        columns = np.column_stack([Y[:, j], _friction_columns(r, j), np.ones(len(r))])
        columns = columns[:, columns.any(axis=0)]
        size = np.linalg.norm(columns, axis=0)
        x = scientific('scipy.linalg').lstsq(columns / size, left[:, j], cond=RANK,
                                             lapack_driver='gelsy')[0] / size
        offset, coulomb_friction = float(x[-1]), abs(float(x[-3]))
        # Friction differs with the direction: a smaller offset is part of it.
        least = ASYMMETRY * coulomb_friction
        if np.isfinite(limits[j]):
            least = max(least, LEAST_TORQUE_OFFSET * float(limits[j]))
        if abs(offset) <= least:
            continue
        tau = r.tau.copy()
        tau[:, j] -= offset
        yield _Repair(f'efforts of {{}} have a constant offset of about {offset:.3g} N m or N',
                      (j,), replace(r, tau=tau), OFFSET)


def _encoder_offsets(robot: Robot, r: Recording, errors: Array) -> Iterator[_Repair]:
    """
    Yield recordings without an offset of one joint's positions.

    The offset is that of a Gauss-Newton step: residuals of all joints, without what
    their friction explains, are fitted by the derivative of the torques with respect to
    the position.
    """
    for j in range(robot.n):
        shifted, total = r, 0.0
        for _ in range(2):  # steps
            step = _encoder_step(robot, shifted, errors, j)
            q = shifted.q.copy()
            q[:, j] += step
            shifted, total = replace(shifted, q=q), total + step
        if LEAST_OFFSET < abs(total) < 1.0:
            yield _Repair(f'positions of {{}} have an offset of about {-total:.2g} rad or m', (j,),
                          shifted, ENCODER_OFFSET)


def _encoder_step(robot: Robot, r: Recording, errors: Array, j: int) -> float:
    """Return the change of a joint's position that reduces the residuals most, rad or m."""
    change = np.zeros(robot.n)
    change[j] = DIFFERENCE
    high, low = (robot.inverse_dynamics(r.q + sign * change, r.u, r.udot) for sign in (1.0, -1.0))
    slope = (high - low) / (2.0 * DIFFERENCE)
    left = r.tau - 0.5 * (high + low)
    product = square = 0.0
    for k in range(robot.n):
        basis = np.linalg.qr(_friction_columns(r, k))[0]
        of_slope = slope[:, k] - basis @ (basis.T @ slope[:, k])
        product += float(of_slope @ left[:, k]) / errors[k]**2
        square += float(of_slope @ of_slope) / errors[k]**2
    return product / square if square > 0.0 else 0.0


def _friction_columns(r: Recording, j: int) -> Array:
    """Return the torques of unit damping, friction and armature of a joint, (N, 3)."""
    u = r.u[:, j]
    return np.column_stack([u, coulomb(u, SLIP), r.udot[:, j]])


def _delays(model: Model, delays: TorqueDelays) -> Iterator[RecordingFault]:
    """Yield delays of torques: the common one, and those of joints that differ from it."""
    late = {int(j): float(delays.delay[j]) for j in np.flatnonzero(delays.different)}
    same = [int(j) for j in np.flatnonzero(delays.judged) if int(j) not in late]
    unknown = np.flatnonzero(~delays.judged)
    more = f' ({_named(model, unknown)} cannot be judged)' if len(unknown) else ''
    found = [(same, delays.common, delays.common_deviation)] if delays.delayed else []
    found += [([j], delay, float(delays.deviation[j])) for j, delay in late.items()]
    for joints, delay, deviation in found:
        side = 'after' if delay > 0.0 else 'before'
        yield RecordingFault('remark', f'efforts of {_named(model, joints)} come '
                             f'{abs(delay):.3g} s (+- {deviation:.1g} s) {side} the '
                             f'motion that they belong to{more}')
