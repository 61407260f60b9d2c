"""Contacts and their ends are detected whatever the friction; thresholds fit."""

from dataclasses import replace
from functools import cache

from kane_dynamics import (CollisionDetector, FrictionError, InputError, load_urdf,
                           MomentumObserver, Robot)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.identification import calibrate_collision, Recording
import numpy as np
import pytest

# s, of the controller; steps of the integration in it
PERIOD = 2e-3
SUBSTEPS = 2
ARMATURE = 0.1  # kg m^2
NOISE = 1e-5, 5e-4  # of positions, rad, and speeds, rad/s
# s
CONTACT = 0.6
PAUSE = 1.5
CLEARED = 0.5
# Coulomb friction, N m, damping, N m s, home and amplitude, rad, and the links in
# contact.
ARMS = {
    'fr3': ((.6, .7, .5, .6, .35, .3, .25), (.5, .5, .4, .4, .15, .15, .1),
            (0.0, -0.6, 0.0, -2.0, 0.0, 1.6, 0.6), (.8, .4, .6, .5, .7, .7, .8),
            [f'fr3_joint{k}' for k in range(1, 8)],
            ('fr3_link4', 'fr3_link5', 'fr3_link6', 'fr3_link7')),
    'ur10e': ((7., 8., 5., 1.5, 1.2, 1.), (10., 10., 7., 1.5, 1.2, 1.),
              (0.0, -1.2, 1.4, -1.0, -1.2, 0.3), (.8, .4, .5, .7, .7, .8), None,
              ('forearm_link', 'wrist_1_link', 'wrist_2_link', 'wrist_3_link'))}


@cache
def robot(name, factor, wrench_frames=()):
    """Return an arm whose friction is a multiple of that of the model."""
    coulomb, damping, *_, joints, _ = ARMS[name]
    model = load_urdf(resource_path('urdf', f'{name}.urdf'), joints=joints)
    friction = {joint: (mu, d)
                for joint, mu, d in zip(model.joint_names, coulomb, damping)}
    bodies = []
    for body in model.bodies:
        joint = body.joint
        if joint.name in friction:
            mu, d = friction[joint.name]
            joint = replace(joint, friction=factor * mu, damping=factor * d,
                            armature=ARMATURE)
        bodies.append(replace(body, joint=joint))
    return Robot(replace(model, bodies=tuple(bodies)), wrench_frames=wrench_frames)


class Arm:
    """An arm with noisy encoders under computed torque, its friction unmodelled."""

    def __init__(self, name, factor, seed):
        self.links = ARMS[name][-1]
        self.model, self.plant = robot(name, 1.0), robot(name, factor, self.links)
        self.rng = np.random.default_rng(seed)
        n = self.model.n
        self.home, self.amplitude = (np.array(ARMS[name][k]) for k in (2, 3))
        self.omega = 2.0 * np.pi * np.linspace(0.11, 0.29, n)[self.rng.permutation(n)]
        self.phase = self.rng.uniform(0.0, 6.0, n)
        self.t, self.wrench = 0.0, np.zeros((len(self.links), 6))
        self.q, self.u, _ = self.desired()

    def desired(self):
        phase = self.omega * self.t + self.phase
        return (self.home + self.amplitude * np.sin(phase),
                self.amplitude * self.omega * np.cos(phase),
                -self.amplitude * self.omega**2 * np.sin(phase))

    def tick(self):
        """Advance by one period; return time, measured state and torque of its start."""
        q = self.q + NOISE[0] * self.rng.normal(size=len(self.q))
        u = self.u + NOISE[1] * self.rng.normal(size=len(self.q))
        q_d, u_d, udot_d = self.desired()
        tau = self.model.inverse_dynamics(q, u,
                                          udot_d + 200.0 * (q_d - q) + 28.0 * (u_d - u))
        start = self.t
        for _ in range(SUBSTEPS):
            udot = self.plant.forward_dynamics(self.q, self.u, tau, wrench=self.wrench)
            self.u = self.u + PERIOD / SUBSTEPS * udot
            self.q = self.q + PERIOD / SUBSTEPS * self.u
        self.t += PERIOD
        return start, q, u, tau


@cache
def calibration(name, factor, seconds):
    arm = Arm(name, factor, seed=1)
    return calibrate_collision(arm.model, recording_of(arm, seconds), held=True)


class Contacts:
    """Counts of a run with contacts: detected, not cleared in 0.5 s, and false flags."""

    def __init__(self, name, factor, calibrated):
        self.arm = Arm(name, factor, seed=3)
        self.observer = MomentumObserver(self.arm.model, held=True,
                                         friction_error=calibrated.friction_error())
        self.detector = CollisionDetector(self.arm.model.joint_names,
                                          calibrated.threshold)
        self.rng = np.random.default_rng(7)
        self.detected = self.late = self.false = 0

    def tick(self):
        """Advance by one period; return whether the flag has just been set."""
        t, q, u, tau = self.arm.tick()
        changed = self.detector.update(t, self.observer.update(t, q, u, tau))
        return changed and self.detector.collision

    def run(self, count):
        """Advance by `count` pauses, each with a contact after it, and a last pause."""
        self.pause()
        for _ in range(count):
            direction = self.rng.normal(size=3)
            direction /= np.linalg.norm(direction)
            link = self.rng.integers(len(self.arm.links))
            self.arm.wrench[link, :3] = self.rng.uniform(10.0, 25.0) * direction
            flags = [self.tick() or self.detector.collision
                     for _ in range(steps(CONTACT))]
            self.detected += any(flags)
            self.arm.wrench[:] = 0.0
            # The arm swings back: a flag is no false one.
            for _ in range(steps(CLEARED)):
                self.tick()
            self.late += self.detector.collision
            self.pause(PAUSE - CLEARED)
        return self

    def pause(self, seconds=PAUSE):
        """Advance without contact."""
        self.false += sum(self.tick() for _ in range(steps(seconds)))


def steps(seconds):
    return round(seconds / PERIOD)


@pytest.mark.parametrize(('name', 'factor'), [('fr3', 1.5), ('ur10e', 0.8)])
def test_contacts_are_detected_and_cleared_with_other_friction_than_the_models(
        name, factor):
    run = Contacts(name, factor, calibration(name, factor, 6.0)).run(4)
    assert (run.detected, run.late, run.false) == (4, 0, 0)


@pytest.mark.slow
@pytest.mark.parametrize('factor', [0.8, 1.0, 1.2, 1.5])
@pytest.mark.parametrize('name', ['fr3', 'ur10e'])
def test_of_twenty_contacts_of_10_to_25_newtons_at_least_17_are_detected(name, factor):
    run = Contacts(name, factor, calibration(name, factor, 20.0)).run(20)
    assert run.detected >= 17, run.detected
    assert run.late == 0
    assert run.false <= 2, run.false
    assert run.arm.t == pytest.approx(43.5)


@pytest.mark.slow
@pytest.mark.parametrize('factor', [0.8, 1.2])
@pytest.mark.parametrize('name', ['fr3', 'ur10e'])
def test_the_flag_follows_friction_that_has_changed_since_the_calibration(name, factor):
    run = Contacts(name, factor, calibration(name, 1.0, 20.0))
    run.run(8)  # the friction follows
    run.late = run.detected = run.false = 0
    run.run(8)
    assert run.detected >= 7
    assert run.late == 0
    assert run.false <= 1


@pytest.mark.parametrize('factor', [0.8, 1.5])
def test_the_friction_beyond_the_model_is_that_of_the_arm(factor):
    calibrated = calibration('fr3', factor,
                             6.0) if factor == 1.5 else calibration('ur10e', factor, 6.0)
    coulomb, damping = (np.array(part)
                        for part in ARMS['fr3' if factor == 1.5 else 'ur10e'][:2])
    # Friction at 0.5 rad/s: single coefficients are correlated in a short recording.
    excess = (factor - 1.0) * (coulomb + 0.5 * damping)
    fitted = calibrated.coulomb * np.tanh(
        0.5 / calibrated.friction_speed) + 0.5 * calibrated.damping
    np.testing.assert_allclose(fitted, excess, rtol=0.1, atol=0.01)
    assert calibrated.suspected == calibrated.unmoved == ()


def recording_of(arm, seconds):
    rows = [arm.tick() for _ in range(steps(seconds))]
    t, q, u, tau = (np.array(column) for column in zip(*rows))
    return Recording(t, q, u, np.gradient(u, t, axis=0), tau)


def test_a_contact_in_the_recording_is_reported():
    arm = Arm('fr3', 1.0, seed=1)
    first = recording_of(arm, 4.0)
    arm.wrench[3, :3] = 15.0, 10.0, 0.0
    touched = recording_of(arm, 0.03)
    arm.wrench[:] = 0.0
    last = recording_of(arm, 2.0)
    parts = first, touched, last
    whole = Recording(*(np.concatenate([getattr(part, name) for part in parts])
                        for name in ('t', 'q', 'u', 'udot', 'tau')))
    calibration = calibrate_collision(arm.model, whole, held=True)
    assert calibration.suspected
    j = calibration.joint_names.index(calibration.suspected[0])
    assert 4.0 < calibration.error_time[j] < 4.2


def test_a_force_on_a_resting_joint_is_never_taken_for_friction():
    friction = FrictionError(('a', 'b'), coulomb=[0.1, -0.2], memory=1.0, largest=1.0)
    for _ in range(10000):
        friction.adapt(0.01, np.exp([-0.5, -0.5]), np.zeros(2), np.array([0.9, -0.9]))
    assert friction.coulomb.tolist() == [0.1, -0.2]
    assert friction.damping.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(('arguments', 'words'), [
    ({'friction_speed': 0.0},
     "friction_speed of joint 'a': 0; expected a positive number"),
    ({'memory': 0.0}, 'memory: 0.0; expected a positive time'),
    ({'memory': None}, 'memory: None; expected a positive time'),
    ({'coulomb': [1.0]}, 'coulomb: '), ({'offset': np.nan}, 'offset')])
def test_invalid_friction_is_refused_by_name(arguments, words):
    with pytest.raises(InputError, match=words):
        FrictionError(('a', 'b'), **arguments)


def test_friction_of_other_joints_is_refused():
    with pytest.raises(InputError, match='friction_error: of b, a; expected '):
        MomentumObserver(Arm('fr3', 1.0, seed=1).model,
                         friction_error=FrictionError(('b', 'a')))
    with pytest.raises(InputError,
                       match="joint_names: 'ab'; expected a sequence of names"):
        FrictionError('ab')


@pytest.mark.parametrize(('arguments', 'words'), [
    ({'margin': 1.0}, 'margin: 1.0; expected a number of at least 1.25'),
    ({'margin': '2'}, "margin: '2'; expected a number of at least 1.25"),
    ({'gain': [50.0, 50.0]}, 'gain: .*expected a positive number'),
    ({'held': 'no'}, "held: 'no'; expected True or False"),
    ({'drift': -0.1}, 'drift: -0.1; expected a finite number >= 0')])
def test_invalid_margins_are_refused(arguments, words):
    arm = Arm('fr3', 1.0, seed=1)
    with pytest.raises(InputError, match=words):
        calibrate_collision(arm.model, recording_of(arm, 0.2), **arguments)
