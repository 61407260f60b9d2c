"""Identify the drives of elastic joints, and say what the data do not determine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple
import warnings

from kane_dynamics._util.checks import instance, number
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.identification.drives.drive_recording import (
    DriveRecording, require_joint_count)
from kane_dynamics.identification.drives.driven_links import DrivenLinks
from kane_dynamics.identification.drives.gear_fit import (encoder_delay, fitted,
                                                          GearEquations, GearFit,
                                                          JointSignals, LinkTorque)
from kane_dynamics.identification.drives.spectra import (audible_band, BEYOND_BAND,
                                                         smooth_motion, smooth_speeds,
                                                         Spectra, spectra, white_noise)
from kane_dynamics.identification.solvers import on_one_processor
from kane_dynamics.model.drive import Drive
from kane_dynamics.model.elastic_model import with_drives
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np
import yaml

DEVIATION = 0.2  # largest relative standard deviation of a number that the data determine
SKEW_DEVIATION = 5e-4  # s, largest standard deviation of a skew that the data determine
SURE = 2.0  # standard deviations
SAMPLES = 200  # configurations for the mean of the mass matrix
MOVES = 1e-3  # rad or m: a motor that moves less rests
ALIKE = 0.2  # relative difference of the ranges of motor and link
FITS = 4.0  # mean square of residuals over the noise, above which equations lack something
DAMPING_NEEDS = 'N m s/rad', 'motion near the resonance, where the deflection is fast'
DELAY = 'torque delay'
NUMBERS = 'stiffness', 'damping', 'rotor inertia', 'skew', DELAY
BOTH_ENCODERS, SENSOR = 'both encoders', 'torque sensor'


class DriveNumber(NamedTuple):
    """
    One identified number of a joint.

    Attributes
    ----------
    value, deviation : float
        NaN where the data do not determine it.
    reason : str
        Why the data do not determine it, and what would; empty if they do.

    """

    value: float
    deviation: float
    reason: str = ''


@dataclass(frozen=True, eq=False)
class DriveIdentification:
    """
    Identified drives; joints are in the order of the recording, numbers joint-side.

    Attributes
    ----------
    joint_names : tuple of n str
        Joints with drives.
    source : str
        Equations that were fitted: 'torque sensor', or 'both encoders' (with the torque of
        the links' model).
    stiffness, damping, rotor_inertia, skew, torque_delay : (n,) arrays
        N m/rad, N m s/rad, kg m^2, s, s; NaN where the data do not determine them, see
        `undetermined`. The skew is how late the encoders of the links are, the delay how
        long after its row a motor torque acts: half of a cycle for which it is held.
    stiffness_deviation, damping_deviation, rotor_inertia_deviation, skew_deviation, \
torque_delay_deviation : (n,) arrays
        Standard deviations; larger by the root of `misfit` than those of the noise.
    skew_share : (n,) array
        RMS of skew times speed over that of the measured deflection: what the delay
        seems to deflect.
    misfit : (n,) array
        Mean square of the residuals over the noise; 1 if the equations hold.
    undetermined : dict of str to str
        Reasons of the numbers that the data do not determine, by '<joint> <number>'.

    """

    joint_names: tuple[str, ...]
    source: str
    stiffness: Array
    damping: Array
    rotor_inertia: Array
    skew: Array
    torque_delay: Array
    stiffness_deviation: Array
    damping_deviation: Array
    rotor_inertia_deviation: Array
    skew_deviation: Array
    torque_delay_deviation: Array
    skew_share: Array
    misfit: Array
    undetermined: dict[str, str]

    def drives(self) -> dict[str, Drive]:
        """
        Return the drives of the joints whose stiffness is determined, for `with_drives`.

        Undetermined damping is 0; a rotor inertia is then the armature of the joint.
        """
        # A drive needs a stiffness; other numbers that are not determined keep their
        # defaults.
        result = {}
        for j, name in enumerate(self.joint_names):
            if not np.isfinite(self.stiffness[j]):
                continue
            values: dict[str, Any] = {'stiffness': float(self.stiffness[j])}
            if np.isfinite(self.damping[j]):
                values['damping'] = float(self.damping[j])
            if np.isfinite(self.rotor_inertia[j]):
                values['rotor_inertia'] = float(self.rotor_inertia[j])
            result[name] = Drive(**values, torque_sensor=self.source == SENSOR)
        return result

    def elastic(self, model: Model) -> Model:
        """Return a model of rigid joints with the identified drives."""
        return with_drives(model, self.drives())

    def supplement(self) -> str:
        """Return the text of a supplement with the identified drives."""
        # Numbers are joint-side, as they were identified.
        entries = {}
        for name, drive in self.drives().items():
            entry: dict[str, Any] = {'side': 'joint', 'stiffness': drive.stiffness,
                                     'damping': drive.damping}
            # Entries that equal their default are left out.
            if drive.rotor_inertia is not None:
                entry['rotor_inertia'] = drive.rotor_inertia
            if drive.torque_sensor:
                entry['torque_sensor'] = True
            entries[name] = entry
        return yaml.safe_dump({'drives': entries}, sort_keys=False)


@on_one_processor
def identify_drives(model: Model | Robot, recording: DriveRecording, *,
                    skew: float | None = None) -> DriveIdentification:
    """
    Identify stiffness, damping and rotor inertia of elastic joints from a recording.

    The data choose the equations:

    - Positions of links and a torque sensor: the sensor against the deflection.
    - Positions of links without a sensor: the torque that the links need by the model
      against the deflection. Errors of masses become errors of the stiffness.

    Motor torques give the rotor inertia. Encoders of links that are late by a skew look
    like a spring that deflects with the speed; the skew is identified with the rest, and
    so is the delay after which the motor torques act. A torque sensor that is late by a
    time d looks like a damping that is smaller by the stiffness times d: synchronize it.
    Friction of both sides (viscous and Coulomb) and offsets are identified too, so that
    the friction of the model is not used; nor is its armature.

    Parameters
    ----------
    model : Model or Robot
        The mechanism with rigid joints. A robot may have closed loops. Friction of joints
        without drives is then that of the model.
    recording : DriveRecording
        Of the joints of the model, in their order, unfiltered: the noise of the signals
        is taken from their high frequencies. With closed loops, of the joints of
        `Robot(actuated=)` in the order of `Robot.actuated_names`, or else of those whose
        rates are the independent speeds, in the order of `Robot.speed_names`. More drives
        than degrees of freedom need torques of the gears and positions of the links.
    skew : float, optional
        How late the positions of the links are after those of the motors, s, if it is
        known; 0 for synchronous encoders.

    Warns
    -----
    ModelWarning
        The residuals are more than twice the noise: the equations lack something, such as
        masses, a stiffness that is no constant, a dead zone, or friction with memory. The
        deviations are increased, but they do not contain such errors.

    Raises
    ------
    InputError
        The recording has other joints, or its positions are not joint-side; the model has
        drives already, or quaternions; its constraints are not constant ones of positions;
        there are more drives than degrees of freedom, and their torques are not recorded.
    ConstraintError
        The recorded positions do not close the loops.

    """
    if not isinstance(model, Robot):
        instance(model, Model, 'model')
    instance(recording, DriveRecording, 'recording')
    rigid = model.model if isinstance(model, Robot) else model
    if rigid.drives:
        raise InputError('model: has elastic joints already; expected the one with rigid '
                         'joints, to which drives are added')
    if rigid.balls:
        raise InputError('model: has ball or free joints; expected joints with one '
                         'coordinate each, whose motors turn about them')
    links = DrivenLinks(model)
    require_joint_count(recording, links.joint_names)
    if recording.q is None:
        raise InputError('recording: no positions of the links; expected those of encoders '
                         'behind the gears (q.<joint>)')
    if skew is not None:
        skew = number(skew, 'skew', 'a finite time in s', np.isfinite)
    # Spectra need equal times between rows.
    even = recording.resampled()
    moving = np.ptp(even.theta, axis=0) > MOVES
    if not moving.any():
        raise InputError(f'recording: no motor moves more than {MOVES:g} rad; expected '
                         'motors in motion')
    assert even.q is not None
    _require_joint_side(links.joint_names, even.theta, even.q)
    result = _with_encoders(links, even, skew)
    # Residuals far above the noise: the numbers would look better than they are.
    poor = np.flatnonzero(result.misfit > FITS)
    if len(poor):
        names = ', '.join(links.joint_names[j] for j in poor)
        warnings.warn(f'drives of {names}: residuals are {np.sqrt(result.misfit.max()):.3g} '
                      'times the noise; expected at most twice: the equations lack '
                      'something (masses, a stiffness that is no constant, a dead zone, '
                      'friction with memory)',
                      ModelWarning, stacklevel=2)
    return result


def _require_joint_side(names: Sequence[str], theta: Array, q: Array) -> None:
    """Raise InputError where motor and link do not move alike."""
    for j, name in enumerate(names):
        of_link = q[:, j] - q[:, j].mean()
        if np.ptp(of_link) <= MOVES:
            continue
        slope = float(of_link @ (theta[:, j] - theta[:, j].mean()) / (of_link @ of_link))
        if abs(slope - 1.0) > ALIKE:
            raise InputError(f"recording: joint '{name}': the motor moves {slope:.4g} times "
                             'as far as the link; expected once: motor values joint-side '
                             '(DriveRecording.from_motor_side), signs alike, units alike')


# Both encoders.

def _with_encoders(links: DrivenLinks, recording: DriveRecording, skew: float | None
                   ) -> DriveIdentification:
    """Return the drives from positions of motors and links."""
    of, signals = _joint_signals(links, recording)
    numbers = []
    misfits, shares = [], []
    for name, signal in zip(links.joint_names, signals, strict=True):
        # A motor at rest says nothing of its drive.
        if np.ptp(signal.theta) <= MOVES:
            numbers.append(_at_rest(name))
            misfits.append(1.0)
            shares.append(0.0)
            continue
        equations = GearEquations(signal, of, skew)
        fit = fitted(equations)
        if _is_determined(fit) and fit.value('compliance') < 0.0:
            raise InputError(f"recording: joint '{name}': the gear deflects against its torque; "
                             'expected signs of positions and torques alike')
        numbers.append(_joint_numbers(fit, skew, signal))
        misfits.append(fit.misfit)
        # How much of the deflection the skew makes: a large share is a warning.
        late = fit.value('skew') if skew is None else skew
        deflection = signal.theta - signal.q
        shares.append(abs(late) * float(np.std(signal.link_speed.values)
                                        / np.std(deflection)))
    source = SENSOR if recording.gear_torque is not None else BOTH_ENCODERS
    return _identification(links.joint_names, source, numbers, shares, misfits)


def _joint_signals(driven: DrivenLinks, recording: DriveRecording
                   ) -> tuple[Spectra, list[JointSignals]]:
    """Return the spectra, and what was measured of each joint."""
    step = float(np.diff(recording.t).mean())
    noise = {name: _noise(getattr(recording, name), step) for name in recording.signals}
    assert recording.q is not None
    # Frequencies at which the deflection is above its noise.
    band = audible_band(recording.theta - recording.q,
                        np.hypot(noise['theta'], noise['q']), step)
    of = spectra(len(recording), step, band)
    speeds = smooth_speeds(recording.theta, noise['theta'], step, band)
    link_speeds = smooth_speeds(recording.q, noise['q'], step, band)
    # Without sensors, the torque of a gear is that of the links' motion.
    count = len(driven.joint_names)
    links: list[LinkTorque | None] = [None] * count
    if recording.gear_torque is None:
        links = _link_torques(driven, recording.q, step, band)
    # Of each joint: its columns of what was measured, with their noise.
    signals = []
    for j in range(count):
        columns = {}
        deviations = {}
        for name in recording.signals:
            columns[name] = getattr(recording, name)[:, j]
            deviations[name] = float(noise[name][j])
        signals.append(JointSignals(
            recording.t, columns['theta'], columns['q'], speeds[j], link_speeds[j],
            links[j], columns.get('gear_torque'), columns.get('motor_torque'),
            deviations, j, noise['q']))
    return of, signals


def _link_torques(links: DrivenLinks, q: Array, step: float,
                  band: float) -> list[LinkTorque | None]:
    """Return the torques of the links' measured motion, with the inertia that noise has."""
    smooth = smooth_motion(q, step, BEYOND_BAND * band)
    samples = np.linspace(0, len(q) - 1, SAMPLES).astype(int)
    t = step * np.arange(len(q), dtype=np.float64)
    torque, mass_matrices = links.motion(t, *smooth, samples)
    inertia = np.sqrt(np.mean(mass_matrices**2, axis=0))
    return [LinkTorque(torque[:, j], inertia[j]) for j in range(q.shape[1])]


def _noise(signal: Array, step: float) -> Array:
    """Return the noise of a signal, (n,), positive for exact numbers too."""
    # Rounding of a computed recording is noise as well.
    rounding = 1e-9 * float(np.abs(signal).max()) + 1e-15
    return np.asarray(np.maximum(white_noise(signal, step), rounding))


def _is_determined(fit: GearFit) -> bool:
    """
    Return whether the data determine the compliance of a constant stiffness.

    A compliance that may be zero determines no stiffness, only that it is large.
    """
    return fit.deviation('compliance') <= DEVIATION * abs(fit.value('compliance'))


def _joint_numbers(fit: GearFit, skew: float | None, signal: JointSignals
                   ) -> dict[str, DriveNumber]:
    """Return the parameters of a joint, each with a reason if it is not determined."""
    late = fit.value('skew')
    of_late = fit.deviation('skew')
    if not _is_determined(fit):
        stiffness = DriveNumber(np.nan, np.nan, _stiffness_reason(fit, signal))
    else:
        compliance = fit.value('compliance')
        stiffness = DriveNumber(1.0 / compliance, fit.deviation('compliance') / compliance**2)
    numbers = {'stiffness': stiffness, 'damping': _damping(fit, stiffness.value)}
    has_torque = signal.motor_torque is not None
    numbers['rotor inertia'] = _rotor_inertia(fit, has_torque)
    numbers[DELAY] = _torque_delay(fit, has_torque)
    # No number of equations that lack something; the delay of the encoders is still one
    # of least squares.
    if fit.misfit > FITS:
        reason = (f'residuals are {np.sqrt(fit.misfit):.3g} times the noise; expected at most '
                  'twice: the equations lack something')
        numbers = {name: DriveNumber(np.nan, np.nan, reason) for name in numbers}
        late, of_late = encoder_delay(signal)
    # The skew of both encoders is known, or a result like the others.
    if skew is not None:
        numbers['skew'] = DriveNumber(skew, 0.0)
    elif of_late <= SKEW_DEVIATION:
        numbers['skew'] = DriveNumber(late, of_late)
    else:
        numbers['skew'] = DriveNumber(np.nan, np.nan, (
            f'{late:.3g} +- {of_late:.1g} s; expected at most {SKEW_DEVIATION:g} s of deviation: '
            'faster motion, in which the torque does not follow the speed'))
    return numbers


def _stiffness_reason(fit: GearFit, signal: JointSignals) -> str:
    """Return why the data do not determine the stiffness, and what would."""
    compliance, deviation = fit.value('compliance'), fit.deviation('compliance')
    if 'skew' in fit.names:
        # The deviation if the skew were known.
        k, s = fit.names.index('compliance'), fit.names.index('skew')
        covariance = fit.covariance
        alone = covariance[k, k] - covariance[k, s]**2 / covariance[s, s]
        if np.sqrt(max(alone, 0.0)) <= DEVIATION * abs(compliance):
            together = covariance[k, s] / np.sqrt(covariance[k, k] * covariance[s, s])
            return ('not separable from the skew of the encoders (correlation '
                    f'{together:.3f}): the torque follows the speed; expected holds in '
                    'several configurations or reversals without stopping, or a known skew')
    # Even the softest compliance within its deviation leaves this stiffness.
    stiffest = 1.0 / max(abs(compliance) + SURE * deviation, 1e-300)
    noise = np.hypot(signal.noise['theta'], signal.noise['q'])
    return (f'compliance {compliance:.3g} +- {deviation:.1g} rad/(N m), stiffer than about '
            f'{stiffest:.3g} N m/rad; expected a deviation of at most {DEVIATION:.0%}: larger or '
            f'faster changes of torque (the encoders have a noise of {noise:.1g} rad)')


def _damping(fit: GearFit, stiffness: float) -> DriveNumber:
    """Return the damping, D = eta K, or why the data do not determine it."""
    if not np.isfinite(stiffness):
        reason = 'the stiffness is not determined; expected that first'
        return DriveNumber(np.nan, np.nan, reason)
    k = fit.names.index('compliance')
    e = fit.names.index('eta')
    eta = fit.x[e]
    compliance = fit.x[k]
    # D = eta / compliance: its variance from those of both, to first order.
    gradient = np.array([-eta / compliance**2, 1.0 / compliance])
    of_both = fit.covariance[np.ix_([k, e], [k, e])]
    value = eta / compliance
    deviation = float(np.sqrt(gradient @ of_both @ gradient))
    return _judged(value, deviation, *DAMPING_NEEDS)


def _rotor_inertia(fit: GearFit, has_torque: bool) -> DriveNumber:
    """Return the rotor inertia, or why the data do not determine it."""
    if not has_torque:
        return DriveNumber(np.nan, np.nan, 'no motor torques; expected a recording of them')
    return _judged(fit.value('rotor_inertia'), fit.deviation('rotor_inertia'), 'kg m^2',
                   'larger accelerations of the motor')


def _torque_delay(fit: GearFit, has_torque: bool) -> DriveNumber:
    """Return how late motor torques act, or why the data do not determine it."""
    if not has_torque:
        return DriveNumber(np.nan, np.nan, 'no motor torques; expected a recording of them')
    value, deviation = fit.value('torque_delay'), fit.deviation('torque_delay')
    if deviation <= SKEW_DEVIATION:
        return DriveNumber(value, deviation)
    return DriveNumber(np.nan, np.nan, (
        f'{value:.3g} +- {deviation:.1g} s; expected at most {SKEW_DEVIATION:g} s of deviation: '
        'faster motion of the motor'))


def _judged(value: float, deviation: float, unit: str, expected: str) -> DriveNumber:
    """Return a positive number with its deviation, or why it is not determined."""
    if deviation <= DEVIATION * value:
        return DriveNumber(float(value), float(deviation))
    return DriveNumber(np.nan, np.nan, f'{value:.3g} +- {deviation:.1g} {unit}; expected a '
                       f'deviation of at most {DEVIATION:.0%} of a positive number: {expected}')


def _at_rest(joint: str) -> dict[str, DriveNumber]:
    """Return the numbers of a joint that rests."""
    reason = f"the motor of '{joint}' rests; expected motion"
    undetermined = DriveNumber(np.nan, np.nan, reason)
    return dict.fromkeys(NUMBERS, undetermined)


def _identification(names: tuple[str, ...], source: str,
                    numbers: Sequence[dict[str, DriveNumber]], shares: Sequence[float],
                    misfits: Sequence[float]) -> DriveIdentification:
    """Return the result of numbers of all joints."""
    # Why a number could not be found, under the words that a user reads.
    undetermined = {}
    for joint, of_joint in zip(names, numbers, strict=True):
        for name, value in of_joint.items():
            if value.reason:
                undetermined[f'{joint} {name}'] = value.reason

    # One array for each quantity, with an entry for each joint.
    columns: dict[str, Any] = {}
    for name in NUMBERS:
        key = name.replace(' ', '_')
        of_joints = [of_joint[name] for of_joint in numbers]
        columns[key] = np.array([one.value for one in of_joints])
        columns[f'{key}_deviation'] = np.array([one.deviation for one in of_joints])
    return DriveIdentification(names, source, **columns, skew_share=np.array(shares),
                               misfit=np.array(misfits), undetermined=undetermined)
