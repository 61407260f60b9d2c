"""
Identify a model from a recording, and judge it on rows that the fit has left out.

The law of friction and the weight of the prior are chosen on blocks of the first half of a
recording; a fit to this half is judged on the second one. The model is then fitted to all
rows with this law and weight. A second recording may be the test instead: all rows of the
first one choose and fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any
import warnings

from kane_dynamics._util.checks import number
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.identification.base_regressor import base_parameters, BaseFit
from kane_dynamics.identification.friction_laws import (block_flags, Blocks,
                                                        CandidateErrors, chosen_weight,
                                                        COLUMNS, COULOMB, Coupled,
                                                        COUPLED_SPEED, CoupledMotor,
                                                        first_within_noise, fit_law,
                                                        friction_shapes,
                                                        FrictionLaw, law_equations,
                                                        law_error, LAW_NAMES, law_rows,
                                                        LawFit, LawRows, LAWS,
                                                        moving_rms, phases, Prior,
                                                        USUAL_WEIGHT)
from kane_dynamics.identification.recordings.diagnosis import diagnose
from kane_dynamics.identification.recordings.recording import (check_recording,
                                                               Recording,
                                                               require_rigid_links,
                                                               STANDSTILL)
from kane_dynamics.identification.regression import (FRICTION, LOWEST, rms, rows,
                                                     triangle, UNBOUNDED)
from kane_dynamics.identification.solvers import on_one_processor
from kane_dynamics.identification.standard_deviations import statistics
from kane_dynamics.mechanics.constraints import Coupling
from kane_dynamics.mechanics.recursive.regressor import pseudo_inertia_of
from kane_dynamics.model.elastic_model import require_rigid_joints
from kane_dynamics.model.model import Body, Inertial, Joint, Model, WORLD
from kane_dynamics.robot.robot import Robot
import numpy as np

WEIGHTS = 10.0 ** np.arange(0, 7)
SELECT = 'select'  # the law of friction of the arm
SUSPECTED = 0.2  # share of two joints' errors that a coupled motor explains
SIGNIFICANT = 2.0  # standard errors of a difference
STRETCHES = 50  # of rows, whose means show how correlated residuals are
OTHER_TERMS: dict[str, Any] = {'friction_backward': None, 'breakaway_friction': None,
                               'stribeck_speed': 0.0, 'load_friction_backdriven': None,
                               'presliding_stiffness': 0.0, 'presliding_damping': 0.0}


@dataclass(frozen=True, eq=False)
class Identification:
    """
    Identified model with its errors and deviations; joints are in the order of the model.

    Attributes
    ----------
    given : Model
        The initial model.
    unknowns : (10 bodies + 4 n,) array
        Identified values: inertial parameters, in the order of `regressor.PARAMETERS`,
        then damping, friction, armature and offset of each joint.
    friction_speed : (n,) array
        Friction speed of the Coulomb friction of each joint, rad/s or m/s.
    friction_only : bool
        Whether the inertials are the given ones.
    law : str
        Law of friction of all joints, of `friction_laws.LAWS`.
    fit : LawFit
        All values of the fit, also those of coupled motors.
    coupled : tuple of CoupledMotor
        Motors that turn with two joints.
    suspected : tuple of (str, str, float)
        Two joints whose errors a coupled motor would explain, and the share of these.
    presliding : (n,) array
        Travel over which presliding friction reverses, rad or m; 0 where the law has none.
        `presliding_stiffness` of `model` is friction divided by it.
    candidates : dict of str to CandidateErrors
        RMS errors of each law on blocks that its fit had left out, of all and of moving
        rows; empty with a law that was given.
    before, held_out : (n,) arrays
        RMS of torque error, N m or N, on the second half or the test recording: of the given
        model, and of the fit to the first half, or to the recording.
    fitted : (n,) array
        RMS of torque error of the identified model on all rows, to which it was fitted.
    tested : bool
        Whether `before` and `held_out` are those of a test recording.
    deviations : (n, 4) array
        Standard deviations of damping, friction, armature and offset, with the correlation
        of the residuals. They include the bias of the prior, see `standard_deviations`, and
        take friction speeds and travels as known.
    inertial_deviations : (bodies, 10) array
        Standard deviations of single inertial parameters about the body's origin, in the
        order of `regressor.PARAMETERS`: those of the torques alone, or larger by the
        bias of the prior; NaN for parameters that are not identifiable by themselves,
        and with `friction_only`.
    covariance : (k, k) array
        Of all values in the order of the fit: bodies, six losses of each joint, couplings.
    fitted_moving, held_out_moving : (n,) arrays
        `fitted` and `held_out` of the rows in which the joint moves, N m or N: rows at
        standstill have static friction, which no parameter describes. NaN for a joint
        without such rows.
    condition : float
        Condition number of the equations with the prior, columns scaled to unit length.
    weight : float
        Weight of the prior on inertials; infinite with `friction_only`.

    """

    given: Model
    unknowns: Array
    friction_speed: Array
    friction_only: bool
    law: str
    fit: LawFit
    coupled: tuple[CoupledMotor, ...]
    suspected: tuple[tuple[str, str, float], ...]
    presliding: Array
    candidates: dict[str, CandidateErrors]
    before: Array
    fitted: Array
    held_out: Array
    tested: bool
    fitted_moving: Array
    held_out_moving: Array
    deviations: Array
    inertial_deviations: Array
    covariance: Array
    condition: float
    weight: float

    @lazy_property
    def model(self) -> Model:
        """
        Return the identified model, without coupled motors, which `robot` has.

        Raises
        ------
        ModelError
            If damping, friction or armature of a joint is negative, which is possible
            without bounds; the message names it.

        """
        return identified(self.given, self.unknowns, self.friction_speed, self.fit,
                          inertials=not self.friction_only)

    @lazy_property
    def robot(self) -> Robot:
        """
        Return the robot of the identified model with its coupled motors.

        Each coupled motor is a joint of a massless body, whose position is the sum or the
        difference of two others (`Coupling`); the speeds are those of the arm's joints.
        """
        if not self.coupled:
            return Robot(self.model)
        bodies = list(self.model.bodies)
        names = self.model.joint_names
        constraints = []
        for k, motor in enumerate(self.coupled):
            rotor = Joint(motor.name, 'revolute', np.array([0.0, 0.0, 1.0]),
                          coordinate=len(names) + k, damping=motor.damping,
                          friction=motor.friction, friction_speed=COUPLED_SPEED,
                          armature=motor.inertia)
            bodies.append(Body(f'{motor.name}_rotor', WORLD, rotor))
            ratios = dict(zip(motor.joints, (1.0, motor.sign), strict=True))
            constraints.append(Coupling(motor.name, ratios, name=motor.name))
        model = replace(self.model, bodies=tuple(bodies), coordinate_names=(
            *names, *(motor.name for motor in self.coupled)))
        return Robot(model, constraints=constraints, independent=names, actuated=names)

    def torque(self, recording: Recording) -> Array:
        """
        Return the torque of the identified values for the motion of a recording, (N, n), N m or N.

        Parameters
        ----------
        recording : Recording
            Of the joints of the model, in their order; its torques are not used.

        """
        return np.asarray(recording.tau - law_error(self._rows(recording), self.fit))

    def torque_deviation(self, recording: Recording) -> Array:
        """
        Return the standard deviation of `torque` by uncertain values, (N, n), N m or N.

        What the law lacks is no part of it: that is `held_out`.
        """
        data = self._rows(recording)
        load = data.load(self.fit)
        n, bodies = self.given.n, data.data.Y.shape[2]
        deviation = np.zeros((len(recording), n))
        for j in range(n):
            own = bodies + COLUMNS * j + np.arange(COLUMNS)
            places = np.concatenate([np.arange(bodies), own,
                                     np.arange(bodies + COLUMNS * n, len(self.covariance))])
            columns = np.column_stack([
                data.data.Y[:, j], data.columns(j, self.fit.law, self.fit.shapes[j], load[:, j]),
                data.coupling_columns(j)])
            P = self.covariance[np.ix_(places, places)]
            variance = np.einsum('ti,ij,tj->t', columns, P, columns)
            deviation[:, j] = np.sqrt(np.maximum(variance, 0.0))
        return deviation

    def _rows(self, recording: Recording) -> LawRows:
        """Return the rows of a recording with the coupled motors of the fit."""
        place = self.given.joint_names.index
        coupled = [Coupled(place(motor.joints[0]), place(motor.joints[1]), motor.sign)
                   for motor in self.coupled]
        return law_rows(rows(self.given, recording), coupled)

    @lazy_property
    def base(self) -> BaseFit:
        """Return the base parameters: combinations of the unknowns that determine the torques."""
        base = base_parameters(self.given, self.friction_speed)
        of_bodies = np.arange(10 * len(self.given.bodies))
        joints = np.arange(self.given.n)[:, None]
        of_losses = len(of_bodies) + COLUMNS * joints + np.arange(len(FRICTION))
        places = np.concatenate([of_bodies, of_losses.ravel()])
        P = self.covariance[np.ix_(places, places)]
        variances = np.einsum('bi,ij,bj->b', base.B, P, base.B)
        return BaseFit(base, base.B @ self.unknowns, np.sqrt(variances))

    @property
    def losses(self) -> Array:
        """Return damping, friction, armature and offset of each joint, (n, 4)."""
        return self.unknowns[-4 * self.given.n:].reshape(-1, 4)

    @property
    def fast_damping(self) -> Array:
        """Return the damping of each joint at high rates, (n,); by default `damping`."""
        return self.fit.losses[:, 4] if self.fit.law.curved else self.losses[:, 0]

    @property
    def load_friction(self) -> Array:
        """Return the load friction of each joint, (n,); 0 where the law has none."""
        return self.fit.losses[:, 5]


@on_one_processor
def identify(model: Model, recording: Recording, *, test: Recording | None = None,
             friction_only: bool = False,
             bounded: bool = True, weight: float | None = None,
             standstill: float = STANDSTILL, friction: str = SELECT,
             coupled: Sequence[tuple[str, str]] = (),
             without_effort: Sequence[str] = (), diagnosed: bool = False,
             progress: Callable[[float], object] = lambda done: None) -> Identification:
    """
    Fit a model to a recording, and judge the fit on rows that it has left out.

    Of a periodic recording the halves are those of its period, since repeated motion is no
    test.

    Parameters
    ----------
    model : Model
        Initial model; its inertials are the prior of parameters that are not
        identifiable.
    recording : Recording
        Recording of the model's joints, in their order; filtered if necessary.
    test : Recording, optional
        Another recording, on which the fit is judged. Default: the second half.
    friction_only : bool
        Keep the given inertials.
    bounded : bool
        Whether damping, friction and armature are bounded to values >= 0. False requires
        `friction_only`: plain least squares, in which a negative value shows an error of
        the rigid bodies; `model` then raises ModelError. The law is then 'coulomb'.
    weight : float, optional
        Weight of the prior. Default: the one with the least error on blocks of rows that fits
        leave out.
    standstill : float
        The fit of a joint ignores rows in which it is slower, rad/s or m/s, but for
        presliding friction; the reported errors are those of all rows.
    friction : str
        Law of friction of all joints, a name of `friction_laws.LAWS`; or 'select': the
        simplest one whose error on blocks that fits leave out is within one standard error
        of the least. With `friction_only` it is 'coulomb', since wrong masses look like
        friction that depends on the load.
    coupled : sequence of (str, str)
        Pairs of joints with a motor that turns with the sum or the difference of both, as of
        some wrists; the sign is the one with the smaller error.
    without_effort : sequence of str
        Joints whose efforts are left out, such as those of a dead sensor: their friction
        stays that of the model, and their errors are NaN.
    diagnosed : bool
        Whether `diagnose` was called already; it is not called again then.
    progress : callable
        Called with the finished fraction of the work.

    Warns
    -----
    ModelWarning
        By what `diagnose` finds, the recording is not of the model: signs, units,
        gravity, exchanged joints. It is fitted nevertheless.

    Raises
    ------
    InputError
        If the recording has other joints or moves too little, or an argument is out of
        range.

    """
    standstill = number(standstill, 'standstill', 'a number >= 0', lambda x: x >= 0.0)
    _check_options(weight, bounded, friction_only, friction)
    check_recording(model, recording)
    require_rigid_joints(model)
    require_rigid_links(model)
    pairs = _checked_pairs(model, coupled)
    if not diagnosed:
        for finding in diagnose(model, recording, without_effort=without_effort):
            if finding.level != 'remark':
                warnings.warn(f'the recording does not fit the model: {finding.words}',
                              ModelWarning, stacklevel=2)
    unknown = set(without_effort) - set(model.joint_names)
    if unknown or set(without_effort) == set(model.joint_names):
        raise InputError(f'without_effort: {list(without_effort)}; expected some of '
                         f'{", ".join(model.joint_names)}, not all')
    whole = _rows_of_efforts(model, recording, standstill, without_effort)
    _require_motion(whole, without_effort)
    # What chooses and is judged: the first half and the second, or one recording and the
    # other.
    place = phases(recording)
    training, judging = whole, None
    if test is None:
        in_first = place < 0.5
        training, judging = whole.part(in_first), whole.part(~in_first)
        place = 2.0 * place[in_first]
    else:
        check_recording(model, test)
        judging = _rows_of_efforts(model, test, standstill, without_effort)
    _require_motion(training, without_effort)
    # An infinite weight of the prior keeps the inertials as they are.
    prior = Prior(model, np.inf if friction_only else weight or USUAL_WEIGHT,
                  LOWEST if bounded else UNBOUNDED)
    training = replace(training, coupled=_signs(training, pairs, prior))
    progress(0.1)
    choice = _Choice(training, block_flags(place), prior, progress)
    law = choice.law(COULOMB.name if friction_only and friction == SELECT else friction)
    fit = choice.fits[law.name]
    if weight is None and not friction_only:
        prior = prior._replace(weight=choice.weight(law))
        fit = fit_law(training, law, prior, fit)
    judging = replace(judging, coupled=training.coupled)
    held_out = _judged(law_error(judging, fit), without_effort, model)
    suspected = () if pairs else choice.suspected(fit, prior)
    progress(0.9)
    if test is None:
        whole = replace(whole, coupled=training.coupled)
        fit = fit_law(whole, law, prior, fit)
    result = _identification(whole, fit, prior)
    fitted = _judged(result.fitted, without_effort, model)
    progress(1.0)
    names = model.joint_names
    before = recording_error(model, judging.data.recording)
    return replace(
        result, candidates=choice.candidates, fitted=fitted, tested=test is not None,
        before=rms(before), held_out=rms(held_out),
        held_out_moving=moving_rms(held_out, judging.data.moving),
        suspected=tuple((names[a], names[b], gain) for a, b, gain in suspected))


def _check_options(weight: float | None, bounded: bool, friction_only: bool,
                   friction: str) -> None:
    """Raise InputError for options of `identify` that are out of range."""
    if weight is not None and not 0.0 < weight < np.inf:
        raise InputError(f'weight: {weight:g}; expected a positive, finite number')
    # Negative losses would show an error of the inertials, which are known with
    # friction_only alone.
    if not (bounded or friction_only):
        raise InputError('bounded: False; expected it only with friction_only=True')
    if friction != SELECT and friction not in LAW_NAMES:
        raise InputError(f'friction: {friction!r}; expected one of {SELECT}, '
                         f'{", ".join(LAW_NAMES)}')
    if not bounded and friction not in (SELECT, COULOMB.name):
        raise InputError(f'friction: {friction!r} with bounded=False; expected '
                         f'{COULOMB.name!r}')


def _checked_pairs(model: Model, coupled: Sequence[tuple[str, str]]) -> list[Coupled]:
    """Return coupled joints by number; raise InputError for names of no two joints."""
    pairs = []
    for pair in coupled:
        names = tuple(pair)
        if len(set(names)) != 2 or not set(names) <= set(model.joint_names):
            raise InputError(f'coupled: {names}; expected two of '
                             f'{", ".join(model.joint_names)}')
        first, second = map(model.joint_names.index, names)
        pairs.append(Coupled(first, second, 1.0))
    return pairs


def _rows_of_efforts(model: Model, recording: Recording, standstill: float,
                     without_effort: Sequence[str]) -> LawRows:
    """Return the rows; joints without efforts count as at rest in all of them."""
    data = rows(model, recording, standstill)
    has_effort = np.array([name not in without_effort for name in model.joint_names])
    return law_rows(replace(data, moving=data.moving & has_effort))


def _judged(error: Array, without_effort: Sequence[str], model: Model) -> Array:
    """Return errors, NaN of joints without efforts."""
    has_effort = np.array([name not in without_effort for name in model.joint_names])
    return np.where(has_effort, error, np.nan)


def _require_motion(data: LawRows, without_effort: Sequence[str]) -> None:
    """Raise InputError for a joint that hardly moves."""
    for j, count in enumerate(data.data.moving.sum(axis=0)):
        if count < 10 and data.data.joint_names[j] not in without_effort:
            raise InputError(f"joint '{data.data.joint_names[j]}': moves in {count} "
                             'rows of the fit; expected at least 10 (a slow motion: a smaller '
                             'standstill, --standstill)')


def _signs(data: LawRows, pairs: Sequence[Coupled], prior: Prior) -> tuple[Coupled, ...]:
    """Return pairs of joints with the signs whose fits have the smaller error."""
    chosen: list[Coupled] = []
    for pair in pairs:
        errors = {}
        for sign in (1.0, -1.0):
            one = pair._replace(sign=sign)
            fit = fit_law(replace(data, coupled=(*chosen, one)), COULOMB, prior)
            errors[one] = float(np.log(fit.sigma).sum())
        chosen.append(min(errors, key=errors.__getitem__))
    return tuple(chosen)


class _Choice:
    """The law of friction and the weight of the prior, judged on left-out blocks."""

    def __init__(self, data: LawRows, blocks: list[Flags], prior: Prior,
                 progress: Callable[[float], object]) -> None:
        self._rows, self._blocks, self._prior = data, blocks, prior
        self._progress = progress
        self.candidates: dict[str, CandidateErrors] = {}
        self.fits: dict[str, LawFit] = {}

    def law(self, name: str) -> FrictionLaw:
        """Return the law of a name, or the one that left-out blocks choose; fit it."""
        plain = fit_law(self._rows, COULOMB, self._prior)
        self.fits[COULOMB.name] = plain
        if name != SELECT:
            law = LAWS[LAW_NAMES.index(name)]
            self.fits[name] = fit_law(self._rows, law, self._prior, plain)
            return law
        errors = []
        for k, law in enumerate(LAWS):
            fit = plain if law is COULOMB else fit_law(self._rows, law, self._prior, plain)
            self.fits[law.name] = fit
            every, moving = Blocks(self._rows, self._blocks, fit).errors(self._prior)
            errors.append(every)
            self.candidates[law.name] = CandidateErrors(_root_mean_square(every),
                                                        _root_mean_square(moving))
            self._progress(0.1 + 0.5 * (k + 1) / len(LAWS))
        return LAWS[first_within_noise(errors)]

    def weight(self, law: FrictionLaw) -> float:
        """Return the weight of the prior that left-out blocks support."""
        left_out = Blocks(self._rows, self._blocks, self.fits[law.name])
        errors = []
        for weight in WEIGHTS:
            errors.append(left_out.errors(self._prior._replace(weight=float(weight)))[0])
        return chosen_weight(errors, WEIGHTS.tolist())

    def suspected(self, fit: LawFit, prior: Prior) -> list[tuple[int, int, float]]:
        """Return consecutive joints whose errors a coupled motor would explain."""
        plain = np.log(Blocks(self._rows, self._blocks, fit).errors(prior)[0])
        found = []
        for first in range(len(fit.losses) - 1):
            pair = [first, first + 1]
            shares = [0.0]
            for sign in (1.0, -1.0):
                data = replace(self._rows, coupled=(Coupled(first, first + 1, sign),))
                wider = replace(fit, couplings=np.zeros((1, 3)))
                errors = Blocks(data, self._blocks, wider).errors(prior)[0]
                gain = (plain - np.log(errors))[:, pair].mean(axis=1)
                noise = gain.std(ddof=1) / np.sqrt(len(gain))
                if gain.mean() > SIGNIFICANT * noise:
                    shares.append(1.0 - float(np.exp(-gain.mean())))
            if max(shares) > SUSPECTED:
                found.append((first, first + 1, max(shares)))
        return found


def _identification(data: LawRows, fit: LawFit, prior: Prior) -> Identification:
    """Return the result for a fit to some rows, with deviations; without left-out errors."""
    model = prior.model
    # The equations in the units of the residuals, whose triangles give the deviations.
    error = law_error(data, fit)
    triangles = law_equations(data, fit.law, fit.shapes, data.load(fit)).triangles
    inflation = _correlation(error, data.data.moving)
    A = triangle(np.vstack([R[:, :-1] / (deviation * growth) for R, deviation, growth
                            in zip(triangles, fit.sigma, inflation, strict=True)]))
    unknowns = np.concatenate([fit.inertial, fit.losses[:, :len(FRICTION)].ravel()])
    speeds = friction_shapes(data, fit, prior.lowest)
    deviations, inertial_deviations, covariance, condition = statistics(
        A, model, unknowns, speeds, prior.weight, COLUMNS)
    names = model.joint_names
    coupled = tuple(CoupledMotor((names[a], names[b]), sign, *values) for (a, b, sign), values
                    in zip(data.coupled, fit.couplings.tolist(), strict=True))
    travel = fit.shapes[:, 0] if fit.law.presliding else np.zeros(model.n)
    nothing = np.zeros(model.n)
    return Identification(
        model, unknowns, speeds, bool(np.isinf(prior.weight)), fit.law.name, fit, coupled, (),
        travel, {}, nothing, rms(error), nothing, False,
        moving_rms(error, data.data.moving), nothing, deviations, inertial_deviations,
        covariance, condition, float(prior.weight))


def _correlation(error: Array, moving: Flags) -> Array:
    """
    Return the factor by which correlated residuals increase deviations, (n,), 1 or more.

    The variance of means over stretches of rows is that of independent residuals times the
    square of the factor.
    """
    length = max(1, len(error) // STRETCHES)
    count = len(error) // length
    in_motion = np.where(moving, error, 0.0)[:count * length].reshape(count, length, -1)
    variance = np.maximum(np.mean(in_motion**2, axis=(0, 1)), np.finfo(float).tiny)
    of_means = np.mean(in_motion.mean(axis=1)**2, axis=0)
    return np.asarray(np.sqrt(np.maximum(1.0, length * of_means / variance)))


def identified(model: Model, x: Array, speeds: Array, fit: LawFit, *,
               inertials: bool = True) -> Model:
    """Return the model with the values of the unknowns, and of further terms of friction."""
    # Friction replaces the model's own; terms that are not identified have their
    # defaults.
    losses: dict[str, dict[str, Any]] = {}
    for j, name in enumerate(model.joint_names):
        if not fit.losses[j].any():  # without efforts, it keeps its own
            continue
        row = x[-4 * model.n:].reshape(-1, 4)[j]
        law = {**OTHER_TERMS, **dict(zip(FRICTION, row.tolist(), strict=True)),
               'friction_speed': float(speeds[j]), 'fast_damping': None,
               'load_friction': float(fit.losses[j, 5])}
        if fit.law.curved:
            law.update(fast_damping=float(fit.losses[j, 4]),
                       damping_speed=float(fit.shapes[j, 1]))
        if fit.law.presliding and row[1] > 0.0:
            law['presliding_stiffness'] = float(row[1] / fit.shapes[j, 0])
        losses[name] = law
    # Unknowns are ten inertial parameters a body, then the losses of each joint.
    bodies = []
    for k, body in enumerate(model.bodies):
        inertial = body.inertial
        if inertials:
            P = pseudo_inertia_of(x[10 * k:10 * k + 10])
            inertial = Inertial.from_pseudo_inertia(P)
        joint = replace(body.joint, **losses.get(body.joint.name, {}))
        bodies.append(replace(body, inertial=inertial, joint=joint))
    return replace(model, bodies=tuple(bodies))


def recording_error(model: Model, recording: Recording) -> Array:
    """Return measured minus computed torque, (N, n), N m or N."""
    return recording.tau - Robot(model).inverse_dynamics(recording.q, recording.u,
                                                         recording.udot)


def _root_mean_square(errors: Array) -> Array:
    """Return the root of the mean square over blocks, (n,); NaN of joints at rest."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)  # a joint that never moves
        return np.asarray(np.sqrt(np.nanmean(errors**2, axis=0)))
