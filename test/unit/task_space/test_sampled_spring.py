"""A sampled spring and damper swing up exactly where the arm on them does."""

from kane_dynamics import CartesianImpedance, load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.task_space.sampled_spring import JointSpring, steady_share, swing
import numpy as np
import pytest

PERIOD = 1e-3
Q = np.array([0.1, -0.7, 0.2, -2.2, 0.1, 1.5, 0.785])


def one_mass(mass, stiffness, damping):
    """Return inertia and spring of one mass."""
    return np.array([[mass]]), JointSpring(np.array([[stiffness]]),
                                           np.array([[damping]]), False)


@pytest.mark.parametrize('ratio', [0.3, 0.9, 1.1, 2.5])
def test_a_delayed_damper_grows_by_the_root_of_its_share_of_a_period(ratio):
    """Of z^2 - z + a, a = d T / m > 1/4, both roots have the magnitude sqrt(a)."""
    inertia, spring = one_mass(0.3, 0.0, ratio * 0.3 / PERIOD)
    motion = swing(inertia, spring, PERIOD)
    assert motion.growth == pytest.approx(max(1.0, np.sqrt(ratio)), abs=1e-6)
    assert motion.swings_up == (ratio > 1.0)


def test_springs_of_the_arm_itself_act_without_a_delay():
    """Two masses on a spring, of which one is held: small steps of the motion itself."""
    own = JointSpring(9e3 * np.array([[1.0, -1.0], [-1.0, 1.0]]), np.zeros((2, 2)),
                      False)
    inertia = np.diag([2.0, 0.5])
    late = JointSpring(np.array([[0.0, 0.0], [0.0, 300.0]]),
                       np.array([[0.0, 0.0], [12.0, 0.0]]), False)
    x, v, force = np.random.default_rng(1).normal(size=(3, 2))
    sizes = []
    for _ in range(3000):
        new_force = -late.stiffness @ x - late.damping @ v
        for _ in range(20):  # a leap-frog
            v = v + 0.05 * PERIOD * (force - own.stiffness @ x) / np.diag(inertia)
            x = x + 0.05 * PERIOD * v
        force = new_force
        sizes.append(np.log(np.linalg.norm(x)))
    growth = np.polyfit(np.arange(2000), sizes[1000:], 1)[0]
    motion = swing(inertia, late, PERIOD, own)
    assert growth == pytest.approx(np.log(motion.growth), rel=0.02)
    assert motion.swings_up and motion.joint == 1


def test_an_undamped_sampled_spring_always_swings_up():
    """The delay of a period makes each spring without a damper a source of energy."""
    inertia, spring = one_mass(1.0, 1000.0, 0.0)
    assert swing(inertia, spring, PERIOD).swings_up
    assert steady_share(inertia, spring, PERIOD) < 1e-2


@pytest.mark.parametrize('seed', range(4))
def test_the_growth_is_that_of_the_recurrence(seed):
    """Many periods of the recurrence itself, from a random state, grow at that rate."""
    rng = np.random.default_rng(seed)
    root, stiff, damp = rng.normal(size=(3, 3, 3))
    inertia = root @ root.T + 0.1 * np.eye(3)
    spring = JointSpring(stiff @ stiff.T * 1e5, damp @ damp.T * 3e2, False)
    motion = swing(inertia, spring, PERIOD)
    x, v, force = rng.normal(size=(3, 3))
    inverse = np.linalg.inv(inertia)
    logs = []
    for _ in range(4000):
        acceleration = inverse @ force
        force = -spring.stiffness @ x - spring.damping @ v
        x = x + PERIOD * v + 0.5 * PERIOD**2 * acceleration
        v = v + PERIOD * acceleration
        size = np.sqrt(x @ x + v @ v + force @ force)
        x = x / size
        v = v / size
        force = force / size
        logs.append(np.log(size))
    assert np.mean(logs[2000:]) == pytest.approx(np.log(motion.growth), abs=1e-3)


@pytest.fixture(scope='module')
def arm():
    """Return the FR3, and the pose of its flange."""
    model = load_urdf(resource_path('urdf', 'fr3.urdf'), tip='fr3_link8')
    robot = Robot(model)
    return robot, robot.frame_pose('fr3_link8', Q)


def spring_of(law, robot, target):
    """Return the law's spring and damper at Q from differences of its torques."""
    h = 1e-6
    zero = np.zeros(7)
    stiffness = [law.torque(Q - h * e, zero, target)
                 - law.torque(Q + h * e, zero, target) for e in np.eye(7)]
    damping = [law.torque(Q, -h * e, target) - law.torque(Q, h * e, target)
               for e in np.eye(7)]
    return JointSpring(np.stack(stiffness, axis=1) / (2 * h),
                       np.stack(damping, axis=1) / (2 * h), by_ratio=True)


def law_with(robot, share):
    """Return a Cartesian impedance with a share of a stiffness that is too large."""
    return CartesianImpedance(robot, 'fr3_link8', limit_stiffness=0.0,
                              speed_limit=np.inf, effort_limit=np.inf,
                              stiffness=share * np.array([2000.0] * 3 + [3000.0] * 3))


def test_an_arm_on_a_share_of_its_spring_swings_up_where_the_recurrence_does(arm):
    """One period late in a simulation, 0.9 of the steady share decays and 1.1 grows."""
    robot, target = arm
    inertia = robot.mass_matrix(Q)
    spring = spring_of(law_with(robot, 1.0), robot, target)
    assert swing(inertia, spring, PERIOD).swings_up
    share = steady_share(inertia, spring, PERIOD)
    assert 0.05 < share < 0.95
    for factor, grows in ((0.9, False), (1.1, True)):
        law = law_with(robot, factor * share)
        q = Q.copy()
        u = np.zeros(7)
        u[6] = 1e-4
        tau = law.torque(q, np.zeros(7), target)
        speeds = []
        for _ in range(300):
            udot = robot.forward_dynamics(q, u, tau)
            tau = law.torque(q, u, target)
            q = q + PERIOD * u + 0.5 * PERIOD**2 * udot
            u = u + PERIOD * udot
            speeds.append(np.abs(u).max())
        assert (max(speeds[-50:]) > max(speeds[:50])) == grows


def test_a_joint_without_inertia_swings_up_on_any_spring():
    spring = JointSpring(np.eye(2), np.eye(2), False)
    motion = swing(np.diag([1.0, 0.0]), spring, PERIOD)
    assert motion.swings_up and motion.joint == 1
    assert steady_share(np.diag([1.0, 0.0]), spring, PERIOD) == 0.0
    # The limit of ever lighter joints.
    growth = [swing(np.diag([1.0, light]), spring, PERIOD).growth
              for light in (1e-6, 1e-9, 1e-12)]
    assert growth == sorted(growth) and growth[-1] > 1e3
