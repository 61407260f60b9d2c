"""What only a robot with chosen speeds or constraints is asked, each by a kernel of its own."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.independent_speeds import closed_posture
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.native.runtime.kernel import Argument, checked
from kane_dynamics.robot.dispatch import Dispatch
import numpy as np
from numpy.typing import ArrayLike

SINGULAR = 1e14  # a condition number at which double precision holds no digit of a solution


class ConstraintMethods(Dispatch):
    """
    The calls of a `Robot` that tell of its speeds and constraints.

    Without these, u = q' and the torques of the joints are tau.
    """

    @property
    def mechanism(self) -> Mechanism:
        """Return speeds and constraints; InputError for a robot that was given neither."""
        if not isinstance(self.equations, ConstrainedEquations):
            raise InputError('this robot has joint rates for speeds and no constraints: construct '
                             'it with speeds= or constraints=')
        return self.equations.mechanism

    @property
    def speed_names(self) -> tuple[str, ...]:
        """Names of the entries of u, udot and tau: the independent speeds."""
        return tuple(self.equations.speed_names)

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the rows of the constraints, as in `constraint_forces`."""
        equations = self.equations
        return equations.mechanism.labels if isinstance(equations, ConstrainedEquations) else ()

    def joint_rates(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                    out: Array | None = None) -> Array:
        """
        Return q', (n_q,), of the independent speeds.

        Parameters
        ----------
        q, u : (n_q,), (n,) or (N, n_q), (N, n) arrays
            Coordinates and independent speeds; rad or m, and s.
        t : float or (N,) array
            Time, s.
        out : array, optional
            Written to and returned.

        """
        if not isinstance(self.equations, ConstrainedEquations):
            return self._same('u', u, out)
        return self._special('joint_rates', (q, u), t, out)

    def joint_torques(self, tau: ArrayLike, q: ArrayLike | None = None, *, t: ArrayLike = 0.0,
                      out: Array | None = None) -> Array:
        """
        Return the torques of the joints, (n_q,), that amount to tau.

        By default each entry of tau acts on its own independent speed and strains no constraint;
        where `Robot(actuated=)` names joints, these share it with the least sum of squares.

        Parameters
        ----------
        tau : (n,) or (N, n) array
            Dual to the independent speeds, N m or N.
        q : (n_q,) or (N, n_q) array, optional
            Coordinates, rad or m; of no account where u = q' and nothing constrains it.
        t : float or (N,) array
            Time, s.
        out : array, optional
            Written to and returned.

        """
        if not isinstance(self.equations, ConstrainedEquations):
            return self._same('tau', tau, out)
        if q is None:
            raise InputError('q is missing: what joint torques amount to tau depends on the '
                             'posture of a robot with chosen speeds or constraints')
        return self._special('joint_torques', (q, tau), t, out)

    def constraint_forces(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike, *,
                          wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                          out: Array | None = None) -> Array:
        """
        Return the force of every constraint row, (m,), in the order of `constraint_names`.

        These are the equations of auxiliary speeds (Kane & Levinson, section 4.9): a row's force
        acts along the velocity that the row holds, N or N m. With the tau of inverse dynamics
        they are those of the motion that it was computed for. A row that follows from the others
        carries nothing.

        Parameters
        ----------
        q, u, tau : (n_q,), (n,), (n,) or (N, ...) arrays
            Coordinates, independent speeds, and what acts on them; rad or m, s, N m or N.
        wrench : (k, 6) or (N, k, 6) array, optional
            As in `inverse_dynamics`.
        t : float or (N,) array
            Time, s.
        out : array, optional
            Written to and returned.

        """
        self._require('constraint_forces')
        return self._loaded(self.kernels.quantity('constraint_forces'), (q, u, tau), wrench, out,
                            t)

    def constraint_gap(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                       out: Array | None = None) -> Array:
        """Return by what each row's condition on positions is missed, (m,); 0 without one."""
        return self._special('constraint_gap', (q,), t, out)

    def closed_posture(self, q: ArrayLike, *, t: float = 0.0, fixed: Sequence[str] = ()) -> Array:
        """
        Return the posture near q, (n_q,), at which all conditions on positions are met.

        Parameters
        ----------
        q : (n_q,) array_like
            Where to start, rad or m.
        t : float
            Time, s.
        fixed : sequence of str
            Names of coordinates to leave as they are.

        Raises
        ------
        ConstraintError
            None is found; names the constraint with the largest remaining gap.

        """
        return closed_posture(self.mechanism, q, t=t, fixed=fixed)

    def _same(self, name: str, value: Any, out: Array | None) -> Array:
        """Return a checked copy: of joints themselves where speeds are their rates."""
        same = checked(Argument(name, (self.equations.n,), self.speed_names), value)
        result: Array = np.empty_like(same) if out is None else out
        result[...] = same
        return result

    def _special(self, name: str, arguments: tuple[Any, ...], t: ArrayLike,
                 out: Array | None) -> Array:
        self._require(name)
        return self._call(name, arguments, out, t)

    def _require(self, name: str) -> None:
        if not isinstance(self.equations, ConstrainedEquations):
            raise InputError(f'{name} is of robots with chosen speeds or constraints: construct '
                             'the Robot with speeds= or constraints=')


def raise_where_singular(mechanism: Mechanism, state: dict[str, Array]) -> None:
    """Raise ConstraintError if speeds and constraints do not determine the motion at a state."""
    q, t = state['q'], float(state.get('t', np.zeros(())))
    with np.errstate(all='ignore'):
        here = mechanism.posture(q, t)
        Y = np.array(here.speed_rows(mechanism.speeds.names)[0], dtype=np.float64)
        S = np.array(mechanism.system(here)[0], dtype=np.float64)
    for what, matrix in (('Y is', Y), ('speeds and constraints are', S)):
        bad = not np.isfinite(matrix).all()
        if bad or np.linalg.cond(matrix) > SINGULAR:
            names = dict(zip(mechanism.model.coordinate_names, np.round(q, 9).tolist()))
            raise ConstraintError(f'{what} singular at {names}, t = {t:g} s: the speeds '
                                  f'{", ".join(mechanism.speed_names)} do not determine the joint '
                                  'rates there; choose others (speeds=, independent=)')
