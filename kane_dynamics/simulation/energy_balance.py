"""
The energy balance of a simulation, checked during the simulation.

The change of energy equals the work of torques and moving constraints minus the
dissipation of friction and damping. The error of this balance shows a wrong integration
that does not diverge: a step that is too long, nearly singular independent speeds, a
violated constraint.

Energy and dissipation of all states of a chunk are one call of a SIMD kernel, which is
fast enough for a check of every step. A constraint or a speed that prescribes a motion
does work: with q' = T u + X, the joint forces f have the power f . q' = tau . u + f . X.
"""

from collections.abc import Sequence
import math
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.motion_samples import motion_at, motion_kernel, speeds_in
from kane_dynamics.simulation.observers import Chunk, Impact, Observer, Power
from kane_dynamics.simulation.presliding import bristle_energies
from kane_dynamics.simulation.step_kernels import state_layout, times_of
from kane_dynamics.simulation.step_size import bristle_frequency
import numpy as np

RELATIVE = 1e-3  # of the energy exchanged so far
ROUNDING = 1e-9  # of the energy itself
MANY_ROWS, FEW_ROWS = 32, 4  # rows of the first check of a chunk: one simulation, many
SKIP = 8  # steps between the rows of the second check
TERMS = 3  # results of the energy kernel: kinetic, potential, power of friction


class BalanceTerms(NamedTuple):
    """
    Terms of the energy balance at several states, (rows, N) arrays, J.

    Attributes
    ----------
    error : array
        Change of energy minus work.
    allowed : array
        Largest magnitude of the error that is no reason for a warning.
    unresolved : array
        Uncertainty of the work so far.
    worked : array
        Magnitude of all work so far.
    fastest : array
        Largest kinetic energy so far.
    low, high : array
        Least and largest potential energy so far.

    """

    error: Array
    allowed: Array
    unresolved: Array
    worked: Array
    fastest: Array
    low: Array
    high: Array


class EnergyBalance(Observer):
    """
    Compares the change of energy with the work, step by step.

    Parameters
    ----------
    robot : Robot
    step : float
        s.
    states : (N, size) array
        Initial states, entries as `step_kernels.state_names`.
    integrator : str
        One of `mechanics.integrators.INTEGRATORS`.
    start : float
        Time of the first state, s.
    single : bool
        Leave out the number of the simulation in the warning.
    cause : str, optional
        A known reason for errors, such as the warning of the step.
    friction : stepper.RowSteps, optional
        Rows with modes, such as set-valued friction in place of the smooth law.

    Attributes
    ----------
    began : (N,) array
        Time of the first error above the allowed one, for each simulation, s; infinite
        if none.
    error : (N,) array
        Current error of the balance, J: change of energy minus work.
    worst : (N,) array
        Its largest magnitude, J.
    expected : (N,) array
        The allowed error at the time `began`, J.

    """

    def __init__(self, robot: Robot, step: float, states: Array, integrator: str,
                 start: float = 0.0, *, single: bool = True,
                 cause: str | None = None,
                 friction: Any = None) -> None:
        """Compile the kernels."""
        self.robot, self._step, self._start = robot, step, start
        self._single, self._cause = single, cause
        exact = friction is not None and friction.sticking
        self._rows, self._exact = friction, exact
        self._bristle_frequency = 0.0  # rad/s, of the stiffest bristles
        if robot.equations.tree.bristles:
            self._bristle_frequency = bristle_frequency(robot, states[0, :robot.n_q],
                                                        start)
        self._kernel = energy_kernel(robot, exact)
        self._parameters = robot.parameters.block.copy()
        self._tree = robot.equations.in_joint_rates
        # What moving constraints do, and what loads add to friction, by held torques.
        self._added_powers: list[Any] = []
        if prescribes_motion(robot):
            self._added_powers.append(self._driven_power)
        if robot.equations.carries_loads:
            self._added_powers.append(self._load_power)
        # An implicit step damps high frequencies by design.
        vibrates = bool(robot.equations.tree.bristles)
        for body in robot.model.bodies:
            if body.beam is not None or body.joint.stiffness or body.joint.drive:
                vibrates = True
        self._damped = integrator_of(integrator).damps and vibrates
        N = len(states)
        self.began = np.full(N, np.inf)
        self.error, self.worst, self.expected, self._unresolved, self._worked = np.zeros((5, N))
        # The balance starts with the energies of the initial states.
        self._fastest, self._low, _ = self._terms(states[:, None])[:, 0]
        self._high = self._low

    def look(self, chunk: Chunk) -> None:
        """Update the balance with the steps of a chunk."""
        exchange = chunk.energetics.exchange(chunk.states, chunk.done)
        self.update(chunk.states, chunk.done, *exchange)

    def update(self, states: Array, done: int, tau: Array | Power,
               impacts: Sequence[Impact] = ()) -> None:
        """
        Update the balance with further steps.

        A few rows of a chunk are checked first; all rows only if the error there is not
        clearly below the allowed one.

        Parameters
        ----------
        states : (N, K + 1, size) array
            After `done` steps, and after each of the K next ones; C-contiguous.
        done : int
            Number of earlier steps.
        tau : (1 or N, 1 or K, n) array, or callable
            Torques held during each of the K steps; or, for a continuous law, a function
            that returns its power at row numbers of `states`, (N, rows), W.
        impacts : sequence of Impact
            Of the K steps.

        """
        count = states.shape[1] - 1
        changing = not callable(tau) and tau.shape[1] > 1
        # Impacts, and moving constraints under changing torques, need every row. Else a
        # few rows are tried first, then more of them.
        skips = []
        if not impacts and not (changing and self._added_powers):
            rows = FEW_ROWS if len(states) > 1 else MANY_ROWS
            skips = sorted({-(-count // rows), min(SKIP, count)}, reverse=True)
        with np.errstate(over='ignore', invalid='ignore'):
            for skip in skips:
                tried = np.append(np.arange(0, count, skip), count)
                terms = self._balance(states, tried, tau)
                if (np.abs(terms.error) <= 0.5 * terms.allowed).all():
                    break
            else:
                terms = self._balance(states, np.arange(count + 1), tau, unresolved=True)
                if impacts:
                    terms = _with_impacts(terms, impacts)
                # The first row of each simulation that fails for the first time.
                too_large = ~(np.abs(terms.error) <= terms.allowed)
                new = np.flatnonzero(np.isinf(self.began) & too_large.any(axis=0))
                first = np.argmax(too_large[:, new], axis=0)
                self.began[new] = self._start + (done + 1 + first) * self._step
                self.expected[new] = terms.allowed[first, new]

        # The last row is the balance with which the next chunk goes on.
        self.worst = np.maximum(self.worst, np.abs(terms.error).max(axis=0))
        last = BalanceTerms(*(term[-1] for term in terms))
        self.error, self._unresolved, self._worked = last.error, last.unresolved, last.worked
        self._fastest, self._low, self._high = last.fastest, last.low, last.high

    def _balance(self, states: Array, rows: Array, tau: Array | Power,
                 unresolved: bool = False) -> BalanceTerms:
        """Return the balance at all chosen rows of states except the first of them."""
        chosen = states if len(rows) == states.shape[1] else states[:, rows]
        # Energies and the power of dissipation at the chosen rows.
        kinetic, potential, loss = self._terms(chosen)
        h = (self._step * np.diff(rows))[:, None]
        # Powers of which only the values at the rows are known are integrated by the
        # trapezoidal rule; the work of held torques is exact in joint rates.
        power = input_power = -loss
        work = self._work(states, chosen, rows, tau)
        if callable(tau):
            input_power = power = power + tau(rows).T
        else:
            # Moving constraints do work on the robot, and friction takes what loads add
            # to it.
            for added_power in self._added_powers:
                begin, end = self._power_at_ends(added_power, chosen, tau)
                work = work + 0.5 * h * (begin + end)
                input_power = input_power + np.concatenate([begin[:1], end])
        # The trapezoidal rule for what is known as a power.
        passive = 0.5 * h * (power[1:] + power[:-1])
        energy = kinetic + potential
        gained = energy[1:] - energy[:1]
        error = self.error + gained - np.cumsum(work + passive, axis=0)
        worked = self._worked + np.cumsum(np.abs(work) + np.abs(passive), axis=0)
        uncertain = self._unresolved + np.zeros(error.shape)
        if unresolved:
            of_steps = self._uncertain(chosen, input_power, potential, tau)
            uncertain = uncertain + np.cumsum(of_steps, axis=0)
        # The error is compared with the energy that was exchanged so far.
        fastest = np.maximum(np.maximum.accumulate(kinetic[1:], axis=0), self._fastest)
        low = np.minimum(np.minimum.accumulate(potential[1:], axis=0), self._low)
        high = np.maximum(np.maximum.accumulate(potential[1:], axis=0), self._high)
        allowed = (RELATIVE * (fastest + (high - low) + worked) + uncertain
                   + ROUNDING * (fastest + np.maximum(np.abs(low), np.abs(high))))
        return BalanceTerms(error, allowed, uncertain, worked, fastest, low, high)

    def _work(self, states: Array, chosen: Array, rows: Array,
              tau: Array | Power) -> Any:
        """Return the work of held torques between rows, (rows - 1, N) or 0, J."""
        if callable(tau) or not tau.any():
            return 0.0
        constant = tau.shape[1] == 1
        # Of constant torques the rows suffice; others need every step.
        x = chosen if constant else states
        if self._tree:  # u = q', so the work is exact for every step
            moved = np.diff(x[:, :, :self.robot.n], axis=1)
        else:
            h = self._step * np.diff(rows)[:, None] if constant else self._step
            u = speeds_in(self.robot, x)
            moved = 0.5 * h * (u[:, 1:] + u[:, :-1])
        work = _dot(tau, moved)
        # One entry for each step: add those between two chosen rows.
        if len(work) == len(rows) - 1:
            return work
        return np.add.reduceat(work, rows[:-1].tolist(), axis=0)

    def _uncertain(self, states: Array, power: Array, potential: Array,
                   tau: Array | Power) -> Array:
        """Return the estimated quadrature error of the work of each step, (K, N), J."""
        # By the second difference of the power, as that of the trapezoidal rule.
        uncertain = self._step * _differences(power, 2)
        if self._damped:
            uncertain = uncertain + 2.0 * _differences(potential, 3)
        if self._bristle_frequency:
            # Bristles answer the jumps of a held torque by vibrations within the steps,
            # of which the rates at the ends of the steps are no mean.
            bent = bristle_energies(self.robot, states).T
            ripple = min(1.0, 0.5 * (self._bristle_frequency * self._step)**2)
            uncertain = uncertain + _differences(bent, 2) + ripple * _differences(bent, 1)
        if not (callable(tau) or self._tree):
            changes = _differences(speeds_in(self.robot, states).swapaxes(0, 1), 2)
            uncertain = uncertain + self._step * _dot(np.abs(tau),
                                                      changes.swapaxes(0, 1))
        return uncertain

    def _terms(self, states: Array) -> Array:
        """Return kinetic energy, potential energy and power of friction, (3, K, N)."""
        terms = np.empty((*states.shape[:2], TERMS))
        rows = np.ascontiguousarray(states)
        results = terms.reshape(-1, TERMS)
        self._kernel.run([rows.reshape(-1, rows.shape[2])], results, len(results),
                         constants=self._parameters)
        return np.ascontiguousarray(terms.T)

    def _driven_power(self, states: Array, tau: Array) -> Array:
        """
        Return the power of moving constraints, (K, N), at states, (K, size), by torques.

        The power of the motion's joint forces, less that of the motors.
        """
        robot = self.robot
        motion = motion_at(robot, states, tau, times_of(robot, states), self._rows)
        size = state_layout(robot).without_margin
        of_joints = joint_power_kernel(robot)(np.ascontiguousarray(states[:, :size]),
                                              motion.vdot, motion.friction)
        power: Array = of_joints - np.sum(tau * speeds_in(robot, states), axis=1)
        return power

    def _load_power(self, states: Array, tau: Array) -> Array:
        """Return the power of the friction that loads add, negative; as `_driven_power`."""
        size = state_layout(self.robot).without_margin
        kernel = load_friction_kernel(self.robot, self._exact)
        power: Array = -kernel(np.ascontiguousarray(states[:, :size]), tau)
        return power

    def _power_at_ends(self, power: Any, states: Array, tau: Array) -> Array:
        """Return a power under held torques at both ends of each interval, (2, K, N)."""
        # The torque of an interval is held: the power at its ends jumps where torques
        # do.
        shape = (len(states), states.shape[1] - 1)
        count, inputs = math.prod(shape), tau.shape[2]  # maybe no inputs at all
        torques = np.broadcast_to(tau, (*shape, inputs)).reshape(count, inputs)
        ends = [power(x.reshape(count, x.shape[2]), torques).reshape(shape)
                for x in (states[:, :-1], states[:, 1:])]
        return np.array(ends).swapaxes(1, 2)

    def warning(self) -> str | None:
        """Return the warning for energy balances with too large errors, or None."""
        failed = np.flatnonzero(np.isfinite(self.began))
        if not len(failed):
            return None

        # The simulation that failed first, and its remedy.
        k = int(failed[np.argmin(self.began[failed])])
        which = '' if self._single else f' of simulation {k}'
        count = ''
        if len(failed) > 1:
            count = f' ({len(failed)} of {len(self.began)} simulations)'
        # A cause that is known has a remedy of its own.
        remedy = self._cause
        if remedy is None:
            remedy = 'Shorten the step'
            if not self._tree:
                remedy += ', or choose other independent speeds (independent=)'
        return (f'energy balance{which}: from {self.began[k]:.6g} s on the energy '
                f'differs from the work done, by up to {self.worst[k]:.3g} J{count}; '
                f'expected at most {self.expected[k]:.3g} J at that time with a step of '
                f'{self._step:g} s. The motion is wrong from there on. {remedy}')


def _with_impacts(terms: BalanceTerms, impacts: Sequence[Impact]) -> BalanceTerms:
    """Return the terms with the energy of impacts, from the end of their steps on."""
    lost = np.zeros(terms.error.shape)
    uncertain = np.zeros(terms.error.shape)
    for impact in impacts:
        lost[impact.step, impact.simulation] += impact.energy
        uncertain[impact.step, impact.simulation] += impact.unresolved
    # The loss and the uncertainty of an impact stay in all later rows.
    uncertain = np.cumsum(uncertain, axis=0)
    return terms._replace(error=terms.error + np.cumsum(lost, axis=0),
                          allowed=terms.allowed + uncertain,
                          unresolved=terms.unresolved + uncertain)


def _dot(a: Array, b: Array) -> Array:
    """Return the scalar products of the last axes of (1 or N, 1 or K, n) arrays, (K, N)."""
    products: Array = np.einsum('nkj,nkj->kn', a, b)
    return products


def _differences(rows: Array, order: int) -> Array:
    """
    Return magnitudes of differences of an order for every interval along the first axis.

    Each interval has the largest of the differences that include it; with too few rows,
    the order is lower.
    """
    # Differences of order k belong to k intervals; zeros at the margins let each
    # interval look at all of its own.
    order = min(order, len(rows) - 1)
    padded = np.zeros((len(rows) + order - 2, *rows.shape[1:]))
    padded[order - 1:len(rows) - 1] = np.abs(np.diff(rows, order, axis=0))
    shifted = [padded[k:k + len(rows) - 1] for k in range(order)]
    largest: Array = np.max(shifted, axis=0)
    return largest


def compile_balance(robot: Robot, exact: bool = False) -> None:
    """Compile the kernels of `EnergyBalance`."""
    energy_kernel(robot, exact).compile_lanes()
    if prescribes_motion(robot):
        joint_power_kernel(robot).compile_lanes()
        motion_kernel(robot).compile_lanes()
    if robot.equations.carries_loads:
        load_friction_kernel(robot, exact).compile_lanes()


@kernel_per_robot
def energy_kernel(robot: Robot, exact: bool = False) -> Kernel:
    """
    Return the kernel of kinetic energy, potential energy and power of friction, (3,).

    With `exact`, friction is set-valued: of joints that slide in the direction of motion.
    The potential energy has that of bristles.
    """
    equations = robot.equations
    tree = equations.tree

    def terms(state: Vector, parameters: Vector) -> list[Scalar]:
        # Joints that slide in the direction of motion; `rates` are those of joints.
        q, rates, _, deflections = _parts(robot, state)
        directions = directions_of(rates) if exact else None
        friction = tree.friction_force(rates, None, directions, deflections)
        potential = tree.potential_energy(q, parameters)
        # Friction takes the power f . q'; what bends bristles is stored instead.
        loss = friction @ rates
        if deflections is not None:
            potential = potential + tree.bristle_energy(deflections)
            changes = tree.deflection_rates(rates, deflections)
            loss = loss - tree.bristle_power(deflections, changes)
        return [tree.kinetic_energy(q, rates, parameters), potential, loss]
    name = 'energy_terms_of_sticking' if exact else 'energy_terms'
    state = {'state': (state_layout(robot).without_margin,)}
    return robot.kernels.compiled(terms, name, state, (TERMS,), ahead=False)


def directions_of(rates: Vector) -> Vector:
    """Return the directions of motion of joints, -1 or 1."""
    return np.array([select(v < 0.0, -1.0, 1.0) for v in rates])


def load_friction_kernel(robot: Robot, exact: bool = False) -> Kernel:
    """Return the kernel of the power of load friction, W."""
    equations, n = robot.equations, robot.n
    tree = equations.tree

    def power(state: Vector, tau: Vector) -> Scalar:
        q, rates, time, deflections = _parts(robot, state)
        directions = directions_of(rates) if exact else None
        t = time[0] if len(time) else 0.0
        # The friction under the loads of these torques, less that without loads, which
        # the energy kernel has.
        friction = equations.driven_friction(q, rates, tau, t, directions, deflections)
        unloaded = tree.friction_force(rates, None, directions, deflections)
        loss = (friction - unloaded) @ rates
        if deflections is None:
            return loss
        # The bristles of a loaded drive yield less.
        loaded = equations.deflection_rates(q, rates, deflections, tau, t)
        change = loaded - tree.deflection_rates(rates, deflections)
        return loss - tree.bristle_power(deflections, change)
    name = 'load_friction_power_of_sticking' if exact else 'load_friction_power'
    inputs = {'state': (state_layout(robot).without_margin,), 'tau': (n,)}
    return robot.kernels.compiled(power, name, inputs, (), ahead=False)


@kernel_per_robot
def joint_power_kernel(robot: Robot) -> Kernel:
    """Return the kernel of the power of the forces of joints in a motion, W."""
    def power(state: Vector, vdot: Vector, friction: Vector,
              parameters: Vector) -> Scalar:
        q, v, _, _ = _parts(robot, state)
        # Joint forces of the motion without friction, and friction, times the joint
        # rates.
        rigid = robot.equations.tree.rigid_dynamics(q, v, vdot, None, parameters)
        return (rigid + friction) @ v
    n_j = (robot.model.n,)
    inputs = {'state': (state_layout(robot).without_margin,), 'vdot': n_j, 'friction': n_j}
    return robot.kernels.compiled(power, 'joint_power', inputs, (), ahead=False)


_DRIVEN: WeakKeyDictionary[Mechanism, bool] = WeakKeyDictionary()


def prescribes_motion(robot: Robot) -> bool:
    """Return whether speeds or constraints prescribe joint rates (q' nonzero at u = 0)."""
    if robot.equations.in_joint_rates:
        return False
    mechanism = robot.mechanism
    if mechanism not in _DRIVEN:
        # The right sides of S q' = s at u_I = 0: zero by structure unless rates are
        # prescribed.
        prescribed: list[bool] = []

        def right_side(state: Vector) -> Vector:
            q, _, time, _ = _parts(robot, state)
            right: Vector = mechanism.system(robot.equations.state(q, *time))[1]
            prescribed.extend(not is_zero(x) for x in right)
            return right
        size = state_layout(robot).without_margin
        trace_program('given_rates', right_side, [('state', (size,))])
        _DRIVEN[mechanism] = any(prescribed)
    return _DRIVEN[mechanism]


def _parts(robot: Robot, state: Vector) -> tuple[Vector, Vector, Vector, Vector | None]:
    """Return q, v, the time as (0 or 1,), and the deflections of bristles or None."""
    layout = state_layout(robot)
    deflections = state[layout.deflections]
    return (state[layout.q], state[layout.v], state[layout.time],
            deflections if len(deflections) else None)
