"""
Drives of elastic joints: gear, rotor and what yields between motor and link.

The numbers of a `Drive` are joint-side: the motor's position divided by the ratio, its
torque times the ratio, stiffness, damping and inertia times the ratio squared.
`Drive.from_motor_side` converts motor-side numbers.

With theta the motor's and q the link's position, the deflection is delta = theta - q and
the gear's torque tau_J = k(delta) + D delta'. In Spong's reduced model the kinetic energy
of the rotor is that of its own rotation, 1/2 B theta'^2 (M. W. Spong, Modeling and
control of elastic joint robots, J. Dyn. Sys. Meas. Control 109, 1987):

    M(q) u' + h(q, u) + friction(u) = tau_J + external
    B theta'' + friction(theta') + tau_J = tau_m
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import math
from typing import Any, NamedTuple

from kane_dynamics._util.checks import constant, number, shape_of
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelError

# Power of the ratio by which a motor-side parameter of friction is multiplied on the
# joint's side: torques by 1, rates by -1. A factor of the load has none.
FRICTION_POWERS = {'damping': 2, 'fast_damping': 2, 'damping_speed': -1, 'friction': 1,
                   'friction_backward': 1, 'breakaway_friction': 1,
                   'stribeck_speed': -1, 'load_friction': 0,
                   'load_friction_backdriven': 0, 'friction_speed': -1,
                   'friction_offset': 1, 'presliding_stiffness': 2,
                   'presliding_damping': 2}
ROUNDING = 0.25  # of the shortest segment of a curve: default of half a corner's width


@dataclass(frozen=True, eq=False)
class StiffnessCurve:
    """
    Torque of a gear over its deflection, as straight segments with rounded corners.

    The curve is odd. It begins at zero, passes near the stated points and goes on with
    the last segment's slope. A first point with torque 0 is a dead zone (backlash).
    Farther than `rounding` from the corners it is exactly straight.

    Parameters
    ----------
    deflection : (k,) array_like
        Positive and increasing, k >= 2, rad or m.
    torque : (k,) array_like
        Increasing, N m or N; the first may be 0.
    rounding : float, optional
        Half of the width of the corners, rad or m: at a corner the curve is off the
        straight segments by 35/256 of it times the change of slope. Default: a quarter
        of the shortest segment.

    Raises
    ------
    ModelError
        If the points do not describe such a curve.

    """

    deflection: Array
    torque: Array
    rounding: float | None = None

    def __post_init__(self) -> None:
        """Check the points."""
        what = 'stiffness curve'
        shapes = (shape_of(self.deflection, f'{what}: deflection'),
                  # As many torques as deflections, at least the two ends of a segment.
                  shape_of(self.torque, f'{what}: torque'))
        if len(shapes[0]) != 1 or shapes[0] != shapes[1] or shapes[0][0] < 2:
            raise ModelError(f'{what}: deflection of shape {shapes[0]}, torque of shape '
                             f'{shapes[1]}; expected two sequences of one length, at '
                             'least 2')
        x = constant(self.deflection, shapes[0], f'{what}: deflection')
        y = constant(self.torque, shapes[1], f'{what}: torque')
        # From zero on, since the curve is odd: through the origin, or with a dead zone.
        lengths = [float(x[0]), *(x[1:] - x[:-1]).tolist()]
        rises = [float(y[0]), *(y[1:] - y[:-1]).tolist()]
        if min(lengths) <= 0.0:
            raise ModelError(f'{what}: deflection {x.tolist()}; expected positive, '
                             'increasing numbers')
        if rises[0] < 0.0 or min(rises[1:]) <= 0.0:
            raise ModelError(f'{what}: torque {y.tolist()}; expected increasing numbers '
                             'that are not negative')
        # Corners are rounded over a width that keeps them apart.
        width = self.rounding
        if width is None:
            width = ROUNDING * min(lengths)
        width = float(constant(width, (), f'{what}: rounding'))
        if width <= 0.0:
            raise ModelError(f'{what}: rounding {width}; expected a positive number')
        freeze(self, 'deflection', x)
        freeze(self, 'torque', y)
        freeze(self, 'rounding', width)

    @property
    def slopes(self) -> list[float]:
        """Return the stiffness of the segments, (k,), N m/rad or N/m."""
        slopes = []
        begin = (0.0, 0.0)
        for end in zip(self.deflection.tolist(), self.torque.tolist()):
            slopes.append((end[1] - begin[1]) / (end[0] - begin[0]))
            begin = end
        return slopes

    @property
    def dead_zone(self) -> float:
        """Return the deflection up to which no torque is transmitted, rad or m."""
        return 0.0 if self.torque[0] else float(self.deflection[0])


@dataclass(frozen=True, eq=False)
class Drive:
    """
    Drive of an elastic joint; `with_drives` adds it to a model.

    All numbers are joint-side, see `from_motor_side`. rad stands for m, and N m for N,
    of prismatic joints.

    Parameters
    ----------
    stiffness : float or StiffnessCurve
        Of gear and torque sensor together, N m/rad, positive; or torque over deflection.
    damping : float
        Of the deflection's rate, N m s/rad.
    ratio : float
        Motor revolutions per joint revolution (rad/m of prismatic joints); negative if
        they turn against each other.
    rotor_inertia : float, optional
        Of the rotor about its axis, times the ratio squared, kg m^2. Default: the
        joint's `armature`.
    friction : mapping of str to float
        Friction law of the motor's side, with the parameters of `Joint`: damping,
        quadratic_damping, friction, friction_backward, breakaway_friction,
        stribeck_speed, load_friction, load_friction_backdriven, friction_speed,
        friction_offset, presliding_stiffness, presliding_damping. The parameters of the
        `Joint` itself are those of the link's side.
    motor_effort : float, optional
        Largest torque of the motor, times the ratio, N m, positive. Default: the effort
        limit of the joint.
    motor_velocity : float, optional
        Largest speed of the motor, divided by the ratio, rad/s, positive. Default: the
        velocity limit of the joint.
    gear_effort : float
        Largest torque of the gear, on the joint's side, N m, positive.
    torque_sensor : bool
        Whether the gear's torque is measured.
    full_coupling : bool
        Include the motion of the link that carries the motor in the rotor's energy:
        1/2 J (s . omega + r theta')^2, with the motor's axis s along the joint's. The
        inertia J = B / r^2 about s is then taken from the carrier, whose inertia in a URDF
        includes the rotor at rest. Default: Spong's reduced model, 1/2 B theta'^2.
    motor : str
        Name of the motor's joint. `with_drives` sets it.

    Raises
    ------
    ModelError
        If a value is invalid.

    """

    stiffness: float | StiffnessCurve
    damping: float = 0.0
    ratio: float = 1.0
    rotor_inertia: float | None = None
    friction: Mapping[str, float] = field(default_factory=dict)
    motor_effort: float | None = None
    motor_velocity: float | None = None
    gear_effort: float = math.inf
    torque_sensor: bool = False
    full_coupling: bool = False
    motor: str = ''

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not isinstance(self.stiffness, StiffnessCurve):
            freeze(self, 'stiffness', _positive(self.stiffness, 'stiffness'))
        damping = float(constant(self.damping, (), 'drive: damping'))
        if damping < 0.0:
            raise ModelError(f'drive: damping {damping}; expected a nonnegative number')
        freeze(self, 'damping', damping)
        # The motor turns ratio times as far as the joint.
        # The sign of the ratio counts: a motor may turn against its joint.
        ratio = float(constant(self.ratio, (), 'drive: ratio'))
        if ratio == 0.0:
            raise ModelError('drive: ratio 0; expected a nonzero number')
        freeze(self, 'ratio', ratio)
        if self.rotor_inertia is not None:
            freeze(self, 'rotor_inertia',
                   _positive(self.rotor_inertia, 'rotor_inertia'))
        freeze(self, 'friction', _checked_friction(self.friction))
        for name in ('motor_effort', 'motor_velocity', 'gear_effort'):
            limit = getattr(self, name)
            if limit is not None:
                freeze(self, name, _limit(limit, name))
        for name in ('torque_sensor', 'full_coupling'):
            if not isinstance(getattr(self, name), bool):
                raise ModelError(f'drive: {name} {getattr(self, name)!r}; expected True '
                                 'or False')
        if not isinstance(self.motor, str):
            raise ModelError(f'drive: motor {self.motor!r}; expected a name')

    @classmethod
    def from_motor_side(cls, *, ratio: float, stiffness: Any, damping: float = 0.0,
                        rotor_inertia: float | None = None,
                        friction: Mapping[str, float] | None = None,
                        motor_effort: float | None = None,
                        motor_velocity: float | None = None,
                        gear_effort: float = math.inf, **options: Any) -> Drive:
        """
        Return the drive with these numbers on the motor's side of the gear.

        Parameters
        ----------
        ratio : float
            Motor revolutions per joint revolution.
        stiffness : float or StiffnessCurve
            Of the motor's angle with the link held, N m/rad.
        damping, rotor_inertia : float
            N m s/rad and kg m^2; rotor_inertia None: the joint's armature.
        friction : mapping of str to float
            Of the motor's rate, rad/s, and torque, N m.
        motor_effort, motor_velocity : float, optional
            Limits of the motor's shaft, N m and rad/s. Default: those of the joint.
        gear_effort : float
            Limit of the gear's torque at its input, N m: that at its output, which data
            sheets of gears state, divided by the ratio.
        **options
            As of the class: torque_sensor, full_coupling.

        """
        r = float(constant(ratio, (), 'drive: ratio'))
        if r == 0.0:
            raise ModelError('drive: ratio 0; expected a nonzero number')

        # Angles of the motor are r times those of the joint, torques 1 / r of the
        # joint's.
        if isinstance(stiffness, StiffnessCurve):
            width = stiffness.rounding
            assert width is not None
            joint_side: Any = StiffnessCurve(stiffness.deflection / abs(r),
                                             stiffness.torque * abs(r), width / abs(r))
        else:
            joint_side = _positive(stiffness, 'stiffness') * r * r
        inertia = None
        if rotor_inertia is not None:
            inertia = _positive(rotor_inertia, 'rotor_inertia') * r * r
        motor_damping = float(constant(damping, (), 'drive: damping'))
        law = _checked_friction({} if friction is None else friction)
        if motor_effort is not None:
            motor_effort = _limit(motor_effort, 'motor_effort') * abs(r)
        if motor_velocity is not None:
            motor_velocity = _limit(motor_velocity, 'motor_velocity') / abs(r)
        gear_effort = _limit(gear_effort, 'gear_effort') * abs(r)
        return cls(joint_side, motor_damping * r * r, r, inertia,
                   friction_seen_through(law, r), motor_effort, motor_velocity,
                   gear_effort, **options)

    @property
    def stiffness_at_rest(self) -> float:
        """Return the slope of the torque at deflection 0, N m/rad."""
        curve = self.stiffness
        if not isinstance(curve, StiffnessCurve):
            return curve
        width = curve.rounding
        assert width is not None
        slopes = curve.slopes
        slope = slopes[0]
        for corner, before, after in zip(curve.deflection, slopes, slopes[1:]):
            # The corners at both signs act at rest if their rounding reaches to 0.
            place = max(0.5 - 0.5 * corner / width, 0.0)
            slope += 2.0 * (after - before) * corner_slope(place)
        return float(slope)


class ElasticJoint(NamedTuple):
    """
    Elastic joint of a model: its name, drive, and indices of link and motor in u.

    `link` and `motor` are also indices in tau, and in q of models without ball joints;
    `Model.places` has those in q of others.
    """

    name: str
    drive: Drive
    link: int
    motor: int


def friction_seen_through(law: Mapping[str, float], ratio: float) -> dict[str, float]:
    """
    Return the parameters of motor-side friction on the joint's side of a gear.

    At a negative ratio, what holds for positive rates of the motor holds for negative
    ones of the joint.
    """
    # Each parameter has its power of the ratio; a negative one also exchanges the
    # directions.
    r = abs(ratio)
    seen = {name: value * r**FRICTION_POWERS[name] for name, value in law.items()}
    if ratio < 0.0:
        seen['friction_offset'] = -seen.get('friction_offset', 0.0)
        if 'friction_backward' in seen:
            forward = seen.get('friction', 0.0)
            # Breakaway friction keeps what it exceeds the friction by.
            seen['friction'] = seen['friction_backward']
            if 'breakaway_friction' in seen:
                seen['breakaway_friction'] += seen['friction'] - forward
            seen['friction_backward'] = forward
    return seen


def corner_ramp(x: Any) -> Any:
    """
    Return the integral of `corner_slope`, from 0 at x = 0 to 1/2 at x = 1.

    With its derivative and integral it rounds the corners of stiffness curves.
    """
    fifth = (x * x) * (x * x) * x
    return 0.5 * fifth * (14.0 + x * (-28.0 + x * (20.0 - 5.0 * x)))


def corner_slope(x: Any) -> Any:
    """Return a step from 0 at x = 0 to 1 at x = 1 with three continuous derivatives."""
    return (x * x) * (x * x) * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x)))


def corner_integral(x: Any) -> Any:
    """Return the integral of `corner_ramp` from x = 0."""
    sixth = (x * x) * (x * x) * (x * x)
    return sixth * (7.0 / 6.0 + x * (-2.0 + x * (1.25 - x * (5.0 / 18.0))))


def _positive(value: Any, what: str) -> float:
    number = float(constant(value, (), f'drive: {what}'))
    if number <= 0.0:
        raise ModelError(f'drive: {what} {number}; expected a positive number')
    return number


def _limit(value: Any, what: str) -> float:
    """Return a checked limit, infinite for none."""
    try:
        return number(value, f'drive: {what}', 'a positive number, or infinity',
                      lambda limit: limit > 0.0)
    except InputError as error:
        raise ModelError(str(error)) from None


def _checked_friction(law: Any) -> dict[str, float]:
    """Return a copy of the parameters; the `Joint` of the motor checks their bounds."""
    # Bounds are those of a joint's friction, which the motor's joint checks.
    if not isinstance(law, Mapping):
        raise ModelError(f'drive: friction: {SHORT.repr(law)}; expected a mapping of '
                         f'{", ".join(FRICTION_POWERS)} to numbers')
    checked = {}
    for name in sorted(law):
        if name not in FRICTION_POWERS:
            raise ModelError(f"drive: friction: no parameter '{name}'; expected some of "
                             f'{", ".join(FRICTION_POWERS)}')
        checked[name] = float(constant(law[name], (), f'drive: friction: {name}'))
    return checked
