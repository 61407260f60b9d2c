"""Identify a model from a recording, and validate it on held-out rows."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import warnings

from kane_dynamics._util.attribute_hints import hinting
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.identification.base_regressor import true_unknowns
from kane_dynamics.identification.physical_consistency import physical
from kane_dynamics.identification.recordings.diagnosis import diagnose
from kane_dynamics.identification.recordings.recording import check_recording, Recording
from kane_dynamics.identification.regression import (compressed, factorized,
                                                     fit_friction, FRICTION,
                                                     friction_speeds, full_regressor,
                                                     LOWEST, RegressionRows, rms, rows,
                                                     settled_speeds, stacked, STANDSTILL,
                                                     triangle, UNBOUNDED, weights)
from kane_dynamics.identification.solvers import on_one_processor
from kane_dynamics.identification.standard_deviations import friction_statistics, statistics
from kane_dynamics.mechanics.recursive.regressor import pseudo_inertia_of
from kane_dynamics.model.model import Inertial, Model
from kane_dynamics.robot.robot import Robot
import numpy as np

ROUNDS = 3  # of reweighting
WEIGHTS = 10.0 ** np.arange(1, 7)


@hinting
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
    before, fitted, held_out : (n,) arrays
        RMS of torque error, N m or N: of the given model on the second half; of the
        identified model on the first half, to which it was fitted; and on the second
        half, held out.
    deviations : (n, 4) array
        Standard deviations of damping, friction, armature and offset for independent
        residuals; those of a smooth recording are correlated, which makes the deviations
        too small. They include the bias of the prior, see `standard_deviations`, and
        take the friction speeds as known.
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
        return identified(self.given, self.unknowns, self.friction_speed,
                          inertials=not self.friction_only)

    def torque(self, recording: Recording) -> Array:
        """
        Return the torque of the identified values for the motion of a recording, (N, n), N m or N.

        Parameters
        ----------
        recording : Recording
            Of the joints of the model, in their order; its torques are not used.

        """
        data = rows(self.given, recording)
        return np.asarray(recording.tau - _error(data, self.friction_speed,
                                                 self.unknowns))

    @property
    def losses(self) -> Array:
        """Return damping, friction, armature and offset of each joint, (n, 4)."""
        return self.unknowns[-4 * self.given.n:].reshape(-1, 4)


@hinting
@on_one_processor
def identify(model: Model, recording: Recording, *, friction_only: bool = False,
             bounded: bool = True, weight: float | None = None,
             standstill: float = STANDSTILL,
             diagnosed: bool = False,
             progress: Callable[[float], object] = lambda done: None) -> Identification:
    """
    Fit a model to the first half of a recording and validate it on the second half.

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
        the rigid bodies; `model` then raises ModelError.
    weight : float, optional
        Weight of the prior. Default: chosen by cross-validation on the first half.
    standstill : float
        The fit of a joint ignores rows in which it is slower, rad/s or m/s; the reported
        errors are those of all rows.
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
    if weight is not None and not 0.0 < weight < np.inf:
        raise InputError(f'weight: {weight:g}; expected a positive, finite number')
    if not (bounded or friction_only):
        raise InputError('bounded: False; expected it only with friction_only=True')
    if not standstill >= 0.0:
        raise InputError(f'standstill: {standstill:g}; expected a number >= 0')
    check_recording(model, recording)
    if not diagnosed:
        for finding in diagnose(model, recording):
            if finding.level != 'remark':
                warnings.warn(f'the recording does not fit the model: {finding.words}',
                              ModelWarning, stacklevel=3)
    data = rows(model, recording, standstill)
    first, second = data.half(second=False), data.half(second=True)
    lowest = LOWEST if bounded else UNBOUNDED
    speeds = friction_speeds(first, lowest)
    x = _friction_alone(model, first, speeds, lowest)
    if friction_only:
        weight = np.inf
    else:
        x, speeds, weight = _with_bodies(model, first, speeds, x, weight, progress)
    progress(1.0)
    A, _, _ = _weighted(compressed(first, speeds), x)
    if friction_only:
        deviations, inertial_deviations, condition = friction_statistics(A, model)
    else:
        deviations, inertial_deviations, condition = statistics(A, model, x, speeds,
                                                                weight)
    fitted = _error(first, speeds, x)
    held_out = _error(second, speeds, x)
    return Identification(
        model, x, speeds, friction_only, rms(recording_error(model, second.recording)),
        rms(fitted), rms(held_out), _moving_rms(fitted, first.moving),
        _moving_rms(held_out, second.moving), deviations,
        inertial_deviations, condition, float(weight))


def identified(model: Model, x: Array, speeds: Array, *,
               inertials: bool = True) -> Model:
    """Return the model with the values of the unknowns."""
    losses = {}
    for name, row, speed in zip(model.joint_names, x[-4 * model.n:].reshape(-1, 4),
                                speeds, strict=True):
        losses[name] = dict(zip(FRICTION, row.tolist(), strict=True),
                            friction_speed=float(speed))
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


def _friction_alone(model: Model, data: RegressionRows, speeds: Array,
                    lowest: Array) -> Array:
    """Return the unknowns with the model's inertials and fitted friction."""
    x = true_unknowns(model)
    for j, speed in enumerate(speeds):
        start = 10 * len(model.bodies) + 4 * j
        x[start:start + 4] = fit_friction(data, j, float(speed), lowest)[0]
    return x


def _with_bodies(model: Model, data: RegressionRows, speeds: Array, x: Array,
                 weight: float | None,
                 progress: Callable[[float], object]) -> tuple[Array, Array, float]:
    """
    Return the unknowns, the friction speeds, and the weight of the prior.

    A weight that is not given is chosen twice: with the friction speeds fitted to the
    given bodies, then with those fitted to the identified bodies.
    """
    prior = [body.inertial for body in model.bodies]
    used_weight = 0.0

    def rigid(speeds: Array) -> Array:
        """Fit at given friction speeds; return the rigid-body torque."""
        nonlocal x
        equations = compressed(data, speeds)
        for _ in range(ROUNDS):
            A, b, _ = _weighted(equations, x)
            x = physical(A, b, prior, model.n, used_weight)
        return np.asarray(data.Y @ x[:10 * len(prior)])

    for done_before in (0.0, 0.5):
        def report(done: float, done_before: float = done_before) -> None:
            progress(done_before + 0.5 * done)
        used_weight = weight or _chosen_weight(model, data, speeds, x, report)
        speeds = settled_speeds(data, speeds, rigid)
        if weight:
            break
    rigid(speeds)
    return x, speeds, used_weight


def _weighted(compressed_rows: tuple[list[tuple[Array, Array]], Array, Array], x: Array
              ) -> tuple[Array, Array, Array]:
    """Return the equations divided by the residuals' deviations at x, and the deviations."""
    equations, floor, counts = compressed_rows
    sigma = weights(equations, floor, counts, x)
    return *stacked(equations, sigma), sigma


def _chosen_weight(model: Model, data: RegressionRows, speeds: Array, x: Array,
                   progress: Callable[[float], object]) -> float:
    """
    Return the weight of the prior, by cross-validation over blocks of consecutive rows.

    It is the largest weight whose error is within one standard error of the smallest
    (Hastie, Tibshirani & Friedman, The Elements of Statistical Learning, section 7.10).
    Errors are in units of each joint's residual at x.
    """
    _, _, sigma = _weighted(compressed(data, speeds), x)
    prior = [body.inertial for body in model.bodies]
    stretches = []
    for part in data.stretches:
        triangles = factorized(part, speeds)
        weighted = [R / deviation for R, deviation in zip(triangles, sigma, strict=True)]
        stretches.append(np.vstack(weighted))
    # The prior counts as much for a fit to all stretches but one as for a fit to all.
    share = 1.0 - 1.0 / len(stretches)
    errors = np.zeros((len(stretches), len(WEIGHTS)))
    for k, held_out in enumerate(stretches):
        R = triangle(np.vstack(stretches[:k] + stretches[k + 1:]))
        count = max(int(data.stretches[k].moving.sum()), 1)
        for i, weight in enumerate(WEIGHTS):
            fitted = physical(R[:, :-1], R[:, -1], prior, model.n, float(weight) * share)
            residual = held_out[:, -1] - held_out[:, :-1] @ fitted
            errors[k, i] = residual @ residual / count
            progress((k * len(WEIGHTS) + i + 1) / (errors.size + ROUNDS))
    mean = errors.mean(axis=0)
    best = int(np.argmin(mean))
    standard_error = errors[:, best].std(ddof=1) / np.sqrt(len(stretches))
    return float(WEIGHTS[mean <= mean[best] + standard_error][-1])


def _moving_rms(error: Array, moving: Flags) -> Array:
    """Return the RMS of each joint's error over the rows in which it moves, (n,)."""
    counts = moving.sum(axis=0)
    squares = np.sum(np.where(moving, error, 0.0)**2, axis=0)
    return np.where(counts > 0, np.sqrt(squares / np.maximum(counts, 1)), np.nan)


def _error(data: RegressionRows, speeds: Array, x: Array) -> Array:
    """Return measured torque minus that of the values of the unknowns, (N, n)."""
    return np.asarray(data.recording.tau - data.rest - full_regressor(data, speeds) @ x)
