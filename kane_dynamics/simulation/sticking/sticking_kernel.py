"""
The native step with given directions of sliding and given joints that stick.

Directions and held joints are arguments, constant in the step: its order is that of the
integrator. A step is valid if no held joint needs more than breakaway friction at its
beginning, no joint that slides changes its direction, and none passes its stop.
`Sticking` computes the other steps, in pieces.
"""

from functools import partial
from typing import Any

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.dual import magnitude, select
from kane_dynamics.mechanics.algebra.flags import finite
from kane_dynamics.mechanics.integrators.held_joints import Held, held_response
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.simulation.held_motion import HeldMotion, HeldStage
from kane_dynamics.simulation.step_kernels import (state_layout, step_signature,
                                                   StepChoice, time_input, traced_step)
from kane_dynamics.simulation.sticking.friction_state import (driving_torques,
                                                              friction_bounds,
                                                              FrictionModes,
                                                              FrictionState,
                                                              of_all_joints)
from kane_dynamics.simulation.stops.pressed_steps import corrected
import numpy as np

ROUNDING = 1e-12  # of a force that holds a joint, relative
MODES = 4  # rows of an input: directions, sides, lower and upper stops


def sticking_kernel(choice: StepChoice, state: FrictionState, holds: bool) -> Kernel:
    """
    Return the kernel of a step: the state after it, then whether begin and end are valid.

    Parameters
    ----------
    choice : StepChoice
        Of the step with smooth friction, whose inputs it has, and `modes` (4, k).
    state : FrictionState
        With the joints.
    holds : bool
        Whether joints may be held; without any the step takes less time.

    """
    # Two kernels: one that holds joints at rest, and one for steps in which all slide.
    robot = state.robot
    choice = choice.needed(robot)
    k = len(state.joints)
    kind = 'sticking' if holds else 'sliding'
    free, inputs, constants = step_signature(robot, choice)
    name = f'{kind}_{free}_{"_".join(map(str, state.joints))}'
    if state.stops:
        name += '_stops'
    row = partial(_traced_row, state, choice, holds)
    return robot.kernels.compiled(row, name, {**inputs, 'modes': (MODES, k)},
                                  (inputs['state'][0] + 2,), constants=constants)


def _traced_row(contact: FrictionState, choice: StepChoice, holds: bool, state: Vector,
                inputs: Matrix, modes: Matrix, constants: Vector) -> list[Scalar]:
    """Return the state after a step, and whether its begin and its end are valid."""
    robot = contact.robot
    directions, sides, lower, upper = modes
    motions: list[FrictionMotion] = []

    # The motion of the step is kept: its first stage tells which joints begin to slide.
    def motion(*arguments: Any) -> FrictionMotion:
        motions.append(FrictionMotion(contact, directions, holds, *arguments))
        return motions[0]
    after = traced_step(robot, choice, state, inputs, constants, motion)

    # Rounding would let held joints of closed loops creep.
    if holds and contact.constrained:
        after = without_drift(contact, modes, after, constants)

    begin_valid = _begin_valid(motions[0], directions, sides, holds)
    end_valid = _end_valid(contact, after, directions, sides, lower, upper)
    return [*after, begin_valid, end_valid]


def _begin_valid(motion: 'FrictionMotion', directions: Vector, sides: Vector,
                 holds: bool) -> Scalar:
    """Return 1 if the first stage confirms the directions and the held joints, else 0."""
    # Self-locking drives that slide are driven.
    valid: Scalar = 1.0
    for driving in motion.driving:
        valid = valid * select(driving > 0.0, 1.0, 0.0)
    if not holds:
        return valid

    # Every held joint needs a force within its bounds. A stop presses only inward, and
    # so takes the place of one of the bounds.
    f, least, largest = motion.first
    for direction, side, x, low, high in zip(directions, sides, f, least, largest):
        rounding = ROUNDING * select(x < 0.0, -x, x)
        below = select(side > 0.5, 0.0, select(x < low - rounding, 1.0, 0.0))
        above = select(side < -0.5, 0.0, select(high + rounding < x, 1.0, 0.0))
        rests = select(direction * direction > 0.5, 0.0, 1.0)
        valid = valid * (1.0 - rests * (below + above))
    return valid


def _end_valid(contact: FrictionState, after: Vector, directions: Vector, sides: Vector,
               lower: Vector, upper: Vector) -> Scalar:
    """Return 1 if the end of a step has no transition behind it, else 0."""
    robot = contact.robot
    equations: Any = robot.equations
    layout = state_layout(robot)
    q, u, time = after[layout.q], after[layout.u], after[layout.time]

    # No joint has reversed its motion, or passed its stop unless it presses against it.
    rates = equations.joint_speeds(q, u, *time)
    valid: Scalar = 1.0
    for row, joint in enumerate(contact.joints):
        direction, slow = directions[row], contact.slow[row]
        reversed_ = select(direction * rates[joint] < -slow, 1.0, 0.0)
        valid = valid * (1.0 - reversed_)
        if contact.at_bound[row] > 1.0:  # one at its bound that moves slides
            moves = select(2.0 * slow < magnitude(rates[joint]), 1.0, 0.0)
            still = select(direction * direction > 1.5, 1.0, 0.0)
            valid = valid * (1.0 - still * moves)
    if contact.stops:
        for place, side, low, high in zip(contact.places, sides, lower, upper):
            if place >= 0:
                x = after[place]
                past = select(x < low, 1.0, select(high < x, 1.0, 0.0))
                valid = valid * (1.0 - past * (1.0 - side * side))

    # The independent speeds are regular, and the state is finite.
    if equations.watched:
        valid = valid * select(after[-1] > 0.0, 1.0, 0.0)
    return valid * finite([*q, *u])


def without_drift(contact: FrictionState, modes: Matrix, after: Vector,
                  constants: Vector) -> Vector:
    """Return a state without the motion of held joints, of the order of the step's error."""
    if contact.stops:
        after = _at_stops(contact, modes, after, constants)
    return _without_creep(contact, modes[0], after, constants)


def _at_stops(contact: FrictionState, modes: Matrix, after: Vector,
              constants: Vector) -> Vector:
    """Return a state in which joints that press against stops are at them."""
    robot = contact.robot
    # Places and rates of the joints at stops are corrected by the loops' own equations.
    layout = state_layout(robot)
    q, u, time = after[layout.q], after[layout.u], after[layout.time]
    parameters = constants[-len(robot.parameters.block):]
    coordinates = []
    touching = []
    stops = []
    # Only joints with a coordinate have stops; `side` is 0 away from both.
    for place, (_, side, lower, upper) in zip(contact.places.tolist(), modes.T):
        if place >= 0:
            coordinates.append(place)
            touching.append(side * side > 0.5)
            stops.append(select(side > 0.0, upper, lower))
    q, u, _ = corrected(robot, coordinates, touching, stops, q, u, list(time),
                        parameters)
    return np.array([*q, *u, *after[layout.u.stop:]])


def _without_creep(contact: FrictionState, directions: Vector, after: Vector,
                   constants: Vector) -> Vector:
    """Return a state in which the rates of held joints are zero, by impulses on them."""
    robot = contact.robot
    equations: Any = robot.equations
    n_q, n, joints = robot.n_q, robot.n, contact.joints
    times = time_input(robot)
    parameters = constants[-len(robot.parameters.block):]

    # q' = T u + X of the held joints, and M^-1, as one subroutine.
    def parts(q: Vector, *inputs: Any) -> Vector:
        t = inputs[0][()] if times else 0.0
        physical = inputs[-1][:robot.parameters.physical]
        motion = equations.at_rest(q, t)
        inverse = equations.inverse_mass_matrix(q, physical, t)
        return np.concatenate([np.ravel(motion.T[joints]), motion.qdot[joints],
                               np.ravel(inverse)])
    program = trace_program('held_rates', parts, [
        ('q', (n_q,)), *times, ('parameters', np.shape(parameters))])
    layout = state_layout(robot)
    q, u = after[layout.q], after[layout.u]
    results = np.array(call(program, q, *after[layout.time], parameters))
    k = len(joints)
    T, X, inverse = np.split(results, [k * n, k * n + k])
    T = T.reshape(k, n)
    inverse = inverse.reshape(n, n)

    # Impulses f on the held joints with T (u - M^-1 T^T f) + X = 0 in their rows.
    along = inverse @ T.T
    held = [direction * direction < 0.5 for direction in directions]
    for _ in range(2):  # the second has the error of the regular response
        u = u - along @ held_response(T @ along, held, T @ u + X)
    return np.concatenate([q, u, after[n_q + n:]])


class FrictionMotion(HeldMotion):
    """
    A robot with set-valued friction during one traced step.

    Parameters
    ----------
    contact : FrictionState
        With the joints.
    directions : (k,) array
        1 or -1 of joints that slide, 0 of those that are held.
    holds : bool
        Whether any may be held.
    *arguments
        Of `RobotMotion`.

    """

    dynamics_name = 'friction_dynamics'

    def __init__(self, contact: FrictionState, directions: Vector, holds: bool,
                 *arguments: Any) -> None:
        """Begin without stages."""
        super().__init__(contact.joints, directions, *arguments)
        self._contact = contact
        self._holds = holds
        # Of the first stage: what holds joints, and the bounds of friction, (k,) each.
        self.first: Any = None
        self.driving: Vector = ()  # of the first stage, (k,)

    def held(self, modes: Vector, q: Vector) -> Held:
        """Return the joints that may be held, and which of them stick (direction 0)."""
        if not self._holds:
            return Held([], [])
        return Held(self._joints, [direction * direction < 0.5 for direction in modes])

    def directions(self, modes: Vector) -> Vector:
        """Return the directions of all joints, (n_j,)."""
        return of_all_joints(self.equations, self._joints, modes)

    def results(self, stage: HeldStage) -> list[Scalar]:
        """Return the holding forces, the bounds of friction, and the driving torques."""
        results: list[Scalar] = []
        q, u, tau, directions, t, solution = stage
        # What the checks at both ends of the step need, in the order in which they read
        # it.
        if self._holds:
            least, largest = friction_bounds(self.equations, self._joints, q, tau, t)
            results += [*solution.f, *least, *largest]
        if self._contact.locks:
            rates = self.equations.joint_speeds(q, u, t)
            results += [*driving_torques(self.equations, self._joints, q, rates, tau,
                                         directions, t)]
        return results

    def called(self, program: Program, q: Vector, u: Vector, tau: Vector, time: Any,
               *inputs: Any) -> Any:
        """Return the rates of a stage; the other results of the first one are stored."""
        results = super().called(program, q, u, tau, time, *inputs)
        k = len(self._joints)
        # Behind the rates: forces of held joints with their bounds, then torques that
        # drive self-locking joints.
        if self._contact.locks:
            results, driving = np.split(np.array(results), [len(results) - k])
            if not len(self.driving):
                self.driving = driving
        if not self._holds:
            return results
        end = len(results) - 3 * k
        rates, f, least, largest = np.split(np.array(results), [end, end + k, end + 2 * k])
        # The forces at the begin of the step decide whether joints hold.
        if self.first is None:
            self.first = f, least, largest
        return rates

    def holding(self, q: Vector, u: Vector, tau: Vector,
                time: Vector) -> tuple[Vector, Vector, Vector]:
        """Return the forces that hold joints at rest, and the bounds of friction, (k,) each."""
        self.first = None
        self.called(self._motion, q, u, tau, time)
        forces: tuple[Vector, Vector, Vector] = self.first
        return forces


def mode_rows(state: FrictionState, modes: FrictionModes) -> Matrix:
    """Return the input `modes` of the kernel, (4, k)."""
    return np.array([*modes, *state.finite_stops])
