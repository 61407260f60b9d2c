"""Kernels of a robot for several choices of independent speeds and constraint rows."""

from collections.abc import Callable, Sequence
from functools import partial

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.jet import moving
from kane_dynamics.mechanics.constraints.conditioning import (best_choice, described,
                                                              EXCESS, figure,
                                                              largest_residuals, loosened,
                                                              scaled_rows, SHARE,
                                                              SINGULAR, singular_error,
                                                              Stack, stacked, system)
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.constraints.transmission import require_transmission
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.robot.kernel_set import KernelSet
from kane_dynamics.robot.parameters import Parameters
import numpy as np


class SpeedSets:
    """
    The kernel sets of a robot, one for each choice of speeds and rows in use.

    Parameters
    ----------
    asked : Mechanism
        The mechanism with the independent speeds of u and the initial choice of rows.
    equations : callable
        Returns the equations of a mechanism with another choice.
    key : str or None
        Cache key of everything else that kernels depend on; None with user-defined
        functions.
    parameters : Parameters
        The parameters that all kernels read at each call.

    """

    def __init__(self, asked: Mechanism, equations: Callable[[Mechanism], Equations],
                 key: str | None, parameters: Parameters) -> None:
        """Store the parts; kernels compile on first use."""
        self.asked = asked
        self._equations, self._key, self._parameters = equations, key, parameters
        self._made: dict[tuple[tuple[int, ...], tuple[int, ...]], KernelSet] = {}

    def kernels(self, free: Sequence[int], kept: Sequence[int]) -> KernelSet:
        """Return the kernels of a choice; each compiles on first use."""
        choice = tuple(free), tuple(kept)
        if choice not in self._made:
            # With user-defined functions there is no key, and the traced programs are
            # compared.
            mechanism = self.asked.with_choice(*choice)
            own = '' if mechanism.in_joint_rates else mechanism.key
            key = None if self._key is None or own is None else self._key + own
            self._made[choice] = KernelSet(self._equations(mechanism), key,
                                           self._parameters.block,
                                           partial(self.instead, mechanism))
        return self._made[choice]

    def with_parameters(self, parameters: Parameters) -> 'SpeedSets':
        """Return the same kernels with other parameters."""
        other = SpeedSets(self.asked, self._equations, self._key, parameters)
        other._made = {choice: kernels.with_parameters(
            parameters.block, partial(other.instead, kernels.equations.mechanism))
            for choice, kernels in self._made.items()}
        return other

    def instead(self, own: Mechanism, state: dict[str, Array]) -> KernelSet | None:
        """
        Return kernels that are regular at a state where the robot's are not.

        None where there are none. They have the same independent speeds and other rows,
        because the redundant rows may depend on the configuration.

        Parameters
        ----------
        own : Mechanism
            The mechanism of the kernels with the non-finite result.
        state : dict of arrays
            The arguments of the call with the non-finite result.

        Raises
        ------
        ConstraintError
            A user-defined function or its derivative is not finite, the independent
            speeds do not determine the motion there, a loop is open, or rows that were
            left out are not redundant there.

        """
        q = state.get('q')
        if q is None or own.in_joint_speeds:  # never singular
            return None
        t = float(state.get('t', np.zeros(())))
        # A function that is not finite is refused by name.
        for of_state in (False, True):
            own.functions(own.state(moving(q, np.ones(len(q))), moving(t, 1.0)),
                          of_state)
        stack = stacked(own, q, t)
        # The choice that is conditioned best; at a singular configuration none is
        # regular.
        choice = best_choice(own, stack, own.free)
        if not choice.figure < SINGULAR:
            raise singular_error(own, stack, q, t)
        if self._parameters.closure_tolerance is not None:
            self._require_closed(stack, q, t, self._parameters.closure_tolerance)
            left_out_error(own, stack, q, t, SHARE * loosened(own, EXCESS))
        # Almost singular, and no other choice is clearly better: the configuration is
        # singular.
        now = figure(own, stack, own.free, own.kept)
        if now > SHARE * SINGULAR and choice.figure > SHARE * now:
            raise singular_error(own, stack, q, t)
        # The actuators must determine the motion in the new speeds too.
        actuated = self._equations(own).actuated
        if actuated is not None:
            inverse = np.linalg.inv(system(stack, choice.free, choice.kept))
            T = np.asarray(inverse[:, :own.n], dtype=np.float64)
            require_transmission(own, T, actuated, True, q)
        return self.kernels(choice.free, choice.kept) if choice.figure < now else None

    def _require_closed(self, stack: Stack, q: Array, t: float,
                        limits: tuple[float, float]) -> None:
        """Raise ConstraintError for a residual above the closure tolerance."""
        # Each residual as a share of its limit, in rad or m.
        largest = largest_residuals(self.asked, limits)
        share = np.abs(stack.residual) / largest
        if np.linalg.norm(share) < SHARE:
            return
        k = int(np.argmax(share))
        unit = 'rad' if self.asked.turning[k] else 'm'
        raise ConstraintError(
            f"constraint '{self.asked.labels[k]}': its residual is "
            f'{abs(stack.residual[k]):.3g} {unit} at {described(self.asked, q)}, t = '
            f'{t:.6g} s; expected at most {largest[k]:g} {unit} (closure_tolerance), as from '
            'robot.closed_configuration')


def left_out_error(mechanism: Mechanism, stack: Stack, q: Array, t: float, most: float,
                   where: str = '') -> None:
    """
    Raise ConstraintError if rows that were left out are not redundant at a state.

    Either they contradict the chosen rows, or they constrain the independent speeds.
    """
    Y, J = scaled_rows(mechanism, stack)
    chosen = list(best_choice(mechanism, stack, mechanism.free).kept)
    left_out = [k for k in range(len(J)) if k not in chosen]
    if not left_out:
        return
    sizes = np.array(mechanism.sizes)
    n = len(mechanism.free)
    place = f'at {described(mechanism, q)}, t = {t:.6g} s'
    # All speeds from the independent ones and the right-hand sides of the chosen rows.
    T = np.linalg.inv(np.concatenate([Y[mechanism.free], J[chosen]]))

    # A row that is not redundant has an entry for an independent speed.
    constrained = np.abs(J[left_out] @ T[:, :n]).max(axis=1, initial=0.0)
    if constrained.max() > most:
        rows = [left_out[k] for k in np.flatnonzero(constrained > most)]
        raise ConstraintError(
            f'{where}constraint rows {_listed(mechanism, rows)} do not follow from the '
            f'others {place}, as they did where the robot was prepared: {len(chosen)} rows '
            'were independent there, more are here, and fewer than the independent speeds '
            f'({", ".join(mechanism.speed_names) or "none"}) remain free')

    # Rows that contradict the chosen ones have a residual in the motion at u = 0.
    free_rows = zip(stack.Y[mechanism.free] * mechanism.units, stack.Z[mechanism.free])
    # Motion at zero independent speeds: along each row of Y, the rate that cancels Z.
    speeds = [-z / max(float(np.linalg.norm(y)), 1e-300) for y, z in free_rows]
    targets = stack.b / sizes
    motion = T @ np.concatenate([np.array(speeds), targets[chosen]])
    residuals = np.abs(J[left_out] @ motion - targets[left_out]) * sizes[left_out]
    if residuals.max() > most:
        label = mechanism.labels[left_out[int(np.argmax(residuals))]]
        raise ConstraintError(f"{where}constraint '{label}' contradicts the others {place}: "
                              f'its velocity residual is {residuals.max():.3g}; expected 0')


def _listed(mechanism: Mechanism, rows: Sequence[int]) -> str:
    return ', '.join(f"'{mechanism.labels[k]}'" for k in rows)
