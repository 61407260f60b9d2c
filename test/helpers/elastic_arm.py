"""
A planar arm with two elastic joints, from its Lagrangian, and what its sensors measure.

It shares no code with the library: links in a vertical plane, a spring and a damper
between motor and link of each driven joint, Coulomb and viscous friction on either side.
The links are two in series, or a parallelogram whose lever turns the second one.
"""

from dataclasses import dataclass, field
from functools import partial
import math
import operator

from kane_dynamics import Closure, Inertial, ModelBuilder, Robot
from kane_dynamics.identification import DriveRecording
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

LENGTH = 0.5  # of the first link, m
MASS = 4.0, 2.5
COM = 0.25, 0.2
INERTIA = 0.12, 0.05  # about the center of mass, kg m^2
GRAVITY = 9.81
SLIP = 0.05  # rad/s
RATE = 1000.0  # Hz
JOINTS = 'shoulder', 'elbow'
URDF = """<robot name="elastic_arm"><link name="base"/>""" + ''.join(
    f"""<link name="link{k}"><inertial><origin xyz="{com} 0 0"/><mass value="{mass}"/>
    <inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/>
    </inertial></link><joint name="{joint}" type="revolute"><parent link="{parent}"/>
    <child link="link{k}"/><origin xyz="{place} 0 0"/><axis xyz="0 -1 0"/>
    <limit lower="-3" upper="3" effort="200" velocity="6"/></joint>"""
    for k, (joint, parent, place, mass, com, inertia) in enumerate(
        zip(JOINTS, ('base', 'link0'), (0.0, LENGTH), MASS, COM, INERTIA, strict=True))
) + '</robot>'


@dataclass(frozen=True)
class Truth:
    """The drives of the arm; every number is joint-side."""

    stiffness: tuple = (3000.0, 1200.0)  # or functions of the deflection
    damping: tuple = (4.0, 1.5)
    rotor_inertia: tuple = (0.9, 0.3)
    motor_damping: tuple = (3.0, 1.0)
    motor_friction: tuple = (6.0, 2.5)
    link_damping: tuple = (0.8, 0.3)
    link_friction: tuple = (1.0, 0.5)


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what is measured, and how late the link's encoders are."""

    theta: float = 2e-5
    q: float = 2e-5
    motor_torque: float = 0.1
    gear_torque: float = 0.1
    skew: float = 0.003


@dataclass(frozen=True)
class Motion:
    """The motion of the arm without noise, (N,) and (N, 2)."""

    t: np.ndarray
    q: np.ndarray
    theta: np.ndarray
    motor_torque: np.ndarray
    gear_torque: np.ndarray
    truth: Truth = field(default_factory=Truth)

    def measured(self, seed, noise=None, *, use=('q', 'motor_torque')):
        """Return what sensors measure, those of `use` beside the motor's encoders."""
        noise = noise or Noise()
        rng = np.random.default_rng(seed)
        late = round(noise.skew * RATE)
        first = max(late, 0)
        last = len(self.t) + min(late, 0)
        values = {'theta': self.theta[first:last], 'q': self.q[first - late:last - late],
                  'motor_torque': self.motor_torque[first:last],
                  'gear_torque': self.gear_torque[first:last]}
        sensors = {}
        for name, signal in values.items():
            disturbed = signal + getattr(noise, name) * rng.standard_normal(signal.shape)
            if name == 'theta' or name in use:
                sensors[name] = disturbed
        return DriveRecording(self.t[first:last], **sensors)


def large_motion(seed, gains):
    """Return a torque law that follows a sum of sines from 0.1 to 3 Hz."""
    rng = np.random.default_rng(seed)
    frequency = 2.0 * math.pi * np.geomspace(0.15, 3.0, 7)
    amplitude = rng.uniform(0.5, 1.0, (2, 7)) * 0.5 / (1.0 + frequency)
    phase = rng.uniform(0.0, 2.0 * math.pi, (2, 7))

    def torque(t, theta, speed):
        argument = frequency * t + phase
        ramp = min(t, 1.0)
        desired = ramp * (amplitude * np.sin(argument)).sum(axis=1)
        rate = ramp * (amplitude * frequency * np.cos(argument)).sum(axis=1)
        return [gain * (desired[k] - theta[k]) + 0.1 * gain * (rate[k] - speed[k])
                for k, gain in enumerate(gains)]
    return torque


def softening(first, last, level, sharpness=0.1):
    """
    Return a spring of stiffness `first`, beyond a torque `level` of stiffness `last`.

    Its slope changes over about twice `sharpness` of the deflection there.
    """
    corner = level / first
    width = sharpness * corner

    def torque(deflection):
        ahead, behind = (width * np.logaddexp(0.0, (sign * deflection - corner) / width)
                         for sign in (1.0, -1.0))
        return first * deflection + (last - first) * (ahead - behind)
    return torque


def simulated(torque, duration, truth=None, start=(0.0, 0.0), links=None):
    """Return the motion of the arm with a torque law, from rest."""
    truth = truth or Truth()
    links = links or SerialLinks()
    springs = []
    for stiffness in truth.stiffness:
        springs.append(stiffness if callable(stiffness)
                       else partial(operator.mul, stiffness))

    def rates(t, x):
        q = x[:2]
        theta = x[2:4]
        u = x[4:6]
        speed = x[6:]
        motor = torque(t, theta, speed)
        on_link = []
        of_motor = []
        for k in range(2):
            # Between them the gear: a spring and a damper. Each side has its losses.
            gear = (springs[k](theta[k] - q[k])
                    + truth.damping[k] * (speed[k] - u[k]))
            on_link.append(gear - truth.link_damping[k] * u[k]
                           - truth.link_friction[k] * math.tanh(u[k] / SLIP))
            losses = (truth.motor_damping[k] * speed[k]
                      + truth.motor_friction[k] * math.tanh(speed[k] / SLIP))
            of_motor.append((motor[k] - gear - losses) / truth.rotor_inertia[k])
        return [*u, *speed, *links.accelerations(q, u, on_link), *of_motor]

    t = np.arange(round(duration * RATE)) / RATE
    # At the start the springs hold the weight.
    sag = list(map(_deflection, springs, links.gravity(*start)))
    solution = solve_ivp(rates, (0.0, t[-1]), [*start, *np.add(start, sag), 0, 0, 0, 0],
                         t_eval=t, rtol=1e-8, atol=1e-10, method='RK45', max_step=2e-3)
    q, theta, u, speed = solution.y.reshape(4, 2, -1).transpose(0, 2, 1)
    motor = np.array([torque(*row) for row in zip(t, theta, speed, strict=True)])
    sprung = [spring(deflection) for spring, deflection in zip(springs, (theta - q).T)]
    gear = np.transpose(sprung) + truth.damping * (speed - u)
    return Motion(t, q, theta, motor, gear, truth)


def _deflection(spring, torque):
    """Return the deflection of a spring under a torque."""
    return brentq(lambda deflection: spring(deflection) - torque, -1.0, 1.0, xtol=1e-14)


class SerialLinks:
    """Two links in series; the second angle is relative to the first link."""

    def gravity(self, q1, q2):
        """Return the torques that hold the links, N m; angles upwards from level."""
        second = MASS[1] * GRAVITY * COM[1] * math.cos(q1 + q2)
        first = (MASS[0] * COM[0] + MASS[1] * LENGTH) * GRAVITY * math.cos(q1)
        return np.array([first + second, second])

    def accelerations(self, q, u, torque):
        """Return the accelerations of the links, by Lagrange's equations of two rods."""
        cosine = math.cos(q[1])
        sine = math.sin(q[1])
        coupling = MASS[1] * LENGTH * COM[1]
        elbow = INERTIA[1] + MASS[1] * COM[1]**2
        shoulder = (INERTIA[0] + MASS[0] * COM[0]**2 + elbow + MASS[1] * LENGTH**2
                    + 2.0 * coupling * cosine)
        mixed = elbow + coupling * cosine
        gravity = self.gravity(q[0], q[1])
        centrifugal = coupling * sine
        right_1 = torque[0] - gravity[0] + centrifugal * (2.0 * u[0] + u[1]) * u[1]
        right_2 = torque[1] - gravity[1] - centrifugal * u[0]**2
        determinant = shoulder * elbow - mixed**2
        return [(elbow * right_1 - mixed * right_2) / determinant,
                (shoulder * right_2 - mixed * right_1) / determinant]


class Parallelogram:
    """
    A parallelogram: arm and lever are driven at one point, and turn by q1 and q2.

    A rod from the lever's end, parallel to the arm, keeps the forearm parallel to the
    lever, which is `ahead` of the arm.
    """

    joint_names = 'arm', 'lever'
    ahead = 1.5  # rad, of the lever at position zero
    lever = 0.2  # length, m
    # Of each part: mass, center of mass from its joint, and inertia about it.
    arm = (4.0, 0.25, 0.12)
    rod = (1.0, 0.25, 0.03)
    forearm = (2.5, 0.3, 0.05)
    crank = (1.5, 0.1, 0.02)

    def constants(self):
        """Return the inertias of arm and lever, their coupling and mass moments."""
        arm = self.arm
        lever = self.crank
        rod = self.rod
        forearm = self.forearm
        of_arm = (arm[2] + arm[0] * arm[1]**2 + rod[2] + rod[0] * rod[1]**2
                  + forearm[0] * LENGTH**2)
        of_lever = (lever[2] + lever[0] * lever[1]**2 + forearm[2]
                    + forearm[0] * forearm[1]**2 + rod[0] * self.lever**2)
        coupling = rod[0] * self.lever * rod[1] + forearm[0] * LENGTH * forearm[1]
        moments = (arm[0] * arm[1] + rod[0] * rod[1] + forearm[0] * LENGTH,
                   lever[0] * lever[1] + rod[0] * self.lever + forearm[0] * forearm[1])
        return of_arm, of_lever, coupling, moments

    def gravity(self, q1, q2):
        """Return the torques that hold arm and lever, N m; angles from horizontal."""
        moments = self.constants()[3]
        return GRAVITY * np.array([moments[0] * math.cos(q1),
                                   moments[1] * math.cos(q2 + self.ahead)])

    def accelerations(self, q, u, torque):
        """Return the accelerations of arm and lever, by Lagrange's equations."""
        of_arm, of_lever, coupling, _ = self.constants()
        angle = q[0] - q[1] - self.ahead
        mixed = coupling * math.cos(angle)
        centrifugal = coupling * math.sin(angle)
        gravity = self.gravity(q[0], q[1])
        right_1 = torque[0] - gravity[0] - centrifugal * u[1]**2
        right_2 = torque[1] - gravity[1] + centrifugal * u[0]**2
        determinant = of_arm * of_lever - mixed**2
        return [(of_lever * right_1 - mixed * right_2) / determinant,
                (of_arm * right_2 - mixed * right_1) / determinant]

    def robot(self, **options):
        """Return the mechanism with rigid joints, its loop closed."""
        b = ModelBuilder('parallelogram')

        def part(name, carrier, place, ahead, stated):
            mass, center, inertia = stated
            about = inertia * np.eye(3)
            b.body(name, carrier, axis=(0, -1, 0), at=(place, 0, 0), rpy=(0, -ahead, 0),
                   inertial=Inertial(mass, (center, 0, 0), about))
        part('arm', 'world', 0.0, 0.0, self.arm)
        part('lever', 'world', 0.0, self.ahead, self.crank)
        part('rod', 'lever', self.lever, -self.ahead, self.rod)
        part('forearm', 'arm', LENGTH, self.ahead, self.forearm)
        b.frame('rod end', 'rod', at=(LENGTH, 0, 0))
        b.frame('forearm pin', 'forearm', at=(self.lever, 0, 0))
        options = {'independent': self.joint_names} | options
        return Robot(b.model(),
                     constraints=[Closure('rod end', 'forearm pin', 'revolute',
                                          axis=(0, 1, 0))], **options)
