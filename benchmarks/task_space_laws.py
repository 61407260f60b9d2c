"""
Laws in task space on arms in MuJoCo: singular configurations, contact, friction.

The plant is MuJoCo, an independent engine. Run `python benchmarks/task_space_laws.py`.
"""

from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import files
from pathlib import Path
import re
import sys
from typing import NamedTuple

from gates import exit_status
from kane_dynamics import (CartesianImpedance, HandGuiding, HybridForce,
                           inverse_kinematics, JointImpedance, load_urdf, PoseLimits,
                           PoseMotion, PosePath, Robot, Terms)
from kane_dynamics._util.resources import resource_path
from kane_dynamics._util.typing import Array
from kane_dynamics.identification import calibrate_collision, Recording
import mujoco
import numpy as np

RATE = 1000.0  # Hz, of the law
SUBSTEPS = 4  # steps of MuJoCo in a period of the law
WITHOUT_SHAPES = r'<(visual|collision)\b.*?</\1>'


class Arm(NamedTuple):
    """An arm, its frame, and an ordinary configuration."""

    name: str
    urdf: Path
    frame: str
    home: Array


def _xarm7() -> Path:
    """Return the URDF of the xArm7 of example-robot-data."""
    for file in files('example-robot-data') or ():
        if file.name == 'xarm7.urdf':
            return Path(str(file.locate()))
    raise FileNotFoundError('xarm7.urdf of example-robot-data')


def arms() -> dict[str, Arm]:
    """Return the arms by their names."""
    return {
        'UR10e': Arm('UR10e', resource_path('urdf', 'ur10e.urdf'), 'tool0',
                     np.array([0.3, -1.2, 1.4, -1.77, -1.57, 0.0])),
        'xArm7': Arm('xArm7', _xarm7(), 'link_eef',
                     np.array([0.3, -0.3, 0.1, 1.2, 0.1, 1.4, 0.0])),
        'FR3': Arm('FR3', resource_path('urdf', 'fr3.urdf'), 'fr3_link8',
                   np.array([0.3, -0.5, 0.1, -2.2, 0.1, 1.9, 0.8]))}


class Plant:
    """
    An arm in MuJoCo, without friction unless it is stated; the joint limits are stops.

    Parameters
    ----------
    robot : Robot
        States the joints that move; the others are fixed.
    urdf : Path

    """

    def __init__(self, robot: Robot, urdf: Path) -> None:
        text = urdf.read_text(encoding='utf-8')
        spec = mujoco.MjSpec.from_string(
            re.sub(WITHOUT_SHAPES, '', text, flags=re.DOTALL))
        spec.compiler.fusestatic = False
        for equality in list(spec.equalities):  # of fingers
            spec.delete(equality)
        for joint in list(spec.joints):
            if joint.name not in robot.joint_names:
                spec.delete(joint)
        self.spec = spec
        self.robot = robot
        self._compile()

    def _compile(self) -> None:
        """Compile the model."""
        self.model = self.spec.compile()
        self.model.opt.timestep = 1.0 / (RATE * SUBSTEPS)
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        self.model.dof_damping[:] = 0.0
        self.model.dof_frictionloss[:] = 0.0
        self.data = mujoco.MjData(self.model)
        names = self.robot.joint_names
        self.q_places = [self.model.joint(name).qposadr[0] for name in names]
        self.u_places = [self.model.joint(name).dofadr[0] for name in names]

    def rub(self, robot: Robot) -> None:
        """
        Give the joints the damping and the Coulomb friction of a robot.

        MuJoCo's default lets a joint creep at rates below 1 rad/s under less than its
        dry friction; these numbers make it stick.
        """
        for body in robot.model.bodies:
            dof = self.model.joint(body.joint.name).dofadr[0]
            self.model.dof_damping[dof] = body.joint.damping
            self.model.dof_frictionloss[dof] = body.joint.friction
        self.model.dof_solref[:], self.model.dof_solimp[:] = DRY

    def reset(self, q: Array) -> None:
        """Put the arm at rest."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self.q_places] = q
        mujoco.mj_forward(self.model, self.data)

    @property
    def state(self) -> tuple[Array, Array]:
        """Return positions and velocities."""
        return (self.data.qpos[self.q_places].copy(),
                self.data.qvel[self.u_places].copy())

    def step(self, tau: Array) -> None:
        """Advance by one period of the law under constant torques."""
        for _ in range(SUBSTEPS):
            self.data.qfrc_applied[:] = 0.0
            self.data.qfrc_applied[self.u_places] = tau
            self.load()
            mujoco.mj_step(self.model, self.data)

    def load(self) -> None:
        """Add further generalized forces of a step; none here."""

    def kinetic_energy(self) -> float:
        """Return MuJoCo's kinetic energy, J."""
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_energyVel(self.model, self.data)
        return float(self.data.energy[1])


class Passage(NamedTuple):
    """A singular configuration, and an ordinary one from which the arm is led there."""

    arm: str
    what: str
    singular: list[float]
    start: list[float]


HALF = 0.5 * np.pi
PASSAGES = (
    Passage('UR10e', 'wrist', [0.3, -1.2, 1.4, -1.77, 0.0, 0.0],
            [0.3, -1.2, 1.4, -1.77, -0.8, 0.0]),
    Passage('UR10e', 'elbow', [0.3, -1.2, 0.0, -0.6, -1.57, 0.0],
            [0.3, -1.2, 0.9, -1.5, -1.57, 0.0]),
    Passage('UR10e', 'shoulder', [0.3, 0.838, 1.4, -1.77, -1.57, 0.0],
            [0.3, 0.2, 1.4, -1.77, -1.57, 0.0]),
    Passage('xArm7', 'wrist', [0.3, -0.3, 0.0, 1.19, HALF, -0.214, 0.0],
            [0.3, -0.3, 0.0, 1.19, HALF, 0.9, 0.0]),
    Passage('xArm7', 'shoulder', [0.3, 0.0, HALF, 1.2, 0.0, 1.2, 0.0],
            [0.3, -0.6, HALF, 1.2, 0.0, 1.2, 0.0]),
    Passage('FR3', 'stretched', [0.3, 0.3, 0.0, -0.467, 0.0, 1.9, 0.8],
            [0.3, 0.0, 0.0, -1.4, 0.0, 1.9, 0.8]),
    Passage('FR3', 'shoulder', [0.3, 0.0, HALF, -2.0, 0.0, 1.9, 0.8],
            [0.3, -0.5, HALF, -2.0, 0.0, 1.9, 0.8]))
LIMITS = PoseLimits((0.5, 2.0, 20.0), (1.5, 6.0, 60.0))
STIFFNESS = np.array([2000.0, 2000.0, 2000.0, 150.0, 150.0, 150.0])
# m, of the search for the edge of the reach
EDGE_STEP = 0.01
EDGE_WITHIN = 1e-4
BEYOND = 0.1  # m of the target along the direction that is lost, and beyond the reach
EDGES = {'edge of the reach': 0.0, 'beyond the reach': BEYOND}
# The elbow of the FR3 is straight at -0.467 rad, before its limit of -0.152: with the
# default walls it can bend to the other side. With this one, from -0.5 rad on, it
# cannot.
WALLED = 'beyond, with a wall'
ELBOW_MARGINS = np.array([0.1, 0.1, 0.1, 0.35, 0.1, 0.1, 0.1])  # rad
SETTLING = 3.0  # s of rest, in which the error of the singular neighborhood decays


class PassageFigures(NamedTuple):
    """Largest shares of limits, and errors, m, of a run through a singularity."""

    duration: float
    fastest_target: float  # m/s
    smallest_singular_value: float
    torque: float
    speed: float
    error_outside: float
    error_inside: float
    error_ordinary: float  # of the ordinary motion, inside and outside
    energy_rise: float  # J, after the target came to rest


def through(robot: Robot, frame: str, passage: Passage) -> PoseMotion:
    """Return the motion to a singular pose, across it along the lost axis, and back."""
    start = robot.frame_pose(frame, passage.start)
    singular = robot.frame_pose(frame, passage.singular)
    left, _, _ = np.linalg.svd(robot.jacobian(frame, passage.singular))
    lost = left[:3, 5]
    near_side = singular.copy()
    far_side = singular.copy()
    near_side[:3, 3] -= BEYOND * lost / np.linalg.norm(lost)
    far_side[:3, 3] += BEYOND * lost / np.linalg.norm(lost)
    path = PosePath.through([start, near_side, far_side, start],
                            blend=0.02, blend_angle=0.1)
    return PoseMotion(path, LIMITS)


def to_a_stop_at(robot: Robot, frame: str, passage: Passage) -> PoseMotion:
    """Return the motion to a singular pose, where it stops, and back."""
    start = robot.frame_pose(frame, passage.start)
    singular = robot.frame_pose(frame, passage.singular)
    return PoseMotion(PosePath.joined([PosePath.through([start, singular]),
                                       PosePath.through([singular, start])]), LIMITS)


def to_the_edge(robot: Robot, frame: str, start: Array, beyond: float) -> PoseMotion:
    """Return the motion outwards to the edge of the reach or beyond by m, and back."""
    pose = robot.frame_pose(frame, start)
    outwards = pose[:3, 3] * [1.0, 1.0, 0.0]
    outwards /= np.linalg.norm(outwards)
    target = pose.copy()
    q = start
    step = EDGE_STEP
    while step > EDGE_WITHIN:
        further = target.copy()
        further[:3, 3] += step * outwards
        reached = inverse_kinematics(robot, frame, further, q, starts=1)
        if reached.converged:
            target = further
            q = reached.q
        else:
            step *= 0.5
    target[:3, 3] += beyond * outwards
    there = PosePath.through([pose, target])
    return PoseMotion(PosePath.joined([there, PosePath.through([target, pose])]), LIMITS)


def follow(arm: Arm, start: Array, desired: PoseMotion,
           limit_margin: Array | None = None) -> PassageFigures:
    """
    Follow a target with the impedance law in MuJoCo, let it rest, and move it again.

    The error counts as one outside of the singular neighborhood before the law limits
    anything: in the passage, and again in the last motion, which begins with an arm at
    rest, and whose first error counts always.
    """
    robot = Robot(load_urdf(arm.urdf, tip=arm.frame), friction=False)
    plant = Plant(robot, arm.urdf)
    law = CartesianImpedance(robot, arm.frame, stiffness=STIFFNESS,
                             limit_margin=limit_margin)
    plant.reset(start)
    end = desired.sample(desired.duration).pose
    aside = end.copy()
    aside[:3, 3] += [0.0, 0.05, -0.05]
    ordinary = PoseMotion(PosePath.through([end, aside, end]), LIMITS)
    begins = desired.duration + SETTLING
    steps = int((begins + ordinary.duration) * RATE)
    torque = speed = inside = outside = in_ordinary = rise = fastest = 0.0
    smallest = np.inf
    energy = np.inf
    entered = False
    for k in range(steps):
        t = k / RATE
        moves_again = t >= begins
        begins_again = moves_again and t - begins < 1.0 / RATE
        if begins_again:
            entered = False
        target = ordinary.sample(t - begins) if moves_again else desired.sample(t)
        q, u = plant.state
        tau = law.torque(q, u, *target)
        state = law.state(q, u, *target[:2])
        error = float(np.linalg.norm(
            robot.frame_pose(arm.frame, q)[:3, 3] - target.pose[:3, 3]))
        entered |= state.regularization > 0.0 or state.braking > 0.0
        entered |= state.speed_scale < 1.0 or state.effort_scale < 1.0
        if moves_again:
            in_ordinary = max(in_ordinary, error)
        if entered and not begins_again:
            inside = max(inside, error)
        else:
            outside = max(outside, error)
        if k % 10 == 0:
            values = np.linalg.svd(robot.jacobian(arm.frame, q), compute_uv=False)
            smallest = min(smallest, float(values.min()))
        torque = max(torque, float(np.max(np.abs(tau) / robot.limits.effort)))
        speed = max(speed, float(np.max(np.abs(u) / robot.limits.velocity)))
        fastest = max(fastest, float(np.linalg.norm(target.twist[:3])))
        if desired.duration < t < begins:
            energy_before = energy
            energy = plant.kinetic_energy() + law.energy(q, target.pose)
            rise = max(rise, energy - energy_before)
        plant.step(tau)
    return PassageFigures(desired.duration, fastest, smallest, torque, speed, outside,
                          inside, in_ordinary, rise)


ENCODER = 2.0 * np.pi / 2**20  # rad, resolution of 20 bits
BANDWIDTH = 100.0  # Hz, of the filter behind the differences of encoder readings
CLEARANCE = 0.02  # m of the tip above the table at the start
CREEP = 0.01  # m/s, below which the table's friction is viscous; stable at SUBSTEPS
TIP = 0.02  # m, radius of the sphere at the tip
# MuJoCo's contact: time constant, s, and damping ratio; little give.
STIFF = ([0.002, 1.0], [0.99, 0.999, 1e-4, 0.5, 2.0])
DRY = ([0.001, 1.0], [0.999, 0.999, 1e-3, 0.5, 2.0])  # likewise, of dry friction


class TablePlant(Plant):
    """
    An arm with a sphere as its tip over a stiff table, encoders and a delayed command.

    The sphere is around the origin of the frame. A command acts one period after the
    readings from which it was computed.
    """

    def __init__(self, robot: Robot, arm: Arm, friction: float) -> None:
        self.arm = arm
        super().__init__(robot, arm.urdf)
        self.height = float(
            robot.frame_pose(arm.frame, arm.home)[2, 3]) - CLEARANCE - TIP
        self.friction = friction
        solref, solimp = STIFF
        contact = {'solref': solref, 'solimp': solimp, 'condim': 1}
        self.spec.worldbody.add_geom(
            name='table', type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2.0, 2.0, 0.1],
            pos=[0.0, 0.0, self.height], **contact)
        self.spec.body(arm.frame).add_geom(
            name='tip', type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[TIP, 0.0, 0.0],
            mass=0.0, **contact)
        self._compile()
        self.reset(arm.home)

    def reset(self, q: Array) -> None:
        """Put the arm at rest; its brakes hold it in the first period."""
        super().reset(q)
        self._waiting = self.robot.gravity_force(q)
        self._readings = np.round(q / ENCODER) * ENCODER
        self._speeds = np.zeros(len(q))

    def load(self) -> None:
        """
        Add the table's sliding friction at the tip.

        MuJoCo's own makes the sphere hop while it slides on a contact as stiff as this
        one, with exact states and without a delay, too.
        """
        force = self.contact_force()
        if not force:
            return
        body = self.model.body(self.arm.frame).id
        point = self.data.xpos[body] - [0.0, 0.0, TIP]
        J = np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, J, None, point, body)
        slip = (J @ self.data.qvel)[:2]
        share = slip / np.hypot(np.linalg.norm(slip), CREEP)
        self.data.qfrc_applied += J[:2].T @ (-self.friction * force * share)

    def measured(self) -> tuple[Array, Array]:
        """Return readings of the encoders, and the filtered differences of them."""
        readings = np.round(self.state[0] / ENCODER) * ENCODER
        share = 1.0 - np.exp(-2.0 * np.pi * BANDWIDTH / RATE)
        self._speeds += share * ((readings - self._readings) * RATE - self._speeds)
        self._readings = readings
        return readings, self._speeds.copy()

    def command(self, tau: Array) -> None:
        """Advance by one period under the command before; this one comes next."""
        self.step(self._waiting)
        self._waiting = tau

    def contact_force(self) -> float:
        """Return the normal force of the table on the tip, N; 0 without contact."""
        total = 0.0
        force = np.zeros(6)
        for k in range(self.data.ncon):
            mujoco.mj_contactForce(self.model, self.data, k, force)
            total += float(force[0])
        return total


class ContactFigures(NamedTuple):
    """A press on the table."""

    peak: float  # N, in the first 0.1 s of contact
    losses: int  # periods without contact after the first 0.1 s
    mean_error: float  # N, of the last second
    largest_error: float  # N, of the last second


TURNING = 10.0  # N m/rad, on the table; see `press`
PRESSED = 20.0  # N


def press(arm: Arm, stiffness: float) -> ContactFigures:
    """
    Lower a target at 0.05 m/s below the table until its spring presses.

    The models state no rotor inertia, and the last link's own is 1e-4 kg m^2: with the
    delay and the filter a stiff spring about its axis would not be stable at 1 kHz.
    """
    robot = Robot(load_urdf(arm.urdf, tip=arm.frame), friction=False)
    plant = TablePlant(robot, arm, 0.3)
    law = CartesianImpedance(robot, arm.frame, stiffness=[stiffness] * 3 + [TURNING] * 3)
    start = robot.frame_pose(arm.frame, arm.home)
    end = start.copy()
    end[2, 3] -= CLEARANCE + PRESSED / stiffness
    desired = PoseMotion(PosePath.through([start, end]),
                         PoseLimits((0.05, 1.0, 20.0), (1.0, 1.0, 1.0)))
    steps = int((desired.duration + 2.0) * RATE)
    forces = np.zeros(steps)
    for k in range(steps):
        q, u = plant.measured()
        plant.command(law.torque(q, u, *desired.sample(k / RATE)))
        forces[k] = plant.contact_force()
    touching = forces > 0.0
    touch = int(touching.argmax())
    early = touch + int(0.1 * RATE)
    settled = forces[-int(RATE):]
    return ContactFigures(float(forces[touch:early].max()),
                          int(np.count_nonzero(~touching[early:])),
                          float(abs(settled.mean() - PRESSED)),
                          float(np.abs(settled - PRESSED).max()))


class DrawingFigures(NamedTuple):
    """A circle drawn on the table with a force along its normal."""

    force_error: float  # N, largest after the first second of contact
    circle_error: float  # m, largest distance from the target in the plane
    losses: int  # periods without contact


DRAWN = 10.0  # N
RADIUS = 0.05  # m
SENSOR = 30.0  # Hz, bandwidth of the force sensor


def draw_circle(arm: Arm) -> DrawingFigures:
    """Press along the normal with a measured force, and draw a circle in 5 s."""
    robot = Robot(load_urdf(arm.urdf, tip=arm.frame), friction=False)
    plant = TablePlant(robot, arm, 0.2)
    law = HybridForce(robot, arm.frame, force_directions=['z'],
                      approach_speed=0.2, stiffness=[2000.0] * 3 + [TURNING] * 3)
    start = robot.frame_pose(arm.frame, arm.home)
    circle = PosePath.circle(start, start[:3, 3] + [RADIUS, 0.0, 0.0], (0.0, 0.0, 1.0))
    desired = PoseMotion(circle, duration=5.0)
    wrench = np.array([0.0, 0.0, -DRAWN, 0.0, 0.0, 0.0])
    pressing = 2.0  # s before the circle: the approach, and the force
    steps = int((pressing + desired.duration) * RATE)
    forces = np.zeros(steps)
    distances = np.zeros(steps)
    sensed = 0.0
    share = 1.0 - np.exp(-2.0 * np.pi * SENSOR / RATE)
    for k in range(steps):
        q, u = plant.measured()
        target = desired.sample(k / RATE - pressing)
        sensed += share * (plant.contact_force() - sensed)
        plant.command(law.torque(q, u, *target, wrench,
                                 measured=-wrench * sensed / DRAWN, elapsed=1.0 / RATE))
        forces[k] = plant.contact_force()
        position = robot.frame_pose(arm.frame, plant.state[0])[:2, 3]
        distances[k] = np.linalg.norm(position - target.pose[:2, 3])
    drawing = slice(int(pressing * RATE), None)
    return DrawingFigures(float(np.abs(forces[drawing] - DRAWN).max()),
                          float(distances[drawing].max()),
                          int(np.count_nonzero(forces[drawing] == 0.0)))


FRICTION = Path(__file__).resolve().parents[1] / 'examples' / 'fr3_friction.yaml'


def with_friction(arm: Arm, factor: float, friction_speed: float | None = None,
                  feedforward: str = 'desired_speed') -> Robot:
    """
    Return the FR3 with the friction of the examples, times a factor.

    Its friction speed, rad/s, and the friction of commands at rest and at reversals may
    be others.
    """
    model = load_urdf(arm.urdf, tip=arm.frame, supplement=FRICTION)
    bodies = []
    for body in model.bodies:
        joint = replace(body.joint, friction=factor * body.joint.friction,
                        damping=factor * body.joint.damping)
        if friction_speed is not None:
            joint = replace(joint, friction_speed=friction_speed)
        bodies.append(replace(body, joint=joint))
    return Robot(replace(model, bodies=tuple(bodies)), feedforward_friction=feedforward)


HAND = (4000.0, 150.0)  # N/m and N s/m: the operator holds on to a point that moves
LED = 0.1  # m/s
LEADING = 3.0  # s
STARTING = 1.0  # s at the beginning that do not count
ERROR = 0.2  # of the model's friction: that of the arm times 1.2, or 0.8
COMPENSATED = 0.8  # of the friction of the model, the default of HandGuiding
RECORDED = 0.9  # of it where a recording without contact corrects the model
RECORDING = 12.0  # s
FREE_SPEED = 0.6  # rad/s, of the motion that is recorded
FREQUENCIES = np.array([0.11, 0.13, 0.17, 0.19, 0.23, 0.29, 0.31])  # Hz
LEFT_ALONE = 3.0  # s


class GuidingFigures(NamedTuple):
    """
    Mean forces, N, that lead the FR3 by its flange at 0.1 m/s.

    More and less: the model has 20 % more or less friction than the arm.
    """

    without: float  # gravity compensation alone
    exact: float  # with the exact model of the friction
    more: float
    less: float
    exact_recorded: float  # with the friction error of a recording without contact
    more_recorded: float
    less_recorded: float


def guiding(arm: Arm) -> GuidingFigures:
    """Lead the FR3 with gravity compensation, and with three models of its friction."""
    factors = (1.0, 1.0 + ERROR, 1.0 - ERROR)
    forces = [lead(arm, HandGuiding(with_friction(arm, 1.0), friction=0.0))]
    for factor in factors:
        forces.append(lead(arm, HandGuiding(with_friction(arm, factor),
                                            friction=COMPENSATED)))
    for factor in factors:
        forces.append(lead(arm, corrected_guiding(arm, factor)))
    return GuidingFigures(*forces)


def corrected_guiding(arm: Arm, factor: float) -> HandGuiding:
    """Return hand guiding with a model that a recording without contact corrects."""
    model = with_friction(arm, factor)
    calibrated = calibrate_collision(model, free_motion(arm, model), held=True)
    return HandGuiding(model, friction=RECORDED,
                       friction_error=calibrated.friction_error())


def free_motion(arm: Arm, model: Robot) -> Recording:
    """Return a recording of the arm under an impedance of its joints, no contact."""
    plant = rubbing_plant(arm)
    stiffness = np.array([600.0] * 4 + [60.0, 60.0, 20.0])
    law = JointImpedance(model, stiffness=stiffness, damping=0.05 * stiffness)
    omega = 2.0 * np.pi * FREQUENCIES
    rows = []
    for t in np.arange(0.0, RECORDING, 1.0 / RATE):
        q, u = plant.state
        desired = arm.home + FREE_SPEED / omega * (1.0 - np.cos(omega * t))
        rates = FREE_SPEED * np.sin(omega * t)
        tau = law.torque(q, u, desired, rates, FREE_SPEED * omega * np.cos(omega * t))
        rows.append((t, q, u, tau))
        plant.step(tau)
    t, q, u, tau = map(np.array, zip(*rows))
    return Recording(t, q, u, np.gradient(u, t, axis=0), tau)


def rubbing_plant(arm: Arm) -> Plant:
    """Return the arm at rest at home, with its friction."""
    actual = with_friction(arm, 1.0)
    plant = Plant(actual, arm.urdf)
    plant.rub(actual)
    plant.reset(arm.home)
    return plant


def hand_force(
        robot: Robot, frame: str, start: Array, t: float, q: Array, u: Array) -> Array:
    """Return the force of a hand that leads a frame along y from a point at rest, N."""
    velocity = np.array([0.0, LED, 0.0])
    position = robot.frame_pose(frame, q)[:3, 3]
    moving = robot.frame_velocity(frame, q, u)[:3]
    stiffness, damping = HAND
    return stiffness * (start + t * velocity - position) + damping * (velocity - moving)


def lead(arm: Arm, law: HandGuiding) -> float:
    """Return the mean force of a hand that leads the flange on a line, N."""
    plant = rubbing_plant(arm)
    forces = led_forces(arm, law, plant)
    return float(np.linalg.norm(forces[int(STARTING * RATE):], axis=1).mean())


def led_forces(arm: Arm, law: HandGuiding, plant: Plant) -> Array:
    """Return the forces of a hand that leads the flange on a line, (N, 3)."""
    robot = plant.robot
    start = robot.frame_pose(arm.frame, arm.home)[:3, 3]
    forces = []
    for k in range(int(LEADING * RATE)):
        q, u = plant.state
        force = hand_force(robot, arm.frame, start, k / RATE, q, u)
        plant.step(law.torque(q, u) + robot.jacobian(arm.frame, q)[:3].T @ force)
        forces.append(force)
    return np.array(forces)


class ReleaseFigures(NamedTuple):
    """An arm that the hand lets go, after leading it at 0.1 m/s."""

    released: float  # rad/s, fastest joint at the release
    rested: float  # rad/s, fastest joint after `LEFT_ALONE`
    energy_rise: float  # J, of kinetic energy and that of walls in a period


def let_go(arm: Arm, law: HandGuiding) -> ReleaseFigures:
    """Lead the flange, let it go, and leave the arm alone."""
    plant = rubbing_plant(arm)
    led_forces(arm, law, plant)
    released = float(np.abs(plant.state[1]).max())
    rise = 0.0
    energy = np.inf
    for _ in range(int(LEFT_ALONE * RATE)):
        q, u = plant.state
        energy_before = energy
        energy = plant.kinetic_energy() + law.energy(q)
        rise = max(rise, energy - energy_before)
        plant.step(law.torque(q, u))
    return ReleaseFigures(released, float(np.abs(plant.state[1]).max()), rise)


def drift_at_rest(arm: Arm, law: HandGuiding) -> float:
    """
    Return the largest change of a joint of an arm that no hand holds, rad.

    The law gets encoder readings and speeds of them, and acts one period later.
    """
    actual = with_friction(arm, 1.0)
    plant = TablePlant(actual, arm, 0.0)  # above the table
    plant.rub(actual)
    farthest = 0.0
    for _ in range(int(LEFT_ALONE * RATE)):
        plant.command(law.torque(*plant.measured()))
        farthest = max(farthest, float(np.abs(plant.state[0] - arm.home).max()))
    return farthest


THROWS = 5
FORCES = (20.0, 60.0)  # N, of a hand
MOMENT = 0.5  # N m, at most
LASTING = (0.1, 0.5)  # s
AFTER = 2.0  # s


class ThrowFigures(NamedTuple):
    """An arm that a hand throws at its joint limits."""

    fastest: float  # rad/s, of a joint
    beyond: float  # rad, farthest past a position limit; negative inside of it


def thrown_by_hand(arm: Arm) -> ThrowFigures:
    """
    Throw the flange by random wrenches of a hand, without friction, in MuJoCo.

    The joints have no speed limits and the plant has no stops: the law alone keeps the
    joints within their position limits.
    """
    robot = Robot(load_urdf(arm.urdf, tip=arm.frame), friction=False)
    robot.limits = replace(robot.limits, velocity=np.full(robot.n, np.inf))
    plant = Plant(robot, arm.urdf)
    plant.model.jnt_limited[:] = 0
    law = HandGuiding(robot)
    fastest = 0.0
    beyond = -np.inf
    for seed in range(THROWS):
        rng = np.random.default_rng(seed)
        plant.reset(arm.home)
        force = rng.normal(size=3)
        moment = rng.normal(size=3)
        force *= rng.uniform(*FORCES) / np.linalg.norm(force)
        moment *= rng.uniform(0.0, MOMENT) / np.linalg.norm(moment)
        wrench = np.concatenate([force, moment])
        lasts = rng.uniform(*LASTING)
        for k in range(int((lasts + AFTER) * RATE)):
            q, u = plant.state
            past = np.maximum(q - robot.limits.upper, robot.limits.lower - q)
            beyond = max(beyond, float(past.max()))
            fastest = max(fastest, float(np.abs(u).max()))
            tau = law.torque(q, u)
            if k < lasts * RATE:
                tau = tau + robot.jacobian(arm.frame, q).T @ wrench
            plant.step(tau)
    return ThrowFigures(fastest, beyond)


NARROW = 0.005  # rad/s, friction speed of a model; that of the examples is ten times it
STANDING = 1.5  # s after the line
LAST = 0.5  # s of it, in which the torques are at rest
CALM = 0.01  # N m in a period: no chatter
REMAINING = 0.05  # of the error without compensation


class FrictionFigures(NamedTuple):
    """Position errors of the FR3 with friction, m, at 2000 N/m."""

    moving: float  # largest, along a line at 0.25 m/s
    resting: float  # after the motion
    deflection: float  # largest difference of a deflection by 20 N from F / K


def line(robot: Robot, arm: Arm) -> PoseMotion:
    """Return the motion of the flange along a line, at 0.25 m/s."""
    start = robot.frame_pose(arm.frame, arm.home)
    end = start.copy()
    end[:3, 3] += [0.1, 0.2, 0.1]
    return PoseMotion(PosePath.through([start, end]),
                      PoseLimits((0.25, 1.0, 10.0), (1.0, 4.0, 40.0)))


class SensedFigures(NamedTuple):
    """Errors of a line with friction, encoders and a late command; final torques."""

    moving: float  # m, largest
    resting: float  # m
    chatter: float  # N m, largest change of a torque in a period, at rest


def sensed_friction(arm: Arm, model: Robot) -> SensedFigures:
    """Follow a line with readings of encoders and a command one period late."""
    actual = with_friction(arm, 1.0)
    plant = TablePlant(actual, arm, 0.0)  # above the table
    plant.rub(actual)
    law = CartesianImpedance(model, arm.frame,
                             stiffness=[2000.0] * 3 + [TURNING] * 3)
    desired = line(actual, arm)
    errors = []
    torques = []
    for k in range(int((desired.duration + STANDING) * RATE)):
        target = desired.sample(k / RATE)
        position = actual.frame_pose(arm.frame, plant.state[0])[:3, 3]
        errors.append(float(np.linalg.norm(position - target.pose[:3, 3])))
        torques.append(law.torque(*plant.measured(), *target))
        plant.command(torques[-1])
    moving = errors[:int(desired.duration * RATE)]
    at_rest = np.array(torques[-int(LAST * RATE):])
    return SensedFigures(max(moving), errors[-1],
                         float(np.abs(np.diff(at_rest, axis=0)).max()))


def friction_errors(arm: Arm, model: Robot, compensated: bool = True) -> FrictionFigures:
    """Follow a line with friction and a model of it, rest, and bear a force."""
    actual = with_friction(arm, 1.0)
    plant = Plant(actual, arm.urdf)
    plant.rub(actual)
    terms = Terms(friction=compensated)
    law = CartesianImpedance(model, arm.frame, stiffness=STIFFNESS, compensate=terms)
    plant.reset(arm.home)
    desired = line(actual, arm)
    moving = resting = 0.0
    force = np.array([0.0, 0.0, -20.0])
    loaded = desired.duration + 1.5
    for k in range(int((loaded + 2.0) * RATE)):
        t = k / RATE
        q, u = plant.state
        target = desired.sample(t)
        position = actual.frame_pose(arm.frame, q)[:3, 3]
        error = float(np.linalg.norm(position - target.pose[:3, 3]))
        tau = law.torque(q, u, *target)
        if t < desired.duration:
            moving = max(moving, error)
        elif t < loaded:
            resting = error
        else:
            tau = tau + actual.jacobian(arm.frame, q)[:3].T @ force
        plant.step(tau)
    expected = target.pose[:3, 3] + force / STIFFNESS[:3]
    position = actual.frame_pose(arm.frame, plant.state[0])[:3, 3]
    return FrictionFigures(moving, resting, float(np.linalg.norm(position - expected)))


# Largest shares of the limits.
SPEED = 1.0
TORQUE = 1.0
OUTSIDE = 1e-3  # m
ORDINARY_ERROR = 5e-3  # m, of the ordinary motion, also where the law limits it
RISE = 1e-9  # J: rounding of an energy
FORCE_ERROR = 0.5  # N
LIGHTER = 5.0  # times
STILL = 1e-4  # rad/s, and rad
STIFFNESSES = (500.0, 1000.0, 2000.0, 3000.0)  # N/m


def passages() -> Iterator[tuple[str, str, PassageFigures]]:
    """Yield the figures of all runs through singularities, with arm and place."""
    for name, arm in arms().items():
        robot = Robot(load_urdf(arm.urdf, tip=arm.frame), friction=False)
        for passage in PASSAGES:
            if passage.arm == name:
                start = np.array(passage.start)
                desired = through(robot, arm.frame, passage)
                yield name, passage.what, follow(arm, start, desired)
        for what, beyond in EDGES.items():
            desired = to_the_edge(robot, arm.frame, arm.home, beyond)
            yield name, what, follow(arm, arm.home, desired)
        if name == 'FR3':
            beyond_reach = to_the_edge(robot, arm.frame, arm.home, BEYOND)
            yield name, WALLED, follow(arm, arm.home, beyond_reach, ELBOW_MARGINS)


def main() -> int:
    """Print the tables; return 1 if a gate does not hold."""
    good = True

    def gate(met: bool, text: str) -> None:
        nonlocal good
        if not met:
            print(f'FAILED: {text}')
            good = False

    print(
        'Through singular configurations, 2000 N/m, target up to 0.5 m/s: '
        'largest shares of limits, errors')
    print('arm    place      sigma    torque  speed   outside    inside     energy')
    for name, place, row in passages():
        print(f'{name:6} {place:9} {row.smallest_singular_value:7.1e} {row.torque:8.2f} '
              f'{row.speed:6.2f} {1e3 * row.error_outside:7.3f} mm '
              f'{1e3 * row.error_inside:7.1f} mm  +{max(row.energy_rise, 0.0):.0e} J',
              flush=True)
        gate(row.torque <= TORQUE + 1e-9 and row.speed <= SPEED,
             f'{name} {place}: limits')
        # With the default walls the elbow of the FR3 bends to the other side.
        returns = (name, place) != ('FR3', 'beyond the reach')
        gate(not returns or row.error_outside <= OUTSIDE, f'{name} {place}: error')
        gate(not returns or row.error_ordinary <= ORDINARY_ERROR,
             f'{name} {place}: error of the ordinary motion')
        gate(row.energy_rise <= RISE, f'{name} {place}: energy')

    print(f'Contact: {PRESSED:g} N on a stiff table, 1 kHz, one period of delay, '
          'encoders of 20 bits')
    for name, arm in arms().items():
        for stiffness in STIFFNESSES:
            pressed = press(arm, stiffness)
            print(f'{name:6} {stiffness:6g} N/m: peak {pressed.peak:5.0f} N, lost in '
                  f'{pressed.losses} periods, error {pressed.mean_error:.4f} N, at most '
                  f'{pressed.largest_error:.2f} N', flush=True)
            gate(pressed.losses == 0 and pressed.largest_error < 1.0,
                 f'{name} {stiffness:g} N/m: contact')
        drawn = draw_circle(arm)
        print(
            f'{name:6} circle with {DRAWN:g} N: force within {drawn.force_error:.2f} N, '
            f'position within {1e3 * drawn.circle_error:.2f} mm', flush=True)
        gate(drawn.force_error <= FORCE_ERROR and not drawn.losses,
             f'{name}: hybrid force')

    print('Hand guiding without speed limits: thrown by random forces')
    for name, arm in arms().items():
        thrown = thrown_by_hand(arm)
        print(f'{name:6} joints up to {thrown.fastest:.0f} rad/s, '
              f'{1e3 * thrown.beyond:+.1f} mrad past a limit', flush=True)
        gate(thrown.beyond <= 0.0, f'{name}: joint limits')

    arm = arms()['FR3']
    led = guiding(arm)
    print(f'Hand guiding of the FR3 at {LED:g} m/s: {led.without:.1f} N without it')
    for what, forces in (
            (f'{COMPENSATED:.0%} of the model', (led.exact, led.more, led.less)),
            (f'{RECORDED:.0%} of the model, corrected by a recording',
             (led.exact_recorded, led.more_recorded, led.less_recorded))):
        listed = ', '.join(f'{force:.1f} N ({led.without / force:.1f} times less)'
                           for force in forces)
        print(f'{what}; exact, {ERROR:.0%} more, {ERROR:.0%} less friction: {listed}',
              flush=True)
    gate(led.without > LIGHTER * led.more, 'hand guiding, more friction in the model')
    for force in (led.exact_recorded, led.more_recorded, led.less_recorded):
        gate(led.without > LIGHTER * force, 'hand guiding, corrected model')
    more_friction = with_friction(arm, 1.0 + ERROR)
    for what, law in (
            (f'{COMPENSATED:.0%} of a model with {ERROR:.0%} more',
             HandGuiding(more_friction)),
            (f'{RECORDED:.0%} of the corrected model',
             corrected_guiding(arm, 1.0 + ERROR))):
        figures = let_go(arm, law)
        print(f'let go, {what}: {figures.released:.2f} rad/s, after {LEFT_ALONE:g} s '
              f'{figures.rested:.0e} rad/s, energy +{figures.energy_rise:.0e} J',
              flush=True)
        gate(figures.rested < STILL and figures.energy_rise <= RISE, f'let go, {what}')
    drift = drift_at_rest(arm, HandGuiding(more_friction, friction=1.0))
    print(f'at rest, all of a model with {ERROR:.0%} more: {drift:.0e} rad in '
          f'{LEFT_ALONE:g} s', flush=True)
    gate(drift < STILL, 'at rest')

    print('Friction of the FR3, 2000 N/m: errors moving, at rest, of a deflection')
    exact = with_friction(arm, 1.0)
    narrow = with_friction(arm, 1.0, NARROW)
    uncompensated = friction_errors(arm, exact, compensated=False)
    rows = {'not compensated': uncompensated}
    for what, model in (
            ('compensated', exact),
            ('friction ahead', with_friction(arm, 1.0, feedforward='ahead')),
            (f'friction speed {NARROW:g} rad/s', narrow),
            ('compensated, 20 % more', with_friction(arm, 1.0 + ERROR)),
            ('compensated, 20 % less', with_friction(arm, 1.0 - ERROR))):
        rows[what] = friction_errors(arm, model)
    for what, errors in rows.items():
        listed = ', '.join(f'{1e3 * error:.2f} mm' for error in errors)
        print(f'{what:28} {listed}', flush=True)
    for what in ('friction ahead', f'friction speed {NARROW:g} rad/s'):
        errors = rows[what]
        gate(errors.moving < REMAINING * uncompensated.moving
             and errors.resting < REMAINING * uncompensated.resting, what)
    sensed = sensed_friction(arm, narrow)
    print(
        f'friction speed {NARROW:g} rad/s, encoders and a late command: '
        f'{1e3 * sensed.moving:.2f} mm, {1e3 * sensed.resting:.2f} mm, torques at rest '
        f'change by {sensed.chatter:.0e} N m in a period')
    gate(sensed.moving < REMAINING * uncompensated.moving and sensed.chatter < CALM,
         'friction with encoders')
    return exit_status(good)


if __name__ == '__main__':
    sys.exit(main())
