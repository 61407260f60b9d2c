"""
An FR3 held by a Cartesian impedance is pushed, and pulled out of its workspace and back.

Without inertia shaping the stiffness is what a hand feels: the deflection under a force
is the force over the stiffness. Through the stretched arm, a singular configuration, the
energy falls. `python examples/push_and_release.py push.png` draws both.
"""

from pathlib import Path
import sys

from kane_dynamics import CartesianImpedance, load_urdf, Robot, TaskSpace
import numpy as np

TOOL = 'fr3_link8'
STIFFNESS = [2000.0, 2000.0, 2000.0, 100.0, 100.0, 100.0]  # N/m, N m/rad
START = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.5, 0.785])

robot = Robot(load_urdf(Path(__file__).parents[1] / 'urdf' / 'fr3.urdf', tip=TOOL),
              friction=False, wrench_frames=(TOOL,))
impedance = CartesianImpedance(robot, TOOL, stiffness=STIFFNESS, force_limit=60.0,
                               moment_limit=8.0)
home = robot.frame_pose(TOOL, START)
far = home.copy()
far[:3, 3] += [0.3, 0.0, 0.35]  # out of reach
SPACE = TaskSpace(robot, TOOL)


def held(target, wrench, q, u, duration):
    """Return configurations, speeds, deflections and energies every 2 ms, (K, ...)."""
    rows = []
    state = q, u
    for _ in range(round(duration / 2e-3)):
        q, u = state
        energy = robot.kinetic_energy(q, u) + impedance.energy(q, target)
        deflection = robot.frame_pose(TOOL, q)[:3, 3] - target[:3, 3]
        rows.append([*deflection, energy, SPACE.at(q).mass])
        state = stepped(target, wrench, q, u)
    return state, np.array(rows)


def stepped(target, wrench, q, u, h=2e-3):
    """Return the state after a step of Runge-Kutta 4, the law at every stage."""
    def rates(q, u):
        tau = impedance.torque(q, u, target)
        return np.array([u, robot.forward_dynamics(q, u, tau, wrench=wrench)])
    x = np.array([q, u])
    a = rates(*x)
    b = rates(*(x + 0.5 * h * a))
    c = rates(*(x + 0.5 * h * b))
    d = rates(*(x + h * c))
    return x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)


no_speed = np.zeros(robot.n)
push = np.array([[0.0, 0.0, -20.0, 0.0, 0.0, 0.0]])
state, pushed = held(home, push, START, no_speed, 2.0)
state, released = held(home, None, *state, 1.0)
expected = push[0, :3] / STIFFNESS[:3]
print(f'deflection under 20 N: {1e3 * pushed[-1, 2]:.6f} mm, force over stiffness: '
      f'{1e3 * expected[2]:.6f} mm')
print(f'after the release: {1e3 * np.abs(released[-1, :3]).max():.3f} mm')

state, out = held(far, None, *state, 1.5)
state, back = held(home, None, *state, 1.5)
print(
    f'largest rise of the energy in 2 ms: {max(0.0, np.diff(out[:, 3]).max()):.1e} '
    f'J out of reach, {max(0.0, np.diff(back[:, 3]).max()):.1e} J on the way back')
print(f'resisting mass in the heaviest direction: {out[0, 4]:.0f} kg at first, up to '
      f'{max(out[:, 4].max(), back[:, 4].max()):.0f} kg')

if len(sys.argv) > 1:
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    figure, (above, middle, below) = plt.subplots(3, 1, figsize=(8.0, 7.0),
                                                  layout='constrained')
    t = 2e-3 * np.arange(len(pushed) + len(released))
    above.plot(t, 1e3 * np.concatenate([pushed, released])[:, 2])
    above.axhline(1e3 * expected[2], color='gray', linestyle=':')
    above.set(title='Pushed down with 20 N for 2 s, then released',
              ylabel='deflection, mm')
    t = 3.0 + 2e-3 * np.arange(len(out) + len(back))
    rows = np.concatenate([out, back])
    middle.plot(t, rows[:, 3])
    middle.set(
        title='Pulled out of the workspace, at 4.5 s back: kinetic and spring energy',
        ylabel='J')
    below.semilogy(t, rows[:, 4])
    below.set(xlabel='s', ylabel='mass, kg', title='Mass in the heaviest direction')
    figure.savefig(sys.argv[1], dpi=130)
