"""Identify a model from a recording, and validate it on held-out rows."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple
import warnings

from kane_dynamics._util.checks import number
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.identification.base_regressor import true_unknowns
from kane_dynamics.identification.friction_laws import (block_flags, Blocks,
                                                        CandidateErrors, chosen_laws,
                                                        clearly_smaller, COLUMNS,
                                                        costs_others, COULOMB, fit_laws,
                                                        fit_sliding, FrictionLaw,
                                                        largest_supported,
                                                        law_equations, law_error,
                                                        LAW_NAMES, law_of_arm, law_rows,
                                                        LawFit, LawRows, LAWS,
                                                        moving_rms, phases, Prior,
                                                        without_harm)
from kane_dynamics.identification.physical_consistency import physical
from kane_dynamics.identification.recordings.diagnosis import diagnose
from kane_dynamics.identification.recordings.recording import (check_recording,
                                                               Recording,
                                                               require_rigid_links,
                                                               STANDSTILL)
from kane_dynamics.identification.regression import (compressed, fit_friction, FRICTION,
                                                     friction_speeds, LOWEST,
                                                     RegressionRows, rms, rows,
                                                     settled_speeds, stacked_rows,
                                                     UNBOUNDED, weights)
from kane_dynamics.identification.solvers import on_one_processor
from kane_dynamics.identification.standard_deviations import (friction_statistics,
                                                              statistics)
from kane_dynamics.mechanics.recursive.regressor import pseudo_inertia_of
from kane_dynamics.model.elastic_model import require_rigid_joints
from kane_dynamics.model.model import Inertial, Model
from kane_dynamics.robot.robot import Robot
import numpy as np

ROUNDS = 3  # of reweighting
WEIGHTS = 10.0 ** np.arange(1, 7)
CHOICES = 2  # of laws and weight in turn, at most
FIRST_WEIGHT = 1e3  # of the prior, before one is chosen
LARGEST_CHANGE = 10.0  # factor, of the weight that is chosen with other laws
LEAST_LOAD = 1e-3  # of gravity, relative to the RMS of the torque
SELECT = 'select'  # the law of friction of each joint
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
    laws : tuple of n str
        Law of friction of each joint, of `friction_laws.LAWS`.
    quadratic_damping, load_friction : (n,) arrays
        As of `Joint`; 0 where the law has none.
    presliding : (n,) array
        Travel over which presliding friction reverses, rad or m; 0 where the law has none.
        `presliding_stiffness` of `model` is friction divided by it.
    candidates : dict of str to CandidateErrors
        RMS errors of each law on blocks of the first half that its fit had left out, of all
        and of moving rows; empty with a law that was given.
    before, fitted, held_out : (n,) arrays
        RMS of torque error, N m or N: of the given model on the second half; of the
        identified model on the first half, to which it was fitted; and on the second
        half, held out.
    deviations : (n, 4) array
        Standard deviations of damping, friction, armature and offset for independent
        residuals; those of a smooth recording are correlated, which makes the deviations
        too small. They include the bias of the prior, see `standard_deviations`, and
        take friction speeds and travels as known.
    inertial_deviations : (bodies, 10) array
        Standard deviations of single inertial parameters about the body's origin, in the
        order of `regressor.PARAMETERS`: those of the torques alone, or larger by the
        bias of the prior; NaN for parameters that are not identifiable by themselves,
        and with `friction_only`.
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
    laws: tuple[str, ...]
    quadratic_damping: Array
    load_friction: Array
    presliding: Array
    candidates: dict[str, CandidateErrors]
    before: Array
    fitted: Array
    held_out: Array
    fitted_moving: Array
    held_out_moving: Array
    deviations: Array
    inertial_deviations: Array
    condition: float
    weight: float

    @lazy_property
    def model(self) -> Model:
        """
        Return the identified model.

        Raises
        ------
        ModelError
            If damping, friction or armature of a joint is negative, which is possible
            without bounds; the message names it.

        """
        further = {'quadratic_damping': self.quadratic_damping,
                   'load_friction': self.load_friction,
                   'presliding_stiffness': self._presliding_stiffness}
        return identified(self.given, self.unknowns, self.friction_speed, further,
                          inertials=not self.friction_only)

    def torque(self, recording: Recording) -> Array:
        """
        Return the torque of the identified values for the motion of a recording, (N, n), N m or N.

        Parameters
        ----------
        recording : Recording
            Of the joints of the model, in their order; its torques are not used.

        """
        data = law_rows(rows(self.given, recording))
        return np.asarray(recording.tau - law_error(data, self._fit))

    @property
    def _presliding_stiffness(self) -> Array:
        """Return `presliding_stiffness` of the joints, (n,); 0 where the law has none."""
        friction = self.losses[:, FRICTION.index('friction')]
        stiffness = np.zeros(len(friction))
        slides = self.presliding > 0.0
        stiffness[slides] = friction[slides] / self.presliding[slides]
        return stiffness

    @property
    def _fit(self) -> LawFit:
        """Return the values as a fit of laws."""
        laws = [LAWS[LAW_NAMES.index(name)] for name in self.laws]
        further = np.column_stack([self.quadratic_damping, self.load_friction])
        shapes = np.where(self.presliding > 0.0, self.presliding, self.friction_speed)
        size = 10 * len(self.given.bodies)
        return LawFit(tuple(laws), self.unknowns[:size],
                      np.hstack([self.losses, further]), shapes, self.fitted)

    @property
    def losses(self) -> Array:
        """Return damping, friction, armature and offset of each joint, (n, 4)."""
        return self.unknowns[-4 * self.given.n:].reshape(-1, 4)


@on_one_processor
def identify(model: Model, recording: Recording, *, friction_only: bool = False,
             bounded: bool = True, weight: float | None = None,
             standstill: float = STANDSTILL, friction: str = SELECT,
             diagnosed: bool = False,
             progress: Callable[[float], object] = lambda done: None) -> Identification:
    """
    Fit a model to the first half of a recording and validate it on the second half.

    Of a periodic recording the halves are those of its period, since repeated motion is no
    test.

    Parameters
    ----------
    model : Model
        Initial model; its inertials are the prior of parameters that are not
        identifiable.
    recording : Recording
        Recording of the model's joints, in their order; filtered if necessary.
    friction_only : bool
        Keep the given inertials.
    bounded : bool
        Whether damping, friction and armature are bounded to values >= 0. False requires
        `friction_only`: plain least squares, in which a negative value shows an error of
        the rigid bodies; `model` then raises ModelError. The law is then 'coulomb'.
    weight : float, optional
        Weight of the prior. Default: chosen on blocks of the first half that fits leave
        out.
    standstill : float
        The fit of a joint ignores rows in which it is slower, rad/s or m/s, but for
        presliding friction; the reported errors are those of all rows.
    friction : str
        Law of friction of all joints, a name of `friction_laws.LAWS`; or 'select', which
        chooses one for each joint on blocks of the first half that fits leave out. With
        `friction_only` it is 'coulomb', since wrong masses look like friction that
        depends on the load.
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
    if not diagnosed:
        for finding in diagnose(model, recording):
            if finding.level != 'remark':
                warnings.warn(f'the recording does not fit the model: {finding.words}',
                              ModelWarning, stacklevel=2)
    # The first half is fitted, on blocks that take turns in being left out; the second
    # half only validates.
    whole = law_rows(rows(model, recording, standstill))
    place = phases(recording)
    in_first = place < 0.5
    first = whole.part(in_first)
    second = whole.part(~in_first)
    blocks = block_flags(2.0 * place[in_first])
    lowest = LOWEST if bounded else UNBOUNDED
    plain = _PlainFits(model, first, blocks, lowest)

    # An infinite weight of the prior keeps the inertials as they are.
    stated_weight = np.inf if friction_only else weight
    laws = _stated_laws(model, friction, friction_only)
    fit, used_weight, candidates = _chosen_fit(plain, laws, stated_weight, progress)
    progress(1.0)
    return _identification(first, second, fit, used_weight, candidates, model)


def _stated_laws(model: Model, friction: str,
                 friction_only: bool) -> tuple[FrictionLaw, ...] | None:
    """Return the law of each joint by the options; None if laws are to be selected."""
    if friction == SELECT and not friction_only:
        return None
    name = COULOMB.name if friction == SELECT else friction
    return (LAWS[LAW_NAMES.index(name)],) * model.n


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


class _PlainFits(NamedTuple):
    """Fits with Coulomb friction of all joints: their model, rows, blocks and bounds."""

    model: Model
    rows: LawRows
    blocks: list[Flags]
    lowest: Array

    def fit(self, weight: float, start: LawFit | None = None) -> LawFit:
        """Return the fit with a weight of the prior."""
        return _coulomb_fit(self.model, self.rows.data, weight, self.lowest, start)

    def weight(self, fit: LawFit) -> float:
        """Return the weight of the prior that predicts left-out blocks best."""
        return _chosen_weight(self.rows, self.blocks, fit, self.model)


def _chosen_fit(plain_fits: _PlainFits, stated: tuple[FrictionLaw, ...] | None,
                given: float | None, progress: Callable[[float], object]
                ) -> tuple[LawFit, float, dict[str, CandidateErrors]]:
    """
    Return the fit, its weight of the prior, and the errors of all laws.

    The weight is chosen with Coulomb friction. With it the laws are compared. Laws without
    load friction keep bodies and offsets unless others predict clearly better. Else the
    weight is chosen with the laws, if that is smaller, by a factor of ten at most; once
    more if both have changed.

    Neither `stated` laws nor a `given` weight are chosen; the weight is infinite for given
    bodies.
    """
    data, model = plain_fits.rows, plain_fits.model
    # Coulomb friction of all joints: the weight, then the fit with this weight.
    weight = given or FIRST_WEIGHT
    plain = plain_fits.fit(weight)
    if given is None:
        weight = plain_fits.weight(plain)
        plain = plain_fits.fit(weight, plain)
    progress(0.4)
    of_coulomb, coulomb_weight = plain, weight
    laws = stated or (COULOMB,) * model.n
    candidates: dict[str, CandidateErrors] = {}
    fit = plain
    # In turns: the laws with this weight, then the weight with these laws.
    for turn in range(CHOICES):
        last_laws, last_weight = laws, weight
        if stated is None:
            laws, candidates = _selected(data, plain_fits.blocks, plain,
                                         Prior(model, weight))
        if turn and laws == last_laws:
            break
        if all(law is COULOMB for law in laws):
            return of_coulomb, coulomb_weight, candidates
        prior = Prior(model, weight)
        fit = fit_laws(data, laws, plain, prior)
        sliding = _sliding_fit(plain_fits, plain, fit, prior)
        if sliding is not None:
            fit = sliding
            break
        if given is None:
            # A weight that is too large costs more than one that is too small: smaller
            # weights are accepted only. Few blocks resolve weights to a factor of ten
            # at best, and a law changes the weight that is right by less.
            lowest = coulomb_weight / LARGEST_CHANGE
            weight = min(weight, max(lowest, plain_fits.weight(fit)))
        if weight == last_weight:
            break
        fit = fit_laws(data, laws, fit, Prior(model, weight))
        plain = plain_fits.fit(weight, plain)
        progress(0.4 + 0.5 * (turn + 1) / CHOICES)
    return fit, weight, candidates


def _sliding_fit(plain_fits: _PlainFits, plain: LawFit, fit: LawFit, prior: Prior
                 ) -> LawFit | None:
    """
    Return the fit with the laws of `fit`, and bodies and offsets of Coulomb friction.

    Return None if those of `fit` predict left-out blocks clearly better, if a law depends
    on the load, or if the bodies are given.
    """
    if not np.isfinite(prior.weight) or any(law.load for law in fit.laws):
        return None
    rows_of_fit, blocks = plain_fits.rows, plain_fits.blocks
    sliding = fit_sliding(rows_of_fit, fit.laws, plain)
    # The errors of both on blocks that neither has seen.
    of_plain = Blocks(rows_of_fit, blocks, plain)
    of_sliding = Blocks(rows_of_fit, blocks, sliding).sliding_errors(of_plain, prior)[0]
    fitted = Blocks(rows_of_fit, blocks, fit).errors(prior)[0]
    return None if clearly_smaller(fitted, of_sliding) else sliding


def _identification(first: LawRows, second: LawRows, fit: LawFit, weight: float,
                    candidates: dict[str, CandidateErrors], model: Model
                    ) -> Identification:
    """Return the result for a fit, with its errors and deviations."""
    # The equations in the units of the residuals, whose triangles give the deviations.
    x = _unknowns(fit)
    load = first.load(fit.inertial, fit.losses[:, 2])
    friction_only = not np.isfinite(weight)
    A = _plain_equations(law_equations(first, fit.laws, fit.shapes, load).triangles, fit)
    speeds = _smooth_speeds(first, fit)
    if friction_only:
        deviations, inertial_deviations, condition = friction_statistics(A, model)
    else:
        deviations, inertial_deviations, condition = statistics(A, model, x, speeds,
                                                                weight)
    # Errors on the first half, to which the values were fitted, and on the second one.
    fitted, held_out = law_error(first, fit), law_error(second, fit)
    has_memory = np.array([law.presliding for law in fit.laws])
    return Identification(
        model, x, speeds, friction_only, tuple(law.name for law in fit.laws),
        fit.losses[:, 4], fit.losses[:, 5], np.where(has_memory, fit.shapes, 0.0),
        candidates, rms(recording_error(model, second.data.recording)), rms(fitted),
        rms(held_out), moving_rms(fitted, first.data.moving),
        moving_rms(held_out, second.data.moving), deviations, inertial_deviations,
        condition, float(weight))


def _unknowns(fit: LawFit) -> Array:
    """Return inertial parameters and the four losses of all laws, (10 bodies + 4 n,)."""
    return np.concatenate([fit.inertial, fit.losses[:, :len(FRICTION)].ravel()])


def _plain_equations(triangles: list[Array], fit: LawFit) -> Array:
    """
    Return the weighted equations of the unknowns of all laws, without the torque.

    What further terms explain is taken from them, so that deviations include those of the
    further terms (Schur complement).
    """
    size, n = len(fit.inertial), len(fit.laws)
    # The columns of the first four losses of each joint are kept, those of further laws
    # are eliminated.
    of_losses = size + np.arange(COLUMNS * n).reshape(n, COLUMNS)
    kept = np.concatenate([np.arange(size), of_losses[:, :len(FRICTION)].ravel()])
    weighted = np.vstack([R[:, :-1] / deviation for R, deviation
                          in zip(triangles, fit.sigma, strict=True)])
    further = weighted[:, of_losses[:, len(FRICTION):].ravel()]
    further = further[:, further.any(axis=0)]
    A = weighted[:, kept]
    # Only what the further terms cannot explain informs about the others.
    if further.shape[1]:
        basis = np.linalg.qr(further)[0]
        A = A - basis @ (basis.T @ A)
    return A


def _smooth_speeds(first: LawRows, fit: LawFit) -> Array:
    """Return the friction speeds; of presliding friction, those that resemble it most."""
    speeds = fit.shapes.copy()
    has_memory = [j for j, law in enumerate(fit.laws) if law.presliding]
    if has_memory:
        alone = replace(first.data, rigid=first.data.Y @ fit.inertial)
        speeds[has_memory] = friction_speeds(alone)[has_memory]
    return speeds


def identified(model: Model, x: Array, speeds: Array, further: dict[str, Array], *,
               inertials: bool = True) -> Model:
    """Return the model with the values of the unknowns, and of further terms of friction."""
    # Friction replaces the model's own; terms that are not identified have their
    # defaults.
    losses: dict[str, dict[str, Any]] = {}
    for j, name in enumerate(model.joint_names):
        row = x[-4 * model.n:].reshape(-1, 4)[j]
        losses[name] = {**OTHER_TERMS, **dict(zip(FRICTION, row.tolist(), strict=True)),
                        'friction_speed': float(speeds[j])}
        for term, values in further.items():
            losses[name][term] = float(values[j])
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


def _coulomb_fit(model: Model, data: RegressionRows, weight: float, lowest: Array,
                 start: LawFit | None = None) -> LawFit:
    """
    Return the fit with Coulomb friction of all joints.

    Friction speeds are searched finely: those fitted to the given bodies, then those
    fitted to the identified bodies.
    """
    prior = [body.inertial for body in model.bodies]
    # The first fit starts from the prior and from the friction of each joint by itself.
    bounds = np.tile(lowest, model.n)
    if start is None:
        speeds = friction_speeds(data, lowest)
        x = true_unknowns(model)
        for j, speed in enumerate(speeds):
            own = slice(10 * len(prior) + 4 * j, 10 * len(prior) + 4 * j + 4)
            x[own] = fit_friction(data, j, float(speed), lowest)[0]
    else:
        speeds, x = start.shapes, _unknowns(start)

    def rigid(speeds: Array) -> Array:
        """Fit at given friction speeds; return the rigid-body torque."""
        nonlocal x
        at_speeds = compressed(data, speeds)
        for _ in range(ROUNDS):
            A, b, _ = _weighted(at_speeds, x)
            x = physical(A, b, prior, bounds, weight)
        return np.asarray(data.Y @ x[:10 * len(prior)])

    # Alternate between friction speeds and the rigid-body fit until the speeds settle.
    if np.isfinite(weight):
        speeds = settled_speeds(data, speeds, rigid)
        rigid(speeds)
    # The deviations of the residuals of each joint, which weigh the equations of the
    # next fit.
    _, _, sigma = _weighted(compressed(data, speeds), x)
    size = 10 * len(prior)
    losses = np.hstack([x[size:].reshape(-1, 4), np.zeros((model.n, 2))])
    return LawFit((COULOMB,) * model.n, x[:size], losses, np.asarray(speeds), sigma)


def _weighted(compressed_rows: tuple[list[tuple[Array, Array]], Array, Array], x: Array
              ) -> tuple[Array, Array, Array]:
    """Return the equations divided by the residuals' deviations at x, and the deviations."""
    equations_of_joints, floor, counts = compressed_rows
    sigma = weights(equations_of_joints, floor, counts, x)
    return *stacked_rows(equations_of_joints, sigma), sigma


def _selected(rows_of_fit: LawRows, blocks: list[Flags], start: LawFit, prior: Prior
              ) -> tuple[tuple[FrictionLaw, ...], dict[str, CandidateErrors]]:
    """Return the law of each joint, and the errors of all laws on left-out blocks."""
    errors = []
    candidates = {}
    # Each law is fitted to all joints, then tried on blocks of rows that it has not
    # seen.
    plain = Blocks(rows_of_fit, blocks, start)
    for law in LAWS:
        if law is COULOMB:
            every, moving = plain.errors(prior)
        else:
            every, moving = _left_out_errors(rows_of_fit, blocks, law, plain, start, prior)
        errors.append(every)
        candidates[law.name] = CandidateErrors(_root_mean_square(every),
                                               _root_mean_square(moving))
    loaded = _loaded(rows_of_fit, prior.model)
    laws = without_harm(chosen_laws(errors, loaded), errors)
    # Loads of single joints are judged as they are fitted: their bodies are those of all.
    if any(law.load for law in laws) and not law_of_arm(errors).load:
        mixed = Blocks(rows_of_fit, blocks, fit_laws(rows_of_fit, laws, start, prior))
        if costs_others(laws, mixed.errors(prior)[0], errors[0]):
            laws = without_harm(chosen_laws(errors, np.zeros_like(loaded)), errors)
    return laws, candidates


def _left_out_errors(rows_of_fit: LawRows, blocks: list[Flags], law: FrictionLaw,
                     plain: Blocks, start: LawFit, prior: Prior) -> tuple[Array, Array]:
    """Return `Blocks.errors` of one law for all joints, fitted as in the end."""
    laws = (law,) * len(start.laws)
    fitted = Blocks(rows_of_fit, blocks, fit_laws(rows_of_fit, laws, start, prior))
    errors = fitted.errors(prior)
    if law.load:
        return errors
    # Bodies and offsets are those of Coulomb friction unless others predict clearly
    # better.
    sliding = Blocks(rows_of_fit, blocks, fit_sliding(rows_of_fit, laws, start))
    kept = sliding.sliding_errors(plain, prior)
    return errors if clearly_smaller(errors[0], kept[0]) else kept


def _loaded(rows_of_fit: LawRows, model: Model) -> Flags:
    """Return whether gravity loads a joint along a recording, (n,)."""
    recording = rows_of_fit.data.recording
    weight = rms(Robot(model).gravity_force(recording.q))
    return np.asarray(weight > LEAST_LOAD * rms(recording.tau))


def _root_mean_square(errors: Array) -> Array:
    """Return the root of the mean square over blocks, (n,); NaN of joints at rest."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)  # a joint that never moves
        return np.asarray(np.sqrt(np.nanmean(errors**2, axis=0)))


def _chosen_weight(rows_of_fit: LawRows, blocks: list[Flags], fit: LawFit, model: Model
                   ) -> float:
    """Return the largest weight of the prior that errors on left-out blocks support."""
    left_out = Blocks(rows_of_fit, blocks, fit)
    errors = []
    for weight in WEIGHTS:
        errors.append(left_out.errors(Prior(model, float(weight)))[0])
    return largest_supported(errors, WEIGHTS.tolist())
