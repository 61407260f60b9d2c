"""
A model with its generalized speeds and constraints: rows, linear system, joint motion.

`MechanismState` is a mechanism at one configuration: poses, partial velocities, speeds.

The independent speeds u_I and the constraints are one linear system for the joint rates,

    [ Y_I ]        [ u_I - Z_I ]
    [  J  ] q'  =  [     b     ],      S q' = s,

and its time derivative gives q''. The inverse is S^-1 = [ T  N ]. The columns of T are
the partial joint rates of the independent speeds (nonholonomic under constraints), so a
generalized force is T^T times the joint forces. The columns of N are those of the
auxiliary speeds J q' - b, which are zero in every motion: N^T times the joint forces are
the constraint forces (Kane & Levinson, chapter 4).
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields
import math
from typing import Any, NamedTuple

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra import linear_solve
from kane_dynamics.mechanics.algebra.jet import Jet, moving, rates, series_array, term
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.ball_joints import (axis_acceleration, coordinate_rates,
                                                 joint_positions)
from kane_dynamics.mechanics.constraints import (Closure, Constraint, ConstraintRows,
                                                 DependentSpeeds, PointVelocity,
                                                 Prescribed, Rolling)
from kane_dynamics.mechanics.constraints.row_units import (closure_length, length_of,
                                                           turning_rows)
from kane_dynamics.mechanics.constraints.speeds import (chosen_speeds, JOINT_RATES,
                                                        speed_places, Speeds)
from kane_dynamics.mechanics.definition import kinematics
from kane_dynamics.mechanics.recursive import frame_kinematics
from kane_dynamics.mechanics.recursive.link import Link, posed
from kane_dynamics.model.model import Frame, Model, WORLD
import numpy as np

PARALLEL = 1e-12  # 1 - cos(angle) below which a joint turns a wheel about its axle


class MechanismState:
    """A mechanism at one configuration and time; implements `constraints.Geometry`."""

    def __init__(self, model: Model, speeds: Speeds, q: Vector, t: Scalar,
                 links: Sequence[Link] | None = None) -> None:
        """Use the kinematics of the definition, or those of the compiled links."""
        self.model = model
        self.q = q
        self.t = t
        self.width = model.n  # of rows
        self._speeds = speeds
        self._positions = q
        self._links = links
        # The rotation of a ball joint goes into the poses;
        # its joints are at position zero there.
        if model.balls:
            self._positions = joint_positions(model, q)
            self._links = None if links is None else posed(links, model, q)
        self._axes = WORLD

    @lazy_property
    def _bodies(self) -> tuple[kinematics.Configuration, ...]:
        """Return the configurations of all bodies, by the definition."""
        return kinematics.configurations(self.model, self.q)

    @lazy_property
    def _link_poses(self) -> frame_kinematics.LinkPoses:
        """Return the poses of the compiled links in the axes of a body."""
        return frame_kinematics.LinkPoses(self._links or (), self._positions, self._axes)

    def in_axes_of(self, frame: str | Frame) -> 'MechanismState':
        """Return this state in the axes of a frame's body, where links were stated."""
        body = self._frame(frame).body
        if self._links is None or body == self._axes:
            return self
        # The copy shares all but the poses, which depend on the axes.
        state = copy(self)
        state.__dict__.pop('_link_poses', None)
        state._axes = body
        return state

    def axle_carrier(self, frame: str, axis: Vector) -> Frame:
        """Return the axes of the body that carries a wheel's axle; else the wheel's."""
        wheel = self.model.frame(frame)
        if wheel.body != WORLD:
            # The parent carries the axle if the wheel turns about it on a joint.
            body = self.model.bodies[wheel.body]
            cosine = abs(body.joint.axis @ wheel.rotation @ axis)
            if body.joint.kind == 'revolute' and cosine > 1.0 - PARALLEL:
                return Frame('', body.parent)
        return Frame('', wheel.body)

    def carrier(self, first: str, second: str) -> Frame:
        """Return the axes of the outermost body that moves both frames, or the world."""
        first_path = self.model.path(self.model.frame(first).body)
        second_path = self.model.path(self.model.frame(second).body)
        common = set(first_path) & set(second_path)
        return Frame('', max(common, default=WORLD))

    def _frame(self, frame: str | Frame) -> Frame:
        """Return a frame of the model by its name."""
        return frame if isinstance(frame, Frame) else self.model.frame(frame)

    def pose(self, frame: str | Frame) -> tuple[Matrix, Vector]:
        """Return axes (3, 3, columns) and origin (3,) of a frame, m."""
        frame = self._frame(frame)
        if self._links is None:
            return kinematics.frame_pose(self.model, frame, self.q, self._bodies)
        return frame_kinematics.frame_axes(self._links, frame, self._link_poses)

    def partial_velocities(self, frame: str | Frame, at: Vector | None = None) -> Matrix:
        """Return the Jacobian (6, n_q) at a frame's origin or at a point of its body."""
        frame = self._frame(frame)
        if self._links is None:
            return kinematics.frame_partial_velocities(self.model, frame, self.q, at,
                                                       self._bodies)
        return frame_kinematics.partial_velocities(self._links, frame, self._positions,
                                                   at, self._link_poses)

    def motion(self, frame: str | Frame, qdot: Vector) -> Matrix:
        """
        Return velocity and acceleration of a frame at constant joint rates, (2, 6).

        Linear, then angular; relative to the axes of `in_axes_of`, of the compiled links
        only.
        """
        # Constant q' of ball joints: their axes turn, which is an acceleration.
        qddot = -axis_acceleration(self.model, qdot)
        return frame_kinematics.frame_motion(self._frame(frame), self._link_poses, qdot,
                                             qddot)

    def coordinate(self, name: str, constraint: str) -> tuple[Vector, Scalar]:
        """Return a coordinate's row, (n,), and its value, for the named constraint."""
        model = self.model
        names = []
        for joint, place in zip(model.joint_names, model.places):
            if place is not None:  # a ball joint has no angle
                names.append(joint)
        if name not in names:
            raise ConstraintError(f"constraint '{constraint}': no coordinate '{name}'; "
                                  f'expected one of {", ".join(names)}')
        k = model.joint_names.index(name)
        return np.eye(model.n)[k], self._positions[k]

    def speed_rows(self, names: Sequence[str]) -> tuple[Matrix, Vector]:
        """Return rows of Y, (k, n_q), and of Z, (k,), of these speeds."""
        Y, Z = self._speeds.of(self.q, self.t)
        places = speed_places(self._speeds, names)
        return Y[places], Z[places]

    def other_speeds(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the names of all speeds but these."""
        return tuple(name for name in self._speeds.names if name not in names)


class ReleasedJointState(MechanismState):
    """
    A mechanism with one released joint; rows have a column per degree of freedom of it.

    The columns are the six auxiliary speeds of the bodies behind the joint, along and
    about the world axes at the joint's origin.
    """

    def __init__(self, state: MechanismState, body: int, origin: Vector) -> None:
        """Release the joint of the body with index `body`; its origin is (3,), m."""
        super().__init__(state.model, state._speeds, state.q, state.t)
        self._links = state._links
        self._body = body
        self._origin = origin
        self.width = 6

    def partial_velocities(self, frame: str | Frame, at: Vector | None = None) -> Matrix:
        """Return the Jacobian of one rigid body, (6, 6); zero before the joint."""
        body = self._frame(frame).body
        if body == WORLD or self._body not in self.model.path(body):
            return np.zeros((6, 6)).astype(object)

        # The world's axes and origin, in the axes of this state.
        R_world, world_origin = self.pose(Frame('', WORLD))
        point = at
        if point is None:
            _, point = self.pose(frame)
        r = point - (R_world @ self._origin + world_origin)

        # A rotation about an axis e moves the point by e x r.
        moment_arms = np.array([cross(axis, r) for axis in R_world.T]).T
        linear = np.concatenate([R_world, moment_arms], axis=1)
        angular = np.concatenate([0.0 * R_world, R_world], axis=1)
        return np.concatenate([linear, angular])

    def coordinate(self, name: str, constraint: str) -> tuple[Vector, Scalar]:
        """Return a zero row, (6,), and the coordinate's value."""
        _, position = super().coordinate(name, constraint)
        return np.zeros(6), position

    def speed_rows(self, names: Sequence[str]) -> tuple[Matrix, Vector]:
        """Return zero rows: the released degrees of freedom do not change the speeds."""
        return np.zeros((len(names), 6)), np.zeros(len(names))


@dataclass(frozen=True, eq=False)
class JointMotion:
    """
    The joint motion for given independent speeds.

    Attributes
    ----------
    qdot, qddot : (n_j,) arrays
        Rates and accelerations of the n_j = `model.n` joints, angular velocities of ball
        joints; rad or m, and s.
    T : (n_j, n) array
        Joint rates per unit of each independent speed.
    N : (n_j, m) array
        Joint rates per unit of each constraint's auxiliary speed.
    T_rate : (n_j, n) array
        Time derivative of T along the motion.
    unit : bool
        Whether T = 1 and dT/dt = 0, in every configuration. Products with them are then
        skipped.

    """

    qdot: Vector
    qddot: Vector
    T: Matrix
    N: Matrix
    T_rate: Matrix
    unit: bool = False

    def projected(self, joint_forces: Vector) -> Vector:
        """Return T^T f: joint forces, (n_j,) or (n_j, k), on the independent speeds."""
        return joint_forces if self.unit else self.T.T @ joint_forces

    def by_speeds(self, by_joints: Matrix) -> Matrix:
        """Return A T: columns for the independent speeds from those for the joints."""
        return by_joints if self.unit else by_joints @ self.T

    def congruent(self, M: Matrix) -> Matrix:
        """Return T^T M T for a symmetric M of the joints, exactly symmetric."""
        return M if self.unit else congruent(M, self.T)


class MotionSeries(NamedTuple):
    """
    Motion of the joints with its time derivatives: arrays of jets, or of plain scalars.

    `q` (n_q,); `qdot` (n_j,) and `qddot` (n_j,), which in ball joints are the angular
    velocity and its rate; `T` (n_j, n), the joint rates per unit of each independent
    speed. `unit`: T = 1 in every configuration.
    """

    q: Vector
    qdot: Vector
    qddot: Vector
    T: Matrix
    unit: bool

    def projected(self, joint_forces: Vector) -> Vector:
        """Return T^T f: joint forces, (n_j,), on the independent speeds, (n,)."""
        return joint_forces if self.unit else self.T.T @ joint_forces


class Mechanism:
    """
    A model with generalized speeds and constraints.

    Parameters
    ----------
    model : Model
    speeds : None, Speeds or callable
        See `speeds.chosen_speeds`; joint rates by default.
    constraints : sequence of constraints
    free, kept : sequences of int
        Indices of the independent speeds and of linearly independent rows, from
        `independent_speeds.choose_independent`.
    sizes : sequence of float, optional
        Approximate size of each row, in `units`; 1 by default.
    rank_tolerance : float
        Singular values up to this fraction of the largest count as zero, and so do
        residuals of rows that then follow from others (rad, or lengths of the
        mechanism).

    Attributes
    ----------
    in_joint_rates : bool
        Whether u = q', and there are no constraints: a tree as it comes from a URDF.
    in_joint_speeds : bool
        The same, but with ball joints u has their angular velocities: T = 1, no rows.
    n : int
        Number of independent speeds.
    speed_names : tuple of str
        Names of the independent speeds, in order.
    left_out : list of int
        Indices of the redundant rows.
    turning : tuple of bool
        Whether each row constrains a rotation, in rad and N m.
    length : float
        m, see `row_units.length_of`: scales moments to forces and angles to distances.
    units : (n_j,) array
        `length` for joints that slide, 1 rad for others.
    row_units : (m,) array
        Of each row's residual: 1 rad where it constrains a rotation, `length` elsewhere.
    closure_units : (m,) array
        The same, but of closures the length of their own loop: whether it is closed does
        not depend on the rest of the mechanism.
    closure_length : float
        The largest of `closure_units` of translations, m; `length` without any.

    """

    def __init__(self, model: Model, speeds: Any = None,
                 constraints: Sequence[Constraint] = (),
                 free: Sequence[int] | None = None, kept: Sequence[int] | None = None,
                 sizes: Sequence[float] | None = None,
                 rank_tolerance: float = 1e-9) -> None:
        """Store the parts; by default all speeds are independent and all rows kept."""
        self.model = model
        self.speeds = chosen_speeds(model, speeds)
        self.constraints = tuple(constraints)
        self.rank_tolerance = rank_tolerance

        # The rows of all constraints, with the constraint that each is of.
        labels: list[str] = []
        owners: list[str] = []
        for constraint in self.constraints:
            if constraint.name in owners:
                raise ConstraintError(f"constraints: '{constraint.name}' given twice; "
                                      'expected different names')
            labels += constraint.labels
            owners += [constraint.name] * len(constraint.labels)
        self.labels = tuple(labels)
        self.owners = tuple(owners)

        # The choice: independent speeds, and rows that do not follow from others.
        if free is None:
            free = range(model.n)
        if kept is None:
            kept = range(len(labels))
        if sizes is None:
            sizes = np.ones(len(labels)).tolist()
        self.free = list(free)
        self.kept = list(kept)
        self.sizes = tuple(sizes)
        self.n = len(self.free)
        self.left_out = sorted(set(range(len(labels))).difference(self.kept))
        self.speed_names = tuple(self.speeds.names[r] for r in self.free)
        self._rolling = self._wheels_with_surface_rows()
        self.in_joint_speeds = (not self.labels and self.speeds.key == JOINT_RATES
                                and self.free == list(range(model.n)))
        self.in_joint_rates = self.in_joint_speeds and not model.balls

        # Units: joints that slide and rows of translation in lengths, others in rad.
        self.length = length_of(model, self.constraints)
        self.units = np.ones(model.n)
        for k, name in enumerate(model.joint_names):
            if name in model.sliding:
                self.units[k] = self.length
        turning: list[bool] = []
        for constraint in self.constraints:
            turning += turning_rows(constraint, model)
        self.turning = tuple(turning)
        self.row_units = np.where(self.turning, 1.0, self.length)
        lengths: list[float] = []
        for constraint in self.constraints:
            length = self.length
            if isinstance(constraint, Closure):
                length = closure_length(model, constraint, self.length)
            lengths += [length] * len(constraint.labels)
        self.closure_units = np.where(self.turning, 1.0, lengths)
        translations = self.closure_units[~np.array(self.turning, dtype=bool)]
        self.closure_length = float(translations.max(initial=0.0)) or self.length

    def _wheels_with_surface_rows(self) -> list[Rolling]:
        """Return the wheels whose `surface_rows` can stand for their rows: all kept."""
        # A wheel has three rows;
        # the rotation B between both kinds of rows needs all of them.
        wheels = []
        for constraint in self.constraints:
            if not (isinstance(constraint, Rolling) and constraint.has_surface_rows):
                continue
            if len(self._kept_places(constraint)) == 3:
                wheels.append(constraint)
        return wheels

    def _kept_places(self, constraint: Constraint) -> list[int]:
        """Return the places of a constraint's rows among the kept rows."""
        places = []
        for place, row in enumerate(self.kept):
            if self.owners[row] == constraint.name:
                places.append(place)
        return places

    @property
    def key(self) -> str | None:
        """
        Return an identifier among mechanisms of the model; None with user functions.

        Only user-defined functions may depend on time.
        """
        parts: list[str | None] = [repr(self.free), repr(self.kept), repr(self.sizes)]
        parts.append(self.speeds.key or None)
        for constraint in self.constraints:
            parts.append(_exact_text(constraint))
        # A part without key is a user-defined function, which no text identifies.
        texts = [part for part in parts if part is not None]
        return '\n'.join(texts) if len(texts) == len(parts) else None

    def with_choice(self, free: Sequence[int], kept: Sequence[int]) -> 'Mechanism':
        """Return the same mechanism with other independent speeds or rows."""
        return Mechanism(self.model, self.speeds, self.constraints, free, kept,
                         self.sizes, self.rank_tolerance)

    def state(self, q: Vector, t: Scalar = 0.0,
              links: Sequence[Link] | None = None) -> MechanismState:
        """Return the mechanism at q, (n_q,), and t, over any scalar."""
        return MechanismState(self.model, self.speeds, q, t, links)

    def rows(self, state: MechanismState) -> ConstraintRows:
        """Return the rows of all constraints, in the order of `labels`."""
        parts = []
        for constraint in self.constraints:
            part = constraint.rows(state)
            if constraint in self._rolling:
                # As `system` has them, so that a program computes the contact once.
                residual = constraint.surface_rows(state)[0].residual
                part = ConstraintRows(part.J, part.b, residual)
            parts.append(part)
        return _stacked(parts, state.width)

    def functions(self, state: MechanismState,
                  of_state: bool) -> dict[tuple[str, str], Any]:
        """
        Return the user-defined functions that must be continuous, by name and unit.

        They are those of t alone or, with `of_state`, those of q and t.
        """
        units = {'position(t)': ' (m or rad)',
                 'the velocity of position(t)': ' (m/s or rad/s)',
                 'value(t)': ' (m/s or rad/s)'}
        functions: dict[tuple[str, str], Any] = {}
        if of_state and not self.speeds.key:
            Y, Z = self.speeds.of(state.q, state.t)
            functions['speeds: Y(q, t)', ''] = Y
            functions['speeds: Z(q, t)', ''] = Z
        for constraint in self.constraints:
            # Dependent speeds are functions of q and t,
            # prescribed motions functions of t alone.
            if isinstance(constraint, DependentSpeeds):
                depends_on_state = True
            elif isinstance(constraint, Prescribed | PointVelocity):
                depends_on_state = False
            else:
                continue
            if depends_on_state == of_state:
                for name, value in constraint.functions(state).items():
                    full_name = f"constraint '{constraint.name}': {name}"
                    functions[full_name, units.get(name, '')] = value
        return functions

    def system(self, state: MechanismState) -> tuple[Matrix, Vector]:
        """
        Return S, (n_q, n_q), and s, (n_q,), of S q' = s at zero independent speeds.

        The first rows define the independent speeds, Y q' = u - Z, the others are the
        constraints. Rows of wheels with all rows kept are `Rolling.surface_rows`.
        """
        Y, Z = state.speed_rows(self.speed_names)
        # The surface rows are an orthogonal combination of a wheel's rows,
        # with shorter expressions.
        parts = []
        for constraint in self.constraints:
            if constraint in self._rolling:
                rows, _ = constraint.surface_rows(state)
            else:
                rows = constraint.rows(state)
            parts.append(rows)
        rows = _stacked(parts, state.width)
        # Y_I q' = u_I - Z_I and J q' = b, at u_I = 0.
        S = np.concatenate([Y, rows.J[self.kept]])
        s = np.concatenate([-Z, rows.b[self.kept]])
        return S, s

    def _of_rows(self, state: MechanismState, N: Matrix) -> Matrix:
        """Return N for the auxiliary speeds of `rows`, from that for the rows of S."""
        if not self._rolling:
            return N
        # J = B J_0 with the rows J_0 of S, and B^-1 = B^T: N = N_0 B^T.
        result = np.array(N, dtype=object)
        for constraint in self._rolling:
            places = self._kept_places(constraint)
            _, B = constraint.surface_rows(state)
            result[:, places] = N[:, places] @ B.T
        return result

    def joint_motion(self, q: Vector, u: Vector, udot: Vector, t: Scalar = 0.0,
                     links: Sequence[Link] | None = None) -> JointMotion:
        """
        Return the joint motion.

        Parameters
        ----------
        q : (n_q,) array of scalars
            Coordinates, rad or m.
        u, udot : (n,) arrays of scalars
            Independent speeds and their rates.
        t : scalar
            Time, s.
        links : sequence of Link, optional
            Use the kinematics of these links, which are compiled.

        Raises
        ------
        ConstraintError
            S is singular in every configuration.

        """
        n = self.n
        if self.in_joint_speeds:
            return JointMotion(u, udot, np.eye(n), np.zeros((n, 0)), np.zeros((n, n)),
                               unit=True)

        # q' = S^-1 ([u; 0] + s): the auxiliary speeds are zero.
        state = self.state(q, t, links)
        S, s = self.system(state)
        S_inverse = self.solved(S, np.eye(len(S)))
        no_speeds = np.zeros(len(self.kept)).astype(object)
        qdot = S_inverse @ (np.concatenate([u, no_speeds]) + s)

        # S and s along the motion, and their time derivatives S', s' (t' = 1).
        q_moving = moving(q, coordinate_rates(self.model, q, qdot))
        S_moving, s_moving = self.system(self.state(q_moving, moving(t, 1.0), links))
        S_rate = rates(S_moving)

        # S q'' = [u'; 0] + s' - S' q'
        bias = rates(s_moving) - S_rate @ qdot
        if links is not None:
            bias = self._with_closures(bias, state, qdot)
        qddot = S_inverse @ (np.concatenate([udot, no_speeds]) + bias)

        # S^-1 = [T N], and T' = -S^-1 S' T.
        T = S_inverse[:, :n]
        N = self._of_rows(state, S_inverse[:, n:])
        T_rate = -(S_inverse @ (S_rate @ T))
        return JointMotion(qdot, qddot, T, N, T_rate)

    def motion_series(self, q: Vector, rates: Matrix, t: Scalar = 0.0,
                      links: Sequence[Link] | None = None) -> MotionSeries:
        """
        Return the motion of the joints as power series in time, S q' = s term by term.

        With the terms S_k, s_k of the system along the motion, those of the joint rates
        are

            q'_k = S_0^-1 ( [u_k; 0] + s_k - sum_(1 <= i <= k) S_i q'_(k-i) )

        and q_(k+1) = q'_k / (k + 1), which S_(k+1) needs: Newton's recursion for the
        series, with one inverse. The terms of T follow from S T = [1; 0] alike.

        Parameters
        ----------
        q : (n_q,) array of scalars
            Coordinates, rad or m, at which the constraints hold.
        rates : (k + 2, n) array of scalars
            Independent speeds u, u', u'' ...; the jets are of order k.
        t : scalar
            Time, s.
        links : sequence of Link, optional
            As of `joint_motion`.

        """
        n = self.n
        count = len(rates)
        # Taylor coefficients: u = sum of u_k t^k with u_k the k-th rate over k!.
        speeds = [rate * (1.0 / math.factorial(k)) for k, rate in enumerate(rates)]
        coordinates = [q]
        joint_rates: list[Vector] = []
        S_terms: list[Matrix] = []
        S_inverse = np.eye(n)
        no_speeds = np.zeros(len(self.kept)).astype(object)
        for order in range(count):
            # The coefficients of S and s of this order need those of q up to it,
            # which are known.
            moving_q = series_array(coordinates)
            if self.in_joint_speeds:
                joint_rates.append(speeds[order])
            else:
                time = t if order == 0 else Jet((t, 1.0, *[0.0] * (order - 1)))
                S, s = self.system(self.state(moving_q, time, links))
                if order == 0:
                    S_inverse = self.solved(S, np.eye(len(S)))
                S_terms.append(term(S, order))
                # S_0 q'_k = [u_k; 0] + s_k - sum over i >= 1 of S_i q'_(k-i)
                right = np.concatenate([speeds[order], no_speeds]) + term(s, order)
                for i in range(1, order + 1):
                    right = right - S_terms[i] @ joint_rates[order - i]
                joint_rates.append(S_inverse @ right)
            # The rates of quaternions follow from the angular velocities of ball joints.
            change = coordinate_rates(self.model, moving_q, series_array(joint_rates))
            coordinates.append(term(change, order) * (1.0 / (order + 1)))

        # Partial joint rates along the motion.
        T_terms = [S_inverse[:, :n]]
        if not self.in_joint_speeds:
            for order in range(1, count - 1):
                # S T = [1; 0], which is constant: S_0 T_k = -sum over i >= 1 of S_i T_(k-i)
                change = np.zeros((self.model.n, n)).astype(object)
                for i in range(1, order + 1):
                    change = change + S_terms[i] @ T_terms[order - i]
                T_terms.append(-(S_inverse @ change))
        if self.in_joint_speeds:
            accelerations = moving(*rates[1:])
        else:
            accelerations = series_array([joint_rates[k] * float(k)
                                          for k in range(1, count)])
        return MotionSeries(series_array(coordinates[:count - 1]),
                            series_array(joint_rates[:count - 1]), accelerations,
                            series_array(T_terms), self.in_joint_speeds)

    def _with_closures(self, bias: Vector, state: MechanismState,
                       qdot: Vector) -> Vector:
        """
        Return s' - S' q' with the rows of closed loops by accelerations.

        Velocities and accelerations from joint to joint take less arithmetic than the
        time derivative of every entry of S.
        """
        # The accelerations by row, counted through the rows of all constraints.
        accelerations: dict[int, Scalar] = {}
        first = 0
        for constraint in self.constraints:
            if isinstance(constraint, Closure):
                of_rows = constraint.accelerations(state, qdot)
                accelerations.update(enumerate(of_rows, first))
            first += len(constraint.labels)

        # They replace the entries of the kept rows: J q'' = -(acceleration at q'' = 0).
        result = list(bias)
        for place, row in enumerate(self.kept, self.n):
            if row in accelerations:
                result[place] = -accelerations[row]
        return np.array(result)

    def solved(self, S: Matrix, right: Matrix) -> Matrix:
        """Return S^-1 times a vector or a matrix; ConstraintError if always singular."""
        columns = right.reshape(len(S), -1)  # of a vector: one column
        try:
            solution = linear_solve.solution(S, columns)
        except ZeroDivisionError as error:
            # The row without a pivot, by its name.
            names = [*self.speed_names, *(self.labels[k] for k in self.kept)]
            row = error.args[0]
            raise ConstraintError(
                f"speeds and constraints: '{names[row]}' depends on the others in every "
                'configuration, so that the motion is not determined; expected '
                'independent rows') from None
        return solution.reshape(right.shape)


def _stacked(parts: Sequence[ConstraintRows], width: int) -> ConstraintRows:
    """Return the rows of several constraints as one; `width` columns without any."""
    # Without constraints, the shapes (0, width) and (0,) remain.
    J = [np.zeros((0, width))]
    b = [np.zeros(0)]
    residual: list[Scalar] = []
    for part in parts:
        J.append(part.J)
        b.append(part.b)
        residual += part.residual
    return ConstraintRows(np.concatenate(J), np.concatenate(b), tuple(residual))


def congruent(M: Matrix, T: Matrix) -> Matrix:
    """Return T^T M T for a symmetric M, exactly symmetric: equal expressions."""
    # The lower triangle is copied: sums in another order would differ by rounding.
    half = M @ T
    n = T.shape[1]
    result: list[list[Scalar]] = np.zeros((n, n)).tolist()
    for r in range(n):
        for s in range(r, n):
            entry = T[:, r] @ half[:, s]
            result[r][s] = entry
            result[s][r] = entry
    return np.array(result).reshape(n, n)


def _exact_text(constraint: Constraint) -> str | None:
    """Return a constraint's exact parameters as text; None if one is a function."""
    words = [type(constraint).__name__]
    # A function has no text that identifies it, numbers have all their digits in theirs.
    for field in fields(constraint):
        value = getattr(constraint, field.name)
        if callable(value):
            return None
        if isinstance(value, np.ndarray):
            value = value.tolist()
        elif isinstance(value, Mapping):
            value = sorted(value.items())
        words.append(repr(value))
    return ' '.join(words)
