"""Two coupled arms: contact is felt, nothing jumps, a lost side is safe."""

import copy
from functools import cache
import math
import pickle
import re

from kane_dynamics import (ArmCoupling, InputError, JointImpedance, load_urdf,
                           ModelBuilder, MomentumObserver, PartnerState, Prescribed,
                           Robot, rod, Terms, with_tool)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.model.model import Inertial
from linkages import five_bar, five_bar_at
import numpy as np
import pytest
from stepping import stepped

STEP = 1e-3  # s
HOME = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.6, 0.8])
STIFFNESS = np.array([300.0, 300.0, 300.0, 300.0, 60.0, 60.0, 30.0])
DAMPING = np.array([30.0, 30.0, 30.0, 30.0, 4.0, 4.0, 1.5])
TREE = [f'fr3_joint{k}' for k in range(1, 8)]


@cache
def fr3(tool=0.0):
    """Return an arm with the friction of its URDF, and a tool of some kg."""
    model = load_urdf(resource_path('urdf', 'fr3.urdf'), joints=TREE)
    if tool:
        mass = Inertial(tool, np.zeros(3), np.zeros((3, 3)))
        model = with_tool(model, 'fr3_link8', 'tool', mass)
    return Robot(model)


class Side:
    """A simulated arm with its coupling and its observer."""

    def __init__(self, robot, q=HOME, *, load=lambda t, q, u: 0.0 * q, resolution=0.0,
                 **settings):
        self.robot = robot
        self.load = load
        self.resolution = resolution
        self.q, self.u = np.array(q), np.zeros(robot.n)
        self.coupling = ArmCoupling(robot, **{'stiffness': STIFFNESS, 'damping': DAMPING}
                                    | settings)
        self.observer = MomentumObserver(robot, gain=100.0, held=True)
        self.tau = None
        self.torques = []
        self.positions = []
        self.loads = []

    def state(self, t):
        """Return what the partner receives."""
        return PartnerState(t, self.q.copy(), self.u.copy(), self.observer.torque.copy())

    def step(self, t, partner):
        torques = self.coupling.torque(t, self.q, self.u, partner)
        self.tau = torques.copy()
        torques[:] = np.nan  # are the caller's; the law remembers nothing in them
        measured = self.tau
        if self.resolution:  # torque constant times a current of some resolution
            measured = self.resolution * np.round(self.tau / self.resolution)
        self.observer.update(t, self.q, self.u, measured)
        load = self.load(t, self.q, self.u)
        self.torques.append(self.tau)
        self.positions.append(self.q)
        self.loads.append(load)
        # Semi-implicit Euler: the step is short, and the tests judge the arms at rest.
        self.u = self.u + STEP * self.robot.forward_dynamics(self.q, self.u,
                                                             self.tau + load)
        self.q = self.q + STEP * self.u


def coupled(leader, follower, duration, *, begin=0.0, delay=1, lost=math.inf):
    """Simulate both sides; each receives the state of the other some steps later."""
    sides = leader, follower
    sent = [[], []]
    for k in range(round(duration / STEP)):
        t = begin + k * STEP
        for states, side in zip(sent, sides):
            if t < lost:
                states.append(side.state(t))
        received = [states[max(0, len(states) - 1 - delay)] for states in sent]
        for side, partner in zip(sides, reversed(received)):
            side.step(t, partner)


def engaged(leader, follower):
    for side, partner in ((leader, follower), (follower, leader)):
        side.coupling.engage(side.q, partner.state(0.0))


GRASP = np.array([150.0, 150.0, 150.0, 150.0, 20.0, 20.0, 20.0])  # N m/rad, of a hand


def hand(joint, travel):
    """Return the torques of a hand that holds all joints and leads one, for 1.5 s."""
    def load(t, q, u):
        x = min(t / 1.5, 1.0)
        target = HOME.copy()
        target[joint] += travel * x * x * (3.0 - 2.0 * x)
        return GRASP * (target - q) - 0.04 * GRASP * u
    return load


def wall(joint, distance, stiffness=2000.0, damping=20.0):
    """Return the torque of a stiff wall in the way of one joint."""
    def load(t, q, u):
        depth = q[joint] - HOME[joint] - distance
        tau = np.zeros(len(q))
        if depth > 0.0:
            tau[joint] = min(-stiffness * depth - damping * u[joint], 0.0)
        return tau
    return load


@pytest.mark.parametrize(('reflection', 'tool'), [(0.0, 0.0), (0.8, 2.0)])
def test_the_contact_of_the_follower_is_felt_at_the_leader(reflection, tool):
    leader = Side(fr3(), load=hand(0, 0.4), reflection=reflection)
    follower = Side(fr3(tool), load=wall(0, 0.2), reflection=reflection)
    engaged(leader, follower)
    coupled(leader, follower, 4.5)
    led = leader.loads[-1][0]
    touched = follower.loads[-1][0]
    assert touched < -10.0
    assert led == pytest.approx(-touched, rel=0.01)
    stretch = leader.q[0] - follower.q[0]
    assert stretch == pytest.approx((1.0 - reflection) * led / STIFFNESS[0], rel=0.02)
    assert np.abs(leader.u).max() < 1e-3
    np.testing.assert_allclose(follower.observer.torque[0], touched, rtol=0.01)


def test_the_torque_channels_shorten_the_lag_of_free_motion():
    lags = {}
    for reflection in (0.0, 1.0):
        leader = Side(fr3(), load=hand(0, 0.4), reflection=reflection, ramp=1e-3)
        follower = Side(fr3(), reflection=reflection, ramp=1e-3)
        engaged(leader, follower)
        coupled(leader, follower, 1.5)
        distance = np.array(leader.positions)[:, 0] - np.array(follower.positions)[:, 0]
        lags[reflection] = np.abs(distance).max()
    assert lags[1.0] < 0.35 * lags[0.0]


def test_engagement_at_a_distance_moves_the_arms_together_without_a_jump():
    leader = Side(fr3())
    apart = HOME + np.array([0.3, 0.1, -0.2, 0.2, 0.1, -0.1, 0.4])
    follower = Side(fr3(2.0), apart)
    coupled(leader, follower, 0.2)
    engaged(leader, follower)
    coupled(leader, follower, 2.8, begin=0.2)
    np.testing.assert_allclose(leader.q, follower.q, atol=1e-3)
    for side in (leader, follower):
        change = np.abs(np.diff(side.torques, axis=0)).max()
        # N m in a millisecond; the springs would give 90 N m at once.
        assert change < 0.5
        speeds = np.abs(np.diff(side.positions, axis=0)) / STEP
        assert speeds.max() < 0.25  # align_speed, and what its end overshoots


def test_a_distance_is_kept_where_it_is_to_be():
    leader = Side(fr3(), load=hand(0, 0.2), align_speed=0.0)
    follower = Side(fr3(), HOME + 0.3, align_speed=0.0)
    engaged(leader, follower)
    coupled(leader, follower, 2.4)
    np.testing.assert_allclose(follower.q - leader.q, 0.3, atol=2e-3)


@pytest.mark.parametrize('alone', ['hold', 'free'])
def test_a_lost_partner_lets_the_torque_neither_jump_nor_the_arm_go_on(alone):
    leader = Side(fr3(), load=hand(0, 0.4), alone=alone)
    follower = Side(fr3(), alone='hold')
    engaged(leader, follower)
    coupled(leader, follower, 3.0, lost=0.7)
    for side in (leader, follower):
        assert not side.coupling.engaged
        assert side.coupling.lost.startswith('partner: no state for 0.10')
    assert np.abs(np.diff(follower.torques[600:], axis=0)).max() < 0.5
    assert np.abs(np.diff(leader.torques[600:], axis=0)).max() < 0.5
    # The follower rests soon after; the leader is held, or follows the hand alone.
    stopped = np.array(follower.positions)
    assert np.abs(stopped[-1] - stopped[-500]).max() < 2e-3
    at_hand = abs(leader.q[0] - HOME[0] - 0.4)
    assert at_hand < 0.01 if alone == 'free' else at_hand > 0.05


def test_without_reflection_the_energy_of_the_coupled_arms_does_not_rise():
    """The rate of kinetic and spring energy between them, at random states."""
    random = np.random.default_rng(3)
    robots = fr3(), fr3(2.0)
    couplings = []
    for robot in robots:
        couplings.append(
            ArmCoupling(robot, stiffness=STIFFNESS, damping=0.0, reflection=0.0,
                        ramp=1e-6, speed_limit=math.inf, align_speed=0.0))
    for _ in range(20):
        start = PartnerState(0.0, HOME, np.zeros(7), np.zeros(7))
        for coupling in couplings:
            coupling.torque(0.0, HOME, np.zeros(7))
            coupling.engage(HOME, start)
            coupling.torque(0.0, HOME, np.zeros(7), start)
        q = HOME + random.uniform(-0.3, 0.3, (2, 7))
        u = random.normal(size=(2, 7))
        energies = []
        states = [PartnerState(STEP, *state, np.zeros(7)) for state in zip(q, u)]
        torques = [coupling.torque(STEP, *state, partner) for coupling, state, partner
                   in zip(couplings, zip(q, u), reversed(states))]
        for step in (-1e-5, 1e-5):
            moved = [stepped(robot, lambda q, u, tau=tau: tau, *state, step)
                     for robot, tau, state in zip(robots, torques, zip(q, u))]
            stretch = moved[0][0] - moved[1][0]
            energies.append(0.5 * STIFFNESS @ stretch**2 + sum(
                robot.kinetic_energy(*state) for robot, state in zip(robots, moved)))
        # What friction takes is more than what its compensation gives: f(a) - f(b) at a
        # - b.
        friction = robots[0].friction_force(u[0]) - robots[0].friction_force(u[1])
        rate = (energies[1] - energies[0]) / 2e-5
        assert rate == pytest.approx(-friction @ (u[0] - u[1]), abs=1e-4)
        assert rate < 0.0
        for coupling in couplings:
            coupling.torque(9.0, HOME, np.zeros(7))  # begins again


def test_arms_with_currents_only_feel_contact_through_their_torque_constants():
    """The observers get current times constant, in 0.3 N m steps, with friction."""
    leader = Side(fr3(), load=hand(0, 0.4), resolution=0.3)
    follower = Side(fr3(), load=wall(0, 0.2), resolution=0.3)
    engaged(leader, follower)
    coupled(leader, follower, 3.0)
    led = leader.loads[-1][0]
    touched = follower.loads[-1][0]
    assert touched < -10.0
    assert led == pytest.approx(-touched, abs=0.4)


def test_a_delay_up_to_damping_over_stiffness_is_stable():
    leader = Side(fr3(), load=hand(0, 0.4))
    follower = Side(fr3(), load=wall(0, 0.2))
    engaged(leader, follower)
    coupled(leader, follower, 3.0, delay=20)
    assert max(np.abs(side.u).max() for side in (leader, follower)) < 5e-3


def test_forces_and_targets_keep_their_limits():
    limit = np.array([20.0, 20.0, 20.0, 20.0, 5.0, 5.0, 2.0])
    side = Side(fr3(), force_limit=limit, ramp=1e-6, align_speed=0.0)
    coupling = side.coupling
    start = PartnerState(0.0, HOME, np.zeros(7), np.zeros(7))
    coupling.engage(HOME, start)
    hold = coupling.torque(0.0, HOME, np.zeros(7), start)
    np.testing.assert_allclose(hold, fr3().gravity_force(HOME), atol=1e-9)
    # The partner jumps by a radian: the target goes there at the speed limits.
    for k in range(1, 40):
        far = PartnerState(k * STEP, HOME + 1.0, np.zeros(7), np.full(7, 30.0))
        tau = coupling.torque(k * STEP, HOME, np.zeros(7), far)
        force = tau - hold
        assert (np.abs(force) <= limit * (1.0 + 1e-9)).all()
    assert coupling.saturated
    moved = np.minimum(1.0, 39 * STEP * fr3().limits.velocity)
    expected = STIFFNESS * np.minimum(moved, fr3().limits.upper - HOME) + 0.8 * 30.0
    np.testing.assert_allclose(force, expected * (limit / expected).min(), rtol=1e-9)


def test_the_torque_is_that_of_joint_impedance_with_the_partner_as_its_motion():
    robot = fr3(2.0)
    scale = np.array([1.0, -1.0, 2.0, 1.0, 0.5, 1.0, 1.0])
    coupling = ArmCoupling(robot, stiffness=STIFFNESS, damping=DAMPING, reflection=0.7,
                           scale=scale, ramp=1e-6, align_speed=0.0)
    random = np.random.default_rng(5)
    theirs, rates, external = random.normal(size=(3, 7)) * 0.1
    partner = PartnerState(0.0, theirs, rates, external)
    coupling.engage(HOME, partner)
    coupling.torque(0.0, HOME, np.zeros(7), partner)
    q = HOME + 0.05 * random.normal(size=7)
    u = 0.2 * random.normal(size=7)
    tau = coupling.torque(STEP, q, u, partner._replace(t=STEP))
    law = JointImpedance(robot, stiffness=STIFFNESS, damping=DAMPING,
                         compensate=Terms(coriolis=False))
    expected = law.torque(q, u, HOME, scale * rates) + 0.7 * external / scale
    np.testing.assert_allclose(tau, expected, rtol=1e-9, atol=1e-9)


def test_the_cranks_of_a_closed_loop_are_coupled():
    robot = five_bar('left_crank', 'right_crank')
    coupling = ArmCoupling(robot, stiffness=50.0, damping=5.0, ramp=1e-6,
                           align_speed=0.0)
    q = five_bar_at(2.1, 1.05)
    u = np.array([0.3, -0.2])
    cranks = [robot.coordinate_names.index(name)
              for name in ('left_crank', 'right_crank')]
    partner = PartnerState(0.0, q[cranks], np.array([0.1, 0.1]), np.array([1.0, 2.0]))
    coupling.engage(q, partner)
    coupling.torque(0.0, q, u, partner)
    tau = coupling.torque(STEP, q, u, partner._replace(t=STEP))
    law = JointImpedance(robot, stiffness=50.0, damping=5.0,
                         compensate=Terms(coriolis=False))
    expected = law.torque(q, u, q[cranks] + 0.8 * partner.external / 50.0, partner.u)
    np.testing.assert_allclose(tau, expected, rtol=1e-9, atol=1e-9)


def test_faulty_states_of_the_partner_disengage_and_settings_are_checked():
    coupling = ArmCoupling(fr3(), stiffness=STIFFNESS, damping=DAMPING)
    good = PartnerState(0.0, HOME, np.zeros(7), np.zeros(7))
    for bad, words in (
            (None, 'partner: no state'),
            (good._replace(u=np.full(7, math.nan)),
             "partner: u of joint 'fr3_joint1': nan; expected"),
            (good._replace(q=HOME[:5]), r'partner: q: shape \(5,\); expected'),
            (good._replace(external=None), r'partner: external: shape \(\); expected'),
            (good._replace(t=-1.0), r'partner: no state for 1\.0'),
            (good._replace(t=1000.0), r'partner: a state 1000\.0.* s ahead; expected')):
        coupling.engage(HOME, good)
        coupling.torque(0.0, HOME, np.zeros(7), bad)
        assert not coupling.engaged
        assert re.search(words, coupling.lost)
    for settings, words in (({'stiffness': -1.0}, 'stiffness'),
                            ({'reflection': 1.5}, 'at most 1'),
                            ({'scale': 0.0}, "scale of joint 'fr3_joint1': 0"),
                            ({'scale': [1.0, 2.0]}, r'scale: shape \(2,\); expected'),
                            ({'alone': 'fall'}, "alone: 'fall'; expected hold or free"),
                            ({'timeout': 0.0}, 'timeout: 0.0; expected'),
                            ({'ramp': math.nan}, 'ramp: nan; expected')):
        with pytest.raises(InputError, match=words):
            ArmCoupling(fr3(), **{'stiffness': 1.0, 'damping': 1.0} | settings)
    with pytest.raises(InputError, match='q of the partner: shape'):
        coupling.engage(HOME, good._replace(q=HOME[:3]))
    with pytest.raises(InputError, match='partner: a tuple; expected a PartnerState'):
        coupling.engage(HOME, (0.0, HOME, HOME, HOME))


def test_an_arm_without_states_for_the_timeout_begins_alone_where_it_is():
    coupling = ArmCoupling(fr3(), stiffness=STIFFNESS, damping=DAMPING)
    good = PartnerState(0.0, HOME, np.zeros(7), np.zeros(7))
    coupling.engage(HOME, good)
    coupling.torque(0.0, HOME, np.zeros(7), good)
    elsewhere = HOME + 0.2
    tau = coupling.torque(5.0, elsewhere, np.zeros(7), good._replace(t=5.0))
    assert coupling.lost == 'this arm: no state for 5.000 s'
    np.testing.assert_allclose(tau, fr3().gravity_force(elsewhere), atol=1e-9)
    coupling.torque(4.0, elsewhere, np.zeros(7), good._replace(t=4.0))
    assert coupling.lost == 'this arm: time went back by 1.000 s'


def test_one_refused_state_changes_nothing_and_lasting_ones_end_the_coupling():
    coupling = ArmCoupling(fr3(), stiffness=STIFFNESS, damping=DAMPING, timeout=0.1)
    at_rest = np.zeros(7)
    bad = np.full(7, np.nan)

    def partner(t):
        return PartnerState(t, HOME + t, at_rest + 1.0, at_rest + 5.0)
    coupling.engage(HOME, partner(0.0))
    coupling.torque(0.0, HOME, at_rest, partner(0.0))
    twin = copy.deepcopy(coupling)
    with pytest.raises(InputError, match='fr3_joint1'):
        coupling.torque(0.02, HOME, bad, partner(0.02))
    np.testing.assert_array_equal(coupling.torque(0.05, HOME, at_rest, partner(0.05)),
                                  twin.torque(0.05, HOME, at_rest, partner(0.05)))
    for t in (0.1, 0.15, 0.2):
        with pytest.raises(InputError):
            coupling.torque(t, HOME, bad, partner(t))
    coupling.torque(0.21, HOME, at_rest, partner(0.21))
    assert not coupling.engaged and coupling.lost == 'this arm: no state for 0.150 s'


def test_states_of_the_partner_may_be_lists():
    coupling = ArmCoupling(fr3(), stiffness=STIFFNESS, damping=DAMPING)
    at_rest = [0.0] * 7
    coupling.engage(HOME, PartnerState(0.0, HOME.tolist(), at_rest, at_rest))
    tau = coupling.torque(0.0, HOME, at_rest,
                          PartnerState(0.0, HOME.tolist(), at_rest, at_rest))
    assert coupling.engaged
    np.testing.assert_allclose(tau, fr3().gravity_force(HOME), atol=1e-9)


def test_constraints_that_depend_on_time_have_the_time_of_the_state():
    builder = ModelBuilder('arm on a turning table')
    beam = rod(1.0, (0, 0, 0), (0.3, 0, 0))
    builder.body('table', axis=(0, 0, 1), inertial=beam)
    builder.body('arm', 'table', axis=(0, 1, 0), at=(0.3, 0, 0), inertial=beam)
    robot = Robot(builder.model(),
                  constraints=[Prescribed('table', lambda t: 0.1 * np.sin(t))])
    t = 0.5
    q = np.array([0.1 * np.sin(t), 0.2])
    at_rest = np.zeros(1)
    coupling = ArmCoupling(robot, stiffness=10.0, damping=1.0)
    expected = JointImpedance(robot, stiffness=10.0, damping=1.0,
                              compensate=Terms(coriolis=False, inertia=False))
    np.testing.assert_allclose(coupling.torque(t, q, at_rest),
                               expected.torque(q, at_rest, q[1:], t=t), atol=1e-12)


@pytest.mark.parametrize('copied', [
    copy.copy, copy.deepcopy, lambda coupling: pickle.loads(pickle.dumps(coupling))])
@pytest.mark.parametrize('alone', ['hold', 'free'])
def test_a_copy_goes_on_where_the_original_is_and_has_a_memory_of_its_own(alone, copied):
    robot = fr3()
    coupling = ArmCoupling(robot, stiffness=STIFFNESS, damping=DAMPING, alone=alone)
    moving = np.linspace(-0.2, 0.3, 7)

    def partner(t):
        return PartnerState(t, HOME + 0.1 + t * moving, moving, 5.0 * moving)
    coupling.engage(HOME, partner(0.0))
    for t in (0.0, 0.05, 0.1):
        coupling.torque(t, HOME, 0.0 * HOME, partner(t))
    twin = copied(coupling)
    assert twin.engaged and twin.robot.joint_names == robot.joint_names
    # The copy loses its partner, and the original follows it.
    for t in np.arange(0.15, 0.5, 0.05):
        twin.torque(t, HOME, 0.0 * HOME)
    assert twin.lost and coupling.engaged and not coupling.lost
    reference = copied(coupling)
    for t in (0.15, 0.2):
        expected = reference.torque(t, HOME, 0.0 * HOME, partner(t))
        np.testing.assert_array_equal(
            coupling.torque(t, HOME, 0.0 * HOME, partner(t)), expected)
    assert np.abs(twin.torque(0.5, HOME, 0.0 * HOME) - expected).max() > 0.1
    # A copy of the robot has its own gravity.
    if twin.robot is not robot:
        twin.robot.parameters.gravity = [0.0, 0.0, 0.0]
        tau = coupling.torque(0.25, HOME, 0.0 * HOME, partner(0.25))
        np.testing.assert_array_equal(
            tau, reference.torque(0.25, HOME, 0.0 * HOME, partner(0.25)))
        assert np.abs(twin.torque(0.51, HOME, 0.0 * HOME) - tau).max() > 10.0
