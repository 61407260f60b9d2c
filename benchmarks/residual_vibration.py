"""
Residual vibration of an FR3 with elastic joints after a fast move, in MuJoCo.

The plant is independent: MuJoCo with a rotor body and a spring at each joint, integrated
by Runge-Kutta. Drives with a motor-side loop, at 1 kHz, get the torques and positions of
the rigid arm, then those of the arm with elastic joints. Both begin with the deflection
under gravity, which the rigid positions keep. The residual vibration is the largest
distance of the tip, after the motion's end, from its mean place in the last 0.2 s. A
third run has the elastic feedforward of an arm whose stiffness is 10 % too high.

Run: `.venv/bin/python benchmarks/residual_vibration.py [PICTURE]`; it prints the
amplitudes and their ratio, and draws the distances.
"""

from dataclasses import replace
import sys

from elastic_joints import arms, HOME, JOINTS, URDF
from kane_dynamics import Motion, MotorSideControl, natural_vibration, Robot, with_drives
from kane_dynamics.control.elastic_control import MotorCommand
import numpy as np
from two_mass_arm import TwoMassArm

# s
DURATION = 0.5
AFTER = 1.0
# s
CYCLE = 1e-3
SUBSTEPS = 4
MOVE = np.array([0.7, 0.4, -0.4, 0.5, 0.4, -0.4, 0.5])  # rad
KP = np.array([600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0])  # N m/rad
KD = np.array([30.0, 30.0, 30.0, 30.0, 10.0, 10.0, 5.0])  # N m s/rad
TIP = 'fr3_link8'
LEAST_RATIO = 20.0  # asked for
# From rest to rest with four continuous derivatives, s from 0 to 1.
SHAPE = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])


def fast_move() -> Motion:
    """Return the motion of the links, quintics through points of the smooth shape."""
    t = np.linspace(0.0, DURATION, 101)
    s = t / DURATION
    q = HOME + np.outer(SHAPE(s), MOVE)
    u = np.outer(SHAPE.deriv(1)(s) / DURATION, MOVE)
    udot = np.outer(SHAPE.deriv(2)(s) / DURATION**2, MOVE)
    return Motion.from_points(t, q, u, udot, joint_names=JOINTS)


def commands(rigid: Robot, elastic: Robot, times: np.ndarray) -> dict[str, MotorCommand]:
    """Return what the drives are commanded in the cycles that begin at times."""
    motion = fast_move()
    middles = times + 0.5 * CYCLE  # torques are held for a cycle
    stiffer = {joint.name: replace(joint.drive, stiffness=1.1 * joint.drive.stiffness)
               for joint in elastic.drives}
    result = {}
    for name, robot in (('elastic feedforward', elastic),
                        ('elastic feedforward, stiffness 10 % too high',
                         Robot(with_drives(rigid.model, stiffer)))):
        control = MotorSideControl(robot, motion, kp=KP, kd=KD)
        held = control.command(middles).torques
        result[name] = control.command(times)._replace(torques=held)
    q, u, udot = motion.sample(times)
    sag = result['elastic feedforward'].positions[0] - q[0]
    torques = rigid.inverse_dynamics(*motion.sample(middles))
    of_rigid = MotorCommand(q + sag, u, udot, torques, torques)
    return {'rigid feedforward': of_rigid, **result}


def tip_places(arm: TwoMassArm, command: MotorCommand, start: np.ndarray) -> np.ndarray:
    """Return the places of the tip at the ends of the cycles, (K, 3), m."""
    arm.put(start, np.zeros(14))
    places = []
    for theta, rate, torque in zip(command.positions, command.velocities,
                                   command.torques):
        q, u = arm.state
        tau = np.zeros(14)
        tau[7:] = torque + KP * (theta - q[7:]) + KD * (rate - u[7:])
        arm.step(tau, SUBSTEPS)
        places.append(arm.position(TIP))
    return np.array(places)


def draw(times: np.ndarray, errors: dict[str, np.ndarray], path: str) -> None:
    """Draw the distances of the tip from its place at rest, logarithmically."""
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import pyplot
    figure, axes = pyplot.subplots(figsize=(8.0, 3.6), layout='constrained')
    for name, error in errors.items():
        axes.semilogy(times - DURATION, 1e3 * np.maximum(error, 1e-8), label=name)
    axes.set(xlabel='time after the end of the motion [s]', xlim=(0.0, AFTER - 0.2),
             ylabel='tip from its place at rest [mm]', ylim=(1e-5, 1e1))
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    print(f'Picture: {path}')


def main(arguments: list[str]) -> int:
    """Print amplitudes and ratio; return 0 if the ratio is that asked for."""
    rigid, elastic = arms()
    times = np.arange(0.0, DURATION + AFTER, CYCLE)
    runs = commands(rigid, elastic, times)
    start = np.concatenate([HOME, runs['elastic feedforward'].positions[0]])
    locked = natural_vibration(elastic, start, held=[f'{name}_motor' for name in JOINTS])
    print(
        f'first mode with motors locked: {locked.frequencies[0] / (2.0 * np.pi):.1f} Hz')

    arm = TwoMassArm(URDF.read_text(encoding='utf-8'), elastic.model, CYCLE / SUBSTEPS,
                     'RK4')
    settled = times >= DURATION
    errors = {}
    amplitudes = {}
    for name, command in runs.items():
        places = tip_places(arm, command, start)
        resting_place = places[times >= times[-1] - 0.2].mean(axis=0)
        errors[name] = np.linalg.norm(places - resting_place, axis=1)
        amplitudes[name] = float(errors[name][settled].max())
        print(f'{name}: residual vibration of the tip {1e3 * amplitudes[name]:.4f} mm')
    for name, amplitude in amplitudes.items():
        print(f'{name}: ratio {amplitudes["rigid feedforward"] / amplitude:.1f}')
    if arguments:
        draw(times, errors, arguments[0])
    ratio = amplitudes['rigid feedforward'] / amplitudes['elastic feedforward']
    return int(ratio < LEAST_RATIO)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
