"""
Hand guiding: an arm that an operator leads by hand, lighter than its friction.

    tau = gravity + springs + a fraction of the friction at the measured rates
          - damping of rates beyond the limits + walls at joint limits and planes
          - brakes of joints that come to their limits too fast

Friction is compensated in part, so that what remains still resists: with the fraction
below one, and a model whose friction is not above the real one divided by it, the arm
takes energy out of every motion. Walls are springs; damping and what limits the speed
take energy out, too. The operator alone adds energy.

At a steady rate friction f and the force of the hand h enter the motion as h - f alone:
no law can tell a model with too much friction from a hand that holds back. How wrong the
model is shows only where no hand is on the arm. `friction_error` is what a recording of
such a motion shows (`calibrate_collision`).
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from kane_dynamics._util.checks import finite_row, instance, number, per_joint
from kane_dynamics._util.fixed_attributes import guarded_class
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.control.computed_torque import require_rigid
from kane_dynamics.control.friction_error import (checked_friction_error,
                                                  friction_beyond, FrictionError,
                                                  values_of)
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.lane_products import product, transpose
from kane_dynamics.mechanics.constraints.conditioning import guarded as nan_unless
from kane_dynamics.mechanics.constraints.transmission import transmission_margin
from kane_dynamics.model.model import Frame, WORLD
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.robot_function import identifier
from kane_dynamics.task_space.frame_task import inverse_mass
from kane_dynamics.task_space.joint_speed_limits import brake_torques, UNSTATED
from kane_dynamics.task_space.joint_walls import DAMPING, JointWalls, STOPS, WALL
from kane_dynamics.task_space.law_kernel import (checked_effort, lanes_of_scalars, LanesOf, Law,
                                                 law_kernel, RunTimeSettings, Settings)
from kane_dynamics.task_space.reference_dynamics import (rated_friction,
                                                         resisting_force)
import numpy as np
from numpy.typing import ArrayLike

FRICTION = 0.8  # default fraction of the model's friction that is compensated
BRAKE = 20.0  # 1/s: rate at which speeds beyond a limit decay
STIFFNESS = 2000.0  # N/m: default of planes
DEPTH = 0.01  # m: the damping of a plane is complete from this depth on
SHARE = 0.5  # of the joints' speed limits: the default limit
SLOW = 1e-12  # m^2/s^2: squared speed of a frame at rest
# Settings: the values of a `FrictionError`, in the order of `friction_beyond`.
ERROR = ('error_coulomb', 'error_damping', 'error_offset', 'error_speed')
RESISTING = (1.0, 1.0, 1.0, 1.0)  # weights of all terms that resist the motion


@guarded_class
class HandGuiding(RunTimeSettings):
    """
    Torques with which an operator leads the arm by hand.

    Parameters
    ----------
    robot : Robot
        A robot without beams. Its payload is a part of gravity (`parameters.payload`).
    frame : str, optional
        The frame to which `planes` and `frame_speed` apply.
    friction : float
        Fraction of the model's friction that is compensated, from 0 to 1; 0.8 by
        default.
    friction_error : FrictionError, optional
        Friction beyond the model, as of `CollisionCalibration.friction_error`, of which
        the same fraction is compensated. Its present values are used; `update` reads
        them again.
    damping : float or array_like
        Further damping of every joint, N m s/rad or N s/m.
    speed_limit : float or array_like, optional
        rad/s or m/s, of every joint: faster motion is braked. Default: half of the
        robot's limits. Before its position limit a joint is braked, too, as by
        `CartesianImpedance`, unless its speed limit is stated as inf.
    frame_speed : float
        m/s: faster motion of the frame's origin is braked.
    limit_stiffness, limit_margin : float or array_like, optional
        Soft walls before the joint limits, as of `CartesianImpedance`.
    planes : (k, 4) array_like
        Planes n . p = d in the world, as rows (n, d) with n of length 1: the frame's
        origin stays where n . p >= d. Their number is fixed, `update` moves them.
    plane_stiffness : float
        N/m.
    effort_limit : float or array_like, optional
        N m or N; default: the robot's. Torques are clamped to it.

    Raises
    ------
    InputError
        Names the argument, what was given and what is expected.

    """

    _changeable = ('friction', 'friction_error', 'damping', 'speed_limit', 'frame_speed',
                   'limit_stiffness', 'limit_margin', 'planes', 'plane_stiffness',
                   'effort_limit')

    def __init__(self, robot: Robot, *, frame: str | None = None,
                 friction: float = FRICTION,
                 friction_error: FrictionError | None = None,
                 damping: ArrayLike = 0.0, speed_limit: ArrayLike | None = None,
                 frame_speed: float = math.inf,
                 limit_stiffness: ArrayLike | None = None,
                 limit_margin: ArrayLike | None = None, planes: ArrayLike = (),
                 plane_stiffness: float = STIFFNESS,
                 effort_limit: ArrayLike | None = None) -> None:
        """Check the settings and compile the kernel."""
        instance(robot, Robot, 'robot')
        require_rigid(robot)
        # Planes and the limit of speed are those of a moving frame.
        self._frame: Frame | None = None
        if frame is not None:
            self._frame = robot.model.frame(frame)
            if self._frame.body == WORLD:
                raise InputError(f"frame: '{frame}', which does not move; expected a "
                                 'frame of a moving body')
        self._walls = JointWalls(robot)
        # The number of planes is a size in the kernel; their numbers may change.
        self._planes = len(_checked_planes(planes))
        names = len(robot.joint_names)
        super().__init__(robot, Settings({
            'friction': (), 'damping': (names,), 'speed_limit': (names,),
            'far_speed': (names,), 'frame_speed': (), 'planes': (self._planes, 4),
            'plane_stiffness': (), 'effort': (names,),
            **self._walls.shapes(*WALL, *STOPS),
            **dict.fromkeys(ERROR, (robot.n,))}))
        # The settings are checked as later changes of them are.
        self.update(friction=friction, friction_error=friction_error, damping=damping,
                    speed_limit=speed_limit, frame_speed=frame_speed,
                    limit_stiffness=limit_stiffness, limit_margin=limit_margin,
                    planes=planes, plane_stiffness=plane_stiffness,
                    effort_limit=effort_limit)
        self._law = self._compiled()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy, and compile its law for its own robot."""
        self.__dict__.update(state)
        self._law = self._compiled()

    def _checked(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return the numbers of the kernel by name, from checked settings."""
        robot = self.robot
        # Planes and frame are parts of the kernel: their number cannot change.
        planes = _checked_planes(values['planes'])
        if len(planes) != self._planes:
            raise InputError(f'planes: {len(planes)}; expected {self._planes}, as many '
                             'as of the constructor')
        if self._frame is None and (self._planes or values['frame_speed'] != math.inf):
            raise InputError('planes, frame_speed: given without a frame; expected '
                             'frame=, whose origin they limit')
        # By default a share of the robot's own limits.
        speed = SHARE * np.asarray(robot.limits.velocity, np.float64)
        if values['speed_limit'] is not None:
            speed = per_joint(values['speed_limit'], 'speed_limit', robot.joint_names,
                              finite=False)
        # Brakes before joint limits act at every speed, unless the user wants none.
        far_speed = np.full(len(speed), UNSTATED)
        if values['speed_limit'] is not None:
            far_speed[np.isinf(speed)] = np.inf
        return {
            'friction': number(values['friction'], 'friction', 'a number from 0 to 1',
                               lambda x: 0.0 <= x <= 1.0),
            'damping': per_joint(values['damping'], 'damping', robot.joint_names),
            'speed_limit': speed,
            'far_speed': far_speed,
            'frame_speed': number(values['frame_speed'], 'frame_speed',
                                  'a positive number, m/s', lambda x: x > 0.0),
            'planes': planes,
            'plane_stiffness': number(values['plane_stiffness'], 'plane_stiffness',
                                      'a finite number >= 0, N/m',
                                      lambda x: 0.0 <= x < math.inf),
            'effort': checked_effort(robot, values['effort_limit']),
            **_error_settings(robot, values['friction_error']),
            **self._walls.settings(values['limit_stiffness'], values['limit_margin'])}

    def torque(self, q: ArrayLike, u: ArrayLike, t: float = 0.0) -> Array:
        """
        Return the torques of the joints, (n_q,), for a measured state.

        Parameters
        ----------
        q, u : (n_q,), (n,) array_like
            rad or m, s.
        t : float
            Time, s, where speeds or constraints depend on it.

        Raises
        ------
        InputError
            A wrong shape, or a number that is not finite.
        ConstraintError
            The configuration is open or singular.

        """
        # Each attribute of a class with hints takes as long to read as ten of these.
        fields = self.__dict__
        law: Callable[..., Array] = fields['_law']
        return law(q, u, fields['_block'], t)

    def energy(self, q: ArrayLike) -> float:
        """Return the energy that the walls of joints and planes store, J."""
        positions = finite_row(q, 'q', self.robot.coordinate_names)
        values = self._shapes.unpacked(self._block)
        with np.errstate(over='ignore'):  # infinite far beyond every mechanism
            total = float(self._walls.energy(positions, values))
        if self._frame is not None:
            p = self.robot.frame_pose(self._frame.name, positions)[:3, 3]
            for plane in values['planes']:
                depth = max(0.0, plane[3] - plane[:3] @ p)
                total += 0.5 * float(values['plane_stiffness']) * depth**2
        return total

    def _compiled(self) -> Callable[..., Array]:
        """Return the entry point of the law."""
        robot = self.robot
        frame = self._frame
        walls = self._walls
        shapes = self._shapes

        def law_of(choice: Robot, lanes_of: LanesOf) -> Law:
            return _law(choice, frame, walls, shapes, lanes_of)
        # The number of planes and the frame are part of the program.
        words = ['hand_guiding', str(self._planes)]
        if frame is not None:
            words.append(frame.name)
        inputs = {'q': (robot.n_q,), 'u': (robot.n,), 'settings': (shapes.size,)}
        kernel = law_kernel(robot, law_of, identifier(*words), inputs,
                            (len(robot.joint_names),))
        return kernel.entry('', kernel)


def hand_guiding_law(law: HandGuiding) -> Law:
    """Return the law of an object as a function of q, u and settings, over any scalar."""
    return _law(law.robot, law._frame, law._walls, law._shapes, lanes_of_scalars)


def wall_slopes(law: HandGuiding, q: Array) -> tuple[Array, Array]:
    """Return stiffness and damping of the walls that act at q, as of `JointWalls`."""
    return law._walls.slopes(q, law._shapes.unpacked(law._block))


def _error_settings(robot: Robot, error: FrictionError | None) -> dict[str, Array]:
    """Return the settings `ERROR`; InputError for the friction of other joints."""
    names = robot.speed_names
    if error is None:
        error = FrictionError(names)
    checked_friction_error(error, names)
    return dict(zip(ERROR, values_of(error)))


def _checked_planes(planes: ArrayLike) -> Array:
    """Return planes as a (k, 4) array; InputError for anything else."""
    try:
        array = np.asarray(planes, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f'planes: {SHORT.repr(planes)}; expected numbers of shape '
                         '(k, 4)') from None
    if not array.size:
        return np.zeros((0, 4))
    if array.ndim != 2 or array.shape[1] != 4 or not np.isfinite(array).all():
        raise InputError(f'planes: {SHORT.repr(planes)}; expected finite numbers of '
                         'shape (k, 4)')
    # A plane is its unit normal and its distance from the origin.
    lengths = np.linalg.norm(array[:, :3], axis=1)
    if np.abs(lengths - 1.0).max() > 1e-6:
        raise InputError(f'planes: normals of length {lengths.tolist()}; expected 1')
    return array


def _law(robot: Robot, frame: Frame | None, walls: JointWalls, shapes: Settings,
         lanes_of: LanesOf) -> Law:
    """Return the law as a function over any scalar; see the module."""
    equations = robot.equations
    tree = equations.tree

    def law(q: Vector, u: Vector, settings: Vector, *, t: Scalar, parameters: Vector
            ) -> Vector:
        values = shapes.unpacked(settings)
        motion = equations.joint_motion(q, u, equations.zeros, t)
        rates = motion.qdot

        # Gravity and springs, and a part of the friction under this load.
        held = tree.reference_dynamics(q, tree.zeros, tree.zeros, tree.zeros, parameters)
        load = motion.projected(held)
        friction = rated_friction(equations, q, rates, load, t)

        # Damping, and brakes of fast joints by their own inertia.
        inertia = tree.mass_matrix(q, parameters)
        brakes = np.zeros(len(rates)).astype(object)
        for r, limit in enumerate(values['speed_limit']):
            brake = BRAKE * inertia[r, r] * _beyond(rates[r], limit)
            brakes[r] = -values['damping'][r] * rates[r] - brake

        force = (held + values['friction'] * friction + brakes
                 + walls.force(q, rates, values))
        beyond = friction_beyond(u, *[values[name] for name in ERROR])
        total = motion.projected(force) + values['friction'] * beyond
        lanes = lanes_of(q[0])
        inverse = inverse_mass(equations, q, parameters, t, lanes)
        if frame is not None:
            J = equations.partial_velocities(frame, q, t)[:3]
            W = product(J, transpose(product(J, inverse, lanes), lanes), lanes)
            position = equations.frame_pose(frame, q, t)[:3, 3]
            total = total + J.T @ _frame_force(position, J @ u, W, values)

        # Brakes of joints that come to their position limits too fast.
        speeds = walls.speeds_towards(q, rates, values['far_speed'], values, lanes)
        bias = resisting_force(equations, q, u, RESISTING, parameters, t)
        stopping = brake_torques(motion, inverse, total - bias, speeds, lanes)
        total = total + motion.projected(stopping)
        tau = _clamped(equations.shared_torques(q, total, t), values['effort'])
        if equations.actuated is not None:
            tau = nan_unless(tau, transmission_margin(equations.mechanism, motion.T,
                                                      equations.actuated))
        return tau
    return law


def _beyond(rate: Scalar, limit: Scalar) -> Scalar:
    """Return the part of a rate beyond its limit on either side."""
    above = rate - limit
    below = rate + limit
    return select(above > 0.0, above, select(below < 0.0, below, 0.0))


def _clamped(torques: Vector, limits: Vector) -> Vector:
    """Return torques within plus and minus their limits."""
    return np.array([x - _beyond(x, limit) for x, limit in zip(torques, limits)])


def _frame_force(position: Vector, velocity: Vector, W: Matrix,
                 values: dict[str, Any]) -> Vector:
    """Return the force of planes and of the brake on a frame's origin, (3,), world."""
    force: Vector = np.zeros(3).astype(object)
    stiffness = values['plane_stiffness']
    for plane in values['planes']:
        normal = plane[:3]
        depth = plane[3] - normal @ position
        depth = select(depth > 0.0, depth, 0.0)
        growing = depth * (1.0 / DEPTH)
        share = select(growing < 1.0, growing, 1.0)
        force = force + stiffness * (depth - DAMPING * share
                                     * (normal @ velocity)) * normal

    # The brake, by the mass of the frame along its velocity, 1 / (direction . W
    # direction).
    square = velocity @ velocity
    moves = square > SLOW
    speed = np.sqrt(select(moves, square, 1.0))
    mass = select(moves, square / select(moves, velocity @ (W @ velocity), 1.0), 0.0)
    excess = _beyond(speed, values['frame_speed'])
    return force - (BRAKE * mass * select(moves, excess, 0.0) / speed) * velocity
