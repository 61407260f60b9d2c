"""
Laws of friction for identification, and the choice of one for each joint.

Every law has damping, Coulomb friction and an offset. Beyond these:

    quadratic           c u |u|
    load                mu |L| y: friction that grows with the load L on the drive, as
                        of gears
    load and quadratic  both
    presliding          Dahl friction z in place of y = tanh(u / u_s)

z' = (u - |u| z) / l, so that friction reverses over the travel l (P. Dahl, "A solid
friction model", 1968). The load L, of the bodies and the rotor, is that of the fit
before, which makes the equations linear.

A law is judged on blocks of rows that its fit has left out. Motion that repeats is no
test of a fit: rows of a periodic motion are divided by their phase instead.

Load friction looks like mass: bodies and offsets are fitted together with it. Other laws
differ from Coulomb friction where joints reverse or are fast. Centers of mass and offsets
that follow these few rows predict other motion worse, so those of Coulomb friction are
kept unless fits with others predict left-out blocks clearly better.

A law is judged as it is fitted in the end, with these bodies and offsets.

The blocks are few and the rows within one are correlated, so that the errors of single
joints say little: in parts of a Panda's recording, gains of 40 % of one joint did not
last, nor did losses beyond two standard errors. Drives of one arm are of one kind: the law
is that of the arm. It is Coulomb friction unless another law gains more than noise makes
the best of all laws gain (the test of P. Hansen, J. Business & Economic Statistics 23
(2005), with the signs of whole blocks in place of a bootstrap); then it is the simplest
whose error is the smallest within its standard error. A joint has another one only if its
own errors say so beyond the chance of as many comparisons; the mean of all joints is the
prior of each joint's (empirical Bayes; Efron & Morris, JASA 70 (1975)). Friction of the
load of single joints changes the bodies of all: it is also judged by what it costs others.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
import math
from typing import NamedTuple

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.identification.physical_consistency import physical
from kane_dynamics.identification.presliding import (dahl_friction, first_rows,
                                                     friction_in_motion)
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.identification.regression import (least_between, LOWEST,
                                                     RegressionRows, rms, SPEEDS,
                                                     triangle)
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import Model
import numpy as np

LENGTHS = np.geomspace(3e-4, 0.03, 15)  # candidates of the travel l, rad or m
NEAR = np.geomspace(0.5, 2.0, 7)  # candidates of a friction speed, relative to the last
SETTLED = 1e-3  # relative change of a friction speed that is fitted
COLUMNS = 6  # damping, friction, armature, offset, quadratic damping, load friction
OFFSET = 3
LOWEST_OF_ALL = np.concatenate([LOWEST, [0.0, 0.0]])
BLOCKS = 6  # of rows that are left out in turn
TURNS = 3  # alternating fits of bodies and of what enters nonlinearly
REWEIGHTED = 2  # fits with weights of the joints by their residuals
SIGNIFICANT = 2.0  # standard errors of a difference
PROBABLY = 1.645  # standard errors that a gain exceeds with a probability of 95 %
# The chance that noise alone gives an arm another law than Coulomb friction, and any joint
# another one than the arm. The test of the arm is approximate with few blocks: of arms of 2
# to 7 joints whose laws differ by noise alone, 10 to 12 % have another one, 12 to 15 % with
# those of joints.
CHANCE_OF_ARM = 0.1
CHANCE_OF_JOINT = 0.1
NEGLIGIBLE = 0.01  # relative difference of errors that justifies no further term
FLOOR = 1e-3  # of the RMS of the torque: smaller errors are no difference
LEAST = 1e-300  # N m or N, of errors whose logarithms are compared; and of deviations
EQUAL = 1e-9  # relative difference of equal numbers
CLEARLY = 0.1  # relative gain for which bodies and offsets follow a law without load
HARM = 0.05  # relative error by which a law is wrong for a joint
ALIKE = 0.02  # RMS distance of a repeated motion, relative to the range of each joint
LEAST_PERIODS = 1.8  # of a periodic recording


class FrictionLaw(NamedTuple):
    """A law: its name, and which terms it has beyond those of all laws."""

    name: str
    quadratic: bool = False
    load: bool = False
    presliding: bool = False


# The simplest first.
LAWS = (FrictionLaw('coulomb'), FrictionLaw('quadratic', quadratic=True),
        FrictionLaw('load', load=True), FrictionLaw('presliding', presliding=True),
        FrictionLaw('load and quadratic', quadratic=True, load=True))
LAW_NAMES = tuple(law.name for law in LAWS)
COULOMB = LAWS[0]


@dataclass(frozen=True, eq=False)
class LawFit:
    """
    Values of all unknowns with one law for each joint.

    Attributes
    ----------
    laws : tuple of n FrictionLaw
    inertial : (10 bodies,) array
    losses : (n, 6) array
        Damping, friction, armature, offset, quadratic damping and load friction.
    shapes : (n,) array
        Friction speed, rad/s or m/s; the travel l, rad or m, of presliding friction.
    sigma : (n,) array
        Standard deviation of each joint's residual, N m or N.

    """

    laws: tuple[FrictionLaw, ...]
    inertial: Array
    losses: Array
    shapes: Array
    sigma: Array


class CandidateErrors(NamedTuple):
    """RMS error of a law on rows that were left out, (n,) arrays, N m or N."""

    every: Array
    moving: Array


@dataclass(frozen=True, eq=False)
class LawRows:
    """
    Rows for fits of friction laws.

    Attributes
    ----------
    data : RegressionRows
    dahl : (N, lengths, n) array
        Dahl friction of coefficient 1, for each of `LENGTHS`.

    """

    data: RegressionRows
    dahl: Array

    def part(self, chosen: slice | Flags) -> 'LawRows':
        """Return some of the rows; Dahl friction remembers the rows before."""
        return LawRows(self.data.part(chosen), self.dahl[chosen])

    @property
    def torque(self) -> Array:
        """Return the torque that bodies, friction and armature explain, (N, n)."""
        return np.asarray(self.data.recording.tau - self.data.rest)

    def load(self, inertial: Array, armature: Array) -> Array:
        """Return the loads on the drives, (N, n), N m or N."""
        of_bodies = self.data.Y @ inertial
        return np.asarray(of_bodies + self.data.rest + armature * self.data.recording.udot)

    def used(self, joint: int, law: FrictionLaw) -> Flags:
        """Return the rows that determine a joint's parameters, (N,)."""
        # At standstill friction is undetermined, but for that which remembers the motion.
        if law.presliding:
            return np.ones(len(self.dahl), dtype=bool)
        return np.asarray(self.data.moving[:, joint])

    def columns(self, joint: int, law: FrictionLaw, shape: float, load: Array) -> Array:
        """Return the torques of a joint's losses of 1, (N, 6); zeros of unused ones."""
        u = self.data.recording.u[:, joint]
        # The direction of sliding: smoothed, or by the deflection of bristles.
        if law.presliding:
            slip = self._dahl(joint, shape)
        else:
            slip = coulomb(u, shape)
        quadratic = np.zeros(len(u))
        if law.quadratic:
            quadratic = u * np.abs(u)
        by_load = np.zeros(len(u))
        if law.load:
            by_load = np.abs(load) * slip
        return np.column_stack([u, slip, self.data.recording.udot[:, joint],
                                np.ones(len(u)), quadratic, by_load])

    def _dahl(self, joint: int, length: float) -> Array:
        """Return the Dahl friction of coefficient 1 of a joint, (N,)."""
        nearest = int(np.argmin(np.abs(np.log(LENGTHS / length))))
        return np.asarray(self.dahl[:, nearest, joint])


def law_rows(data: RegressionRows) -> LawRows:
    """Return the rows for fits of friction laws, of a whole recording."""
    recording = data.recording
    q, u, udot = recording.q, recording.u, recording.udot
    dahl = np.zeros((len(q), len(LENGTHS), q.shape[1]))
    # A recording may begin in motion, and join motions that did not follow each other.
    # Dahl friction remembers one motion only.
    begins = first_rows(recording.t, q, float(LENGTHS[0]))
    for motion in np.split(np.arange(len(q)), begins[1:]):
        row = motion[0]
        moving = np.where(data.moving[row], u[row], 0.0)
        first = friction_in_motion(moving, udot[row], LENGTHS)
        dahl[motion] = dahl_friction(q[motion], LENGTHS, first)
    return LawRows(data, dahl)


# Rows that are left out.

def period(recording: Recording) -> float | None:
    """Return the period of a recording that repeats itself, s; None if it does not."""
    q = recording.q
    count = len(q)
    reach = np.ptp(q, axis=0)
    moves = reach > 0.0
    if not moves.any() or count < 50:
        return None
    latest = int(count / LEAST_PERIODS)
    # A position recurs now and then; after a period all rows do.
    scaled = q[:, moves] / reach[moves]
    stride = max(1, count // 2000)
    least, best = ALIKE, 0
    for lag in range(count // 50 + 1, latest, stride):
        difference = scaled[lag:] - scaled[:-lag]
        distance = float(np.sqrt(np.mean(difference**2, axis=0)).max())
        if distance < least:
            least, best = distance, lag
        elif best and distance > ALIKE:
            break  # beyond the first minimum; the next one is that of two periods
    return float(recording.t[best] - recording.t[0]) if best else None


def phases(recording: Recording) -> Array:
    """Return the place of each row in the motion, 0 to 1; equal for repeated motion."""
    t = recording.t - recording.t[0]
    repeated = period(recording)
    if repeated is None:
        return np.asarray(np.arange(len(t)) / len(t))
    return np.asarray((t % repeated) / repeated)


def block_flags(place: Array) -> list[Flags]:
    """Return the rows of each block, by their places in the motion."""
    number = np.minimum((BLOCKS * place).astype(int), BLOCKS - 1)
    return [np.asarray(number == k) for k in range(BLOCKS)]


# Fits.

class Prior(NamedTuple):
    """Prior of the inertial parameters: a model, and the weight of the distance from it."""

    model: Model
    weight: float  # infinite: the bodies are those of the model


class JointEquations(NamedTuple):
    """Equations R of each joint, [bodies | losses | torque], and their number of rows."""

    triangles: list[Array]
    counts: Array


def fit_laws(rows: LawRows, laws: Sequence[FrictionLaw], start: LawFit,
             prior: Prior) -> LawFit:
    """Return the fit of bodies and friction with these laws, from another fit."""
    # Loads, shapes of the laws, and linear coefficients in turn, until they agree.
    fit = start
    for _ in range(TURNS):
        load = rows.load(fit.inertial, fit.losses[:, 2])
        shapes = _best_shapes(rows, laws, fit, load)
        system = law_equations(rows, laws, shapes, load)
        fit = LawFit(tuple(laws), fit.inertial, fit.losses, shapes, fit.sigma)
        # Rows far from the fit lose weight.
        for _ in range(REWEIGHTED):
            fit = _solved(system, fit, prior)
    return fit


def fit_sliding(rows: LawRows, laws: Sequence[FrictionLaw], plain: LawFit) -> LawFit:
    """
    Return the fit with laws without load friction that keeps bodies and offsets.

    They are those of `plain`, which has Coulomb friction. Joints that have it too keep all.
    """
    no_load = np.zeros_like(rows.torque)
    shapes = _best_shapes(rows, laws, plain, no_load)
    shapes = np.where(_are_plain(laws), plain.shapes, shapes)
    system = law_equations(rows, laws, shapes, no_load)
    return _sliding(system, replace(plain, laws=tuple(laws), shapes=shapes))


def _are_plain(laws: Sequence[FrictionLaw]) -> Flags:
    """Return which joints have Coulomb friction, (n,)."""
    return np.array([law is COULOMB for law in laws])


def _best_shapes(rows: LawRows, laws: Sequence[FrictionLaw], fit: LawFit, load: Array
                 ) -> Array:
    """Return the friction speeds and travels that fit best for given bodies, (n,)."""
    # The torque that the bodies leave for friction, joint by joint.
    missing = rows.torque - rows.data.Y @ fit.inertial
    shapes = np.zeros(len(laws))
    for j, law in enumerate(laws):
        used = rows.used(j, law)
        missed = partial(_missed, rows, j, law, load[:, j], used, missing[used, j])
        # Travels of presliding have few candidates, because the error has many minima.
        if law.presliding:
            errors = [missed(float(length)) for length in LENGTHS]
            shapes[j] = LENGTHS[int(np.argmin(errors))]
            continue
        candidates = SPEEDS
        if not fit.laws[j].presliding:  # near that of the fit before
            near = np.clip(fit.shapes[j] * NEAR, SPEEDS[0], SPEEDS[-1])
            candidates = np.unique(near)
        shapes[j] = least_between(missed, candidates, SETTLED)
    return shapes


def _missed(rows: LawRows, joint: int, law: FrictionLaw, load: Array, used: Flags,
            missing: Array, shape: float) -> float:
    """Return the sum of squares that the losses of a joint leave of the torque `missing`."""
    columns = rows.columns(joint, law, shape, load)[used]
    R = triangle(np.column_stack([columns, missing]))
    losses = _bounded(R)
    return float(np.sum((R[:, -1] - R[:, :-1] @ losses)**2))


def _bounded(R: Array) -> Array:
    """Return the losses within their bounds that solve R = [losses | torque] best, (6,)."""
    present = np.asarray(R[:, :-1].any(axis=0))
    solution = scientific('scipy.optimize').lsq_linear(
        R[:, :-1][:, present], R[:, -1], bounds=(LOWEST_OF_ALL[present], np.inf),
        method='bvls')
    losses = np.zeros(len(present))
    losses[present] = np.maximum(solution.x, LOWEST_OF_ALL[present])
    return losses


def law_equations(rows: LawRows, laws: Sequence[FrictionLaw], shapes: Array, load: Array
                  ) -> JointEquations:
    """Return the equations of all joints in their used rows."""
    n = len(laws)
    inertial = rows.data.Y.shape[2]
    torque = rows.torque
    triangles = []
    counts = np.zeros(n)
    for j, law in enumerate(laws):
        used = rows.used(j, law)
        counts[j] = max(int(used.sum()), 1)
        columns = rows.columns(j, law, float(shapes[j]), load[:, j])
        # R of the joint's own columns has as few rows as columns. The columns of the
        # other joints' losses are zero, and added to R afterwards.
        of_joint = [rows.data.Y[used, j], columns[used], torque[used, j]]
        R = triangle(np.column_stack(of_joint))
        padded = np.zeros((len(R), inertial + COLUMNS * n + 1))
        padded[:, :inertial] = R[:, :inertial]
        padded[:, own_columns(inertial, j)] = R[:, inertial:-1]
        padded[:, -1] = R[:, -1]
        triangles.append(padded)
    return JointEquations(triangles, counts)


def own_columns(inertial: int, joint: int) -> slice:
    """Return the columns of a joint's losses, behind those of the bodies."""
    begin = inertial + COLUMNS * joint
    return slice(begin, begin + COLUMNS)


def _solved(system: JointEquations, fit: LawFit, prior: Prior) -> LawFit:
    """Return the minimum of the equations, joints weighted by the residuals of a fit."""
    if np.isfinite(prior.weight):
        inertial, losses = _with_bodies(system, fit, prior)
    else:
        inertial, losses = fit.inertial, _losses_of_given_bodies(system, fit.inertial)
    return _with_values(system, fit, inertial, losses)


def _sliding(system: JointEquations, fit: LawFit) -> LawFit:
    """Return the minimum of the equations for bodies, offsets and Coulomb friction of a fit."""
    offsets = fit.losses[:, OFFSET]
    losses = _losses_of_given_bodies(system, fit.inertial, offsets)
    losses = np.where(_are_plain(fit.laws)[:, None], fit.losses, losses)
    return _with_values(system, fit, fit.inertial, losses)


def _with_values(system: JointEquations, fit: LawFit, inertial: Array, losses: Array
                 ) -> LawFit:
    """Return a fit with other values, and the deviations of their residuals."""
    x = np.concatenate([inertial, losses.ravel()])
    squares = np.array([np.sum((R[:, -1] - R[:, :-1] @ x)**2) for R in system.triangles])
    sigma = np.sqrt(np.maximum(squares / system.counts, 1e-24))
    return LawFit(fit.laws, inertial, losses, fit.shapes, sigma)


def _with_bodies(system: JointEquations, fit: LawFit, prior: Prior) -> tuple[Array, Array]:
    """Return inertial parameters and losses, (10 bodies,) and (n, 6), fitted together."""
    weighted = [R / deviation
                for R, deviation in zip(system.triangles, fit.sigma, strict=True)]
    A = triangle(np.vstack(weighted))
    size = len(fit.inertial)

    # Losses that no law has are columns of zeros, and left out.
    is_used: Flags = np.asarray(A[:, :-1].any(axis=0))
    is_used[:size] = True
    lowest = np.tile(LOWEST_OF_ALL, len(fit.laws))[is_used[size:]]
    bodies = [body.inertial for body in prior.model.bodies]
    x = np.zeros(len(is_used))
    x[is_used] = physical(A[:, :-1][:, is_used], A[:, -1], bodies, lowest, prior.weight)
    return x[:size], x[size:].reshape(-1, COLUMNS)


def _losses_of_given_bodies(system: JointEquations, inertial: Array,
                            offsets: Array | None = None) -> Array:
    """
    Return the losses of all joints, (n, 6), each fitted to what the bodies leave.

    Offsets, (n,), N m or N, are fitted too if they are not given.
    """
    size = len(inertial)
    losses = []
    for j, R in enumerate(system.triangles):
        remaining_torque = R[:, -1] - R[:, :size] @ inertial
        columns = R[:, own_columns(size, j)].copy()
        if offsets is not None:
            remaining_torque -= columns[:, OFFSET] * offsets[j]
            columns[:, OFFSET] = 0.0
        losses.append(_bounded(np.column_stack([columns, remaining_torque])))
    if offsets is not None:
        for of_joint, offset in zip(losses, offsets, strict=True):
            of_joint[OFFSET] = offset
    return np.array(losses)


def law_error(rows: LawRows, fit: LawFit) -> Array:
    """Return measured torque minus that of a fit, (N, n), N m or N."""
    load = rows.load(fit.inertial, fit.losses[:, 2])
    error = rows.torque - rows.data.Y @ fit.inertial
    for j, law in enumerate(fit.laws):
        columns = rows.columns(j, law, float(fit.shapes[j]), load[:, j])
        error[:, j] -= columns @ fit.losses[j]
    return error


# Errors on rows that were left out, and the choice.

class Blocks:
    """
    Blocks of rows, each predicted by fits of the others, with the laws of one fit.

    Loads, friction speeds and travels are those of that fit, to all blocks.
    """

    def __init__(self, rows: LawRows, flags: Sequence[Flags], fit: LawFit) -> None:
        self._fit = fit
        self._floor = np.maximum(FLOOR * rms(rows.torque), LEAST)
        load = rows.load(fit.inertial, fit.losses[:, 2])
        self._parts = [rows.part(block) for block in flags]
        systems = []
        for part, block in zip(self._parts, flags, strict=True):
            systems.append(law_equations(part, fit.laws, fit.shapes, load[block]))
        # The equations of all blocks but one.
        self._others = [_without(systems, k) for k in range(len(systems))]

    def errors(self, prior: Prior) -> tuple[Array, Array]:
        """
        Return each joint's error on each block, (blocks, n), of all and of moving rows.

        The prior counts as much for a fit to all blocks but one as for a fit to all.
        """
        predicted = [_solved(others, self._fit, self._for_the_others(prior))
                     for others in self._others]
        return self._errors_of(predicted)

    def sliding_errors(self, plain: 'Blocks', prior: Prior) -> tuple[Array, Array]:
        """
        Return `errors` with bodies and offsets of Coulomb friction.

        `plain` has the same blocks with Coulomb friction; its fits find bodies and offsets.
        """
        predicted = []
        for others, of_plain in zip(self._others, plain._others, strict=True):
            start = _solved(of_plain, plain._fit, self._for_the_others(prior))
            of_laws = replace(start, laws=self._fit.laws, shapes=self._fit.shapes)
            predicted.append(_sliding(others, of_laws))
        return self._errors_of(predicted)

    def _errors_of(self, predicted: Sequence[LawFit]) -> tuple[Array, Array]:
        """Return `errors` of the fit that predicts each block."""
        every, moving = [], []
        for part, fit in zip(self._parts, predicted, strict=True):
            error = law_error(part, fit)
            every.append(np.maximum(rms(error), self._floor))
            moving.append(np.maximum(moving_rms(error, part.data.moving), self._floor))
        return np.array(every), np.array(moving)

    def _for_the_others(self, prior: Prior) -> Prior:
        """Return the prior for all blocks but one."""
        share = 1.0 - 1.0 / len(self._parts)
        return Prior(prior.model, share * prior.weight)


def _without(systems: Sequence[JointEquations], left_out: int) -> JointEquations:
    """Return the equations of all systems but one."""
    others = [*systems[:left_out], *systems[left_out + 1:]]
    counts = np.sum([system.counts for system in others], axis=0)
    triangles = []
    for joint in range(len(counts)):
        of_joint = np.vstack([system.triangles[joint] for system in others])
        triangles.append(triangle(of_joint))
    return JointEquations(triangles, counts)


def largest_supported(errors: Sequence[Array], values: Sequence[float] | Array) -> float:
    """
    Return the largest value whose errors on left-out blocks are the smallest within noise.

    The noise is the standard error of the difference to the best value, over the blocks.

    Parameters
    ----------
    errors : sequence of (blocks, n) arrays
        Of each value; all joints count alike.
    values : sequence of float
        Increasing.

    """
    levels = np.array([np.log(of_value).mean(axis=1) for of_value in errors])
    best = int(np.argmin(levels.mean(axis=1)))
    differences = levels - levels[best]
    deviation = differences.std(axis=1, ddof=1) / np.sqrt(levels.shape[1])
    supported = differences.mean(axis=1) <= deviation
    return float(np.asarray(values)[supported][-1])


def clearly_smaller(errors: Array, others: Array) -> bool:
    """
    Return whether errors on left-out blocks, (blocks, n), are clearly smaller than others.

    That is by more than 10 %, and by more than twice the standard error over the blocks.
    """
    gain = np.log(others / errors).mean(axis=1)
    doubt = float(gain.std(ddof=1)) / np.sqrt(len(gain))
    return bool(gain.mean() > max(CLEARLY, SIGNIFICANT * doubt))


def moving_rms(error: Array, moving: Flags) -> Array:
    """Return the RMS of each joint's error over the rows in which it moves, (n,)."""
    counts = moving.sum(axis=0)
    squares = np.sum(np.where(moving, error, 0.0)**2, axis=0)
    return np.where(counts > 0, np.sqrt(squares / np.maximum(counts, 1)), np.nan)


def chosen_laws(errors: Sequence[Array], loaded: Flags) -> tuple[FrictionLaw, ...]:
    """
    Return the law of each joint from the errors of all laws on left-out blocks.

    Drives of one arm are of one kind: the law is first that of the arm, Coulomb friction
    unless another law gains more than noise alone makes the best of all gain in nine of ten
    recordings. Else it is the simplest whose error over all joints is the smallest within
    its standard error. A joint has Coulomb friction in place of a law of the load if
    gravity does not load it, and another law if its own gain is larger than noise makes
    that of any joint and law in nine of ten recordings. The blocks are few, so that the
    quantile is that of Student's distribution.

    Parameters
    ----------
    errors : sequence of (blocks, n) arrays
        Of each of `LAWS`.
    loaded : (n,) array of bool
        Whether gravity acts on a joint.

    """
    logarithms = [np.log(of_law) for of_law in errors]
    n = errors[0].shape[1]
    arm_law = law_of_arm(errors)
    # Bonferroni's correction for all joints and other laws.
    comparisons = n * (len(LAWS) - 1)
    student = scientific('scipy.stats').t
    freedom = errors[0].shape[0] - 1
    significant = float(student.ppf(1.0 - CHANCE_OF_JOINT / comparisons, freedom))
    chosen = []
    for j in range(n):
        law = arm_law
        # Friction of a load that only accelerations cause looks like inertia.
        if law.load and not loaded[j]:
            law = COULOMB
        present = LAWS.index(law)
        candidates = [k for k, other in enumerate(LAWS) if loaded[j] or not other.load]
        for k in candidates:
            gain, doubt = _of_alike_drives(logarithms[k] - logarithms[present])
            if gain[j] < -max(significant * float(doubt[j]), NEGLIGIBLE):
                present = k
        chosen.append(LAWS[present])
    return tuple(chosen)


def law_of_arm(errors: Sequence[Array]) -> FrictionLaw:
    """Return the law of all joints together, from the errors of `chosen_laws`."""
    levels = np.array([np.log(of_law).mean(axis=1) for of_law in errors])
    return LAWS[_simplest(levels)]


def costs_others(laws: Sequence[FrictionLaw], errors: Array, plain: Array) -> bool:
    """
    Return whether friction of the load of some joints costs another one more than 5 %.

    `errors` on left-out blocks, (blocks, n), are those of these laws, `plain` those of
    Coulomb friction.
    """
    loss = np.log(errors / plain).mean(axis=0)
    without_load = np.array([not law.load for law in laws])
    return bool((loss[without_load] > HARM).any())


def _without_square(law: FrictionLaw) -> FrictionLaw:
    """Return a law without its quadratic term."""
    name = 'load' if law.load else COULOMB.name
    return LAWS[LAW_NAMES.index(name)]


def without_harm(laws: Sequence[FrictionLaw], errors: Sequence[Array]
                 ) -> tuple[FrictionLaw, ...]:
    """
    Return the laws, with Coulomb friction of joints at which theirs does not help.

    A law of the load is left out of a joint where the error on left-out blocks is larger by
    more than 5 %, and by more than two standard errors; it changes bodies, and so all
    joints. Another law is left out where it does not gain with a probability of 95 %. The
    mean of all joints is the prior of both. Squares of the rate are left out where they
    gain less than 1 %, since they predict higher speeds wrongly there. The errors are those
    of `chosen_laws`.
    """
    plain = errors[LAWS.index(COULOMB)]
    helpful = []
    for j, law in enumerate(laws):
        if law.quadratic:
            linear = _without_square(law)
            with_square = rms(errors[LAWS.index(law)][:, j])
            without_square = rms(errors[LAWS.index(linear)][:, j])
            if with_square > (1.0 - NEGLIGIBLE) * without_square:
                law = linear
        loss, doubt = _of_alike_drives(np.log(errors[LAWS.index(law)] / plain))
        largest_loss = -PROBABLY * float(doubt[j])
        if law.load:
            largest_loss = max(HARM, SIGNIFICANT * float(doubt[j]))
        helpful.append(COULOMB if loss[j] > largest_loss else law)
    return tuple(helpful)


def _simplest(levels: Array) -> int:
    """
    Return the first row whose mean is the smallest within noise, of (laws, blocks).

    It is the first of all unless others are better by more than noise alone makes the best
    of them. The noise is the standard error of the difference to the best row, over the
    blocks. Rows that are no better than the first one are left out, however large their
    noise.
    """
    if _chance_of(levels[0] - levels[1:]) > CHANCE_OF_ARM:
        return 0
    best = int(np.argmin(levels.mean(axis=1)))
    differences = levels - levels[best]
    deviation = differences.std(axis=1, ddof=1) / np.sqrt(levels.shape[1])
    noise = np.maximum(deviation, NEGLIGIBLE)
    gains_enough = levels.mean(axis=1) < levels[0].mean() - NEGLIGIBLE
    gains_enough[0] = True
    return int(np.argmax(gains_enough & (differences.mean(axis=1) <= noise)))


def _chance_of(gains: Array) -> float:
    """
    Return how probable it is that the best of laws gains as much by noise, 0 to 1.

    The gains are (laws, blocks). Noise has either sign, so that the gains of a block are
    as probable with the other sign, of all laws at once because they are correlated.
    """
    blocks = gains.shape[1]
    observed = _standardized(gains)
    # Laws that lose clearly cannot be the best by noise, but would be with other signs.
    comparable = observed > -math.sqrt(2.0 * math.log(math.log(blocks)))
    if not comparable.any():
        return 1.0
    signs = np.array(list(product((1.0, -1.0), repeat=blocks)))
    by_noise = _standardized(signs[:, None] * gains[comparable]).max(axis=1)
    as_good = by_noise >= (1.0 - EQUAL) * observed.max()
    return float(as_good.mean())


def _standardized(gains: Array) -> Array:
    """Return the mean over blocks, the last axis, divided by its standard error."""
    deviation = gains.std(axis=-1, ddof=1) / np.sqrt(gains.shape[-1])
    return np.asarray(gains.mean(axis=-1) / np.maximum(deviation, LEAST))


def _of_alike_drives(ratios: Array) -> tuple[Array, Array]:
    """
    Return the mean of each joint's logarithm of a ratio, and its standard error, (n,) each.

    Both are those of the posterior with the mean of all joints as the prior, whose
    variance is that of the joints' means beyond their errors. The ratios, (blocks, n), are
    of errors.
    """
    blocks, n = ratios.shape
    # Shrinkage: a joint's own mean counts as much as its error allows, the rest is the
    # mean of all joints.
    own = ratios.mean(axis=0)
    variance = np.maximum(ratios.var(axis=0, ddof=1) / blocks, 1e-8)
    common = float(own.mean())
    of_common = float(ratios.mean(axis=1).var(ddof=1)) / blocks
    between = 0.0
    if n > 1:
        between = max(float(own.var(ddof=1)) - float(variance.mean()), 1e-8)
    weight = between / (between + variance)  # of the joint's own mean
    mean = weight * own + (1.0 - weight) * common
    return mean, np.sqrt(weight * variance + (1.0 - weight)**2 * of_common)
