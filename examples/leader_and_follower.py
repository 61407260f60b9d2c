"""Two FR3: a hand leads one, the other follows and touches a wall; the hand feels it."""

from pathlib import Path
import sys

from kane_dynamics import ArmCoupling, load_urdf, MomentumObserver, PartnerState, Robot
import numpy as np

STEP = 1e-3  # s, also the delay between the arms
STIFFNESS = [300.0, 300.0, 300.0, 300.0, 60.0, 60.0, 30.0]  # N m/rad
DAMPING = [30.0, 30.0, 30.0, 30.0, 4.0, 4.0, 1.5]  # N m s/rad
HOME = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.6, 0.8])
robot = Robot(load_urdf(Path(__file__).parents[1] / 'urdf' / 'fr3.urdf',
                        joints=[f'fr3_joint{k}' for k in range(1, 8)]))


class Arm:
    """A simulated arm, its side of the coupling, and its torque observer."""

    def __init__(self, load):
        self.q, self.u = HOME.copy(), np.zeros(7)
        self.load = load  # external torque, by time and state
        self.coupling = ArmCoupling(robot, stiffness=STIFFNESS, damping=DAMPING,
                                    reflection=0.8)
        self.observer = MomentumObserver(robot, gain=100.0, held=True)

    def state(self, t):
        """Return the state that this arm sends to its partner."""
        return PartnerState(t, self.q, self.u, self.observer.torque)

    def step(self, t, partner):
        """Command the coupling's torque for one step; return the external torque."""
        tau = self.coupling.torque(t, self.q, self.u, partner)
        self.observer.update(t, self.q, self.u, tau)
        external = self.load(t, self.q, self.u)
        self.u = self.u + STEP * robot.forward_dynamics(self.q, self.u, tau + external)
        self.q = self.q + STEP * self.u
        return external


def hand(t, q, u):
    """Return the torque of a hand that turns the first joint by 0.4 rad and back."""
    target = HOME.copy()
    target[0] += 0.2 * (1.0 - np.cos(np.pi * min(t, 4.0) / 2.0))
    grasp = np.array([150.0, 150.0, 150.0, 150.0, 20.0, 20.0, 20.0])
    return grasp * (target - q) - 0.04 * grasp * u


def wall(t, q, u):
    """Return the torque of a wall at 0.2 rad of the first joint."""
    depth = q[0] - HOME[0] - 0.2
    tau = np.zeros(7)
    if depth > 0.0:
        tau[0] = min(-2000.0 * depth - 20.0 * u[0], 0.0)
    return tau


leader = Arm(hand)
follower = Arm(wall)
leader.coupling.engage(leader.q, follower.state(0.0))
follower.coupling.engage(follower.q, leader.state(0.0))
rows = []
for k in range(4500):
    t = STEP * k
    of_leader = leader.state(t)
    of_follower = follower.state(t)
    felt = leader.step(t, of_follower)[0]
    touched = follower.step(t, of_leader)[0]
    rows.append((t, leader.q[0], follower.q[0], felt, -touched))
rows = np.array(rows)

pressed = rows[np.argmax(rows[:, 4])]
print(f'the wall is pressed with {pressed[4]:.1f} N m, the hand feels '
      f'{pressed[3]:.1f} N m')
print(f'the arms are {1e3 * (pressed[1] - pressed[2]):.0f} mrad apart then, '
      f'and {1e3 * abs(rows[-1, 1] - rows[-1, 2]):.1f} mrad in the end')

if len(sys.argv) > 1:
    import matplotlib.pyplot as plt
    figure, (positions, torques) = plt.subplots(2, sharex=True, figsize=(7.0, 4.5))
    positions.plot(rows[:, 0], rows[:, 1], label='leader')
    positions.plot(rows[:, 0], rows[:, 2], label='follower')
    positions.set_ylabel('first joint, rad')
    torques.plot(rows[:, 0], rows[:, 3], label='hand on the leader')
    torques.plot(rows[:, 0], rows[:, 4], label='follower on the wall')
    torques.set_ylabel('N m')
    torques.set_xlabel('s')
    for axes in (positions, torques):
        axes.legend()
    figure.tight_layout()
    figure.savefig(sys.argv[1], dpi=120)
