"""
Check that a recording matches the model: units, signs, exchanged joints, gravity, delay.

Positions, speeds and times are compared with each other. Torques are compared with those of the
model, plus fitted friction and armature of each joint. A correction of the recording is a finding
if it at least halves the residuals of its joints. Corrections are applied one after the other,
the most effective first. Errors of URDF masses are much smaller.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
import math
from typing import Literal, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.recording import check_recording, Recording
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
SLIP = 0.05  # assumed friction speed, rad/s or m/s
FLOOR = 0.03  # of the measured torque: smaller errors need no correction
WINDOWS = 200  # number of windows in which positions and speeds are compared
EXPECTED = 'expected it, in rad/s or m/s'
UNITS = ((math.degrees(1.0), 'are they in degrees a second?'),
         (math.radians(1.0), 'are the positions in degrees?'),
         (1e3, 'are the times in milliseconds?'), (1e6, 'are the times in microseconds?'),
         (1e9, 'are the times in nanoseconds?'), (1e-3, 'are they in units 1000 times as large?'))


@dataclass(frozen=True)
class Finding:
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
             ) -> list[Finding]:
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
    found = [Finding('impossible', words) for words in _motion(model, recording)]
    if not recording.tau.any():
        found.append(Finding('wrong', 'the measured efforts are all 0: the recording has none'))
    elif not found:
        found += _torques(model, recording, gravity_added)
    noise = recording.acceleration_noise()
    noisy = np.flatnonzero(noise > NOISE)
    if len(noisy):
        found.append(Finding('remark', f'accelerations of {_named(model, noisy)} are noise to '
                             f'{100.0 * noise[noisy].max():.0f} %; expected filtered ones: '
                             '--cutoff HZ'))
    return found


def refuse(model: Model, recording: Recording, levels: tuple[str, ...] = ('impossible', 'wrong'),
           *, gravity_added: bool = False) -> list[Finding]:
    """Return the findings about a recording; raise InputError if one is of these levels."""
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
        yield (f'positions of {_named(model, beyond)} reach {most[beyond].max():.4g} rad, limits '
               f'{reach[beyond].max():.4g} rad; expected rad: are these degrees?')
        return
    step = float(np.median(np.diff(recording.t)))
    if 'u' in recording.derived:
        if step >= 0.5:
            yield (f'times: rows are {step:g} s apart; expected seconds: are the times in '
                   'milliseconds?')
        return
    width = max(1, len(recording) // WINDOWS)
    mean = 0.5 * (recording.u[1:] + recording.u[:-1]) * np.diff(recording.t)[:, None]
    way = np.vstack([np.zeros(mean.shape[1]), np.cumsum(mean, axis=0)])
    D, W = (x[width:] - x[:-width] for x in (recording.q, way))
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
                         f'{factor[j]:.2g} times the derivative of the positions; {EXPECTED}')
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


def _torques(model: Model, recording: Recording, gravity_added: bool) -> Iterator[Finding]:
    """Yield errors of torques, found by the corrections that reduce the residual."""
    given = smoothed(recording)
    robot = Robot(model, friction=False)
    now = given.rows(slice(None, None, max(1, len(given) // MOST_ROWS)))
    errors = _errors(robot, now)
    found: dict[str, list[int]] = {}
    for _ in range(MOST_FAULTS):
        best: tuple[float, _Repair, Array] | None = None
        for repair in _repairs(robot, now, gravity_added):
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
        yield Finding('wrong', kind.format(_named(model, which)))
    if not found:
        yield from _delays(model, torque_delays(model, given))


def _errors(robot: Robot, recording: Recording) -> Array:
    """Return the RMS of each joint's torque residual with fitted friction, (n,)."""
    rigid = robot.inverse_dynamics(recording.q, recording.u, recording.udot)
    return np.array([_fitted(recording, j, recording.tau[:, j] - rigid[:, j])[0]
                     for j in range(robot.n)])


def _fitted(recording: Recording, j: int, left: Array, model: Array | None = None
            ) -> tuple[float, float]:
    """Return the residual of a torque with fitted friction, and the factor of a model torque."""
    u, tau = recording.u[:, j], recording.tau[:, j]
    columns = [u, coulomb(u, SLIP), recording.udot[:, j], *([] if model is None else [model])]
    R: Array = np.asarray(np.linalg.qr(np.column_stack([*columns, left]), mode='r'))
    x, missed = scientific('scipy.optimize').nnls(R[:, :-1], R[:, -1])
    root = math.sqrt(len(u))
    return (max(float(missed), FLOOR * float(np.linalg.norm(tau)), 1e-9 * root) / root,
            float(x[-1]))


def _repairs(robot: Robot, r: Recording, gravity_added: bool) -> Iterator[_Repair]:
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
        yield _Repair('efforts of {} have the opposite sign of torques on the joints: multiply '
                      'them by -1', joints, with_tau(lambda tau: -tau, joints),
                      once * len(joints))
        if heavy:
            yield _Repair('efforts of {} fit the torques without gravity: the arm holds its '
                          'weight by itself, or reports efforts without it; expected efforts '
                          'with gravity, or a statement that they lack it '
                          '(--efforts-without-gravity)', joints,
                          with_tau(lambda tau: tau + gravity, joints), once * len(heavy))
            yield _Repair('efforts of {} have the opposite sign of torques on the joints, and fit '
                          'these without gravity', joints,
                          with_tau(lambda tau: gravity - tau, joints), once * len(joints))
        if heavy and gravity_added:  # else it is a payload that makes gravity larger
            yield _Repair('efforts of {} fit the torques with gravity twice: they hold the weight '
                          'already; expected no --efforts-without-gravity', joints,
                          with_tau(lambda tau: tau - gravity, joints), once * len(heavy))
    factors = np.array([_fitted(r, j, tau[:, j], rigid[:, j])[1] for j in range(n)])
    clear = factors * np.abs(rigid).max(axis=0) > 0.5 * np.abs(tau).max(axis=0)
    for joints in sets:
        known = [j for j in joints if clear[j]]
        if not known:
            continue
        factor = float(np.median(factors[known]))
        if 0.4 < factor < 2.5:
            continue
        unit = next((f': {name}?' for value, name in (
            (1e3, 'mN m'), (1e2, 'N cm'), (1e-3, 'kN m')) if 0.6 < factor / value < 1.6),
            ': another unit, a current, or torque before the gearbox?')
        yield _Repair(f'efforts of {{}} are about {factor:.3g} times the torques{unit}', joints,
                      with_tau(lambda tau, factor=factor: tau / factor,  # type: ignore[misc]
                               joints), once * len(known), factor)
    for j in range(n):
        sign = np.ones(n)
        sign[j] = -1.0
        turned = replace(r, q=q * sign, u=r.u * sign, udot=r.udot * sign)
        yield _Repair('positions of {} have the opposite sign', (j,), turned, 2.0 * once)
        yield _Repair('positions and efforts of {} have the opposite sign', (j,),
                      replace(turned, tau=tau * sign), 2.0 * once)
    for pair in combinations(range(n), 2):
        order = np.arange(n)
        order[list(pair)] = pair[::-1]
        moved = {name: getattr(r, name)[:, order] for name in ('q', 'u', 'udot')}
        exchanged = tau[:, order]
        yield _Repair('efforts of {} are exchanged', pair, replace(r, tau=exchanged), 2.0 * once)
        yield _Repair('positions of {} are exchanged', pair, replace(r, **moved), 3.0 * once)
        yield _Repair('{} are exchanged', pair, replace(r, **moved, tau=exchanged), 3.0 * once)


def _delays(model: Model, delays: TorqueDelays) -> Iterator[Finding]:
    """Yield delays of torques: the common one, and those of joints that differ from it."""
    late = {int(j): float(delays.delay[j]) for j in np.flatnonzero(delays.different)}
    same = [int(j) for j in np.flatnonzero(delays.judged) if int(j) not in late]
    unknown = np.flatnonzero(~delays.judged)
    more = f' ({_named(model, unknown)} cannot be judged)' if len(unknown) else ''
    found = [(same, delays.common, delays.common_deviation)] if delays.delayed else []
    found += [([j], delay, float(delays.deviation[j])) for j, delay in late.items()]
    for joints, delay, deviation in found:
        yield Finding('remark', f'efforts of {_named(model, joints)} come {abs(delay):.3g} s (+- '
                      f'{deviation:.1g} s) {"after" if delay > 0.0 else "before"} the motion that '
                      f'they belong to{more}')
