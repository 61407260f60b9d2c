"""
The native search for the transitions in one step of exact friction.

The kernel is one evaluation of the search: it follows a part of the step from the last
transition on, with directions that are constant, and evaluates there the functions whose
roots are transitions and the response of the joints to forces. Its result, a `Search`,
is its next argument (`Kernel.iterate`). The phases of a step:

    START    the directions of the joints that move at the beginning of the step
    SETTLE   which joints stick from here on: the complementarity problem, one change of
             a joint at a time
    BEGIN    the functions at the beginning of the part
    END      the functions at the end of the step: without a sign change, it is done
    SEARCH   regula falsi for the first root, where the next part begins with SETTLE

Impacts on stops and self-locking drives are left to `sticking_steps`, where the same
search is in Python.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.dual import magnitude, select
from kane_dynamics.mechanics.integrators.held_joints import (held_response,
                                                             masked_solution, REGULAR)
from kane_dynamics.native.runtime.event_loop import SearchPlaces
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.simulation.step_kernels import (RobotMotion, state_layout,
                                                   state_names, step_signature,
                                                   StepChoice, tau_from, traced_step)
from kane_dynamics.simulation.sticking.friction_state import (FrictionModes,
                                                              FrictionState, NEGLIGIBLE,
                                                              of_all_joints, TOUCHING,
                                                              traced_forces, TRIALS)
from kane_dynamics.simulation.sticking.sticking_kernel import (FrictionMotion,
                                                               without_drift)
import numpy as np

MOST = 200  # transitions in one step
CALLS = 20_000  # evaluations in one step
SHORT = 1e-13  # of a step: resolution of a transition's time
ROOT = 1e-14  # of the largest value of a function in a step: zero
MARGIN = 1e-12  # of a force that holds a joint, relative
FAR = 1e300  # value of a function without a root
START, SETTLE, BEGIN, END, SEARCH = -1.0, 0.0, 1.0, 2.0, 3.0  # phases
DONE, REFUSED = 1.0, 2.0  # ends of a search
SCALARS = 12  # fields of `Search` before its arrays
KINDS = 4  # reversal, breakaway forward and backward, distance from a stop


class Search(NamedTuple):
    """
    The state of a search within a step; `kinds` is 4 k.

    Attributes
    ----------
    phase, transitions, turn : scalar
        The phase, the transitions so far and the iteration of a root, modulo 4.
    trials : scalar
        Changes of joints that break away together, since the last transition.
    passed : scalar
        Time from the beginning of the step to that of the part, s.
    power : scalar
        Sum of the powers of friction at the beginning and the end of the step, W.
    holds : scalar
        Whether any joint is held.
    low, high, f_low, f_high, last : scalar
        Bracket of the first root, s after the beginning of the part, with the least
        function at both ends, and the end that moved last, -1 or 1.
    state, state_high : (size,) arrays
        At the beginning of the part, and at the end of the bracket.
    directions, sides, lower, upper : (k,) arrays
        As the argument `modes` of `sticking_kernel`.
    rates, rates_high : (k,) arrays
        Of the joints, at both places.
    at_begin, at_high, size : (kinds,) arrays
        The functions at both places, and the size of their values in the part.
    held, at_largest : (k,) arrays
        In SETTLE: joints at rest which are held, and others whose friction is at its
        largest.
    end : scalar
        0, or one of the ends of a search.

    """

    phase: Scalar
    transitions: Scalar
    turn: Scalar
    trials: Scalar
    passed: Scalar
    power: Scalar
    holds: Scalar
    low: Scalar
    high: Scalar
    f_low: Scalar
    f_high: Scalar
    last: Scalar
    state: Vector
    state_high: Vector
    directions: Vector
    sides: Vector
    lower: Vector
    upper: Vector
    rates: Vector
    rates_high: Vector
    at_begin: Vector
    at_high: Vector
    size: Vector
    held: Vector
    at_largest: Vector
    end: Scalar


class AtRest(NamedTuple):
    """
    Quantities of the complementarity problem at a state, of k joints.

    Attributes
    ----------
    rates, a, forces : (k,) arrays
        Of the joints; their accelerations with the forces; the forces of friction on
        those at rest, N m or N.
    least, largest : (k,) arrays
        Bounds of the forces.
    touching : (k,) array
        As `FrictionState.sides_at`.
    A : (k, k) array
        Acceleration of the joints per unit of each force.
    size : scalar
        The largest acceleration without forces.
    rounding : (k,) array
        Of the accelerations.

    """

    rates: Vector
    a: Vector
    forces: Vector
    least: Vector
    largest: Vector
    touching: Vector
    A: Matrix
    size: Scalar
    rounding: Vector


class AtPlace(NamedTuple):
    """
    Quantities of the search for a root at a place of the part.

    Attributes
    ----------
    x : scalar
        s after the beginning of the part.
    state : (size,) array
    rates : (k,) array
        Of the joints.
    functions : (kinds,) array
        Negative past a transition.
    power : scalar
        Of the friction of joints that slide, W.

    """

    x: Scalar
    state: Vector
    rates: Vector
    functions: Vector
    power: Scalar


def search_shapes(size: int, k: int) -> Search:
    """Return the numbers of entries of the fields of a search."""
    kinds = KINDS * k
    return Search._make([*[1] * SCALARS, size, size, *[k] * 6, *[kinds] * 3, k, k, 1])


def phase_kernels(choice: StepChoice, contact: FrictionState) -> tuple[Kernel, Kernel]:
    """
    Return the kernels of one evaluation of the search: START and SETTLE, and later phases.

    Their arguments: the search, and the inputs of the step as of `step_kernel`.
    """
    transitions = _search_kernel('transitions', _traced_search, choice, contact)
    return settling_kernel(choice, contact), transitions


def settling_kernel(choice: StepChoice, contact: FrictionState) -> Kernel:
    """Return the kernel of START and SETTLE, which integrators share: it has no steps."""
    choice = choice._replace(integrator='rk4')
    return _search_kernel('settling', _traced_settling, choice, contact)


def _search_kernel(kind: str, function: Callable[..., list[Scalar]], choice: StepChoice,
                   contact: FrictionState) -> Kernel:
    """Return the kernel of a traced function of the search."""
    robot = contact.robot
    choice = choice.needed(robot)
    free, inputs, constants = step_signature(robot, choice)
    length = sum(search_shapes(inputs['state'][0], len(contact.joints)))
    # A kernel for each set of joints with friction, with stops or without.
    name = f'{kind}_{free}_{"_".join(map(str, contact.joints))}'
    if contact.stops:
        name += '_stops'
    kernel: Kernel = robot.kernels.compiled(
        partial(function, contact, choice), name,
        {'search': (length,), 'inputs': inputs['inputs']}, (length,), constants=constants)
    return kernel


def settled_modes(kernel: Kernel, contact: FrictionState, state: Array, inputs: Array,
                  constants: Array, step: float) -> FrictionModes | None:
    """
    Return how the joints move from a state on, by the native search; None without a solution.

    Parameters
    ----------
    kernel : Kernel
        `settling_kernel`.
    contact : FrictionState
        Of the robot, with its stops if they act.
    state : array
        Entries as `step_kernels.state_names`; the margin may be missing.
    inputs, constants : arrays
        Arguments of a step that begins at the state.
    step : float
        The length of this step, s.

    """
    places = phase_places(len(state_names(contact.robot)), len(contact.joints))
    # The search begins at the state, with stops where the robot has them.
    search = np.zeros(places.end + 1)
    search[places.phase] = START
    begin = places.state.start
    search[begin:begin + len(state)] = state
    search[places.lower], search[places.upper] = contact.finite_stops
    # The whole step has passed, so that the search ends with the modes.
    search[places.passed] = step
    kernel.iterate(search, [inputs], CALLS, constants=constants)
    if search[places.end] != DONE:
        return None
    return FrictionModes(search[places.directions], search[places.sides])


@cache
def phase_places(size: int, k: int) -> Search:
    """Return where the fields of a search are in its row: slices, and numbers of scalars."""
    shapes = search_shapes(size, k)
    ends = np.cumsum(shapes).tolist()
    slices = [slice(end - count, end) for end, count in zip(ends, shapes)]
    return Search._make([*range(SCALARS), *slices[SCALARS:-1], ends[-1] - 1])


def loop_places(places: Search) -> SearchPlaces:
    """Return where in its row the native loop finds the parts of a search."""
    modes = slice(places.directions.start, places.upper.stop)
    return SearchPlaces(places.phase, places.passed, places.transitions, places.power,
                        places.holds, places.end, modes, places.state)


# The traced search. Conditions are the numbers 0 and 1.


def _fields(contact: FrictionState, row: Vector) -> Search:
    """Return the fields of a traced search."""
    k = len(contact.joints)
    size = (len(row) - sum(search_shapes(0, k))) // 2
    return Search(*(row[at] for at in phase_places(size, k)))


def _entries(search: Search) -> list[Scalar]:
    """Return the row of a search."""
    entries: list[Scalar] = []
    for field in search:
        entries += list(np.ravel(np.asarray(field)))
    return entries


def _traced_settling(contact: FrictionState, choice: StepChoice, row: Vector,
                     inputs: Matrix, constants: Vector) -> list[Scalar]:
    """Return the search after START, or after one change in SETTLE."""
    search = _fields(contact, row)
    step = _step_length(contact, choice, constants)
    # The forces of the joints at rest, for START and for one change of the sets.
    here = _at_rest(contact, choice, search, inputs, constants)
    ones = np.ones(len(contact.joints))
    started = search._replace(phase=SETTLE, directions=_moving(contact, here.rates),
                              held=ones, at_largest=0.0 * ones, trials=0.0)
    settled = _settled(contact, search, here, step)
    return _entries(_where(search.phase < -0.5, started, settled))


def _traced_search(contact: FrictionState, choice: StepChoice, row: Vector,
                   inputs: Matrix, constants: Vector) -> list[Scalar]:
    """Return the search after BEGIN, END or one evaluation in SEARCH."""
    search = _fields(contact, row)
    step = _step_length(contact, choice, constants)
    # One evaluation at the place of the phase: the begin, the end, or within a bracket.
    x = _place(search, step)
    here = _at_place(contact, choice, search, inputs, constants, x)
    begun = search._replace(
        phase=END, at_begin=here.functions, rates=here.rates,
        power=search.power + select(search.transitions < 0.5, here.power, 0.0))
    ended = _ended(search, here, step)
    searched = _searched(search, here)
    # The phase decides which result counts; all are computed, as a trace has no branch.
    late = _where(search.phase > 2.5, searched, ended)
    after = _where(search.phase > 1.5, late, begun)
    return _entries(_located(contact, after, search.phase, step))


def _step_length(contact: FrictionState, choice: StepChoice, constants: Vector) -> Scalar:
    """Return the length of the step, s, which is after the gains."""
    return constants[2 * contact.robot.n if choice.feedback else 0]


def _place(search: Search, step: Scalar) -> Scalar:
    """Return the place to evaluate, s after the beginning of the part."""
    # Regula falsi; bisection at every fourth turn. Never closer to an end of the bracket
    # than what the result needs.
    width = search.high - search.low
    x = search.high - search.f_high * width / (search.f_high - search.f_low)
    x = select(search.turn > 2.5, 0.5 * (search.low + search.high), x)
    resolution = 0.4 * SHORT * step
    x = _largest(x, search.low + resolution)
    x = _least(x, search.high - resolution)
    left = step - search.passed
    return select(search.phase > 2.5, x, select(search.phase > 1.5, left, 0.0))


def _after_part(contact: FrictionState, choice: StepChoice, search: Search,
                inputs: Matrix, constants: Vector,
                x: Scalar) -> tuple[Vector, FrictionMotion]:
    """Return the state at a place, without a step in BEGIN, and the motion to it."""
    # The step of length x, with the inputs at its own begin, middle and end.
    robot = contact.robot
    place = 2 * robot.n if choice.feedback else 0
    step = constants[place]
    constants = np.array([*constants[:place], x, *constants[place + 1:]])
    moments = [search.passed, search.passed + 0.5 * x, search.passed + x]
    inputs = _inputs_at(inputs, [moment / step for moment in moments])

    motions: list[FrictionMotion] = []

    def motion(*arguments: Any) -> FrictionMotion:
        motions.append(FrictionMotion(contact, search.directions, True, *arguments))
        return motions[0]
    end = traced_step(robot, choice, search.state, inputs, constants, motion)
    if contact.constrained:
        modes = np.array([search.directions, search.sides, search.lower, search.upper])
        end = without_drift(contact, modes, end, constants)
    # In BEGIN nothing moves: the state is that of the part's begin.
    moves = search.phase > 1.5
    state = [select(moves, x_end, x_begin) for x_end, x_begin in zip(end, search.state)]
    return np.array(state), motions[0]


def _inputs_at(inputs: Matrix, parts: list[Scalar]) -> Matrix:
    """
    Return the inputs of a part of a step, at three parts of its length.

    The desired motion is the parabola through its values at the beginning, middle and
    end.
    """
    if len(inputs) == 1:  # held torques
        return inputs
    begin, middle, end = inputs
    rows = []
    for s in parts:
        rows.append((2.0 * s - 1.0) * (s - 1.0) * begin + 4.0 * s * (1.0 - s) * middle
                    + s * (2.0 * s - 1.0) * end)
    return np.stack(rows)


def _parts(contact: FrictionState, state: Vector) -> tuple[Vector, Vector, Vector]:
    """Return q, u and, if the equations depend on it, the time of a state."""
    layout = state_layout(contact.robot)
    return state[layout.q], state[layout.u], state[layout.time]


def _at_place(contact: FrictionState, choice: StepChoice, search: Search, inputs: Matrix,
              constants: Vector, x: Scalar) -> AtPlace:
    """Return the state, x s after the beginning of the part, with its functions."""
    robot = contact.robot
    equations: Any = robot.equations
    state, motion = _after_part(contact, choice, search, inputs, constants, x)
    q, u, time = _parts(contact, state)
    # Functions whose roots are transitions, then the power of friction there.
    tau = motion.torque(q, u, 2, *time)
    forces, least, largest = motion.holding(q, u, tau, time)
    least, largest = _with_stops(search.sides, least, largest)
    rates = equations.joint_speeds(q, u, *time)[contact.joints]
    functions = _functions(contact, search, state, rates, forces, least, largest)

    if choice.dual_to is not None:
        tau = tau_from(equations, choice.dual_to, q, tau, *time)
    directions = of_all_joints(equations, contact.joints, search.directions)
    t = time[0] if len(time) else 0.0
    friction = equations.driven_friction(q, equations.joint_speeds(q, u, *time), tau, t,
                                         directions)
    # Friction takes power where joints slide: direction is not 0.
    power: Scalar = 0.0
    for joint, direction, rate in zip(contact.joints, search.directions, rates):
        power = power + direction * direction * magnitude(friction[joint] * rate)
    return AtPlace(x, state, rates, functions, power)


def _at_rest(contact: FrictionState, choice: StepChoice, search: Search, inputs: Matrix,
             constants: Vector) -> AtRest:
    """Return the complementarity problem at the beginning of the part."""
    robot = contact.robot
    equations: Any = robot.equations
    k = len(contact.joints)
    q, u, time = _parts(contact, search.state)

    # The torque at the beginning of the part: all three inputs of the step are those there.
    gains = 2 * robot.n if choice.feedback else 0
    parameters = constants[gains + 1:]
    at_begin = _inputs_at(inputs, [search.passed / constants[gains]] * 3)
    motion = RobotMotion(robot, at_begin, constants[:gains] if choice.feedback else None,
                         parameters, choice.dual_to, False, choice.followed, time, 0.0)
    tau = motion.torque(q, u, 0, *time)
    if choice.dual_to is not None:
        tau = tau_from(equations, choice.dual_to, q, tau, *time)
    t = time[0] if len(time) else 0.0

    # Accelerations a + A f of the joints under forces f, regular where loops couple them.
    results = traced_forces(equations, contact.joints, q, u, tau, search.directions, t,
                            parameters[:robot.parameters.physical])
    _, rates, a, _, A, least, largest, _, _ = np.split(results, contact.ends)
    A = A.reshape(k, k)
    regular = A
    if contact.constrained:
        scale: Scalar = 0.0
        for i in range(k):
            scale = _largest(scale, A[i, i])
        regular = A + REGULAR * scale * np.eye(k)

    # Stops widen the bounds of the joints at rest that touch them.
    resting = _resting(search.directions)
    touching = _sides_at(contact, q, search)
    sides = [side * rests for side, rests in zip(touching, resting)]
    least, largest = _with_stops(sides, least, largest)
    forces = _forces_of_sets(search, resting, regular, a, least, largest)

    # The largest accelerations without forces, by which rounding is judged.
    of_all: Scalar = 0.0
    at_rest: Scalar = 0.0
    for acceleration, rests in zip(a, resting):
        size = magnitude(acceleration)
        of_all = _largest(of_all, size)
        at_rest = _largest(at_rest, size * rests)
    return AtRest(rates, a + regular @ forces, forces, least, largest, np.array(touching),
                  A, of_all, _rounding(regular, forces, at_rest))


def _resting(directions: Vector) -> list[Scalar]:
    """Return 1 for each joint without a direction of sliding, else 0."""
    return [select(direction * direction > 0.5, 0.0, 1.0) for direction in directions]


def _forces_of_sets(search: Search, resting: list[Scalar], A: Matrix, a: Vector,
                    least: Vector, largest: Vector) -> Vector:
    """
    Return the forces, (k,), that the sets of the joints at rest mean.

    Joints at a bound have its force; those that are held have the force that leaves them
    no acceleration.
    """
    # Held joints do not accelerate; the others have the force at their bound.
    held = []
    at_bounds = []
    for j, rests in enumerate(resting):
        is_held = rests * search.held[j]
        bound = select(search.at_largest[j] > 0.5, largest[j], least[j])
        held.append(is_held > 0.5)
        at_bounds.append(select(rests - is_held > 0.5, bound, 0.0))
    # A f = -a in the rows of held joints, with the stated forces of the others.
    stated = np.array(at_bounds)
    return stated - masked_solution(A, held, a + A @ stated)


def _rounding(A: Matrix, forces: Vector, at_rest: Scalar) -> Vector:
    """Return bounds of the rounding errors of the accelerations A forces, (k,)."""
    magnitudes = _magnitudes(forces)
    bounds = []
    for row in A:
        terms = _magnitudes(row) @ magnitudes
        bounds.append(MARGIN * _largest(at_rest, terms))
    return np.array(bounds)


def _with_stops(sides: Vector, least: Vector, largest: Vector) -> tuple[Vector, Vector]:
    """Return bounds of forces, as `friction_state.bounds`."""
    lower = [select(side > 0.5, -FAR, x) for side, x in zip(sides, least)]
    upper = [select(side < -0.5, FAR, x) for side, x in zip(sides, largest)]
    return np.array(lower), np.array(upper)


def _sides_at(contact: FrictionState, q: Vector, search: Search) -> list[Scalar]:
    """Return the stops at which joints are, as `FrictionState.sides_at`."""
    sides: list[Scalar] = []
    for place, low, high, unit in zip(contact.places, search.lower, search.upper,
                                      contact.units):
        # Without a stop or a coordinate, no side.
        if place < 0 or not contact.stops:
            sides.append(0.0)
            continue
        near = TOUCHING * unit * contact.constrained
        below = 1.0 - ((low + near) < q[place])
        above = 1.0 - (q[place] < (high - near))
        sides.append(select(above, 1.0, -below))
    return sides


def _functions(contact: FrictionState, search: Search, state: Vector, rates: Vector,
               forces: Vector, least: Vector, largest: Vector) -> Vector:
    """Return the functions whose roots are transitions, (kinds,), as `_Event`."""
    reversal = []
    forward = []
    backward = []
    distances = []
    for j in range(len(contact.joints)):
        # Sliding joints: their rate along the direction, until it reverses.
        direction = search.directions[j]
        rounding = MARGIN * magnitude(forces[j])
        slides = direction * direction > 0.5
        ahead = direction * rates[j] + contact.slow[j]
        if contact.at_bound[j] > 1.0:  # one at its bound that begins to move slides
            still = 2.0 * contact.slow[j] - magnitude(rates[j])
            ahead = select(direction * direction > 1.5, still, ahead)
        reversal.append(select(slides, ahead, FAR))
        # Held joints: the distance of the force from either bound.
        forward.append(select(slides, FAR, forces[j] - least[j] + rounding))
        backward.append(select(slides, FAR, largest[j] - forces[j] + rounding))
        # Joints that do not press against a stop: the distance to the nearer one.
        distance: Scalar = FAR
        if contact.stops and contact.places[j] >= 0:
            position = state[contact.places[j]]
            side = search.sides[j]
            nearer = _least(position - search.lower[j], search.upper[j] - position)
            distance = select(side * side > 0.5, FAR, nearer)
        distances.append(distance)
    return np.array([*reversal, *forward, *backward, *distances])


def _moving(contact: FrictionState, rates: Vector) -> Vector:
    """Return the directions of motion of the joints, 0 of those that have stopped."""
    directions = []
    for rate, slow in zip(rates, contact.slow):
        # Twice the rate at which a joint that stops has stopped, but for rounding.
        directions.append(select(2.0 * slow < magnitude(rate), _sign(rate), 0.0))
    return np.array(directions)


def _settled(contact: FrictionState, search: Search, here: AtRest,
             step: Scalar) -> Search:
    """Return the search after one change of the complementarity problem at its begin."""
    resting = _resting(search.directions)
    sets = _first_wrong_changed(search, here, resting)

    # When the sets are right, joints whose friction does not hold them begin to slide.
    sliding = _sliding(search, here, resting, sets.right)
    settled = sets.right * sliding.nothing
    directions = sliding.directions
    trials = search.trials
    if contact.constrained:
        saturated = _saturated(contact, resting, search.directions, here)
        directions = _selected(settled, saturated, directions)
    if contact.drops:
        tried = _tried(contact, search, here, saturated)
        tries = settled * (1.0 - tried.nothing)
        directions = _selected(tries, tried.directions, directions)
        settled = settled - tries
        trials = trials + tries

    # For the others that rest, the problem is then another one.
    starts_again = sets.right * (1.0 - settled)
    k = len(contact.joints)
    held = _selected(starts_again, np.ones(k), sets.held)
    at_largest = _selected(starts_again, np.zeros(k), sets.at_largest)

    # Whether any joint sticks from here on; a very short remainder of the step is left
    # out.
    still = np.array(_resting(directions))
    holds: Scalar = 0.0
    for rests in still:
        holds = _largest(holds, rests)
    short = 1.0 - (SHORT * step < step - search.passed)
    refused = trials > TRIALS * k + 0.5
    return search._replace(phase=select(settled > 0.5, BEGIN, SETTLE), trials=trials,
                           directions=directions, sides=here.touching * still,
                           rates=here.rates, holds=holds, held=held,
                           at_largest=at_largest,
                           end=select(refused, REFUSED, settled * short * DONE))


class _Sets(NamedTuple):
    """Sets of joints at rest, 1 for members; `right` is 1 if no joint contradicts them."""

    held: Vector
    at_largest: Vector
    right: Scalar


def _first_wrong_changed(search: Search, here: AtRest, resting: list[Scalar]) -> _Sets:
    """
    Return the sets after the first wrong joint at rest has changed its set.

    A held joint is wrong if it needs more force than friction has, and is then at that
    bound; one at a bound is wrong if it accelerates along the force, and is then held.
    """
    right: Scalar = 1.0  # of the joints so far
    held = []
    at_largest = []
    for j, rests in enumerate(resting):
        # A held joint is wrong beyond a bound; one at its bound, if it accelerates back.
        force = here.forces[j]
        least = here.least[j]
        largest = here.largest[j]
        above = (largest + MARGIN * magnitude(largest)) < force
        below = force < (least - MARGIN * magnitude(least))
        exceeds = select(above, 1.0, below)
        along = select(search.at_largest[j] > 0.5, here.rounding[j] < here.a[j],
                       here.a[j] < -here.rounding[j])
        wrong = rests * select(search.held[j] > 0.5, exceeds, along)
        # Only the first wrong one changes, as in `friction.held_forces`.
        changes = right * wrong > 0.5
        right = right * (1.0 - wrong)
        held.append(select(changes, 1.0 - search.held[j], search.held[j]))
        at_largest.append(select(changes, largest < force, search.at_largest[j]))
    return _Sets(np.array(held), np.array(at_largest), right)


class _Sliding(NamedTuple):
    """Directions of motion; `nothing` is 1 if no joint begins to slide."""

    directions: Vector
    nothing: Scalar


def _sliding(search: Search, here: AtRest, resting: list[Scalar],
             right: Scalar) -> _Sliding:
    """Return the directions after joints at rest that accelerate begin to slide."""
    # 1 until a joint begins to slide.
    nothing: Scalar = 1.0
    directions = []
    for direction, rests, a in zip(search.directions, resting, here.a):
        begins = right * rests * (NEGLIGIBLE * here.size < magnitude(a))
        nothing = nothing * (1.0 - begins)
        directions.append(select(begins > 0.5, _sign(a), direction))
    return _Sliding(np.array(directions), nothing)


def _tried(contact: FrictionState, search: Search, here: AtRest,
           saturated: Vector) -> _Sliding:
    """
    Return directions as `FrictionState._returns`, else as `FrictionState._break_away`.

    `saturated` are the directions that joints at their bounds have otherwise.
    """
    of_drops = [_magnitudes(row) @ contact.drop for row in here.A]

    # The first joint that does not accelerate in its direction of sliding is held.
    returning: Scalar = 0.0
    reached: Scalar = 0.0
    directions = []
    for j, direction in enumerate(search.directions):
        is_at_bound = direction * direction > 1.5
        zero = NEGLIGIBLE * (of_drops[j] + here.size)
        least = -zero
        if contact.drop[j]:
            least = select(is_at_bound, -zero, zero)
        starts = (direction * direction > 0.5) * (
            1.0 - (2.0 * contact.slow[j] < magnitude(here.rates[j])))
        reached = _largest(reached, starts)
        wrong = starts * (1.0 - (least < _sign(direction) * here.a[j]))
        changes = wrong * (1.0 - returning)
        returning = _largest(returning, wrong)
        directions.append(select(changes > 0.5, 0.0, direction))

    # The accelerations due to the drops, while joints at rest are held by any force.
    at_bounds = []
    drops = []
    for direction, drop in zip(saturated, contact.drop):
        is_at_bound = direction * direction > 1.5
        at_bounds.append(is_at_bound)
        drops.append(select(is_at_bound, _sign(direction) * drop, 0.0))
    response = here.A @ np.array(drops)
    held = [rests > 0.5 for rests in _resting(saturated)]
    response = response - here.A @ held_response(here.A, held, response)

    # Those whose friction drops along the motion break away together.
    breaks: Scalar = 0.0
    sliding = []
    for direction, is_at_bound, a, size in zip(saturated, at_bounds, response, of_drops):
        begins = is_at_bound * (NEGLIGIBLE * size < _sign(direction) * a)
        breaks = _largest(breaks, begins)
        dropped = select(begins > 0.5, _sign(direction), 0.0)
        sliding.append(select(is_at_bound, dropped, direction))
    breaks = breaks * reached
    changed = _selected(returning, np.array(directions), np.array(sliding))
    return _Sliding(changed, (1.0 - returning) * (1.0 - breaks))


def _magnitudes(values: Vector) -> Vector:
    """Return the magnitudes of numbers."""
    return np.array([magnitude(value) for value in values])


def _selected(condition: Scalar, of_one: Vector, otherwise: Vector) -> Vector:
    """Return one vector where a scalar is 1, another where it is 0."""
    return np.array([select(condition > 0.5, x, y) for x, y in zip(of_one, otherwise)])


def _saturated(contact: FrictionState, resting: list[Scalar], directions: Vector,
               here: AtRest) -> Vector:
    """Return directions of joints at rest as `FrictionState._saturate`."""
    # Joints within their bounds rest; those at a bound get the direction of sliding.
    between = []
    any_between: Scalar = 0.0
    for rests, f, low, high in zip(resting, here.forces, here.least, here.largest):
        between.append(rests * (low < f) * (f < high))
        any_between = _largest(any_between, between[-1])
    result = []
    for direction, rests, inside, f, low, size in zip(
            directions, resting, between, here.forces, here.least, contact.at_bound):
        at_bound = size * select(low < f, -1.0, 1.0)
        of_joint = select(inside > 0.5, 0.0, at_bound)
        result.append(select(any_between * rests > 0.5, of_joint, direction))
    return np.array(result)


def _ended(search: Search, here: AtPlace, step: Scalar) -> Search:
    """Return the search at the end of the step: done, or with the bracket of a root."""
    # Functions of different kinds are compared by their own sizes within the step.
    sizes = []
    for begin, end in zip(search.at_begin, here.functions):
        largest = _largest(magnitude(begin), magnitude(end))
        infinite = magnitude(end) > 0.5 * FAR
        sizes.append(select(infinite, 1.0, select(largest > 0.0, largest, 1.0)))
    size = np.array(sizes)
    happens = _smallest(here.functions) < 0.0
    # Nothing happens: the step ends. Otherwise the root is bracketed by begin and end.
    left = step - search.passed

    def kept(x: Any, y: Any) -> Any:
        return _chosen(happens, x, y)
    return search._replace(
        phase=select(happens, SEARCH, END), turn=0.0,
        passed=select(happens, search.passed, step),
        power=search.power + select(happens, 0.0, here.power),
        low=0.0, high=left, f_low=_smallest(search.at_begin / size),
        f_high=_smallest(here.functions / size), last=0.0,
        state=kept(search.state, here.state), state_high=here.state,
        rates=kept(search.rates, here.rates), rates_high=here.rates,
        at_high=here.functions, size=size, end=select(happens, 0.0, DONE))


def _searched(search: Search, here: AtPlace) -> Search:
    """Return the search with a smaller bracket."""
    # The function is negative past the first transition of any kind.
    f = _smallest(here.functions / search.size)
    past = f < 0.0
    low = search.low
    high = search.high
    x = here.x
    # An end that stays twice has half of its value (Illinois).
    f_low = select(search.last < -0.5, 0.5 * search.f_low, search.f_low)
    f_high = select(search.last > 0.5, 0.5 * search.f_high, search.f_high)
    # The new place becomes one end of the bracket.
    return search._replace(
        turn=select(search.turn > 2.5, 0.0, search.turn + 1.0),
        low=select(past, low, x), high=select(past, x, high),
        f_low=select(past, f_low, f), f_high=select(past, f, f_high),
        last=select(past, -1.0, 1.0),
        state_high=_chosen(past, here.state, search.state_high),
        rates_high=_chosen(past, here.rates, search.rates_high),
        at_high=_chosen(past, here.functions, search.at_high))


def _located(contact: FrictionState, search: Search, phase: Scalar,
             step: Scalar) -> Search:
    """Return the search after a transition, if one is located; `phase` was its last phase."""
    robot = contact.robot
    searches = (search.phase > 2.5) * (phase > 1.5)
    at_once = search.f_low < 0.0
    wide = (SHORT * step < search.high - search.low) * (search.f_high < -ROOT)
    located = searches * _largest(at_once, 1.0 - wide) > 0.5
    state = _chosen(at_once, search.state, search.state_high)
    rates = _chosen(at_once, search.rates, search.rates_high)
    functions = _chosen(at_once, search.at_begin, search.at_high)
    reversal, forward, backward, distances = np.split(functions, KINDS)

    # A joint of a tree that stops has no rate, which is zero but for the root's error.
    if not contact.constrained:
        for j, joint in enumerate(contact.joints):
            place = robot.n_q + joint
            state[place] = select(reversal[j] > 0.0, state[place], 0.0)
            rates[j] = select(reversal[j] > 0.0, rates[j], 0.0)

    # Without time since the last transition, joints at their bounds stay there, as in
    # `sticking_steps`: set free again, those of a loop would take turns without end.
    directions = []
    for j, direction in enumerate(_moving(contact, rates)):
        stays = at_once * (reversal[j] > 0.0)
        direction = select(stays > 0.5, search.directions[j], direction)
        direction = select(forward[j] > 0.0, direction, contact.at_bound[j])
        directions.append(select(backward[j] > 0.0, direction, -contact.at_bound[j]))
    hits = 1.0 - (_smallest(distances) > 0.0)
    transitions = search.transitions + 1.0
    refused = _largest(hits, transitions > MOST - 0.5)
    ones = np.ones(len(contact.joints))
    after = search._replace(
        phase=SETTLE, transitions=transitions, trials=0.0, state=state,
        directions=np.array(directions),
        passed=search.passed + select(at_once, 0.0, search.high), held=ones,
        at_largest=0.0 * ones, end=refused * REFUSED)
    return _where(located, after, search)


def _where(condition: Scalar, x: Search, y: Search) -> Search:
    """Return one of two searches."""
    return Search(*(_chosen(condition, a, b) for a, b in zip(x, y)))


def _chosen(condition: Scalar, x: Any, y: Any) -> Any:
    """Return x if a condition holds, else y: scalars or arrays."""
    if np.ndim(x) == 0:
        return select(condition, x, y)
    return np.array([select(condition, a, b) for a, b in zip(x, y)])


def _least(x: Scalar, y: Scalar) -> Scalar:
    """Return the lesser number."""
    return select(x < y, x, y)


def _largest(x: Scalar, y: Scalar) -> Scalar:
    """Return the larger number."""
    return select(x < y, y, x)


def _smallest(values: Vector) -> Scalar:
    """Return the least of several numbers."""
    result = values[0]
    for value in values[1:]:
        result = _least(value, result)
    return result


def _sign(x: Scalar) -> Scalar:
    """Return the sign of a number that is not zero."""
    return select(x < 0.0, -1.0, 1.0)
