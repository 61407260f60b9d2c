"""
The friction law of a joint.

With the rate v of the joint and the load L on its drive, the torque that overcomes
friction is

    friction(v, L) = D(v) v + offset + (level(v) + mu |L|) y + (h + k L) y^2
    y = tanh(v / u_s),    level(v) = mu_c + e exp(-(v / v_s)^2)
    D(v) = d_f + (d - d_f) / (1 + |v| / v_d)

with the fields of `model.Joint`: ``damping`` d, ``fast_damping`` d_f, ``damping_speed``
v_d, ``friction_offset``, ``friction_speed`` u_s and ``stribeck_speed`` v_s. Where y is 1 or
-1, Coulomb friction is ``friction`` for positive and ``friction_backward`` for negative
rates: mu_c is their mean, h half their difference. Stribeck friction e is what
``breakaway_friction`` exceeds ``friction`` by, in both directions. Load friction is
``load_friction`` times abs(L) where the motor drives the load, L v > 0, and
``load_friction_backdriven`` times abs(L) where the load drives the motor: mu is the mean of
both, k half their difference.

The load is the torque of the motor less friction, as it accelerates the bodies and the
rotor and holds gravity, springs and external wrenches:

    tau = L + friction(v, L)

Inverse dynamics knows L. Forward dynamics knows tau, and `load_of_drive` solves this
equation for L, joint by joint. The solution is unique where the right side grows with L
at all rates. Of other drives, such as self-locking ones (``load_friction_backdriven`` of
1 or more), `require_solvable` refuses forward dynamics with this smooth law.

With ``presliding_stiffness`` s, friction in simulations has a state of its own, the
deflection z of bristles (Dahl 1968; LuGre: Canudas de Wit, Olsson, Astrom & Lischinsky,
IEEE Trans. Automatic Control 40 (1995)):

    z' = v - s |v| z / g(v, L)
    F = D(v) v + offset + s z + s_d z'

with ``presliding_damping`` s_d and the friction g of sliding, ``level(v) + mu |L|`` in
the direction of motion. In steady sliding F is the law above with y of 1 or -1. The load of
g is that of a motor whose friction is F without s_d z'. All other quantities have the law
above, in which the bristles have no part.

The feedforward of a command does not need the torque of a joint that moves alone: at rest
and at reversals friction takes any value of an interval. `feedforward_direction` is the y of
a command, one of three choices, with the desired rate and acceleration v and a:

    desired_speed   y = tanh(v / u_s)
    ahead           y = tanh((v + lead) / u_s),    lead = u_s tanh(T a / u_s)
    none            y = 0 up to u_s, then share(v) tanh(v / u_s), all of it from 2 u_s on

The speed that the desired acceleration adds in a time T, by default u_s / (1 rad/s^2), is
bounded by u_s: as a motion begins, friction is there before the rate, and at a reversal
its sign changes no earlier than at the rate u_s, however large the acceleration. Nothing
measured is part of y, so that the friction of a command does not chatter.

All formulations of the dynamics, the integrators and identification use the functions
below; to change or to extend the law, edit them and the fields of `model.Joint`. They
run over any scalar.
"""

from typing import Any

from kane_dynamics._util.typing import Scalar
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import magnitude, select
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.model.model import Joint, Model
import numpy as np

# Choices of the friction that a command compensates at rest and at reversals.
DESIRED_SPEED, AHEAD, NO_FRICTION = FEEDFORWARD = ('desired_speed', 'ahead', 'none')
BREAKAWAY_ACCELERATION = 1.0  # rad/s^2 or m/s^2: 'ahead' has most of its y at rest there

AT_BOUND = 2.0  # direction of a joint that others hold at the bound of its friction

UNLIMITED = 1e30  # N m or N: friction of a self-locking drive, force of a stop


def coulomb(rate: Scalar, friction_speed: Scalar) -> Scalar:
    """Return smoothed Coulomb friction of 1 N m or N: tanh(rate / friction_speed)."""
    return np.tanh(rate * (1.0 / friction_speed))


def has_dry_friction(joint: Joint) -> bool:
    """Return whether a joint has friction that depends on the direction of motion."""
    return bool(not is_zero(joint.friction) or joint.friction_backward
                or joint.breakaway_friction or carries_load(joint))


def is_nonlinear(joint: Joint) -> bool:
    """Return whether the friction of a joint is more than damping times its rate."""
    return bool(has_dry_friction(joint) or has_curved_damping(joint))


def has_curved_damping(joint: Joint) -> bool:
    """Return whether viscous friction is not in proportion to the rate."""
    return joint.fast_damping is not None


def damping_range(joint: Joint) -> tuple[Any, Any]:
    """Return the least and the largest slope of viscous friction, N m s/rad or N s/m."""
    if joint.fast_damping is None:
        return joint.damping, joint.damping
    return min(joint.damping, joint.fast_damping), max(joint.damping, joint.fast_damping)


def has_linear_damping(joint: Joint) -> bool:
    """Return whether friction in one direction is linear in the rate, but for its smoothing."""
    stribeck = joint.stribeck_speed and stribeck_excess(joint)
    return not (has_curved_damping(joint) or stribeck)


def has_friction(joint: Joint) -> bool:
    """Return whether a joint has friction of any kind."""
    return bool(joint.damping or joint.fast_damping or has_dry_friction(joint))


def carries_load(joint: Joint) -> bool:
    """Return whether the friction of a joint depends on the torque that it transmits."""
    return bool(joint.load_friction or joint.load_friction_backdriven)


def carries_loads(model: Model) -> bool:
    """Return whether the friction of any joint depends on the torque that it transmits."""
    return any(carries_load(body.joint) for body in model.bodies)


def coulomb_levels(joint: Joint) -> tuple[Any, Any]:
    """Return Coulomb friction for positive and for negative rates, N m or N."""
    backward = joint.friction_backward
    return joint.friction, joint.friction if backward is None else backward


def stribeck_excess(joint: Joint) -> Any:
    """Return the excess of breakaway friction over Coulomb friction, N m or N."""
    if joint.breakaway_friction is None:
        return 0.0
    return joint.breakaway_friction - joint.friction


def load_fractions(joint: Joint) -> tuple[Any, Any]:
    """Return load friction per unit of load, of a driving and of a backdriven motor."""
    backdriven = joint.load_friction_backdriven
    return joint.load_friction, joint.load_friction if backdriven is None else backdriven


def has_breakaway_drop(joint: Joint) -> bool:
    """Return whether friction falls at once where a joint begins to slide."""
    return bool(stribeck_excess(joint) and not joint.stribeck_speed)


def _of_sliding(joint: Joint, direction: Scalar) -> Scalar:
    """Return the direction of sliding, -1 to 1, of a joint that may be at its bound."""
    return direction_of_sliding(direction) if has_breakaway_drop(joint) else direction


def direction_of_sliding(direction: Scalar) -> Scalar:
    """Return -1 or 1 of a direction of sliding, which may be times `AT_BOUND`."""
    return select(direction * direction > 1.5, direction / AT_BOUND, direction)


def friction_torque(joint: Joint, rate: Scalar, load: Scalar = 0.0,
                    direction: Scalar = None) -> Scalar:
    """
    Return the torque that overcomes a joint's friction, N m or N.

    Parameters
    ----------
    joint : Joint
        With the parameters of the law.
    rate : scalar
        rad/s or m/s.
    load : scalar
        The load on the drive, N m or N.
    direction : scalar, optional
        Direction of sliding, -1 or 1, of the set-valued law; times `AT_BOUND` of a joint
        at rest, with breakaway friction. Default: the smooth law's
        ``tanh(rate / friction_speed)``.

    """
    # The terms of the law in the module's text: viscous, then those with y and y^2,
    # then the offset.
    torque = _viscous(joint, rate)
    if has_dry_friction(joint):
        if direction is None:
            y = coulomb(rate, joint.friction_speed)
        else:
            y = _of_sliding(joint, direction)
            if has_breakaway_drop(joint):
                torque = torque + stribeck_excess(joint) * (direction - y)
        level, half_difference = _sliding_levels(joint, rate, load)
        torque = torque + level * y
        if half_difference is not None:
            torque = torque + half_difference * (y * y)
    return torque + joint.friction_offset


def checked_feedforward(choice: Any) -> str | float:
    """Return a checked choice of the friction that commands compensate."""
    if isinstance(choice, str) and choice in FEEDFORWARD:
        return choice
    is_number = isinstance(choice, int | float | np.integer | np.floating)
    if is_number and not isinstance(choice, bool) and 0.0 < choice < np.inf:
        return float(choice)
    raise InputError(f'feedforward_friction: {choice!r}; expected one of '
                     f'{", ".join(FEEDFORWARD)}, or the time ahead, s, a positive number')


def feedforward_direction(joint: Joint, rate: Scalar, acceleration: Scalar,
                          choice: str | float) -> Scalar:
    """
    Return the direction y of friction that a command compensates, -1 to 1.

    Parameters
    ----------
    joint : Joint
        With the parameters of the law.
    rate, acceleration : scalar
        Desired, rad/s and rad/s^2, or m/s and m/s^2.
    choice : str or float
        One of `FEEDFORWARD`; or the time T of 'ahead', s.

    """
    width = joint.friction_speed
    if choice == DESIRED_SPEED:
        return coulomb(rate, width)
    if choice == NO_FRICTION:
        # Without friction up to the width, and continuous.
        beyond = magnitude(rate) * (1.0 / width) - 1.0
        share = select(beyond < 0.0, 0.0, select(beyond < 1.0, beyond, 1.0))
        return share * coulomb(rate, width)
    # By the time 'ahead', in which the rate changes by at most the width.
    time_over_width = 1.0 / BREAKAWAY_ACCELERATION
    if not isinstance(choice, str):
        time_over_width = choice / width
    lead = width * np.tanh(time_over_width * acceleration)
    return coulomb(rate + lead, width)


def friction_slope(joint: Joint, rate: Scalar, load: Scalar = 0.0) -> Scalar:
    """Return the derivative of `friction_torque` by the rate, N m s or N s/m."""
    slope: Scalar = joint.damping
    fast = joint.fast_damping
    if fast is not None:
        share = _share_of_slow(joint, rate)
        slope = fast + (joint.damping - fast) * (share * share)
    if has_dry_friction(joint):
        # d tanh(x) / dx = 1 - tanh(x)^2
        y = coulomb(rate, joint.friction_speed)
        level, half_difference = _sliding_levels(joint, rate, load)
        change = level / joint.friction_speed * (1.0 - y * y)
        if half_difference is not None:
            twice = (2.0 / joint.friction_speed) * half_difference
            change = change + twice * y * (1.0 - y * y)
        slope = slope + change
        if _has_stribeck(joint):
            # d level / dv = -2 v / v_s^2 times the excess at this rate
            excess = _stribeck(joint, rate)
            slope = slope - (2.0 / joint.stribeck_speed**2) * rate * excess * y
    return slope


def load_slope(joint: Joint, rate: Scalar, load: Scalar) -> Scalar:
    """Return the derivative of `friction_torque` by the load."""
    if not carries_load(joint):
        return 0.0
    # The derivative of mu |L| y + k L y^2.
    mu, k = _load_parts(joint)
    y = coulomb(rate, joint.friction_speed)
    return mu * y * select(load < 0.0, -1.0, 1.0) + k * (y * y)


def load_of_drive(joint: Joint, rate: Scalar, torque: Scalar, direction: Scalar = None,
                  factor: Scalar = 1.0) -> Scalar:
    """
    Return the load L, N m or N, with torque = L + friction(rate, L).

    The equation is piecewise linear in L: with x = torque - friction(rate, 0), it is
    x = a L, where a differs between both signs of L, which are those of x.

    Parameters
    ----------
    joint : Joint
        With the parameters of the law.
    rate : scalar
        rad/s or m/s.
    torque : scalar
        Of the motor, N m or N.
    direction : scalar, optional
        As of `friction_torque`.
    factor : scalar
        Factor on the friction.

    """
    # The torque without the friction that does not depend on the load: L + by_load L.
    x = torque - factor * friction_torque(joint, rate, 0.0, direction)
    if not carries_load(joint):
        return x
    mu, k = _load_parts(joint)
    if direction is None:
        y = coulomb(rate, joint.friction_speed)
    else:
        y = _of_sliding(joint, direction)
    # L has the sign of x, so that |L| = sign(x) L makes the equation linear.
    by_load = k * (y * y) + mu * y * select(x < 0.0, -1.0, 1.0)
    return x / (1.0 + factor * by_load)


def friction_over_rate(joint: Joint, rate: Scalar, load: Scalar = 0.0) -> Scalar:
    """
    Return friction without its offset divided by the rate, N m s or N s/m.

    For implicit integration. Coulomb friction over the rate is mu / sqrt(rate^2 +
    u_s^2), within 8 % of mu tanh(rate / u_s) / rate and regular at rest.
    """
    ratio = viscous_over_rate(joint, rate)
    if has_dry_friction(joint):
        smoothed = np.sqrt(rate * rate + joint.friction_speed**2)
        level, half_difference = _sliding_levels(joint, rate, load)
        ratio = ratio + level / smoothed
        if half_difference is not None:
            ratio = ratio + half_difference * rate / (smoothed * smoothed)
    return ratio


def viscous_over_rate(joint: Joint, rate: Scalar) -> Scalar:
    """Return viscous friction divided by the rate, D(v), N m s or N s/m."""
    fast = joint.fast_damping
    if fast is None:
        return joint.damping
    return fast + (joint.damping - fast) * _share_of_slow(joint, rate)


def has_bristles(joint: Joint) -> bool:
    """Return whether the friction of a joint has a state of its own in simulations."""
    return bool(joint.presliding_stiffness)


def sliding_friction(joint: Joint, rate: Scalar, load: Scalar = 0.0) -> Scalar:
    """Return the friction g of sliding in the direction of motion, positive, N m or N."""
    forward, backward = coulomb_levels(joint)
    level: Scalar = forward
    if joint.friction_backward is not None:
        # Each direction may have its own Coulomb friction.
        level = select(rate < 0.0, backward, forward)
    if _has_stribeck(joint):
        level = level + _stribeck(joint, rate)
    if carries_load(joint):
        driving, backdriven = load_fractions(joint)
        # The load drives the motor where its power is negative.
        fraction = select(rate * load < 0.0, backdriven, driving)
        level = level + fraction * magnitude(load)
    return level


def bristle_decay(joint: Joint, rate: Scalar, load: Scalar = 0.0) -> Scalar:
    """Return ``s |v| / g``, 1/s; z' = v - decay z is the rate of the deflection."""
    g = sliding_friction(joint, rate, load)
    return joint.presliding_stiffness * magnitude(rate) / g


def bristle_rate(joint: Joint, rate: Scalar, deflection: Scalar,
                 load: Scalar = 0.0) -> Scalar:
    """Return the rate z' of the deflection of a joint's bristles, rad/s or m/s."""
    return rate - bristle_decay(joint, rate, load) * deflection


def deflection_after(joint: Joint, rate: Scalar, deflection: Scalar, load: Scalar,
                     travel: Scalar) -> Scalar:
    """
    Return the deflection after a joint has moved one way, rad or m.

    The travel, rad or m, has the sign of the motion. The load and the size of the rate
    are constant on the way; the sign of the rate has no influence.
    """
    # dz / dx = 1 - s z / g forward, and 1 + s z / g backward.
    direction = select(travel < 0.0, -1.0, 1.0)
    g = sliding_friction(joint, direction * magnitude(rate), load)
    sliding = direction * g / joint.presliding_stiffness
    remaining = np.exp(-joint.presliding_stiffness * magnitude(travel) / g)
    return sliding + (deflection - sliding) * remaining


def bristle_torque(joint: Joint, rate: Scalar, deflection: Scalar,
                   load: Scalar = 0.0) -> Scalar:
    """Return the torque F that overcomes friction with bristles, N m or N."""
    torque = elastic_bristle_torque(joint, rate, deflection)
    if joint.presliding_damping:
        change = bristle_rate(joint, rate, deflection, load)
        torque = torque + joint.presliding_damping * change
    return torque


def elastic_bristle_torque(joint: Joint, rate: Scalar, deflection: Scalar) -> Scalar:
    """Return `bristle_torque` without the damping of the bristles, N m or N."""
    viscous = _viscous(joint, rate)
    return viscous + joint.friction_offset + joint.presliding_stiffness * deflection


def bristle_energy(joint: Joint, deflection: Scalar) -> Scalar:
    """Return the energy of the bristles of a joint, J."""
    return (0.5 * joint.presliding_stiffness) * (deflection * deflection)


def bristle_slope(joint: Joint, rate: Scalar, deflection: Scalar,
                  load: Scalar = 0.0) -> Scalar:
    """
    Return d z' / d v for linearly implicit steps, between 0 and about 2.

    Without the slope of g, which Stribeck friction makes negative; 0 where the deflection
    exceeds that of steady sliding.
    """
    g = sliding_friction(joint, rate, load)
    forward = select(rate < 0.0, -1.0, 1.0)
    slope = 1.0 - (joint.presliding_stiffness * forward) * deflection / g
    return select(slope < 0.0, 0.0, slope)


def holding_interval(joint: Joint, load: Any) -> tuple[Any, Any]:
    """
    Return the least and the largest friction of a joint at rest, on its coordinate, N m or N.

    The motor may have any torque between the sums of the load and these, while the drive
    carries the load. `load` may be an array.
    """
    forward, backward = breakaway_levels(joint)
    # Under a positive load the motor drives forward motions and the load backward ones;
    # under a negative load it is the reverse.
    driving, backdriven = load_fractions(joint)
    lifts = np.asarray(load) >= 0.0
    up = np.where(lifts, driving, backdriven)
    down = np.where(lifts, backdriven, driving)
    size = np.abs(load)
    backward_end = joint.friction_offset - backward - down * size
    forward_end = joint.friction_offset + forward + up * size
    # On the coordinate, of which a negative multiplier exchanges the ends.
    ends = (joint.multiplier * backward_end, joint.multiplier * forward_end)
    return min(ends, key=np.sum), max(ends, key=np.sum)


def breakaway_levels(joint: Joint) -> tuple[Any, Any]:
    """Return friction without load at the begin of motions forward and backward, N m or N."""
    forward, backward = coulomb_levels(joint)
    excess = stribeck_excess(joint)
    return forward + excess, backward + excess


def holding_friction(joint: Joint, torque: Scalar) -> tuple[Scalar, Scalar]:
    """
    Return the least and the largest friction of a joint at rest, N m or N, without offset.

    The motor has a torque, and friction carries what the load does not: the load is
    torque less friction less offset. Friction p resists motions forward up to

        p = c + mu abs(L),    L = x - p,    x = torque - offset

    with breakaway friction c. For x > c the load that begins to move is driven, L > 0,
    else it drives the motor. A self-locking drive holds any such load: the bound is
    infinite.
    """
    forward, backward = breakaway_levels(joint)
    if not carries_load(joint):
        return -backward, forward
    x = torque - joint.friction_offset
    return -_resistance_ahead(joint, backward, -x), _resistance_ahead(joint, forward, x)


def _resistance_ahead(joint: Joint, level: float, x: Scalar) -> Scalar:
    """Return the largest friction against a motion ahead, for a torque x along it."""
    driving, backdriven = load_fractions(joint)
    driven = (level + driving * x) / (1.0 + driving)
    overrun: Scalar = UNLIMITED
    if backdriven < 1.0:
        overrun = (level - backdriven * x) / (1.0 - backdriven)
    return select(level < x, driven, overrun)


def is_self_locking(joint: Joint) -> bool:
    """Return whether no load moves the drive of a joint."""
    return bool(load_fractions(joint)[1] >= 1.0)


def driving_torque(joint: Joint, rate: Scalar, torque: Scalar,
                   direction: Scalar) -> Scalar:
    """
    Return the torque of a motor beyond friction without load, along the motion, N m or N.

    A self-locking drive that slides locks at once where it is not positive: friction
    would grow faster than the load that drives it.
    """
    return direction * (torque - friction_torque(joint, rate, 0.0, direction))


def require_solvable(model: Model) -> None:
    """
    Raise InputError where the load of a drive does not follow from the motor's torque.

    That is so of self-locking drives, in the smooth law.
    """
    # The smooth law's slope must stay positive, so that each torque has one load.
    for body in model.bodies:
        driving, backdriven = load_fractions(body.joint)
        if least_load_slope(driving, backdriven) <= 0.0:
            raise InputError(
                f"joint '{body.joint.name}': load_friction {driving:g} and "
                f'load_friction_backdriven {backdriven:g}; expected a drive that is not '
                'self-locking (load_friction_backdriven below 1, and load_friction at '
                'most 3): of others the motion does not follow from the torque with the '
                'smooth law of friction')


def least_load_slope(driving: float, backdriven: float) -> float:
    """Return the least derivative of L + friction(v, L) by L, for all rates v."""
    mean = 0.5 * (driving + backdriven)
    half_difference = 0.5 * (driving - backdriven)
    # 1 + k y^2 - mu y for 0 <= y <= 1: at its end, or where its slope is zero.
    slopes = [1.0, 1.0 + half_difference - mean]
    if half_difference > 0.5 * mean:
        slopes.append(1.0 - mean * mean / (4.0 * half_difference))
    return min(slopes)


def refuse_load_friction(model: Model, what: str) -> None:
    """Raise InputError if the friction of a joint depends on the torque that it transmits."""
    for body in model.bodies:
        if carries_load(body.joint):
            raise InputError(f"{what}: joint '{body.joint.name}' has load friction "
                             f'{body.joint.load_friction:g}; expected none, because the '
                             'torque is then not linear in the accelerations')


def _viscous(joint: Joint, rate: Scalar) -> Scalar:
    """Return viscous friction, N m or N."""
    return viscous_over_rate(joint, rate) * rate


def _share_of_slow(joint: Joint, rate: Scalar) -> Scalar:
    """Return 1 / (1 + |v| / v_d), the share that the damping at rest has at a rate."""
    return 1.0 / (1.0 + magnitude(rate) * (1.0 / joint.damping_speed))


def _sliding_levels(joint: Joint, rate: Scalar, load: Scalar) -> tuple[Scalar, Scalar]:
    """
    Return the factors of y and y^2 in the module, N m or N; None for a factor of 0.

    level(v) + mu |L| is the mean of the friction in both directions, h + k L half the
    difference between these.
    """
    forward, backward = coulomb_levels(joint)
    level: Scalar = forward
    half_difference: Scalar = None
    if joint.friction_backward is not None:
        level = 0.5 * (forward + backward)
        half_difference = 0.5 * (forward - backward)
    if _has_stribeck(joint):
        level = level + _stribeck(joint, rate)
    # Load friction is a share of the transmitted torque; a drive that is driven back by
    # the load has another share.
    if carries_load(joint):
        mu, k = _load_parts(joint)
        level = level + mu * magnitude(load)
        if joint.load_friction_backdriven is not None:
            of_coulomb = 0.0 if half_difference is None else half_difference
            half_difference = k * load + of_coulomb
    return level, half_difference


def _has_stribeck(joint: Joint) -> bool:
    """Return whether friction falls with the rate from breakaway to Coulomb friction."""
    return bool(joint.breakaway_friction is not None and joint.stribeck_speed)


def _stribeck(joint: Joint, rate: Scalar) -> Scalar:
    """Return Stribeck friction at a rate, N m or N."""
    relative = rate * (1.0 / joint.stribeck_speed)
    return stribeck_excess(joint) * np.exp(-(relative * relative))


def _load_parts(joint: Joint) -> tuple[Any, Any]:
    """Return mu and k: mean and half difference of the `load_fractions`."""
    driving, backdriven = load_fractions(joint)
    return 0.5 * (driving + backdriven), 0.5 * (driving - backdriven)
