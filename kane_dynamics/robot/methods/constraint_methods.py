"""Methods of a robot with chosen speeds or constraints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.checks import finite_row
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.loop_closure import (closed_posture, defined_rows,
                                                              followed_posture, Rows)
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.native.runtime.argument import Argument, checked
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.robot.methods.dispatch import Dispatch
import numpy as np
from numpy.typing import ArrayLike


class ConstraintMethods(Dispatch):
    """
    The methods of `Robot` for generalized speeds and constraints.

    Without these, u = q' and the joint torques equal tau. Arguments are those of one state, or
    (N, ...) arrays of a batch: q (n_q,), the independent speeds u, udot and the generalized forces
    tau (n,), rad or m, s, N m or N; the time `t`, s, a float or (N,) array; and `out`, which is
    written to and returned.
    """

    _choices: dict[str, Any]

    @property
    def mechanism(self) -> Mechanism:
        """Speeds and constraints; by default joint rates and no constraints."""
        return self.equations.mechanism

    @property
    def speed_names(self) -> tuple[str, ...]:
        """Names of the entries of u, udot and tau: the independent speeds."""
        return tuple(self.equations.speed_names)

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the rows of the constraints, as in `constraint_forces`."""
        return self.mechanism.labels

    @property
    def configuration(self) -> Any:
        """Return the configuration at which speeds and rows were chosen; None without one."""
        return self._choices['configuration']

    @property
    def speeds_are_given(self) -> bool:
        """Return whether the user chose the independent speeds."""
        return self._choices['independent'] is not None

    @property
    def actuated_names(self) -> tuple[str, ...]:
        """
        Names of the joints with actuators.

        Those of `Robot(actuated=)`; by default the joints whose rates are the independent speeds,
        and all joints where the speeds are no joint rates.
        """
        equations, names = self.equations, self.joint_names
        if equations.actuated is not None:
            return tuple(names[k] for k in equations.actuated)
        return tuple(name for name in names if name in self.speed_names) or names

    def joint_rates(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                    out: Array | None = None) -> Array:
        """Return q', (n_q,), of the independent speeds."""
        if self.equations.in_joint_rates:
            return self._same('u', u, out)
        return self._special('joint_rates', (q, u), t, out)

    def joint_torques(self, tau: ArrayLike, q: ArrayLike | None = None, *, t: ArrayLike = 0.0,
                      out: Array | None = None) -> Array:
        """
        Return joint torques, (n_q,), with the generalized force tau.

        Of ball joints the moments about the axes of the body, so that the order is `joint_names`.

        By default each entry of tau acts on its own independent speed without constraint forces;
        with `Robot(actuated=)`, the actuators have the torques of minimum norm, or of the least
        sum of weight times torque squared. ConstraintError where the actuators cannot produce
        every motion: the mechanism moves a thousand times as fast as they do, or faster.

        Robots in joint rates without constraints ignore q.
        """
        if self.equations.in_joint_rates:
            return self._same('tau', tau, out)
        if q is None:
            raise InputError('q: missing; expected the configuration, on which the joint torques '
                             'of a robot with chosen speeds or constraints depend')
        return self._special('joint_torques', (tau, q), t, out)

    def generalized_force(self, joint_torques: ArrayLike, q: ArrayLike, *,
                          t: ArrayLike = 0.0) -> Array:
        """
        Return the generalized force tau, (n,), of joint torques, (n_q,): reverse `joint_torques`.

        For torques measured at all joints, zero at those without actuators, N m or N.
        """
        equations = self.equations
        if equations.in_joint_rates:
            return self._same('joint_torques', joint_torques, None)
        model = equations.model
        torques = Argument('joint_torques', (model.n,), model.joint_names)
        kernel = self._kernel('generalized_force', {'q': (equations.n_q,),
                                                    'joint_torques': torques}, (equations.n,))
        result: Array = kernel(*self._at_time((q, joint_torques), t))
        return result

    def constraint_forces(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike, *,
                          wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                          out: Array | None = None) -> Array:
        """
        Return the force of every constraint row, (m,), in the order of `constraint_names`.

        These are the equations of auxiliary speeds (Kane & Levinson, chapter 4): a row's force
        acts along the velocity that the row constrains, N or N m. With the tau of inverse dynamics
        they are the forces in that motion. The forces of redundant rows are not unique: the result
        has minimum norm, with moments divided by `mechanism.length` (or as `Robot(redundant=)`).
        `wrench` is as in `inverse_dynamics`.
        """
        self._require('constraint_forces')
        return self._loaded('constraint_forces', (q, u, tau), wrench, out,
                            t)

    def constraint_residual(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                            out: Array | None = None) -> Array:
        """Return the residual of every row, (m,), m or rad; 0 for velocity constraints."""
        return self._special('constraint_residual', (q,), t, out)

    def constraint_gap(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                       out: Array | None = None) -> Array:
        """Return `constraint_residual`; the former name of that method."""
        return self.constraint_residual(q, t=t, out=out)

    def constraint_velocity_residual(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                                     out: Array | None = None) -> Array:
        """Return the velocity residual J q' - b of every row, (m,), m/s or rad/s."""
        return self._special('constraint_velocity_residual', (q, u), t, out)

    def joint_accelerations(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                            t: ArrayLike = 0.0, out: Array | None = None) -> Array:
        """
        Return q'', (n_q,), of all joints, dependent ones included.

        Of ball joints the angular accelerations about the axes of the body, so that the order is
        `joint_names`.
        """
        if self.equations.in_joint_rates:
            return self._same('udot', udot, out)
        return self._special('joint_accelerations', (q, u, udot), t, out)

    def closed_posture(self, q: ArrayLike, *, t: float = 0.0, fixed: Sequence[str] = (),
                       start: ArrayLike | None = None) -> Array:
        """
        Return the configuration near q, (n_q,), that satisfies all position constraints.

        With fixed coordinates and a start, it is on the branch of the start: the fixed
        coordinates move from there to their values in small steps, and other entries of q are
        ignored.

        Parameters
        ----------
        q : (n_q,) array_like
            Initial guess, rad or m.
        t : float
            Time, s.
        fixed : sequence of str
            Names of coordinates that keep their values.
        start : (n_q,) array_like, optional
            A nearly closed configuration; q itself, to stay on its branch. Default: the
            `configuration` of the robot, if one was given.

        Raises
        ------
        InputError
            A number is missing or not finite, or a start comes without fixed coordinates.
        ConstraintError
            None is found; names the constraint with the largest residual.

        """
        mechanism, rows = self.mechanism, self._compiled_rows()
        begin = self.configuration if start is None else finite_row(
            start, 'start', mechanism.model.coordinate_names)
        if begin is not None and len(fixed):
            return followed_posture(mechanism, begin, q, t=t, fixed=fixed, rows=rows)
        if start is not None:
            raise InputError(f'start: {begin.tolist()}, without fixed; expected the coordinates '
                             'that move from there to their values in q')
        return closed_posture(mechanism, q, t=t, fixed=fixed, rows=rows)

    def _compiled_rows(self) -> Rows | None:
        """Return the rows of the constraints in native code, with arrays of their own, if any."""
        if not self.constraint_names:
            return None
        result = np.empty((len(self.constraint_names), self.equations.model.n + 2))
        kernel = self._kernel('closure_rows', {'q': (self.equations.n_q,)}, result.shape)
        here = [np.empty(x.shape) for x in kernel.arguments]
        call = kernel.bind(here, result, 'Compute the rows.')

        def rows(*given: Any) -> tuple[Array, Array, Array]:
            for array, value in zip(here, given):
                array[...] = value
            try:
                call()
            except InputError:  # not finite, which those of the definition say of each row
                return defined_rows(self.mechanism)(given[0], float(given[1]))
            return result[:, :-2], result[:, -2], result[:, -1]
        return rows

    def _kernel(self, name: str, inputs: dict[str, Shape | Argument], shape: Shape) -> Kernel:
        """Return the kernel of a method of the equations that is none of their quantities."""
        return self.kernels.compiled(getattr(self.equations, name), name, inputs, shape)

    def _same(self, name: str, value: Any, out: Array | None) -> Array:
        """Return a checked copy, for a robot in joint rates without constraints."""
        same = checked(Argument(name, (self.equations.n,), self.speed_names), value)
        result: Array = np.empty_like(same) if out is None else out
        result[...] = same
        return result

    def _special(self, name: str, arguments: tuple[Any, ...], t: ArrayLike,
                 out: Array | None) -> Array:
        self._require(name)
        if self.equations.timed:
            return self._call(name, arguments, out, t)
        entry = self._entry(name, '', lambda _: self.kernels.quantity(name))
        result: Array = entry(*arguments) if out is None else entry(*arguments, out=out)
        return result

    def _require(self, name: str) -> None:
        if self.equations.in_joint_rates:
            raise InputError(f'{name}: a robot in joint rates without constraints; expected '
                             'Robot(..., speeds=...) or Robot(..., constraints=...)')
