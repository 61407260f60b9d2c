"""
Laws of friction for identification, and the choice of one for an arm.

Every law has damping, Coulomb friction and an offset. Beyond these:

    curved              viscous friction that flattens, or grows, with the rate:
                        d u / (1 + |u| / u_d) + d_f u |u| / (u_d + |u|)
    load                mu |L| y: friction that grows with the load L on the drive, as
                        of gears
    presliding          Dahl friction z in place of y = tanh(u / u_s)
    load and curved     both

Both coefficients of the curved law are positive, so that it is passive, and the equations
are linear in them. Dahl friction has z' = (u - |u| z) / l, so that friction reverses over
the travel l (P. Dahl, "A solid friction model", 1968). The load L, of the bodies and the
rotor, is that of the fit before, which makes the equations linear.

Coupled motors, as of wrists: a motor that turns with the sum (or the difference) of two
joints has inertia, damping and Coulomb friction of its own, whose torque acts on both.

The law is that of the arm, since drives of one arm are of one kind, and the errors of
single joints on a few blocks say little. A law is judged on blocks of rows that its fit
has left out: it is the simplest one whose mean logarithm of errors is within one standard
error of the least (the one-standard-error rule of Breiman et al., "Classification and
Regression Trees", 1984). Motion that repeats is no test of a fit: rows of a periodic
motion are divided by their phase instead.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.identification.physical_consistency import physical
from kane_dynamics.identification.presliding import (dahl_friction, first_rows,
                                                     friction_in_motion)
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.identification.regression import (bounded, least_between, LOWEST,
                                                     RegressionRows, rms, SPEEDS,
                                                     triangle)
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.mechanics.recursive.regressor import inertial_parameters
from kane_dynamics.model.model import Model
import numpy as np

LENGTHS = np.geomspace(3e-4, 0.03, 15)  # candidates of the travel l, rad or m
BENDS = np.geomspace(0.05, 5.0, 9)  # candidates of u_d, relative to the highest rate
NEAR = np.geomspace(0.5, 2.0, 7)  # candidates of a friction speed, relative to the last
SETTLED = 1e-3  # relative change of a friction speed that is fitted
STAYS = 0.02  # relative change of shapes that have settled
COLUMNS = 6  # damping, friction, armature, offset, damping at high rates, load friction
OF_COUPLING = 3  # damping, friction, inertia of a coupled motor
COUPLED_SPEED = 0.05  # friction speed of coupled motors, rad/s
BLOCKS = 6  # of rows that are left out in turn
TURNS = 6  # alternating fits of bodies and of what enters nonlinearly, at most
REWEIGHTED = 2  # fits with weights of the joints by their residuals
FLOOR = 1e-3  # of the RMS of the torque: smaller errors are no difference
LEAST = 1e-300  # N m or N, of errors whose logarithms are compared
ALIKE = 0.02  # RMS distance of a repeated motion, relative to the range of each joint
LEAST_PERIODS = 1.8  # of a periodic recording
USUAL_WEIGHT = 10.0  # of the prior


class FrictionLaw(NamedTuple):
    """A law: its name, and which terms it has beyond those of all laws."""

    name: str
    curved: bool = False
    load: bool = False
    presliding: bool = False


# The simplest first.
LAWS = (FrictionLaw('coulomb'), FrictionLaw('curved', curved=True),
        FrictionLaw('load', load=True), FrictionLaw('presliding', presliding=True),
        FrictionLaw('load and curved', curved=True, load=True))
LAW_NAMES = tuple(law.name for law in LAWS)
COULOMB = LAWS[0]


class Coupled(NamedTuple):
    """A motor that turns with joint `first` plus `sign` times joint `second`."""

    first: int
    second: int
    sign: float


class CoupledMotor(NamedTuple):
    """
    An identified motor that turns with two joints.

    Attributes
    ----------
    joints : (str, str)
        It turns with the first joint plus `sign` times the second one.
    sign : float
        1 or -1.
    damping, friction, inertia : float
        N m s/rad, N m, kg m^2.

    """

    joints: tuple[str, str]
    sign: float
    damping: float
    friction: float
    inertia: float

    @property
    def name(self) -> str:
        """Return the name of its joint in a written model."""
        return f'{self.joints[0]}_{self.joints[1]}_motor'


@dataclass(frozen=True, eq=False)
class LawFit:
    """
    Values of all unknowns with one law for all joints.

    Attributes
    ----------
    law : FrictionLaw
    inertial : (10 bodies,) array
    losses : (n, 6) array
        Damping, friction, armature, offset, damping at high rates and load friction.
    couplings : (k, 3) array
        Damping, friction and inertia of coupled motors.
    shapes : (n, 2) array
        Friction speed, rad/s or m/s, or the travel l, rad or m, of presliding friction; and
        the rate u_d of curved damping, rad/s or m/s.
    sigma : (n,) array
        Standard deviation of each joint's residual, N m or N.

    """

    law: FrictionLaw
    inertial: Array
    losses: Array
    couplings: Array
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
    coupled : tuple of Coupled

    """

    data: RegressionRows
    dahl: Array
    coupled: tuple[Coupled, ...] = ()

    def part(self, chosen: slice | Flags) -> 'LawRows':
        """Return some of the rows; Dahl friction remembers the rows before."""
        return LawRows(self.data.part(chosen), self.dahl[chosen], self.coupled)

    @property
    def torque(self) -> Array:
        """Return the torque that bodies, friction and armature explain, (N, n)."""
        return np.asarray(self.data.recording.tau - self.data.rest)

    def load(self, fit: LawFit) -> Array:
        """Return the loads on the drives of a fit, (N, n), N m or N."""
        of_bodies = self.data.Y @ fit.inertial
        of_rotors = fit.losses[:, 2] * self.data.recording.udot
        return np.asarray(of_bodies + self.data.rest + of_rotors)

    def used(self, joint: int, law: FrictionLaw) -> Flags:
        """Return the rows that determine a joint's parameters, (N,)."""
        # At standstill friction is undetermined, but for that which remembers the motion.
        moving = np.asarray(self.data.moving[:, joint])
        if law.presliding:
            return np.full(len(moving), moving.any())
        return moving

    def columns(self, joint: int, law: FrictionLaw, shape: Array, load: Array) -> Array:
        """Return the torques of a joint's losses of 1, (N, 6); zeros of unused ones."""
        u = self.data.recording.u[:, joint]
        zeros = np.zeros(len(u))
        # The direction of sliding: smoothed, or by the deflection of bristles.
        if law.presliding:
            nearest = int(np.argmin(np.abs(np.log(LENGTHS / shape[0]))))
            slip = self.dahl[:, nearest, joint]
        else:
            slip = coulomb(u, float(shape[0]))
        slow, fast = u, zeros
        if law.curved:
            slow = u / (1.0 + np.abs(u) / shape[1])
            fast = u - slow
        by_load = np.abs(load) * slip if law.load else zeros
        return np.column_stack([slow, slip, self.data.recording.udot[:, joint],
                                np.ones(len(u)), fast, by_load])

    def coupling_columns(self, joint: int) -> Array:
        """Return the torques of coupled motors on a joint, (N, 3 k), of coefficients 1."""
        recording = self.data.recording
        columns = np.zeros((len(recording), OF_COUPLING * len(self.coupled)))
        for k, (first, second, sign) in enumerate(self.coupled):
            if joint in (first, second):
                rate = recording.u[:, first] + sign * recording.u[:, second]
                udot = recording.udot[:, first] + sign * recording.udot[:, second]
                share = 1.0 if joint == first else sign
                torque = np.column_stack([rate, coulomb(rate, COUPLED_SPEED), udot])
                columns[:, OF_COUPLING * k:OF_COUPLING * (k + 1)] = share * torque
        return columns


def law_rows(data: RegressionRows, coupled: Sequence[Coupled] = ()) -> LawRows:
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
    return LawRows(data, dahl, tuple(coupled))


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
    return [np.asarray(number == k) for k in np.unique(number)]


# Fits.

class Prior(NamedTuple):
    """
    A model that a fit starts from, the weight of the distance from it, and bounds.

    An infinite weight keeps the bodies of the model. `lowest`, (4,), bounds damping,
    friction, armature and offset.
    """

    model: Model
    weight: float
    lowest: Array = LOWEST


class JointEquations(NamedTuple):
    """Equations R of each joint, [bodies | losses | couplings | torque], and their rows."""

    triangles: list[Array]
    counts: Array


def fit_law(rows: LawRows, law: FrictionLaw, prior: Prior, start: LawFit | None = None
            ) -> LawFit:
    """Return the fit of bodies and friction with a law, from another fit."""
    # Loads, shapes of the laws, and linear coefficients in turn, until they agree.
    fit = first_fit(rows, prior) if start is None else start
    for _ in range(TURNS):
        load = rows.load(fit)
        shapes = _best_shapes(rows, law, fit, load, prior.lowest)
        system = law_equations(rows, law, shapes, load)
        change = np.abs(np.log(shapes / fit.shapes)).max()
        settled = law is fit.law and change < STAYS
        fit = replace(fit, law=law, shapes=shapes)
        # Rows far from the fit lose weight.
        for _ in range(REWEIGHTED):
            fit = _solved(system, fit, prior)
        if settled:
            break
    return fit


def first_fit(rows: LawRows, prior: Prior) -> LawFit:
    """Return the bodies of the model, and Coulomb friction fitted to what they leave."""
    n = rows.torque.shape[1]
    couplings = np.zeros((len(rows.coupled), OF_COUPLING))
    highest = np.maximum(np.abs(rows.data.recording.u).max(axis=0), LEAST)
    shapes = np.column_stack([np.full(n, SPEEDS[-1]), highest])
    fit = LawFit(LAWS[-1], inertial_parameters(prior.model).ravel(), np.zeros((n, COLUMNS)),
                 couplings, shapes, np.maximum(rms(rows.torque), LEAST))
    load = rows.load(fit)
    shapes = _best_shapes(rows, COULOMB, fit, load, prior.lowest)
    system = law_equations(rows, COULOMB, shapes, load)
    return _solved(system, replace(fit, law=COULOMB, shapes=shapes),
                   prior._replace(weight=np.inf))


def _best_shapes(rows: LawRows, law: FrictionLaw, fit: LawFit, load: Array, lowest: Array
                 ) -> Array:
    """Return the friction speeds or travels, and bends, that fit best, (n, 2)."""
    # The torque that the bodies and coupled motors leave for friction, joint by joint.
    missing = rows.torque - rows.data.Y @ fit.inertial
    shapes = fit.shapes.copy()
    bounds = _lowest_of_joint(lowest)
    for j in range(len(shapes)):
        left = missing[:, j] - rows.coupling_columns(j) @ fit.couplings.ravel()
        used = rows.used(j, law)
        if not used.any():  # without efforts
            continue
        missed = partial(_missed, rows, j, law, load[:, j], used, left[used], bounds)
        if law.presliding:
            # The error has many minima over the travel: the candidates are few.
            errors = [missed(np.array([length, shapes[j, 1]])) for length in LENGTHS]
            shapes[j, 0] = LENGTHS[int(np.argmin(errors))]
            continue
        candidates = SPEEDS
        if fit.law is law:  # near that of the fit before
            candidates = np.unique(np.clip(shapes[j, 0] * NEAR, SPEEDS[0], SPEEDS[-1]))
        slip, bend = (float(shape) for shape in shapes[j])
        if law.curved:
            highest = max(float(np.abs(rows.data.recording.u[:, j]).max()), LEAST)
            bend = least_between(partial(_missed_by_bend, missed, slip), highest * BENDS,
                                 SETTLED)
        slip = least_between(partial(_missed_by_slip, missed, bend), candidates, SETTLED)
        shapes[j] = slip, bend
    return shapes


def _missed_by_slip(missed: Callable[[Array], float], bend: float, slip: float) -> float:
    return missed(np.array([slip, bend]))


def _missed_by_bend(missed: Callable[[Array], float], slip: float, bend: float) -> float:
    return missed(np.array([slip, bend]))


def friction_shapes(rows: LawRows, fit: LawFit, lowest: Array) -> Array:
    """Return the friction speeds; of presliding friction, those that resemble it most."""
    if not fit.law.presliding:
        return fit.shapes[:, 0]
    return _best_shapes(rows, COULOMB, fit, rows.load(fit), lowest)[:, 0]


def _missed(rows: LawRows, joint: int, law: FrictionLaw, load: Array, used: Flags,
            missing: Array, bounds: Array, shape: Array) -> float:
    """Return the sum of squares that the losses of a joint leave of the torque `missing`."""
    columns = rows.columns(joint, law, shape, load)[used]
    R = triangle(np.column_stack([columns, missing]))
    losses = bounded(R[:, :-1], R[:, -1], bounds)
    return float(np.sum((R[:, -1] - R[:, :-1] @ losses)**2))


def _lowest_of_joint(lowest: Array) -> Array:
    """Return the lower bounds of a joint's six losses."""
    return np.concatenate([lowest, [0.0, 0.0]])


def law_equations(rows: LawRows, law: FrictionLaw, shapes: Array, load: Array
                  ) -> JointEquations:
    """Return the equations of all joints in their used rows."""
    n = len(shapes)
    bodies = rows.data.Y.shape[2]
    couplings = OF_COUPLING * len(rows.coupled)
    torque = rows.torque
    triangles = []
    counts = np.zeros(n)
    for j in range(n):
        used = rows.used(j, law)
        counts[j] = max(int(used.sum()), 1)
        # R of the joint's own columns has as few rows as columns. The columns of the
        # other joints' losses are zero, and added to R afterwards.
        table = np.column_stack([rows.data.Y[:, j], rows.columns(j, law, shapes[j], load[:, j]),
                                 rows.coupling_columns(j), torque[:, j]])
        R = triangle(table[used])
        padded = np.zeros((len(R), bodies + COLUMNS * n + couplings + 1))
        own = bodies + COLUMNS * j
        padded[:, :bodies] = R[:, :bodies]
        padded[:, own:own + COLUMNS] = R[:, bodies:bodies + COLUMNS]
        padded[:, bodies + COLUMNS * n:] = R[:, bodies + COLUMNS:]
        triangles.append(padded)
    return JointEquations(triangles, counts)


def _solved(system: JointEquations, fit: LawFit, prior: Prior) -> LawFit:
    """Return the minimum of the equations, joints weighted by the residuals of a fit."""
    weighted = [R / deviation
                for R, deviation in zip(system.triangles, fit.sigma, strict=True)]
    A = triangle(np.vstack(weighted))
    size, n = len(fit.inertial), len(fit.losses)
    lowest = np.concatenate([np.tile(_lowest_of_joint(prior.lowest), n),
                             np.zeros(fit.couplings.size)])
    # Losses that no law has are columns of zeros, and left out.
    is_used: Flags = np.asarray(A[:, :-1].any(axis=0))
    is_used[:size] = True
    columns, bounds = A[:, :-1][:, is_used], lowest[is_used[size:]]
    x = np.zeros(len(is_used))
    if np.isfinite(prior.weight):
        bodies = [body.inertial for body in prior.model.bodies]
        x[is_used] = physical(columns, A[:, -1], bodies, bounds, prior.weight)
    else:
        x[:size] = fit.inertial
        left = A[:, -1] - A[:, :size] @ fit.inertial
        x[size:][is_used[size:]] = bounded(columns[:, size:], left, bounds)
    squares = np.array([np.sum((R[:, -1] - R[:, :-1] @ x)**2) for R in system.triangles])
    sigma = np.sqrt(np.maximum(squares / system.counts, 1e-24))
    losses, couplings = np.split(x[size:], [COLUMNS * n])
    return replace(fit, inertial=x[:size], losses=losses.reshape(n, COLUMNS),
                   couplings=couplings.reshape(-1, OF_COUPLING), sigma=sigma)


def law_error(rows: LawRows, fit: LawFit) -> Array:
    """Return measured torque minus that of a fit, (N, n), N m or N."""
    load = rows.load(fit)
    error = rows.torque - rows.data.Y @ fit.inertial
    for j, losses in enumerate(fit.losses):
        columns = rows.columns(j, fit.law, fit.shapes[j], load[:, j])
        error[:, j] -= columns @ losses
        error[:, j] -= rows.coupling_columns(j) @ fit.couplings.ravel()
    return error


# Errors on rows that were left out, and the choice.

class Blocks:
    """
    Blocks of rows, each predicted by fits of the others, with the law of one fit.

    Loads, friction speeds and travels are those of that fit, to all blocks.
    """

    def __init__(self, rows: LawRows, flags: Sequence[Flags], fit: LawFit) -> None:
        self._fit = fit
        self._floor = np.maximum(FLOOR * rms(rows.torque), LEAST)
        self._judged = rows.data.moving.any(axis=0)
        load = rows.load(fit)
        self._parts = [rows.part(block) for block in flags]
        systems = []
        for part, block in zip(self._parts, flags, strict=True):
            systems.append(law_equations(part, fit.law, fit.shapes, load[block]))
        # The equations of all blocks but one.
        self._others = [_without(systems, k) for k in range(len(systems))]

    def errors(self, prior: Prior) -> tuple[Array, Array]:
        """
        Return each joint's error on each block, (blocks, n), of all and of moving rows.

        The prior counts as much for a fit to all blocks but one as for a fit to all.
        """
        share = 1.0 - 1.0 / len(self._parts)
        scaled = prior._replace(weight=share * prior.weight)
        every, moving = [], []
        for part, others in zip(self._parts, self._others, strict=True):
            error = law_error(part, _solved(others, self._fit, scaled))
            every.append(np.where(self._judged, np.maximum(rms(error), self._floor), 1.0))
            moving.append(np.maximum(moving_rms(error, part.data.moving), self._floor))
        return np.array(every), np.array(moving)


def _without(systems: Sequence[JointEquations], left_out: int) -> JointEquations:
    """Return the equations of all systems but one."""
    others = [*systems[:left_out], *systems[left_out + 1:]]
    counts = np.sum([system.counts for system in others], axis=0)
    triangles = []
    for joint in range(len(counts)):
        of_joint = np.vstack([system.triangles[joint] for system in others])
        triangles.append(triangle(of_joint))
    return JointEquations(triangles, counts)


def moving_rms(error: Array, moving: Flags) -> Array:
    """Return the RMS of each joint's error over the rows in which it moves, (n,)."""
    counts = moving.sum(axis=0)
    squares = np.sum(np.where(moving, error, 0.0)**2, axis=0)
    return np.where(counts > 0, np.sqrt(squares / np.maximum(counts, 1)), np.nan)


def first_within_noise(errors: Sequence[Array]) -> int:
    """
    Return the first of several errors whose mean is the least within its noise.

    Errors on left-out blocks, (blocks, n) each, are compared by the mean of their
    logarithms; all joints count alike. The noise is the standard error, over the blocks, of
    the difference to the least one.
    """
    levels = np.array([np.log(of_one).mean(axis=1) for of_one in errors])
    best = int(np.argmin(levels.mean(axis=1)))
    differences = levels - levels[best]
    noise = differences.std(axis=1, ddof=1) / np.sqrt(levels.shape[1])
    return int(np.argmax(differences.mean(axis=1) <= noise))


def chosen_weight(errors: Sequence[Array], weights: Sequence[float]) -> float:
    """
    Return the weight of the prior with the least mean error on left-out blocks.

    Errors are compared as in `first_within_noise`. A larger weight within the noise would
    be simpler, but its error is larger on other motion, too: that of a wrong prior.
    """
    means = [float(np.log(of_weight).mean()) for of_weight in errors]
    return float(weights[int(np.argmin(means))])
