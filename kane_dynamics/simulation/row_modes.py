"""
The modes of rows at a state: impacts, then which rows hold and which slide.

Rows that touch and approach get impulses; then the forces of the rows at rest and their
accelerations solve one complementarity problem (`mechanics.complementarity`).
"""

from collections.abc import Collection
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.complementarity import (Disc, held, lcp, still_directions,
                                                     with_discs)
from kane_dynamics.mechanics.constraints.row_units import coordinate_units, rate_of
from kane_dynamics.mechanics.contacts import ContactPair
from kane_dynamics.mechanics.friction import (has_breakaway_drop, has_dry_friction,
                                              is_self_locking, stribeck_excess)
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.motion_samples import MotionSamples
from kane_dynamics.simulation.row_kernel import (AT_BOUNDS, AT_STOP, HELD, ModeChoice, Response,
                                                 response_kernel, responses, row_kernel,
                                                 RowMode, RowSet, SIGNS)
from kane_dynamics.simulation.step_kernels import state_layout, StepChoice
from kane_dynamics.simulation.trajectory import ContactMode
import numpy as np

TOUCHING = 1e-9  # rad or m: distance of rows that touch
AT_REST = 3e-10  # rad, or lengths, in the time of the mechanism, with constraints
SLOW = 1e-9  # m/s: speed of a contact at rest
SINGULAR = 1e-6  # singular value of normals that no redundant row refers to
STILL = 1e-9  # acceleration of a row that others hold, relative to the largest one
OPENS = 3e-8  # acceleration of a contact that opens, relative to the largest one
LIFT = 1e-3  # response of a contact that slides, relative to that of one without friction
DRIVEN = 1e-12  # response of a joint that constraints drive, relative to the largest one
TRIALS = 4  # changes of joints that break away together, for each joint
SHORT_FLIGHT = 1e-3  # of a step: a flight that is shorter is none
FEEDBACK = 4.0  # characteristic rates of the mechanism: how fast held rows lose their errors
CONTACT_MODES = {RowMode.OFF: ContactMode.OPEN, RowMode.STICKING: ContactMode.STICKING,
                 RowMode.BOUND: ContactMode.STICKING, RowMode.SLIDING: ContactMode.SLIDING}


class Impulses(NamedTuple):
    """
    The impulses of one instant.

    `joints` and `contacts` have the rows that hit, by number, with their speed; `impulses`,
    (c, 3), are those of contacts along normal and tangents; `loss` is of kinetic energy, J;
    `rests` are contacts whose bounces have become too short to follow; `locked` are
    self-locking joints that have stopped at once.
    """

    joints: dict[int, float]
    contacts: dict[int, float]
    impulses: Array
    loss: float
    rests: frozenset[int]
    locked: frozenset[int]


def row_set(robot: Robot, stops: bool, sticking: bool, pairs: tuple[ContactPair, ...],
            friction: Any, restitution: Any,
            dual_to: tuple[str, ...] | None = None) -> RowSet:
    """Return the rows of a robot: its joints with friction or stops, and contacts."""
    model = robot.model
    rubbing = set()
    drops = np.zeros(model.n)
    if sticking and robot.friction:
        for body in model.bodies:
            if has_dry_friction(body.joint):
                rubbing.add(body.joint.coordinate)
            if has_breakaway_drop(body.joint):
                size = abs(body.joint.multiplier) * stribeck_excess(body.joint)
                drops[body.joint.coordinate] += size
    lower, upper = robot.limits.lower, robot.limits.upper
    stopped = set()
    for joint, place in enumerate(model.places):
        if stops and place is not None and np.isfinite([lower[place], upper[place]]).any():
            stopped.add(joint)
    joints = sorted(rubbing | stopped)
    places = np.array([model.places[joint] or 0 for joint in joints], dtype=int)
    has_stop = np.isin(joints, sorted(stopped))
    by_joint = [model.coordinate_joints[joint] for joint in joints]
    locks = np.array([sticking and robot.friction and is_self_locking(joint)
                      for joint in by_joint], dtype=bool)
    slow = np.zeros(len(joints))
    constraints = robot.mechanism.constraints
    tree = robot.equations.in_joint_rates
    if pairs or not tree:
        units = coordinate_units(model, constraints)[places]
        slow = AT_REST * rate_of(model, constraints) * units
    return RowSet(robot, sticking, dual_to, joints, places,
                  np.where(has_stop, lower[places], -np.inf),
                  np.where(has_stop, upper[places], np.inf),
                  np.isin(joints, sorted(rubbing)), drops[joints], locks, slow, pairs,
                  np.asarray(friction, dtype=float),
                  np.asarray(restitution, dtype=float),
                  tree, FEEDBACK * rate_of(model, constraints))


def require_stops(robot: Robot, q: Array) -> None:
    """
    Check the stops of a robot, and that its initial configurations, (N, n_q), are between them.

    Raises
    ------
    InputError
        The limits of a joint leave it no range, or a joint starts past its stop.

    """
    lower, upper = robot.limits.lower, robot.limits.upper
    constrained = bool(robot.mechanism.constraints)
    for name, low, high in zip(robot.coordinate_names, lower, upper):
        # A loop may hold a joint at one position, but a free joint needs a range.
        if not (low < high or (low == high and constrained)):
            raise InputError(f"limits: of joint '{name}' {low:g} to {high:g}; expected "
                             'a range, between its stops; a joint that cannot move is '
                             'fixed')

    # Rounding may put a configuration at a stop just behind it.
    touching = TOUCHING * coordinate_units(robot.model, robot.mechanism.constraints)
    past = (q < lower - touching) | (q > upper + touching)
    if past.any():
        i, j = (int(x) for x in np.argwhere(past)[0])
        raise InputError(f"q0: joint '{robot.coordinate_names[j]}' at {q[i, j]:.6g}; "
                         f'expected {lower[j]:.6g} to {upper[j]:.6g}, between its stops')


class RowModes:
    """
    The choice of modes of the rows of one robot.

    Parameters
    ----------
    rows : RowSet
    step : float
        s; flights far shorter than it end at rest.

    """

    def __init__(self, rows: RowSet, step: float) -> None:
        """Compile the response."""
        self.rows = rows
        self._step = step
        self._last: tuple[Any, Response] | None = None
        self._kernel = response_kernel(rows)
        self._kernels: dict[StepChoice, Kernel] = {}
        k = len(rows.joints)
        self._contacts = [k + 3 * i for i in range(len(rows.pairs))]

    def step_kernel(self, choice: StepChoice) -> Kernel:
        """Return `row_kernel` of a choice of the step, found once."""
        if choice not in self._kernels:
            self._kernels[choice] = row_kernel(self.rows, choice)
        return self._kernels[choice]

    def response(self, state: Array, tau: Array, directions: Array, t: float) -> Response:
        """Return the response of rows at a state, (size,); the last one if it is the same."""
        arguments = state.tobytes(), tau.tobytes(), directions.tobytes(), t
        if self._last is None or self._last[0] != arguments:
            now = responses(self.rows, self._kernel, state[None], tau[None],
                            directions[None], np.array([t]))[0]
            self._last = arguments, now
        return self._last[1]

    def impact(self, state: Array, tau: Array, t: float,
               breaks: Collection[int] = ()) -> tuple[Array, Impulses | None]:
        """
        Return a state, (size,), after the impulses of rows that touch and approach.

        Arguments as of `choose`.
        """
        rows = self.rows
        k, c = len(rows.joints), len(rows.pairs)
        now = self.response(state, tau, np.zeros(k), t)
        sides = self.sides(state)
        # The velocity into each row that touches; e times it is the rebound.
        into = np.concatenate([sides * now.v[:k], -now.v[self._contacts]])
        touching = np.concatenate([sides != 0.0, now.distances <= TOUCHING])
        slow = np.concatenate([rows.slow, np.full(c, SLOW)])
        hits = touching & (into > slow)
        for i in breaks:
            if i >= k:
                self._require_lift(now, i - k)
        locked = [j for j in breaks if j < k and rows.locks[j]
                  and abs(now.v[j]) > rows.slow[j]]
        if not (hits.any() or locked):
            return state, None
        self._require_response(now, hits, t)
        away = np.abs(now.a[self._contacts])
        flight = 2.0 * rows.restitution * np.maximum(0.0, into[k:])
        short = flight <= SHORT_FLIGHT * self._step * away
        restitution = np.where(short, 0.0, rows.restitution)

        # Impulses of stops press inward, those of contacts outward, friction opposes slip.
        m = len(now.v)
        lower, upper = np.zeros((2, m))
        lower[:k] = np.where(touching[:k] & (sides > 0.0), -np.inf, 0.0)
        upper[:k] = np.where(touching[:k] & (sides < 0.0), np.inf, 0.0)
        lower[locked], upper[locked] = -np.inf, np.inf
        target = now.v.copy()
        discs = []
        for i, normal in enumerate(self._contacts):
            if touching[k + i]:
                upper[normal] = np.inf
                if rows.friction[i] > 0.0:
                    discs.append(Disc(normal, normal + 1, normal + 2, rows.friction[i]))
                target[normal] += restitution[i] * min(0.0, now.v[normal])
        used = np.flatnonzero((lower < 0.0) | (upper > 0.0)
                              | np.isin(np.arange(m), [x for disc in discs
                                                       for x in disc[1:3]]))
        p = np.zeros(m)
        p[used] = _solved(now.A, target, lower, upper, discs, used)
        after = state.copy()
        rates = state_layout(rows.robot).v
        after[rates] += now.B @ p
        v = now.v + now.A @ p
        if rows.tree:
            pressed = [joint for joint, x in zip(rows.joints, p[:k]) if x]
            after[rates.start + np.array(pressed, dtype=int)] = 0.0
        return after, Impulses(
            {j: float(into[j]) for j in np.flatnonzero(hits[:k]).tolist()},
            {i: float(into[k + i]) for i in np.flatnonzero(hits[k:]).tolist()},
            p[k:].reshape(c, 3), float(-0.5 * p @ (now.v + v)),
            frozenset(np.flatnonzero(hits[k:] & short & (rows.restitution > 0.0)).tolist()),
            frozenset(locked))

    def _require_lift(self, now: Response, i: int) -> None:
        """Raise ConstraintError if friction presses a contact on while it slides."""
        normal = self._contacts[i]
        both = [normal + 1, normal + 2]
        slip = now.v[both]
        speed = float(np.linalg.norm(slip))
        if speed <= SLOW:
            return
        by_friction = self.rows.friction[i] * now.A[normal, both] @ (slip / speed)
        if now.A[normal, normal] - by_friction <= LIFT * now.A[normal, normal]:
            raise ConstraintError(
                f"contact '{self.rows.pairs[i].name}': its friction presses it on while it "
                'slides, so that no force ends the approach; expected less friction '
                "(Painleve's paradox)")

    def _require_response(self, now: Response, hits: Any, t: float) -> None:
        """Raise ConstraintError for a joint that constraints drive into its stop."""
        of_joints = np.diag(now.A)[:len(self.rows.joints)]
        driven = hits[:len(of_joints)] & (of_joints <= DRIVEN * np.max(np.diag(now.A)))
        if driven.any():
            place = self.rows.places[int(np.argmax(driven))]
            name = self.rows.robot.coordinate_names[place]
            raise ConstraintError(f"{t:.6g} s: joint '{name}' is at its stop, and the "
                                  'constraints drive it on; expected a motion between the '
                                  'stops')

    def sides(self, state: Array) -> Array:
        """Return the stops that joints touch, (..., k): 1 upper, -1 lower, else 0."""
        q = state[..., self.rows.places]
        near = 0.0 if self.rows.tree else 3.0 * AT_STOP
        return np.where(q >= self.rows.upper - near, 1.0,
                        np.where(q <= self.rows.lower + near, -1.0, 0.0))

    def _moving(self, states: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Return `sides`, and the directions of joints that move, (..., k) each."""
        sides = self.sides(states)
        slow = 2.0 * self.rows.slow
        # What leaves a stop for a flight that is too short rests there.
        short = 0.5 * SHORT_FLIGHT * self._step * np.abs(a)
        slow = np.where(sides != 0.0, np.maximum(slow, short), slow)
        return sides, np.sign(v) * (np.abs(v) > slow)

    def choose(self, state: Array, tau: Array, t: float, breaks: Collection[int] = (),
               at_rest: Response | None = None, sliding: Response | None = None
               ) -> tuple[ModeChoice, Response, Array]:
        """
        Return the modes from a state on, the response in them, and the forces of rows.

        Parameters
        ----------
        state : (size,) array
            After the impulses of rows that approach.
        tau : array
            Torque, N m or N.
        t : float
            s.
        breaks : collection of int
            Rows whose forces have reached their bounds: joints, then contacts by k + i.
        at_rest, sliding : Response, optional
            Of joints without directions, and with those of the joints that move.

        """
        rows = self.rows
        k, c = len(rows.joints), len(rows.pairs)
        now = self.response(state, tau, np.zeros(k), t) if at_rest is None else at_rest
        sides, moving = self._moving(state, now.v[:k], now.a[:k])
        joints = np.full(k, RowMode.OFF, dtype=object)
        for j in np.flatnonzero((moving != 0.0) & rows.rubs).tolist():
            joints[j] = RowMode.FORWARD if moving[j] > 0.0 else RowMode.BACKWARD
        resting = set(np.flatnonzero((moving == 0.0) & (rows.rubs | (sides != 0.0))).tolist())
        contacts = np.full(c, RowMode.OFF, dtype=object)
        stops = np.array([rows.lower, rows.upper])
        begins = np.zeros((c, 2))
        # What leaves a surface for a flight that is too short rests there.
        short = 0.5 * SHORT_FLIGHT * self._step * np.abs(now.a[self._contacts])
        slow_normal = np.maximum(SLOW, short)
        rests = (now.distances <= TOUCHING) & (now.v[self._contacts] <= slow_normal)
        touching = np.flatnonzero(rests).tolist()

        coupled = not rows.tree or bool(touching)
        drops = coupled and bool(rows.drops.any())
        reached = any(row < k for row in breaks)
        for _ in range(TRIALS * k + 2):
            modes = ModeChoice(tuple(joints), tuple(contacts), begins, now.distances, stops,
                               np.zeros(len(now.v)))
            directions = modes.directions(rows)
            if sliding is not None:
                now, sliding = sliding, None
            else:
                now = self.response(state, tau, directions, t)
            f, begun = self._settled(now, sides, sorted(resting), touching, joints,
                                     contacts, begins, breaks)
            for j in begun & set(np.flatnonzero(rows.locks).tolist()):
                self._require_driven(now, f, j, state, tau, t)
            resting -= begun
            if drops and all(joints[j] in AT_BOUNDS for j in begun):
                rows_at_rest = [*sorted(resting), *self._rows_of(touching)]
                begun |= self._broken_away(now, f, joints, resting, rows_at_rest, reached)
            reached |= any(joints[j] in (RowMode.FORWARD, RowMode.BACKWARD) for j in begun)
            if not begun:
                break
        # Joints at their bounds whose friction does not drop move with the others.
        a = now.a + now.A @ f
        still = STILL * np.abs(now.a).max(initial=1e-300)
        for j in range(k):
            if joints[j] in AT_BOUNDS and abs(a[j]) > still:
                joints[j] = RowMode.FORWARD if SIGNS[joints[j]] > 0.0 else RowMode.BACKWARD
        # A joint that others hold at its stop is there to rounding. One that leaves its stop
        # may be there as long as its motion is below rounding.
        q = state[rows.places]
        free = np.array([mode not in HELD for mode in joints], dtype=bool)
        below = np.nextafter(np.minimum(stops[0], q), -np.inf)
        above = np.nextafter(np.maximum(stops[1], q), np.inf)
        stops = np.array([np.where(free & (sides < 0.0), below, stops[0]),
                          np.where(free & (sides > 0.0), above, stops[1])])
        floors = self._floors(now, joints, contacts)
        # Joints alone share with the least sum of squares.
        forces = f if touching else np.zeros(len(f))
        choice = ModeChoice(tuple(joints), tuple(contacts), begins, floors, stops, forces)
        return choice, now, f

    def _floors(self, now: Response, joints: Any, contacts: Any) -> Array:
        """
        Return the distances that contacts keep, or fall to while they are open, (c,).

        Redundant rows cannot reduce distances that contradict each other: no motion does
        it, and the forces of the attempt would grow without limit.
        """
        k = len(self.rows.joints)
        floors = np.nextafter(np.minimum(0.0, now.distances), -np.inf)
        touching = np.flatnonzero(contacts != RowMode.OFF)
        if not len(touching):
            return floors
        normals = k + 3 * touching
        held_rows = [j for j in range(k) if joints[j] in HELD]
        for i in touching.tolist():
            sticks = contacts[i] == RowMode.STICKING
            held_rows += self._rows_of([i])[:3 if sticks else 1]
        without_motion = still_directions(now.A[np.ix_(held_rows, held_rows)])
        of_normals = without_motion[np.isin(held_rows, normals)].T
        floors[touching] = np.linalg.lstsq(of_normals,
                                           of_normals @ now.distances[touching],
                                           rcond=SINGULAR)[0]
        return floors

    def _settled(self, now: Response, sides: Array, resting: list[int],
                 touching: list[int], joints: Any, contacts: Any, begins: Array,
                 breaks: Collection[int]) -> tuple[Array, set[int]]:
        """
        Solve for the forces of rows at rest, and write their modes.

        Return the forces, (k + 3 c,), and the joints that begin to slide or reach the
        bound of their friction: their friction counts as that of directions from now on.
        """
        rows = self.rows
        k, m = len(rows.joints), len(now.v)
        lower, upper = np.zeros((2, m))
        lower[:k] = np.where(sides > 0.0, -np.inf, now.least)
        upper[:k] = np.where(sides < 0.0, np.inf, now.largest)
        A, discs, tangents = now.A.copy(), [], []
        for i in touching:
            normal = self._contacts[i]
            both = [normal + 1, normal + 2]
            upper[normal] = np.inf
            slip = now.v[both]
            speed = float(np.linalg.norm(slip))
            if speed > SLOW:
                # The friction of a contact that slides goes with its normal force.
                A[:, normal] -= rows.friction[i] * A[:, both] @ (slip / speed)
                self._require_lift(now, i)
                contacts[i] = RowMode.SLIDING
                begins[i] = slip / speed
            elif rows.friction[i] > 0.0:
                discs.append(Disc(normal, normal + 1, normal + 2, rows.friction[i]))
                tangents += both
        used = np.array([*resting, *(self._contacts[i] for i in touching), *tangents],
                        dtype=int)
        f = np.zeros(m)
        if len(used):
            if touching or not rows.tree:
                f[used] = _solved(A, now.a, lower, upper, discs, used)
            else:  # of independent joints: nothing contradicts
                f[used] = lcp(A[np.ix_(used, used)], now.a[used], lower[used], upper[used])
        a = now.a + A @ f
        still = STILL * np.abs(now.a).max(initial=1e-300)
        self._contact_modes(f, a, touching, contacts, begins, still, breaks)

        begun = set()
        inside = [j for j in resting if lower[j] < f[j] < upper[j] and j not in breaks]
        redundant = not rows.tree or bool(touching)
        if not inside:  # of several that are just at their bounds, one holds
            inside = [j for j in resting if abs(a[j]) <= still and j not in breaks][:1]
        fixed = any(contacts[i] == RowMode.STICKING for i in touching)
        for j in resting:
            rests = abs(a[j]) <= still and j not in breaks
            others = redundant and (fixed or any(joint != j for joint in inside))
            beyond = f[j] < now.least[j] or f[j] > now.largest[j]
            # The force on a joint is opposite to its direction of sliding.
            forward = f[j] < 0.5 * (now.least[j] + now.largest[j])
            if sides[j] and (beyond or (rests and not rows.rubs[j] and not others)):
                joints[j] = RowMode.UPPER if sides[j] > 0.0 else RowMode.LOWER
            elif not rows.rubs[j]:
                joints[j] = RowMode.OFF
            elif j in inside or (rests and not others):
                joints[j] = RowMode.STICKING
            elif others and abs(a[j]) <= still:
                joints[j] = RowMode.BOUND_FORWARD if forward else RowMode.BOUND_BACKWARD
                begun.add(j)
            else:
                joints[j] = RowMode.FORWARD if forward else RowMode.BACKWARD
                begun.add(j)
        return f, begun

    def _broken_away(self, now: Response, f: Array, joints: Any, resting: set[int],
                     rests: list[int], reached: bool) -> set[int]:
        """
        Change the modes of joints that start to slide together, and return them.

        Joints at the bounds of their friction break away together if, with friction that
        drops, no others hold them. One whose friction has dropped must accelerate; one
        at its bound may rest. `reached` says that some have just reached their bounds;
        `rests` are the rows at rest.
        """
        rows = self.rows
        k = len(rows.joints)
        signs = np.array([SIGNS.get(mode, 0.0) for mode in joints])
        at_bound = np.array([mode in AT_BOUNDS for mode in joints], dtype=bool)
        starts = (np.abs(now.v[:k]) <= 2.0 * rows.slow) & (signs != 0.0)
        dropped = starts & ~at_bound & (rows.drops > 0.0)

        # The first that does not accelerate in its direction rests again.
        by_drops = np.abs(now.A[:k, :k]) @ rows.drops
        zero = STILL * (by_drops + np.abs(now.a).max(initial=0.0))
        along = signs * (now.a + now.A @ f)[:k]
        wrong = np.flatnonzero(starts & (along <= np.where(dropped, zero, -zero)))[:1]
        if len(wrong) or not reached:
            resting.update(wrong.tolist())
            return set(wrong.tolist())

        # Accelerations due to the drops, while rows at rest are held by any force.
        at_bound &= rows.drops > 0.0
        response = now.A[:, :k] @ np.where(at_bound, signs * rows.drops, 0.0)
        response += now.A[:, rests] @ held(now.A[np.ix_(rests, rests)], response[rests])
        begins = at_bound & (signs * response[:k] > STILL * by_drops)
        if not begins.any():
            return set()
        for j in np.flatnonzero(begins).tolist():
            joints[j] = RowMode.FORWARD if signs[j] > 0.0 else RowMode.BACKWARD
        resting.update(np.flatnonzero(at_bound & ~begins).tolist())
        return set(np.flatnonzero(at_bound).tolist())

    def _require_driven(self, now: Response, f: Array, j: int, state: Array, tau: Array,
                        t: float) -> None:
        """
        Raise InputError if the load of a self-locking drive helps its motor to move it.

        With the rotor as part of the load, the law then has several motions.
        """
        robot = self.rows.robot
        torques = tau
        if not robot.equations.in_joint_rates:
            torques = robot.joint_torques(tau, state[:robot.n_q], t=t)
        joint = robot.model.coordinate_joints[self.rows.joints[j]]
        motor = torques[self.rows.joints[j]] - joint.friction_offset
        # The force that would hold the joint by itself.
        force = f[j] - (now.a + now.A @ f)[j] / now.A[j, j]
        if abs(force) > abs(motor) and -force * motor > 0.0:
            raise InputError(
                f"sticking: at {t:.6g} s the load of the self-locking joint '{joint.name}' "
                'helps its motor to move it; expected a motor that drives against the load, '
                'since the motion is not determined otherwise')

    def _rows_of(self, contacts: list[int]) -> list[int]:
        """Return the rows of normals and tangents of contacts."""
        return [self._contacts[i] + row for i in contacts for row in range(3)]

    def _contact_modes(self, f: Array, a: Array, touching: list[int], contacts: Any,
                       begins: Array, still: float, breaks: Collection[int]) -> None:
        """Write the modes of contacts that touch, by their forces and accelerations."""
        for i in touching:
            normal = self._contacts[i]
            force = f[normal + 1:normal + 3]
            opens = a[normal] > OPENS / STILL * still or len(self.rows.joints) + i in breaks
            if not f[normal] > 0.0 and opens:
                contacts[i] = RowMode.OFF
            elif contacts[i] != RowMode.SLIDING:
                size = float(np.linalg.norm(force))
                radius = self.rows.friction[i] * f[normal]
                contacts[i] = RowMode.STICKING
                if radius == 0.0:
                    contacts[i], begins[i] = RowMode.SLIDING, 0.0
                elif size >= radius * (1.0 - 1e-12):
                    slip = a[normal + 1:normal + 3]
                    moves = float(np.linalg.norm(slip)) > still
                    contacts[i] = RowMode.SLIDING if moves else RowMode.BOUND
                    begins[i] = -force / size

    def at_rest(self, state: Array, modes: ModeChoice, now: Response) -> Array:
        """Return a state in which held rows have no velocity, by impulses on them."""
        rows = self.rows
        k = len(rows.joints)
        rates = state_layout(rows.robot).v
        after = state.copy()
        stuck = [j for j, mode in enumerate(modes.joints) if mode in HELD]
        used = list(stuck)
        for i, mode in enumerate(modes.contacts):
            if mode != RowMode.OFF:
                used.append(k + 3 * i)
            # Slip begins from rest: what is left of another direction would end it at once.
            tangents = [k + 3 * i + 1, k + 3 * i + 2]
            if mode == RowMode.STICKING or (mode != RowMode.OFF and
                                            np.linalg.norm(now.v[tangents]) <= SLOW):
                used += tangents
        if used and now.v[used].any():
            p = held(now.A[np.ix_(used, used)], now.v[used])
            after[rates] += now.B[:, used] @ p
        if rows.tree:
            after[rates.start + np.array([rows.joints[j] for j in stuck], dtype=int)] = 0.0
            for j in stuck:
                if modes.joints[j] != RowMode.STICKING:
                    bound = rows.upper if modes.joints[j] == RowMode.UPPER else rows.lower
                    after[rows.places[j]] = bound[j]
        return after

    def at_samples(self, states: Array, tau: Array, times: Array) -> MotionSamples:
        """Return accelerations, forces and modes at K states, (K, size)."""
        rows = self.rows
        k, c = len(rows.joints), len(rows.pairs)
        n_j = rows.robot.model.n
        stop_forces, friction = np.zeros((2, len(states), n_j))
        sticking = np.zeros((len(states), n_j), dtype=bool)
        contact_forces, contact_points = np.zeros((2, len(states), c, 3))
        contact_modes = np.zeros((len(states), c), dtype=int)
        vdot = np.empty((len(states), n_j))
        # The responses of all samples, without directions and with those of joints that move.
        none = np.zeros((len(states), k))
        at_rest = responses(rows, self._kernel, states, tau, none, times)
        v = np.array([now.v for now in at_rest]).reshape(len(states), -1)
        a = np.array([now.a for now in at_rest]).reshape(len(states), -1)
        sides, moving = self._moving(states, v[:, :k], a[:, :k])
        sliding = responses(rows, self._kernel, states, tau, moving * rows.rubs, times)
        rests = ((moving == 0.0) & (rows.rubs | (sides != 0.0))).any(axis=1)
        for row, (state, torque, t) in enumerate(zip(states, tau, times)):
            now = sliding[row]
            contact_points[row] = now.points
            if not (rests[row] or (now.distances <= TOUCHING).any()):
                vdot[row], friction[row] = now.vdot, now.friction
                continue
            modes, now, f = self.choose(state, torque, float(t), (), at_rest[row], now)
            forces = self.acting(modes, now, f)
            vdot[row] = now.vdot + now.B @ forces
            of_joints = forces[:k]
            beyond = of_joints - np.clip(of_joints, now.least, now.largest)
            stop_forces[row, rows.joints] = beyond
            friction[row] = now.friction - now.J.T @ forces[k:]
            friction[row, rows.joints] -= of_joints - beyond
            sticks = [(mode in HELD or mode in AT_BOUNDS) and bool(rubs)
                      for mode, rubs in zip(modes.joints, rows.rubs)]
            sticking[row, rows.joints] = sticks
            along = forces[k:].reshape(c, 3)
            contact_forces[row] = np.einsum('ci,cij->cj', along, now.bases)
            contact_modes[row] = [CONTACT_MODES[mode] for mode in modes.contacts]
        return MotionSamples(vdot, stop_forces, friction, sticking, contact_forces,
                             contact_points, contact_modes)

    def acting(self, modes: ModeChoice, now: Response, f: Array) -> Array:
        """Return the forces of all rows, with the friction of contacts that slide."""
        k = len(self.rows.joints)
        forces = f.copy()
        for j, mode in enumerate(modes.joints):
            if mode not in HELD:
                forces[j] = 0.0  # friction of directions
        for i, mode in enumerate(modes.contacts):
            normal = k + 3 * i
            slip = now.v[normal + 1:normal + 3]
            speed = float(np.linalg.norm(slip))
            if mode == RowMode.SLIDING and speed > SLOW:
                forces[normal + 1:normal + 3] = (-self.rows.friction[i] * forces[normal]
                                                 * slip / speed)
        return forces


def _solved(A: Array, b: Array, lower: Array, upper: Array, discs: list[Disc],
            used: Any) -> Array:
    """Return the solution of `with_discs` for some of the rows."""
    place = {row: number for number, row in enumerate(used.tolist())}
    among = [Disc(place[disc.normal], place[disc.first], place[disc.second], disc.friction)
             for disc in discs]
    return with_discs(A[np.ix_(used, used)], b[used], lower[used], upper[used], among)
