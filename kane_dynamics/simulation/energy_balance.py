"""
The energy balance of a simulation, checked during the simulation.

The change of energy equals the work of torques and moving constraints minus the dissipation of
friction and damping. The error of this balance shows a wrong integration that does not diverge: a
step that is too long, nearly singular independent speeds, a violated constraint.

Energy and dissipation of all states of a chunk are one call of a SIMD kernel, which is fast enough
for a check of every step.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_kernels import driven_kernel, energy_kernel, TERMS
import numpy as np

RELATIVE = 1e-3  # of the energy exchanged so far
ROUNDING = 1e-9  # of the energy itself
MANY_ROWS, FEW_ROWS = 32, 4  # rows of the first check of a chunk: one simulation, many
SKIP = 8  # steps between the rows of the second check

Law = Callable[[Array], Array]


class BalanceTerms(NamedTuple):
    """Terms of the energy balance at several states, (rows, N) arrays."""

    error: Array
    allowed: Array
    unresolved: Array
    worked: Array
    fastest: Array
    low: Array
    high: Array


class Impact(NamedTuple):
    """
    Energy that stops take at the end of one of several steps, or arrays of several different ones.

    The uncertainty is that of the work of the step, J.
    """

    step: Any
    simulation: int
    energy: Any
    unresolved: Any


class EnergyBalance:
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

    Attributes
    ----------
    began : (N,) array
        Time of the first error above the allowed one, for each simulation, s; infinite if none.
    error : (N,) array
        Current error of the balance, J: change of energy minus work.
    worst : (N,) array
        Its largest magnitude, J.
    expected : (N,) array
        The allowed error at the time `began`, J.

    """

    def __init__(self, robot: Robot, step: float, states: Array, integrator: str,
                 start: float = 0.0) -> None:
        """Compile the kernels."""
        self.robot, self._step, self._start = robot, step, start
        self._kernel = energy_kernel(robot)
        self._parameters = robot.parameters.block.copy()
        self._driven = driven_kernel(robot)
        # High frequencies die out by design.
        self._damped = integrator_of(integrator).damps and any(
            body.beam is not None or body.joint.stiffness for body in robot.model.bodies)
        self._tree = not isinstance(robot.equations, ConstrainedEquations)
        N = len(states)
        self.began = np.full(N, np.inf)
        self.error, self.worst, self.expected, self._unresolved, self._worked = np.zeros((5, N))
        self._fastest, self._low, _ = self._terms(states[:, None])[:, 0]
        self._high = self._low

    def look(self, states: Array, done: int, tau: Array | Law,
             impacts: Sequence[Impact] = ()) -> None:
        """
        Update the balance with further steps.

        A few rows of a chunk are checked first; all rows only if the error there is not clearly
        below the allowed one.

        Parameters
        ----------
        states : (N, K + 1, size) array
            After `done` steps, and after each of the K next ones; C-contiguous.
        done : int
            Number of earlier steps.
        tau : (1 or N, 1 or K, n) array, or callable
            Torques held during each of the K steps; or, for a continuous law, a function that
            returns its power at row numbers of `states`, (N, rows), W.
        impacts : sequence of Impact
            Of the K steps.

        """
        count = states.shape[1] - 1
        changing = not callable(tau) and tau.shape[1] > 1
        most = FEW_ROWS if len(states) > 1 else MANY_ROWS
        skips = sorted({-(-count // most), min(SKIP, count)}, reverse=True)
        with np.errstate(over='ignore', invalid='ignore'):
            for skip in () if impacts or (changing and self._driven) else skips:
                seen = self._balance(states, np.append(np.arange(0, count, skip), count), tau)
                if (np.abs(seen.error) <= 0.5 * seen.allowed).all():
                    self._keep(seen)
                    return
            seen = self._balance(states, np.arange(count + 1), tau, unresolved=True)
            if impacts:
                seen = _with_impacts(seen, impacts)
            missed = ~(np.abs(seen.error) <= seen.allowed)
        new = np.flatnonzero(np.isinf(self.began) & missed.any(axis=0))
        first = np.argmax(missed[:, new], axis=0)
        self.began[new] = self._start + (done + 1 + first) * self._step
        self.expected[new] = seen.allowed[first, new]
        self._keep(seen)

    def _keep(self, seen: 'BalanceTerms') -> None:
        """Store the last row as the current balance."""
        self.worst = np.maximum(self.worst, np.abs(seen.error).max(axis=0))
        (self.error, _, self._unresolved, self._worked, self._fastest, self._low,
         self._high) = (part[-1] for part in seen)

    def _balance(self, states: Array, rows: Array, tau: Array | Law,
                 unresolved: bool = False) -> 'BalanceTerms':
        """Return the balance at all chosen rows of states except the first of them."""
        chosen = states if len(rows) == states.shape[1] else states[:, rows]
        kinetic, potential, loss = self._terms(chosen)
        h = (self._step * np.diff(rows))[:, None]
        power, work = -loss, self._work(states, chosen, rows, tau)
        given = power
        if callable(tau):
            given = power = power + tau(rows).T
        elif self._driven is not None:
            before, after = self._driven_power(chosen, tau)
            work = work + 0.5 * h * (before + after)
            given = power + np.concatenate([before[:1], after])
        passive = 0.5 * h * (power[1:] + power[:-1])
        energy = kinetic + potential
        error = self.error + (energy[1:] - energy[:1]) - np.cumsum(work + passive, axis=0)
        worked = self._worked + np.cumsum(np.abs(work) + np.abs(passive), axis=0)
        uncertain = self._unresolved + np.zeros(error.shape)
        if unresolved:
            uncertain = uncertain + np.cumsum(
                self._uncertain(chosen, given, potential, tau), axis=0)
        fastest = np.maximum(np.maximum.accumulate(kinetic[1:], axis=0), self._fastest)
        low = np.minimum(np.minimum.accumulate(potential[1:], axis=0), self._low)
        high = np.maximum(np.maximum.accumulate(potential[1:], axis=0), self._high)
        allowed = (RELATIVE * (fastest + (high - low) + worked) + uncertain
                   + ROUNDING * (fastest + np.maximum(np.abs(low), np.abs(high))))
        return BalanceTerms(error, allowed, uncertain, worked, fastest, low, high)

    def _work(self, states: Array, chosen: Array, rows: Array, tau: Array | Law) -> Any:
        """Return the work of held torques between rows, (rows - 1, N) or 0, J."""
        if callable(tau) or not tau.any():
            return 0.0
        n_q, n = self.robot.n_q, self.robot.n
        part = slice(0, n) if self._tree else slice(n_q, n_q + n)
        held = tau.shape[1] == 1
        x = (chosen if held else states)[:, :, part]
        if self._tree:  # u = q': exact for every step
            turned = x[:, 1:] - x[:, :-1]
        else:
            h = self._step * (np.diff(rows)[:, None] if held else 1.0)
            turned = 0.5 * h * (x[:, 1:] + x[:, :-1])
        work = _dot(tau, turned)
        return work if len(work) == len(rows) - 1 else np.add.reduceat(
            work, rows[:-1].tolist(), axis=0)

    def _uncertain(self, states: Array, power: Array, potential: Array,
                   tau: Array | Law) -> Array:
        """Return the estimated quadrature error of the work of each step, (K, N), J."""
        found = self._step * _differences(power, 2)
        if self._damped:
            found = found + 2.0 * _differences(potential, 3)
        if not (callable(tau) or self._tree):
            n_q, n = self.robot.n_q, self.robot.n
            turning = _differences(states[:, :, n_q:n_q + n].swapaxes(0, 1), 2)
            found = found + self._step * _dot(np.abs(tau), turning.swapaxes(0, 1))
        return found

    def _terms(self, states: Array) -> Array:
        """Return kinetic energy, potential energy and power of friction, (3, K, N)."""
        found = np.empty((*states.shape[:2], TERMS))
        rows = np.ascontiguousarray(states)
        run_batch(self._kernel.lane_address, [
            Strided(rows.ctypes.data, 8 * rows.shape[2]),
            Strided(self._parameters.ctypes.data),
            Strided(found.ctypes.data, 8 * TERMS)], found.size // TERMS)
        return np.ascontiguousarray(found.T)

    def _driven_power(self, states: Array, tau: Array) -> Array:
        """Return the power of moving constraints at both ends of each interval, (2, K, N)."""
        kernel = self._driven
        assert kernel is not None
        shape = (len(states), states.shape[1] - 1)
        given = np.ascontiguousarray(np.broadcast_to(tau, (*shape, tau.shape[2])))
        found = np.empty((2, *shape))
        for part, end in zip((states[:, :-1], states[:, 1:]), found):
            rows = np.ascontiguousarray(part)
            run_batch(kernel.lane_address, [
                *(Strided(x.ctypes.data, 8 * x.shape[2]) for x in (rows, given)),
                Strided(self._parameters.ctypes.data), Strided(end.ctypes.data, 8)],
                shape[0] * shape[1])
        return found.swapaxes(1, 2)

    def warning(self, single: bool, cause: str | None = None) -> str | None:
        """
        Return the warning for energy balances with too large errors, or None.

        Parameters
        ----------
        single : bool
            Leave out the number of the simulation.
        cause : str, optional
            A known reason, such as the warning of the step.

        """
        missed = np.flatnonzero(np.isfinite(self.began))
        if not len(missed):
            return None
        k = int(missed[np.argmin(self.began[missed])])
        which = '' if single else f' of simulation {k}'
        more = f' ({len(missed)} of {len(self.began)} simulations)' if len(missed) > 1 else ''
        remedy = cause or ('Shorten the step' + (
            '' if self._tree else ', or choose other independent speeds (independent=)'))
        return (f'energy balance{which}: from {self.began[k]:.6g} s on the energy differs from '
                f'the work done, by up to {self.worst[k]:.3g} J{more}; expected at most '
                f'{self.expected[k]:.3g} J at that time with a step of {self._step:g} s. The '
                f'motion is wrong from there on. {remedy}')


def _with_impacts(seen: BalanceTerms, impacts: Sequence[Impact]) -> BalanceTerms:
    """Return the terms with the energy of impacts, from the end of their steps on."""
    lost, uncertain = np.zeros((2, *seen.error.shape))
    for step, i, energy, unresolved in impacts:
        lost[step, i] += energy
        uncertain[step, i] += unresolved
    uncertain = np.cumsum(uncertain, axis=0)
    return seen._replace(error=seen.error + np.cumsum(lost, axis=0),
                         allowed=seen.allowed + uncertain, unresolved=seen.unresolved + uncertain)


def _dot(a: Array, b: Array) -> Array:
    """Return the scalar products of the last axes of (1 or N, 1 or K, n) arrays, (K, N)."""
    found: Array = np.einsum('nkj,nkj->kn', *np.broadcast_arrays(a, b))
    return found


def _differences(rows: Array, order: int) -> Array:
    """
    Return magnitudes of differences of an order for every interval along the first axis.

    Each interval has the largest of the differences that include it; with too few rows, the order
    is lower.
    """
    order = min(order, len(rows) - 1)
    found = np.abs(np.diff(rows, order, axis=0))
    padded = np.pad(found, [(order - 1, order - 1)] + [(0, 0)] * (rows.ndim - 1))
    largest: Array = np.max([padded[k:k + len(rows) - 1] for k in range(order)], axis=0)
    return largest
