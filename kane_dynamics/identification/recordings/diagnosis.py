"""
Check that a recording matches the model: units, signs, exchanged joints, gravity, delay.

Positions, speeds and times are compared with each other. Torques are compared with those
of the model, plus fitted friction and armature of each joint. A correction of the
recording is a finding if it at least halves the residuals of its joints. Corrections are
applied one after the other, the most effective first. Errors of URDF masses are much
smaller.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
import math
from typing import Literal, NamedTuple

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.identification.poses.held_poses import holds, is_held
from kane_dynamics.identification.recordings.recording import (check_recording,
                                                               Recording, STANDSTILL)
from kane_dynamics.identification.recordings.signal_faults import (beyond_limits,
                                                                   frozen_rows,
                                                                   idle_efforts,
                                                                   interruptions,
                                                                   longest_stretch,
                                                                   without_outliers)
from kane_dynamics.identification.recordings.torque_delay import (NOISE, smoothed,
                                                                  torque_delays,
                                                                  TorqueDelays)
from kane_dynamics.identification.solvers import on_one_processor, scientific
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import NDArray

CLEARLY = 0.5  # largest ratio of errors, with and without a correction, of a fault
ONCE = math.log(1.0 / CLEARLY)  # the fall of one joint's logarithm of errors that is needed
MOST_ROWS = 1500  # used rows, evenly distributed
FEWEST_ROWS = 30  # of which torques are judged
MOST_FAULTS = 8
REVERSED_EFFORTS = ('efforts of {} have the opposite sign of torques on the joints: '
                    'multiply them by -1')
REVERSED = (f'{REVERSED_EFFORTS}; or the positions of that joint have the opposite sign, '
            'which explains the torques as well')
MOST_PAUSES = 3  # of which the times are named
EFFORT_UNITS = ((1e3, 'mN m'), (1e2, 'N cm'), (1e-3, 'kN m'))
LARGE_UNITS = 1e3, 1e2, 10.0, 1.0  # of efforts beyond limits; 1 if limits are too low
RANK = 1e-3  # relative size of what is regarded as zero in the fit of a payload
LEAST_SCALE = 0.6  # of efforts: a factor that is nearer to 1 is an error of masses
MODERATE = 2.5  # a smaller factor may be one of masses
PAYLOAD = 'a payload that the model does not have'
LEAST_PAYLOAD = 0.03  # of the arm's mass: less is an error of masses
FIRST = 1.3  # factor of the evidence for a payload
SLIP = 0.05  # assumed friction speed, rad/s or m/s
FLOOR = 0.03  # of the measured torque: smaller errors need no correction
LONG_STEP = 0.5  # s between rows: seconds would be milliseconds
MOVES = 0.02  # rad or m: a joint that moves less is at rest
LIKE = 0.8  # smallest cosine between speeds and derivatives of positions that are alike
WINDOWS = 200  # number of windows in which positions and speeds are compared
SPEED_WINDOW = 0.3  # s, of displacements that are compared with integrals of speeds
LONGEST_SPEED_DELAY = 0.3  # s
SPEED_ERROR = 0.05  # relative error of displacements for which a delay of speeds counts
HELD = ('the arm is held in {} poses; expected a motion: `kane-dynamics calibrate` takes held '
        'poses')
EXPECTED = 'expected it, in rad/s or m/s'
UNITS = ((math.degrees(1.0), 'are they in degrees a second?'),
         (math.radians(1.0), 'are the positions in degrees?'),
         (1e3, 'are the times in milliseconds?'),
         (1e6, 'are the times in microseconds?'),
         (1e9, 'are the times in nanoseconds?'),
         (1e-3, 'are they in units 1000 times as large?'))

Level = Literal['impossible', 'wrong', 'remark']


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

    level: Level
    words: str


class _Repair(NamedTuple):
    """Corrected recording, its joints, and the description of their error."""

    kind: str
    joints: tuple[int, ...]
    recording: Recording
    needed: float  # least fall of the sum of logarithms of errors
    factor: float = 1.0  # by which its efforts were divided


@on_one_processor
def diagnose(model: Model, recording: Recording, *, gravity_added: bool = False,
             without_effort: Sequence[str] = ()) -> list[RecordingFault]:
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
    without_effort : sequence of str
        Joints whose efforts are not judged.

    Raises
    ------
    InputError
        If the recording has another number of joints, or less than 3 rows.

    """
    check_recording(model, recording)
    if without_effort:
        places = [model.joint_names.index(name) for name in without_effort]
        sound_tau = recording.tau.copy()
        computed = Robot(model).inverse_dynamics(recording.q, recording.u, recording.udot)
        sound_tau[:, places] = computed[:, places]
        recording = replace(recording, tau=sound_tau)
    # What no arm can do excludes further analysis.
    contradictions = list(_motion(model, recording))
    faults = []
    if is_held(recording):
        # Speeds of zero at each pose are right, whatever happens between the poses.
        level: Level = 'impossible' if contradictions else 'remark'
        faults = [RecordingFault(level, HELD.format(len(holds(recording))))]
        contradictions = [words for words in contradictions
                          if not words.startswith('speeds')]
    faults += [RecordingFault('impossible', words) for words in contradictions]
    if not recording.tau.any():
        faults.append(RecordingFault('wrong', 'the measured efforts are all 0: the '
                                     'recording has none'))
    # Faults of single signals first; the torques are judged without them.
    elif not any(fault.level == 'impossible' for fault in faults):
        sound, signals = _signals(model, recording)
        # Beside late speeds, torques seem to come early.
        late_speeds = list(_late_speeds(model, recording))
        faults += signals
        faults += _torques(model, sound, gravity_added,
                           has_signal_faults=bool(signals or late_speeds))
        faults += late_speeds
    faults += _interruptions(recording)

    # Remarks do not refuse a recording.
    noise = recording.acceleration_noise()
    noisy = np.flatnonzero(noise > NOISE)
    if len(noisy):
        faults.append(RecordingFault(
            'remark', f'accelerations of {_named(model, noisy)} are noise to '
            f'{100.0 * noise[noisy].max():.0f} %; expected filtered ones: --cutoff '
            f'{recording.proposed_cutoff():.2g}'))
    return faults


def refuse_faulty(model: Model, recording: Recording,
                  levels: tuple[str, ...] = ('impossible', 'wrong'), *,
                  gravity_added: bool = False, without_effort: Sequence[str] = ()
                  ) -> list[RecordingFault]:
    """Return the faults of a recording; raise InputError if one is of these levels."""
    faults = diagnose(model, recording, gravity_added=gravity_added,
                      without_effort=without_effort)
    refused = [fault.words for fault in faults if fault.level in levels]
    if refused:
        raise InputError(f'recording: {"; ".join(refused)}')
    return faults


def _named(model: Model, joints: Sequence[int] | NDArray[np.intp]) -> str:
    """Return names of joints as text."""
    if len(joints) == model.n > 1:
        return 'all joints'
    names = ', '.join(f"'{model.joint_names[j]}'" for j in joints)
    if len(joints) == 1:
        return f'joint {names}'
    return f'joints {names}'


def _motion(model: Model, recording: Recording) -> Iterator[str]:
    """Yield contradictions of positions, speeds and times."""
    degrees = _suspected_degrees(model, recording)
    if degrees is not None:
        yield degrees
        return
    step = float(np.median(np.diff(recording.t)))
    if 'u' in recording.derived:  # differences of the positions contradict them nowhere
        if step >= LONG_STEP:
            yield (f'times: rows are {step:g} s apart; expected seconds: are the times '
                   'in milliseconds?')
        return
    displacement, integral = _displacements(recording)
    size = np.linalg.norm(displacement, axis=0)
    with np.errstate(invalid='ignore', divide='ignore'):
        # The cosine of the angle between the integrated speeds of joint k and the
        # displacements of joint j, and the factor of the speeds over the derivatives of
        # the positions.
        cosines = (integral.T @ displacement) / np.outer(np.linalg.norm(integral,
                                                                        axis=0), size)
        factors = np.sum(integral * displacement, axis=0) / size**2
    moves = np.flatnonzero(np.abs(recording.q - recording.q[0]).max(axis=0) > MOVES)
    joints_by_fault: dict[str, list[int]] = {}
    for j in moves:
        fault = _speed_fault(model, int(j), cosines[j], float(factors[j]))
        if fault is not None:
            joints_by_fault.setdefault(fault, []).append(int(j))
    for fault, joints in joints_by_fault.items():
        yield f'speeds of {_named(model, joints)} are {fault}'


def _suspected_degrees(model: Model, recording: Recording) -> str | None:
    """Return a contradiction if positions far beyond the limits would fit them in degrees."""
    limits = Robot(model).limits
    turning = np.array([name not in model.sliding for name in model.joint_names])
    largest = np.abs(recording.q).max(axis=0)
    # Joints without limits turn twice at most.
    reach = np.maximum(np.abs(limits.lower), np.abs(limits.upper))
    reach = np.where(np.isfinite(reach), reach, 4.0 * math.pi)
    beyond = np.flatnonzero(turning & (largest > 2.0 * reach))
    fits_in_degrees = (np.radians(largest) <= 1.1 * reach)[turning].all()
    if not len(beyond) or not fits_in_degrees:
        return None
    return (f'positions of {_named(model, beyond)} reach {largest[beyond].max():.4g} '
            f'rad, limits {reach[beyond].max():.4g} rad; expected rad: are these '
            'degrees?')


def _displacements(recording: Recording) -> tuple[Array, Array]:
    """
    Return the displacements over windows of rows, and the integrals of the speeds over them.

    No window spans an interruption.
    """
    width = max(1, len(recording) // WINDOWS)
    interruptions_until = np.concatenate([[0.0], np.cumsum(_is_interruption(recording))])
    whole = interruptions_until[width:] == interruptions_until[:-width]
    mean_speed = 0.5 * (recording.u[1:] + recording.u[:-1])
    steps = mean_speed * np.diff(recording.t)[:, None]
    integral = np.vstack([np.zeros(steps.shape[1]), np.cumsum(steps, axis=0)])
    return ((recording.q[width:] - recording.q[:-width])[whole],
            (integral[width:] - integral[:-width])[whole])


def _speed_fault(model: Model, j: int, cosines: Array, factor: float) -> str | None:
    """Return how speeds of a joint differ from derivatives of its positions; None if not."""
    if cosines[j] > LIKE and 0.6 < factor < 1.6:
        return None
    # The right direction with a wrong size: a unit that differs by a known factor.
    if cosines[j] > LIKE:
        for value, unit in UNITS:
            if 0.8 < factor / value < 1.25:
                return f'{value:.4g} times the derivative of the positions; {EXPECTED}: {unit}'
        return f'{factor:.2g} times the derivative of the positions; {EXPECTED}'
    if cosines[j] < -LIKE:
        return f'the negative derivative of the positions; {EXPECTED}'
    # Otherwise the speed may be that of another joint.
    of_other_joints = np.where(np.arange(len(cosines)) == j, -1.0, cosines)
    nearest = int(np.nanargmax(of_other_joints))
    if cosines[nearest] > LIKE:
        return ('the derivative of the positions of joint '
                f"'{model.joint_names[nearest]}'; expected those of their own joint")
    return f'not the derivative of the positions; {EXPECTED}'


def _late_speeds(model: Model, recording: Recording) -> Iterator[RecordingFault]:
    """Yield the joints whose speeds come later or earlier than the positions change."""
    if 'u' in recording.derived:
        return
    stretch = longest_stretch(recording)
    delays = np.zeros(model.n)
    for j in range(model.n):
        if np.abs(recording.q[:, j] - recording.q[0, j]).max() > MOVES:
            delays[j] = _speed_delay(stretch, j)
    for late, side, cause in (
            (delays > 0.0, 'after', 'as those of a filter do'),
            (delays < 0.0, 'before', 'as if the positions were filtered')):
        if not late.any():
            continue
        low, high = np.sort(np.abs(delays[late]))[[0, -1]]
        span = f'{low:.2g} s' if high - low < 0.005 else f'{low:.2g} to {high:.2g} s'
        yield RecordingFault(
            'remark', f'speeds of {_named(model, np.flatnonzero(late))} come {span} {side} '
            f'the changes of the positions, {cause}, beside which torques seem to have a '
            'delay; expected none of this delay, or speeds that are derived from the '
            'positions (--derive-speeds, Recording.with_derived_speeds)')


def _speed_delay(recording: Recording, j: int) -> float:
    """
    Return by how much the speeds of a joint come after its positions, s; 0 if they do not.

    Displacements over windows of rows are compared with integrals of the speeds over
    windows that begin later.
    """
    t = recording.t
    q, u = recording.q[:, j], recording.u[:, j]
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (u[1:] + u[:-1]) * np.diff(t))])
    step = float(np.median(np.diff(t)))
    width = max(1, round(SPEED_WINDOW / step))
    most = round(LONGEST_SPEED_DELAY / step)
    if len(t) <= 2 * (most + width):
        return 0.0
    begins = np.arange(most, len(t) - most - width, max(1, len(t) // MOST_ROWS))
    displacement = q[begins + width] - q[begins]
    size = float(np.linalg.norm(displacement))

    def missed(delay: float) -> float:
        """Return the difference of displacements to those of speeds that come later."""
        later = np.interp(t[begins + width] + delay, t, integral)
        earlier = np.interp(t[begins] + delay, t, integral)
        return float(np.linalg.norm(displacement - (later - earlier)))
    delays = step * np.arange(-most, most + 1)
    errors = [missed(delay) for delay in delays]
    best = int(np.argmin(errors))
    # The error of the speeds must be large, and the delay explain most of it.
    at_once = errors[most]
    if at_once <= SPEED_ERROR * size or errors[best] > CLEARLY * at_once:
        return 0.0
    return float(delays[best])


def _is_interruption(recording: Recording) -> Array:
    """Return for each step of time whether it is an interruption, 0 or 1, (N - 1,)."""
    steps = np.zeros(len(recording) - 1)
    steps[interruptions(recording)] = 1.0
    return steps


def _interruptions(recording: Recording) -> Iterator[RecordingFault]:
    """Yield the interruptions of the times."""
    # Filters and differences assume rows in even steps.
    rows = interruptions(recording)
    if not len(rows):
        return

    # The longest list that reads well, then a count.
    lengths = np.diff(recording.t)[rows]
    places = []
    for row, length in zip(rows[:MOST_PAUSES], lengths, strict=False):
        places.append(f'{length:.3g} s after {recording.t[row]:.4g} s')
    text = ', '.join(places)
    if len(rows) > MOST_PAUSES:
        text += f' and {len(rows) - MOST_PAUSES} more'
    yield RecordingFault('remark',
                         f'times: interruption of {text}; expected a recording '
                         'without interruptions, as filters and differences need it')


def _signals(model: Model,
             recording: Recording) -> tuple[Recording, list[RecordingFault]]:
    """Return a recording without faults of single effort signals, and these faults."""
    # Outliers and frozen sensors, whose rows are left out.
    joints_by_fault: dict[str, list[int]] = {}
    sound, outliers = without_outliers(longest_stretch(recording))
    for j in np.flatnonzero(outliers.any(axis=0)):
        first_row = int(np.flatnonzero(outliers[:, j])[0])
        fault = (f'efforts of {{}} have {outliers[:, j].sum()} outliers, the first at '
                 f'{sound.t[first_row]:.4g} s: a spike or a lost message')
        joints_by_fault.setdefault(fault, []).append(int(j))
    # A channel that measures nothing is a fault of all rows, which includes that of some.
    # At constant speed, without friction and weight, a sound one has little to measure.
    rigid = Robot(model, friction=False).inverse_dynamics(sound.q, sound.u, sound.udot)
    idle: Flags = idle_efforts(sound) & ~idle_efforts(replace(sound, tau=rigid))
    if idle.any():
        joints_by_fault['efforts of {} stay near one value while the joint moves both ways; '
                        'expected efforts that follow the motion: are they measured?'
                        ] = np.flatnonzero(idle).tolist()
    frozen = frozen_rows(sound)
    frozen[:, idle] = False
    for j in np.flatnonzero(frozen.any(axis=0)):
        frozen_times = sound.t[frozen[:, j]]
        fault = (f'efforts of {{}} are constant from {frozen_times[0]:.4g} s to '
                 f'{frozen_times[-1]:.4g} s while the joint moves')
        joints_by_fault.setdefault(fault, []).append(int(j))

    # A joint without any sound row gets the model's torque, in which nothing is to be
    # corrected.
    dead: Flags = np.asarray(frozen.all(axis=0) | idle)
    sound_rows: Flags = ~np.asarray((frozen & ~dead).any(axis=1))
    sound = sound.rows(sound_rows)
    sound = replace(sound, tau=np.where(dead, rigid[sound_rows], sound.tau))
    faults = []
    for fault, joints in joints_by_fault.items():
        faults.append(RecordingFault('wrong', fault.format(_named(model, joints))))
    return sound, faults


def _torques(model: Model, recording: Recording, gravity_added: bool, *,
             has_signal_faults: bool) -> Iterator[RecordingFault]:
    """
    Yield errors of torques, found by the corrections that reduce the residual.

    Delays are judged only if there is no other error.
    """
    robot = Robot(model, friction=False)
    # Fitted friction and corrections explain any few rows.
    if len(recording) < FEWEST_ROWS:
        return
    smooth = smoothed(recording)
    # A part of the rows shows faults as well as all of them.
    step = max(1, len(smooth) // MOST_ROWS)
    corrected, scaled = _within_limits(robot, smooth.rows(slice(None, None, step)))
    joints_by_fault: dict[str, set[int]] = {}
    factors = scaled.copy()

    # The most effective correction is applied, and the search starts again from there.
    errors = _errors(robot, corrected)
    for _ in range(MOST_FAULTS):
        best = _best_repair(robot, corrected, errors, gravity_added)
        if best is None:
            break
        repair, errors = best
        corrected = repair.recording
        # A second factor of a joint multiplies the first; a second change of a sign undoes
        # the first.
        joints = set(repair.joints)
        if repair.factor != 1.0:
            factors[list(joints)] *= repair.factor
            continue
        of_kind = joints_by_fault.setdefault(repair.kind, set())
        if repair.kind == REVERSED_EFFORTS:
            of_kind ^= joints
        else:
            of_kind |= joints
    for factor in np.unique(factors[factors != 1.0]):
        fault = _scale_words(float(factor))
        joints_by_fault.setdefault(fault, set()).update(
            np.flatnonzero(factors == factor).tolist())
    for fault, faulty in joints_by_fault.items():
        if faulty:
            hedged = PAYLOAD in fault or 'masses that the model lacks' in fault
            yield RecordingFault('remark' if hedged else 'wrong',
                                 fault.format(_named(model, sorted(faulty))))
    if not any(joints_by_fault.values()) and not has_signal_faults:
        yield from _delays(model, torque_delays(model, recording))


def _best_repair(robot: Robot, recording: Recording, errors: Array, gravity_added: bool
                 ) -> tuple[_Repair, Array] | None:
    """Return the correction that reduces the residuals most, and what it leaves of them."""
    best: tuple[_Repair, Array] | None = None
    largest_fall = -math.inf
    # Corrections are compared by the product of the ratios by which errors fall.
    for repair in _repairs(robot, recording, errors, gravity_added):
        joints = list(repair.joints)
        remaining = _errors(robot, repair.recording)
        # Torques in another unit would shrink the error by that unit alone.
        comparable = remaining.copy()
        comparable[joints] *= abs(repair.factor)
        fall = float(np.log(errors / comparable).sum())
        reduces_all = (comparable[joints] <= 1.01 * errors[joints]).all()
        # A payload is the first explanation: it goes before what explains as much.
        is_payload = PAYLOAD in repair.kind
        level = fall * (FIRST if is_payload else 1.0)
        # More joints need more evidence, and no joint may become worse.
        if fall > repair.needed and (reduces_all or is_payload) and level > largest_fall + 1e-3:
            best = repair, remaining
            largest_fall = level
    if best is not None and best[0].kind == REVERSED_EFFORTS:
        repair, remaining = best
        best = _with_reversed_positions(robot, recording, repair, remaining), remaining
    return best


def _with_reversed_positions(robot: Robot, recording: Recording, repair: _Repair,
                             remaining: Array) -> _Repair:
    """
    Return reversed efforts, with reversed positions in words where these fit as well.

    Friction and armature change their sign with the efforts as with the positions. Only
    gravity and the torques of other joints tell the two apart, and a last joint around
    the center of mass of its link has neither.
    """
    if len(repair.joints) > 1:
        return repair
    turned = _turned(recording, repair.joints[0])
    fits_as_well = (_errors(robot, turned) <= 1.01 * remaining).all()
    return repair._replace(kind=REVERSED) if fits_as_well else repair


def _within_limits(robot: Robot,
                   r: Recording) -> tuple[Recording, Array]:
    """Return the efforts in N m where they exceed the limits by far, and units, (n,)."""
    rigid = robot.inverse_dynamics(r.q, r.u, r.udot)
    tau = r.tau
    units = np.ones(robot.n)
    # An effort beyond all limits is in other units, such as N mm: the nearest power of
    # ten.
    for j in np.flatnonzero(beyond_limits(r, np.asarray(robot.limits.effort))):
        measured = float(np.linalg.norm(tau[:, j]))
        computed = max(float(np.linalg.norm(rigid[:, j])), 1e-12)
        distances = np.abs(np.log(measured / computed / np.array(LARGE_UNITS)))
        units[j] = LARGE_UNITS[int(np.argmin(distances))]
    return replace(r, tau=tau / units), units


def _scale_words(factor: float) -> str:
    """Return the description of efforts of another unit."""
    unit = 'another unit, a current, or torque before the gearbox?'
    if 1.0 / MODERATE < factor < MODERATE:
        unit = 'a wrong torque constant, or masses that the model lacks?'
    for value, name in EFFORT_UNITS:
        if 0.6 < abs(factor) / value < 1.6:
            unit = f'{name}?'
    return f'efforts of {{}} are about {factor:.3g} times the torques: {unit}'


def _errors(robot: Robot, recording: Recording) -> Array:
    """Return the RMS of each joint's torque residual with fitted friction, (n,)."""
    rigid = robot.inverse_dynamics(recording.q, recording.u, recording.udot)
    errors = np.zeros(robot.n)
    for j in range(robot.n):
        errors[j], _ = _fitted(recording, j, recording.tau[:, j] - rigid[:, j])
    return errors


def _fitted(recording: Recording, j: int, torque: Array, model: Array | None = None
            ) -> tuple[float, float]:
    """
    Return the RMS residual of a joint's torque with fitted friction.

    With a model torque, that torque is scaled too: the second result is its factor.
    """
    # Stiction may give a joint at rest any torque.
    moves = _moving(recording)[:, j]
    if np.count_nonzero(moves) < FEWEST_ROWS:
        return 1.0, 1.0
    columns = [_friction_columns(recording, j)[moves]]
    if model is not None:
        columns.append(model[moves, None])
    torque = torque[moves]
    # Nonnegative least squares on R: friction and the model's factor cannot be
    # negative.
    equations = np.column_stack([*columns, torque])
    R: Array = np.asarray(np.linalg.qr(equations, mode='r'))
    x, residual = scientific('scipy.optimize').nnls(R[:, :-1], R[:, -1])
    root = math.sqrt(len(torque))
    smallest = max(FLOOR * float(np.linalg.norm(recording.tau[moves, j])), 1e-9 * root)
    return max(float(residual), smallest) / root, float(x[-1])


def _repairs(robot: Robot, r: Recording, errors: Array, gravity_added: bool
             ) -> Iterator[_Repair]:
    """Yield recordings with one correction each."""
    # From the most common fault to the rarest; the best repair is chosen by its
    # residuals.
    rigid = robot.inverse_dynamics(r.q, r.u, r.udot)
    # A fault may be that of all joints or of one. Rows at rest judge none.
    all_joints = tuple(np.flatnonzero(_moving(r).sum(axis=0) >= FEWEST_ROWS).tolist())
    if not all_joints:
        return
    joint_sets = [all_joints]
    if len(all_joints) > 1:
        joint_sets += [(j,) for j in all_joints]
    yield from _unknown_payloads(robot, r, r.tau - rigid)
    yield from _sign_and_gravity_repairs(robot, r, joint_sets, gravity_added)
    yield from _scale_repairs(robot, r, rigid, errors, joint_sets)
    yield from _reversed_encoders(robot, r)
    yield from _exchanged_joints(robot, r)


def _with_torque(r: Recording, joints: tuple[int, ...], tau: Array) -> Recording:
    """Return a recording with other torques of some joints, which are columns of `tau`."""
    corrected = r.tau.copy()
    corrected[:, joints] = tau[:, joints]
    return replace(r, tau=corrected)


def _sign_and_gravity_repairs(robot: Robot, r: Recording,
                              joint_sets: Sequence[tuple[int, ...]],
                              gravity_added: bool) -> Iterator[_Repair]:
    """Yield recordings with torques of the other sign, with gravity, or without it."""
    # A joint without weight (a vertical axis) shows nothing about gravity.
    gravity = robot.gravity_force(r.q)
    is_loaded = np.abs(gravity).max(axis=0) > 1e-6
    for joints in joint_sets:
        # Reversed torques, then those without the weight, or with it twice.
        yield _Repair(REVERSED_EFFORTS, joints, _with_torque(r, joints, -r.tau),
                      ONCE * len(joints))
        loaded = int(is_loaded[list(joints)].sum())
        if not loaded:
            continue
        yield _Repair('efforts of {} fit the torques without gravity: the arm holds its '
                      'weight by itself, or reports efforts without it; expected '
                      'efforts with gravity, or a statement that they lack it '
                      '(--efforts-without-gravity)', joints,
                      _with_torque(r, joints, r.tau + gravity), ONCE * loaded)
        yield _Repair('efforts of {} have the opposite sign of torques on the joints, '
                      'and fit these without gravity', joints,
                      _with_torque(r, joints, gravity - r.tau), ONCE * len(joints))
        if gravity_added:  # else it is a payload that makes gravity larger
            yield _Repair('efforts of {} fit the torques with gravity twice: they hold '
                          'the weight already; expected no --efforts-without-gravity',
                          joints,
                          _with_torque(r, joints, r.tau - gravity), ONCE * loaded)


def _scale_repairs(robot: Robot, r: Recording, rigid: Array, errors: Array,
                   joint_sets: Sequence[tuple[int, ...]]) -> Iterator[_Repair]:
    """Yield recordings with torques in another unit, of the same sign or the other."""
    for sign in (1.0, -1.0):
        residuals = np.zeros(robot.n)
        factors = np.zeros(robot.n)
        of_sign = np.zeros(robot.n)  # errors with this sign alone
        for j in range(robot.n):
            tau = sign * r.tau[:, j]
            residuals[j], factors[j] = _fitted(r, j, tau, rigid[:, j])
            of_sign[j], _ = _fitted(r, j, tau - rigid[:, j])
        # The factor is known where rigid bodies cause most of the torque, or where it
        # matters.
        from_bodies = (factors * np.abs(rigid).max(axis=0)
                       > 0.5 * np.abs(r.tau).max(axis=0))
        matters = (residuals < CLEARLY * of_sign) & (factors > 0.0)
        is_known = from_bodies | matters
        for joints in joint_sets:
            known = [j for j in joints if is_known[j]]
            if not known:
                continue
            # Beyond what the sign alone explains, the unit needs evidence of its own.
            needed = ONCE * len(known)
            needed += float(np.log(errors[known] / of_sign[known]).sum())
            size = float(np.median(factors[known]))
            if not LEAST_SCALE < size < 1.0 / LEAST_SCALE:
                factor = sign * size
                yield _Repair(_scale_words(factor), joints,
                              _with_torque(r, joints, r.tau / factor), needed, factor)


def _unknown_payloads(robot: Robot, r: Recording, torque: Array) -> Iterator[_Repair]:
    """
    Yield recordings without the torque of a payload that the model does not know.

    Its ten parameters are fitted together with the friction of each joint, at outermost
    bodies. Wrong masses of single links explain less than a half of three joints.
    """
    if robot.model.flexible:  # beams have no regressor
        return
    Y = robot.regressor(r.q, r.u, r.udot)
    moving = _moving(r)
    size = np.maximum(np.sqrt(np.mean(torque**2, axis=0)), 1e-9)
    parents = {body.parent for body in robot.model.bodies}
    moving_mass = sum(body.inertial.mass for body in robot.model.bodies)
    for k, body in enumerate(robot.model.bodies):
        if k in parents:
            continue
        own = Y[:, :, 10 * k:10 * k + 10]
        rows = []
        for j in range(robot.n):
            basis = np.linalg.qr(_friction_columns(r, j)[moving[:, j]])[0]
            of_joint = np.column_stack([own[moving[:, j], j], torque[moving[:, j], j]])
            rows.append((of_joint - basis @ (basis.T @ of_joint)) / size[j])
        A = np.vstack(rows)
        scale = np.linalg.norm(A[:, :-1], axis=0)
        scale[scale == 0.0] = 1.0
        x = scientific('scipy.linalg').lstsq(A[:, :-1] / scale, A[:, -1], cond=RANK,
                                             lapack_driver='gelsy')[0] / scale
        if x[0] <= LEAST_PAYLOAD * moving_mass:
            continue
        joints = tuple(np.flatnonzero((own @ x).any(axis=0)).tolist())
        yield _Repair(f'efforts of {{}} fit the model with about {x[0]:.2g} kg more at '
                      f"'{body.name}': a payload that the model does not have? "
                      f'(identify --payload {body.name})', joints,
                      replace(r, tau=r.tau - own @ x), ONCE * min(robot.n, 3))


def _moving(r: Recording) -> Flags:
    """Return where joints move, (N, n)."""
    return np.asarray(np.abs(r.u) > STANDSTILL)


def _reversed_encoders(robot: Robot, r: Recording) -> Iterator[_Repair]:
    """Yield recordings with the positions of one joint in the other direction."""
    for j in range(robot.n):
        turned = _turned(r, j)
        yield _Repair('positions of {} have the opposite sign', (j,), turned, 2.0 * ONCE)
        yield _Repair('positions and efforts of {} have the opposite sign', (j,),
                      _with_torque(turned, (j,), -r.tau), 2.0 * ONCE)


def _turned(r: Recording, j: int) -> Recording:
    """Return a recording with the positions of one joint in the other direction."""
    sign = np.ones(r.q.shape[1])
    sign[j] = -1.0
    return replace(r, q=r.q * sign, u=r.u * sign, udot=r.udot * sign)


def _exchanged_joints(robot: Robot, r: Recording) -> Iterator[_Repair]:
    """Yield recordings in which two joints are exchanged: efforts, positions, or both."""
    for first, second in combinations(range(robot.n), 2):
        order = np.arange(robot.n)
        order[[first, second]] = second, first
        pair = first, second
        positions = {name: getattr(r, name)[:, order] for name in ('q', 'u', 'udot')}
        # Both signals, or one of them; an exchange of positions needs the better
        # evidence.
        efforts = r.tau[:, order]
        yield _Repair('efforts of {} are exchanged', pair, replace(r, tau=efforts),
                      2.0 * ONCE)
        yield _Repair('positions of {} are exchanged', pair, replace(r, **positions),
                      3.0 * ONCE)
        yield _Repair('{} are exchanged', pair, replace(r, **positions, tau=efforts),
                      3.0 * ONCE)


def _friction_columns(r: Recording, j: int) -> Array:
    """Return the torques of unit damping, friction and armature of a joint, (N, 3)."""
    u = r.u[:, j]
    return np.column_stack([u, coulomb(u, SLIP), r.udot[:, j]])


def _delays(model: Model, delays: TorqueDelays) -> Iterator[RecordingFault]:
    """Yield delays of torques: the common one, and those of joints that differ from it."""
    # Joints that move too little are named as not judged.
    unknown = np.flatnonzero(~delays.judged)
    remark = ''
    if len(unknown):
        remark = f' ({_named(model, unknown)} cannot be judged)'
    different = [int(j) for j in np.flatnonzero(delays.different)]
    if delays.delayed:
        common = [int(j) for j in np.flatnonzero(delays.judged) if int(j) not in different]
        yield _delay(model, common, delays.common, delays.common_deviation, remark)
    for j in different:
        yield _delay(model, [j], float(delays.delay[j]), float(delays.deviation[j]),
                     remark)


def _delay(model: Model, joints: list[int], delay: float, deviation: float, remark: str
           ) -> RecordingFault:
    """Return the delay of the torques of some joints."""
    side = 'after' if delay > 0.0 else 'before'
    return RecordingFault('remark', f'efforts of {_named(model, joints)} come '
                          f'{abs(delay):.3g} s (+- {deviation:.1g} s) {side} the motion '
                          f'that they belong to{remark}')
