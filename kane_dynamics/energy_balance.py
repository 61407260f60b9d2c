"""
The energy balance of a simulation, checked while it runs.

The energy that a motion gains is the work that torques and moving constraints put in, less what
friction and damping take. An integration that goes wrong without diverging breaks this balance: a
step that is too long, independent speeds that become singular, a constraint that is lost.

Energy and dissipation of all states of a chunk are one call of a SIMD kernel, which is why every
step can be checked.
"""

from typing import Any

from kane_dynamics.mechanics.constrained import ConstrainedEquations
from kane_dynamics.mechanics.vector import is_zero
from kane_dynamics.model import Array
from kane_dynamics.native.kernels import Argument, Kernel
from kane_dynamics.native.march import march, Strided
from kane_dynamics.native.program import Program, trace_program
from kane_dynamics.robot import Robot
import numpy as np

RELATIVE = 1e-3  # of the energy that the motion has turned over
ROUNDING = 1e-9  # of the energy itself
TERMS = 3  # results of the energy kernel: kinetic, potential, power of friction
PAST = 3  # states whose terms are kept for differences across chunks


class EnergyBalance:
    """
    Compare, step by step, the energy that motions gain with the work done on them.

    Parameters
    ----------
    robot : Robot
    step : float
        s.
    states : (N, size) array
        At time 0, as `stepping.state_names`.
    integrator : str
        One of `stepping.INTEGRATORS`.

    Attributes
    ----------
    began : (N,) array
        Time at which the balance of each simulation was first missed, s; infinite where it never
        was.
    error : (N,) array
        Energy gained that no work accounts for, up to now, J.
    worst : (N,) array
        Its largest magnitude, J.
    expected : (N,) array
        The largest error that the step explained at that time, J.

    """

    def __init__(self, robot: Robot, step: float, states: Array, integrator: str) -> None:
        """Compile the kernels."""
        self.robot, self._step = robot, step
        self._kernel = energy_kernel(robot)
        self._driven = driven_kernel(robot)
        self._damped = integrator != 'rk4'  # springs' high frequencies die out by design
        self._tree = not isinstance(robot.equations, ConstrainedEquations)
        N = len(states)
        self.began = np.full(N, np.inf)
        self.error, self.worst, self.expected, self._unresolved, self._worked = np.zeros((5, N))
        self.restart(states)

    def restart(self, states: Array) -> None:
        """Go on from other states: what moved them there is no part of the balance."""
        terms = self._terms(states[:, None])
        self._past = terms[:, :0]
        self._fastest = terms[:, 0, 0].copy()
        self._low, self._high = terms[:, 0, 1].copy(), terms[:, 0, 1].copy()

    def look(self, states: Array, done: int, tau: Array, smooth: bool = False) -> None:
        """
        Take further steps into the balance.

        Parameters
        ----------
        states : (N, K + 1, size) array
            After `done` steps, and after each of the K next ones; C-contiguous.
        done : int
            Steps before these.
        tau : (1 or N, 1 or K, n) array
            Torques held during each of the K steps; or, where `smooth`, (N, K + 1, n): those at
            the states, of a law that is evaluated continuously.
        smooth : bool
            See `tau`.

        """
        with np.errstate(over='ignore', invalid='ignore'):
            self._look(states, done, tau, smooth)

    def _look(self, states: Array, done: int, tau: Array, smooth: bool) -> None:
        h, steps = self._step, states.shape[1] - 1
        terms = self._terms(states)
        kinetic, potential, loss = np.moveaxis(terms, 2, 0)
        n_q, n = self.robot.n_q, self.robot.n
        u = states[:, :, n_q:n_q + n]
        power, driven = -loss, 0.0
        if smooth:
            power = power + np.einsum('nkj,nkj->nk', tau, u)
            work = np.zeros(power[:, 1:].shape)
        elif self._tree:  # u = q': exact, whatever the step
            work = np.einsum('nkj,nkj->nk', *np.broadcast_arrays(
                tau, np.diff(states[:, :, :n], axis=1)))
        else:
            work = (0.5 * h) * np.einsum('nkj,nkj->nk', *np.broadcast_arrays(
                tau, u[:, 1:] + u[:, :-1]))
            if self._driven is not None:
                ends = self._driven_power(states, np.broadcast_to(
                    tau, (len(states), steps, n)))
                work += (0.5 * h) * (ends[0] + ends[1])
                driven = np.concatenate([ends[0][:, :1], ends[1]], axis=1)
        passive = (0.5 * h) * (power[:, 1:] + power[:, :-1])
        total = kinetic + potential
        error = self.error[:, None] + (total[:, 1:] - total[:, :1]) - np.cumsum(
            work + passive, axis=1)
        unresolved = self._unresolved[:, None] + np.cumsum(
            self._error_of_quadrature(terms, power + driven, u, tau, smooth), axis=1)
        worked = self._worked[:, None] + np.cumsum(np.abs(work) + np.abs(passive), axis=1)
        fastest, low, high = (accumulate(np.concatenate([before[:, None], rows[:, 1:]], axis=1),
                                         axis=1)[:, 1:] for accumulate, before, rows in (
            (np.maximum.accumulate, self._fastest, kinetic),
            (np.minimum.accumulate, self._low, potential),
            (np.maximum.accumulate, self._high, potential)))
        allowed = (RELATIVE * (fastest + (high - low) + worked) + unresolved
                   + ROUNDING * (fastest + np.maximum(np.abs(low), np.abs(high))))
        size = np.abs(error)
        missed = ~(size <= allowed)
        first = np.where(missed.any(axis=1), (done + 1 + np.argmax(missed, axis=1)) * h, np.inf)
        new = np.isinf(self.began) & np.isfinite(first)
        self.began[new] = first[new]
        self.expected[new] = allowed[new, np.argmax(missed[new], axis=1)]
        self.worst = np.maximum(self.worst, size.max(axis=1))
        self.error = error[:, -1]
        self._unresolved, self._worked = unresolved[:, -1], worked[:, -1]
        self._fastest, self._low, self._high = fastest[:, -1], low[:, -1], high[:, -1]

    def _error_of_quadrature(self, terms: Array, power: Array, u: Array, tau: Array,
                             smooth: bool) -> Array:
        """Return how far the work of each step is uncertain, (N, K), J."""
        steps = power.shape[1] - 1
        rows = np.stack([power, terms[:, :, 1]], axis=2)
        before = self._past
        whole = np.concatenate([before, rows], axis=1) if before.shape[1] else rows
        self._past = whole[:, -PAST - 1:-1]
        found = self._step * _differences(whole[:, :, 0], 2)[:, -steps:]
        if self._damped:
            found = found + 2.0 * _differences(whole[:, :, 1], 3)[:, -steps:]
        if not (smooth or self._tree):
            bend = _differences(u, 2)
            found = found + self._step * np.einsum(
                'nkj,nkj->nk', *np.broadcast_arrays(np.abs(tau), bend))
        return found

    def _terms(self, states: Array) -> Array:
        """Return kinetic and potential energy and power of friction, (N, K, 3)."""
        found = np.empty((*states.shape[:2], TERMS))
        parameters = self._kernel.parameters
        rows = np.ascontiguousarray(states).reshape(-1, states.shape[2])
        march(self._kernel.lane_address, [
            Strided(rows.ctypes.data, rows.strides[0]), Strided(parameters.ctypes.data),
            Strided(found.ctypes.data, 8 * TERMS)], len(rows))
        return found

    def _driven_power(self, states: Array, tau: Array) -> Array:
        """Return the power of moving constraints at both ends of each step, (2, N, K)."""
        kernel = self._driven
        assert kernel is not None
        given = np.ascontiguousarray(tau).reshape(-1, tau.shape[2])
        found = np.empty((2, len(given)))
        for part, end in zip((states[:, :-1], states[:, 1:]), found):
            rows = np.ascontiguousarray(part).reshape(-1, states.shape[2])
            march(kernel.lane_address, [
                Strided(rows.ctypes.data, rows.strides[0]),
                Strided(given.ctypes.data, given.strides[0]),
                Strided(kernel.parameters.ctypes.data), Strided(end.ctypes.data, 8)], len(rows))
        return found.reshape(2, *tau.shape[:2])

    def warning(self, single: bool, cause: str | None = None) -> str | None:
        """
        Return what to say of balances that were missed; None where all of them close.

        Parameters
        ----------
        single : bool
            Leave out which simulation it is.
        cause : str, optional
            What is known already to be wrong with the step.

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


def compile_balance(robot: Robot) -> None:
    """Compile what `EnergyBalance` calls."""
    for kernel in (energy_kernel(robot), driven_kernel(robot)):
        if kernel is not None:
            kernel.compile_lanes()


def energy_kernel(robot: Robot) -> Kernel:
    """Return the kernel of kinetic energy, potential energy and power of friction, (3,)."""
    equations, n_q, n = robot.equations, robot.n_q, robot.n
    constrained = isinstance(equations, ConstrainedEquations)

    def terms(state: Any, parameters: Any) -> Any:
        q, u, time = np.split(state, [n_q, n_q + n])
        tree, rates = equations, u
        if constrained:
            tree, rates = equations.tree, equations.joint_rates(q, u, *time)
        return [tree.kinetic_energy(q, rates, parameters),
                tree.potential_energy(q, parameters), tree.friction_force(rates) @ rates]
    return _kernel(robot, 'energy_terms', terms, (TERMS,))


def driven_kernel(robot: Robot) -> Kernel | None:
    """
    Return the kernel of the power of all joint forces beyond that of tau, W; None if it is zero.

    A constraint or a speed that prescribes a motion does work: q' = T u + X, and the forces f of
    the joints have the power f . q' = tau . u + f . X.
    """
    equations, n_q, n = robot.equations, robot.n_q, robot.n
    if not isinstance(equations, ConstrainedEquations) or not _driven(robot):
        return None

    def power(state: Any, tau: Any, parameters: Any) -> Any:
        q, u, time = np.split(state, [n_q, n_q + n])
        force = equations.actual_joint_forces(q, u, tau, parameters, *time)
        return force @ equations.joint_rates(q, u, *time) - tau @ u
    return _kernel(robot, 'driven_power', power, (), ('tau', (n,)))


def _driven(robot: Robot) -> bool:
    """Tell whether speeds or constraints prescribe rates: joints then move at u = 0."""
    mechanism = robot.mechanism
    found: list[bool] = []

    def given(state: Any) -> Any:
        q, _, time = np.split(state, [robot.n_q, robot.n_q + robot.n])
        right = mechanism.system(mechanism.posture(q, *time))[1]
        found.extend(not is_zero(x) for x in right)
        return right
    trace_program('given_rates', given, [('state', (_size(robot),))])
    return any(found)


def _size(robot: Robot) -> int:
    return robot.n_q + robot.n + robot.equations.timed


def _kernel(robot: Robot, name: str, function: Any, shape: tuple[int, ...],
            *more: tuple[str, tuple[int, ...]]) -> Kernel:
    inputs = [('state', (_size(robot),)), *more]

    def traced() -> Program:
        return trace_program(name, function,
                             [*inputs, ('parameters', robot.parameters.block.shape)])
    return robot.kernels.extra(name, traced, [Argument(*x) for x in inputs],
                               robot.parameters.block, shape)


def _differences(rows: Array, order: int) -> Array:
    """
    Return sizes of differences of that order for every interval along axis 1.

    An interval has the largest of the differences that it is part of; where there are too few
    rows, a lower order's.
    """
    order = min(order, rows.shape[1] - 1)
    found = np.abs(np.diff(rows, order, axis=1))
    width = [(0, 0)] * rows.ndim
    width[1] = (order - 1, order - 1)
    padded = np.pad(found, width)
    intervals = rows.shape[1] - 1
    return np.max([padded[:, k:k + intervals] for k in range(order)], axis=0)
