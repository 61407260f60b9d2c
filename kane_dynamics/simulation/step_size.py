"""The longest stable Runge-Kutta step with a robot's friction, springs and beams."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
import math
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from kane_dynamics._util.checks import constant, instance
from kane_dynamics._util.typing import Array, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.elastic_joints import steepest_slope
from kane_dynamics.mechanics.friction import (bristle_decay, damping_range,
                                              has_bristles, has_friction)
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.model.drive import StiffnessCurve
from kane_dynamics.model.model import Joint, Model
from kane_dynamics.robot.robot import Robot
import numpy as np

REAL_RADIUS = 2.785  # of the region of stability along the negative real axis
# Fields of a joint whose friction does not depend on the direction of motion.
SLIDELESS: dict[str, Any] = {
    'friction': 0.0, 'friction_backward': None, 'breakaway_friction': None,
    'load_friction': 0.0, 'load_friction_backdriven': None, 'presliding_stiffness': 0.0,
    'presliding_damping': 0.0}
DIFFERENCE = 1e-6  # rad, m and their rates: small compared to the friction speed
ANGLES = np.linspace(0.5 * np.pi, np.pi, 181)


class LongestStep(NamedTuple):
    """
    The longest stable step, and the speed that limits it.

    Attributes
    ----------
    step : float
        s; infinite without a limit.
    name : str
        The speed with the largest amplitude in the least stable mode.

    """

    step: float
    name: str = ''


def longest_step(robot: Robot, q: Any, u: Any = None, *, t: float = 0.0) -> LongestStep:
    """
    Return the longest Runge-Kutta step that is stable near a state.

    The equations are linearised about the state, x' = J x. A step h multiplies the part
    of x of an eigenvalue of J by R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24, z = h times the
    eigenvalue, and ``|R| <= 1`` is required (Hairer & Wanner, Solving Ordinary
    Differential Equations II, section IV.2). The limit is most often smoothed Coulomb
    friction: the slope of mu tanh(u / u_s) at rest, mu / u_s, over a small inertia.

    A curve of stiffness counts with its steepest segment, wherever its drive is. Bristles
    (`presliding_stiffness`) count as springs and dampers before they slide, and with the
    rate at which they settle at the speeds u.

    In a motion the limit of a beam or spring changes with the configuration and the
    speeds: take the least over the states of the motion. A stable step is not an
    accurate one. Vibrations near the limit lose their energy within a few steps, which
    the energy balance of `simulate` reports.

    Parameters
    ----------
    robot : Robot
        With its current parameters.
    q : (n_q,) array
        The configuration, rad or m, with closed loops.
    u : (n,) array, optional
        The speeds, rad/s or m/s. Default: rest, where friction limits the step most.
    t : float
        Time, s.

    Raises
    ------
    InputError
        q or u is not an array of finite numbers; or as `Robot.forward_dynamics`.

    """
    instance(robot, Robot, 'robot')
    q, n = constant(q, (robot.n_q,), 'q', InputError), robot.n
    u = np.zeros(n) if u is None else constant(u, (n,), 'u', InputError)
    if not (n and _may_limit_step(robot.model, robot.friction)):
        return LongestStep(math.inf)
    bristles = settling_step(robot, q, u, t)
    values, vectors = np.linalg.eig(_stiff_matrix(robot, q, u, t))
    # The step limit of an eigenvalue depends on its angle. An unstable equilibrium (an
    # inverted arm) does not limit the step.
    angles = np.angle(np.minimum(values.real, 0.0) + 1j * np.abs(values.imag))
    with np.errstate(divide='ignore'):
        steps = np.interp(angles, ANGLES, _radii()) / np.abs(values)
    worst = int(np.argmin(steps))
    speed = int(np.argmax(np.abs(vectors[n:, worst])))
    if bristles.step < steps[worst]:
        return bristles
    return LongestStep(float(steps[worst]), robot.speed_names[speed])


def settling_step(robot: Robot, q: Array, u: Array, t: float) -> LongestStep:
    """Return the longest stable step with the bristles of sliding joints."""
    joints = robot.equations.tree.bristles
    if not joints:
        return LongestStep(math.inf)
    # The bristles that settle fastest bound the step, as real negative eigenvalues.
    v = np.array(robot.equations.joint_speeds(q, u, t), dtype=np.float64)
    decays = settling_rates(robot, v[None])[0]
    fastest = int(np.argmax(decays))
    with np.errstate(divide='ignore'):
        step = float(REAL_RADIUS / decays[fastest])
    return LongestStep(step, joints[fastest].name)


def settling_rates(robot: Robot, v: Array) -> Array:
    """Return the rates at which bristles settle, (K, n_b), 1/s, at joint rates (K, n_j)."""
    joints = robot.equations.tree.bristles

    def rates(v: Vector) -> Vector:
        return np.array([bristle_decay(joint, joint.multiplier * v[joint.coordinate])
                         for joint in joints])
    kernel = robot.compiled(rates, name='settling_rates', v=(robot.model.n,),
                            shape=(len(joints),))
    result: Array = kernel(v)
    return result


def _state_matrix(robot: Robot, q: Array, u: Array, t: float) -> Array:
    """
    Return J, (2 n, 2 n), of the equations linearised about a state, by central differences.

    Its coordinates are changes of q along the partial rates of the joints, and changes
    of u. Along these rates loops stay closed to first order, and the residual of second
    order is equal on both sides of a difference.
    """
    n = robot.n
    # Partial rates of the joints: q' at unit speeds minus q' at none.
    units = DIFFERENCE * np.eye(n)
    partial_rates = units
    if not robot.equations.in_joint_rates:
        rates = robot.joint_rates(np.tile(q, (n + 1, 1)),
                                  np.concatenate([np.zeros((1, n)), units]), t=t)
        partial_rates = rates[1:] - rates[0]

    # Rows of displacements: first of u, then of q, on both sides of the state.
    dq, du = np.zeros((2 * n, robot.n_q)), np.zeros((2 * n, n))
    du[:n] = units
    dq[n:] = partial_rates
    udot = robot.forward_dynamics(np.concatenate([q + dq, q - dq]),
                                  np.concatenate([u + du, u - du]), np.zeros((4 * n, n)),
                                  t=t)
    slopes = (udot[:2 * n] - udot[2 * n:]).T / (2.0 * DIFFERENCE)

    # x = (changes of q along the partial rates, changes of u).
    matrix = np.zeros((2 * n, 2 * n))
    matrix[:n, n:] = np.eye(n)
    matrix[n:, :n] = slopes[:, n:]
    matrix[n:, n:] = slopes[:, :n]
    return matrix


def _stiff_matrix(robot: Robot, q: Array, u: Array, t: float) -> Array:
    """Return `_state_matrix` with the steepest springs, and bristles that do not slide."""
    matrix = _state_matrix(_with_bound_bristles(_steepest(robot)), q, u, t)
    matrix[robot.n:, :robot.n] -= _bristle_stiffness(robot, q, t)
    return matrix


def is_clearly_stable(robot: Robot, q: Array, step: float, t: float) -> bool:
    """
    Return whether a bound of all eigenvalues shows that a step is stable at rest.

    With rows of accelerations by q and by u, J = [[0, 1], [A, B]], every eigenvalue has a
    magnitude of at most sqrt(norm(A)) + norm(B): a norm of J with u scaled by sqrt(norm(A)).
    """
    n = robot.n
    if not (n and _may_limit_step(robot.model, robot.friction)):
        return True
    # Gershgorin: no eigenvalue is larger than a sum of absolute entries of a row.
    rows = np.abs(_stiff_matrix(robot, q, np.zeros(n), t)[n:])
    by_q = float(rows[:, :n].sum(axis=1).max())
    by_u = float(rows[:, n:].sum(axis=1).max())
    return step * (math.sqrt(by_q) + by_u) <= float(_radii().min())


def step_warning(robot: Robot, q: Any, step: float, integrator: str = 'rk4',
                 t: float = 0.0) -> str | None:
    """Return the warning for a step, s, that is too long at a configuration, else None."""
    # Most steps are far from the limit, which a bound shows without eigenvalues.
    if integrator_of(integrator).damps or is_clearly_stable(robot, q, step, t):
        return None
    longest, name = longest_step(robot, q, t=t)
    if step <= longest:
        return None
    return (f"a step of {step:g} s is too long for '{name}'; expected at most "
            f'{longest:.2g} s near rest with its friction, springs or bending. With a '
            'longer step it oscillates or creeps instead of resting. Use the '
            "integrator 'implicit', or shorten the step")


def stable_integrator(robot: Robot, q: Array, step: float, integrator: str | None,
                      t: float) -> tuple[str, str | None]:
    """
    Return the integrator of a simulation, and the warning about its step or its choice, if any.

    `q` has the first initial configuration as its only row; no row without initial
    states.
    """
    if not len(q):
        # No simulation, no step.
        return integrator or 'rk4', None
    if integrator is not None:
        return integrator, step_warning(robot, q[0], step, integrator, t)
    # Bristles settle faster the faster a joint slides, so that no step is safe for rk4.
    if robot.equations.tree.bristles:
        return 'implicit', None  # how fast bristles settle depends on the rate
    if is_clearly_stable(robot, q[0], step, t):
        return 'rk4', None
    longest, name = longest_step(robot, q[0], t=t)
    if step <= longest:
        return 'rk4', None
    return 'implicit', (f"integrator 'implicit' is used: a step of {step:g} s is too "
                        f"long for '{name}' with 'rk4', which needs at most "
                        f'{longest:.2g} s with its friction, springs or bending')


def possible_integrators(robot: Robot, integrator: str | None) -> tuple[str, ...]:
    """Return the integrators that `stable_integrator` may return for a robot."""
    if integrator is not None:
        return (integrator,)
    if robot.equations.tree.bristles:
        return ('implicit',)
    if _may_limit_step(robot.model, robot.friction):
        return 'rk4', 'implicit'
    return ('rk4',)


_CHANGED: WeakKeyDictionary[Robot, dict[str, Robot]] = WeakKeyDictionary()


def _with_changed_joints(robot: Robot, name: str,
                         changed: Callable[[Joint], Joint]) -> Robot:
    """
    Return a robot with changed joints, in its present gravity and with its payload.

    It is compiled once for each robot and `name` of a change.
    """
    others = _CHANGED.setdefault(robot, {})
    # Robots are made once; the parameters are copied at each call.
    if name not in others:
        bodies = []
        for body in robot.model.bodies:
            bodies.append(replace(body, joint=changed(body.joint)))
        others[name] = Robot(replace(robot.model, bodies=tuple(bodies)), **robot.options)
    other = others[name]
    other.parameters.block[:] = robot.parameters.block
    return other


def _steepest(robot: Robot) -> Robot:
    """Return a robot whose drives have the steepest stiffness of their curves."""
    curves = [elastic for elastic in robot.model.drives
              if isinstance(elastic.drive.stiffness, StiffnessCurve)]
    if not curves:
        return robot

    # The slope of a curve varies; the steepest segment bounds the frequency.
    def changed(joint: Joint) -> Joint:
        drive = joint.drive
        if drive is None or not isinstance(drive.stiffness, StiffnessCurve):
            return joint
        return replace(joint, drive=replace(drive, stiffness=steepest_slope(drive)))
    return _with_changed_joints(robot, 'steepest', changed)


def _bristle_stiffness(robot: Robot, q: Array, t: float) -> Any:
    """Return M^-1 T^T S T, (n, n), with the stiffnesses S of bristles that do not slide."""
    equations: Any = robot.equations
    joints = equations.tree.bristles
    if not joints:
        return 0.0
    # The stiffness of the joints, projected on the independent speeds: M^-1 T^T S T.
    S = np.zeros((robot.model.n, robot.model.n))
    for joint in joints:
        k = joint.coordinate
        S[k, k] += joint.multiplier**2 * joint.presliding_stiffness
    T = np.eye(robot.n)
    if not equations.in_joint_rates:
        T = np.array(equations.at_rest(q, t).T, dtype=float)
    return robot.inverse_mass_matrix(q, t=t) @ T.T @ S @ T


def bristle_frequency(robot: Robot, q: Array, t: float) -> float:
    """Return the highest frequency of a robot on bristles that do not slide, rad/s."""
    values = np.linalg.eigvals(_bristle_stiffness(robot, q, t))
    return float(np.sqrt(np.abs(values).max(initial=0.0)))


def _with_bound_bristles(robot: Robot) -> Robot:
    """Return a robot with the dampers of bristles that do not slide, without friction."""
    if not robot.equations.tree.bristles:
        return robot

    # A bristle that does not slide is a spring with its damper between link and joint.
    def changed(joint: Joint) -> Joint:
        if not has_bristles(joint):
            return joint
        largest = damping_range(joint)[1] + joint.presliding_damping
        return replace(joint, damping=largest, fast_damping=None, **SLIDELESS)
    return _with_changed_joints(robot, 'bound bristles', changed)


def without_coulomb(robot: Robot) -> Robot:
    """Return a robot whose friction does not depend on the direction of motion."""
    return _with_changed_joints(robot, 'without Coulomb friction',
                                lambda joint: replace(joint, **SLIDELESS))


def _may_limit_step(model: Model, friction: bool) -> bool:
    """Return whether friction, springs or beams may limit the step."""
    for body in model.bodies:
        joint = body.joint
        if body.beam is not None or joint.stiffness or joint.drive:
            return True
        if friction and has_friction(joint):
            return True
    return False


@cache
def _radii() -> Array:
    """Return the radius of the region ``|R(z)| <= 1`` at each of `ANGLES`."""
    # Bisection for the largest radius inside the region, along each angle.
    low = np.zeros(len(ANGLES))
    high = np.full(len(ANGLES), 4.0)
    for _ in range(50):  # bisections
        middle = 0.5 * (low + high)
        z = middle * np.exp(1j * ANGLES)
        R = 1.0 + z * (1.0 + z * (1.0 + z * (1.0 + z / 4.0) / 3.0) / 2.0)
        inside = np.abs(R) <= 1.0
        low = np.where(inside, middle, low)
        high = np.where(inside, high, middle)
    return low
