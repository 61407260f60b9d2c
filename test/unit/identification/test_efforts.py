"""Each kind of effort gives the joints' torques; contradictions are found."""

from dataclasses import replace

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import InputError
from kane_dynamics.identification import Efforts, identify_payload, Recording
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.model import with_payload
import numpy as np
import pytest

URDF = resource_path('urdf', 'ur10e.urdf')
JOINTS = load_urdf(URDF).joint_names
LOSSES = {'joints': {name: {'damping': 2.0, 'friction': 3.0, 'armature': 0.4}
                     for name in JOINTS}}
ARM = load_urdf(URDF, supplement=LOSSES)
CONSTANTS = np.array([12.0, 12.0, -10.0, 8.0, -8.0, 8.0])  # two turn the other way


@pytest.fixture(scope='module')
def robot():
    return Robot(ARM)


@pytest.fixture(scope='module')
def recording(robot):
    """Return a motion with the torques of the motors, gravity included."""
    t = np.linspace(0.0, 6.0, 301)
    w = np.array([0.7, 0.9, 1.1, 1.3, 1.5, 1.7])
    q = 0.5 * np.sin(np.outer(t, w)) + [0.0, -1.2, 1.4, -1.7, -1.5, 0.0]
    u = 0.5 * w * np.cos(np.outer(t, w))
    udot = -0.5 * w**2 * np.sin(np.outer(t, w))
    return Recording(t, q, u, udot, robot.inverse_dynamics(q, u, udot))


def as_reported(kind, robot, r, external=0.0):
    """Return what a driver of each kind would report of a recording, without the law."""
    losses = robot.friction_force(r.u) + 0.4 * r.udot  # between motor and sensor
    weight = robot.gravity_force(r.q)
    return {'current': (Efforts('motor_current', constants=CONSTANTS),
                        r.tau / CONSTANTS),
            'current without gravity': (Efforts('motor_current', False, CONSTANTS),
                                        (r.tau - weight) / CONSTANTS),
            'motor': (Efforts(), r.tau),
            'motor without gravity': (Efforts('motor_torque', False), r.tau - weight),
            'joint': (Efforts('joint_torque'), r.tau - losses),
            'joint without gravity': (Efforts('joint_torque', gravity=False),
                                      r.tau - losses - weight),
            'external': (Efforts('external_torque'), external + 0.0 * r.tau)}[kind]


KINDS = ('current', 'current without gravity', 'motor', 'motor without gravity', 'joint',
         'joint without gravity', 'external')


@pytest.mark.parametrize('kind', KINDS)
def test_the_torque_of_the_motion_follows_from_every_kind_of_effort(
        kind, robot, recording):
    efforts, reported = as_reported(kind, robot, recording)
    torques = efforts.applied(robot, replace(recording, tau=reported))
    np.testing.assert_allclose(torques.tau, recording.tau, atol=1e-9)


@pytest.mark.parametrize('kind', KINDS)
def test_a_payload_is_found_from_every_kind_of_effort(kind, recording):
    load = Inertial(3.0, np.array([0.0, 0.02, 0.1]), 0.01 * np.eye(3))
    bare = Robot(ARM)
    loaded = Robot(with_payload(ARM, 'tool0', load))
    r = recording
    loaded_run = replace(r, tau=loaded.inverse_dynamics(r.q, r.u, r.udot))
    # An arm that leaves its weight out knows nothing of the payload.
    external = bare.inverse_dynamics(r.q, r.u, r.udot) - loaded_run.tau
    efforts, reported = as_reported(kind, bare, loaded_run, external)
    measured = replace(loaded_run, tau=reported)
    payload = identify_payload(bare, efforts.applied(bare, measured), 'tool0')
    assert payload.inertial.mass == pytest.approx(3.0, abs=0.01)


def test_efforts_at_rest_that_contradict_their_meaning_are_named(robot, recording):
    q = recording.q[0]
    weight = robot.gravity_force(q)
    none = np.full(6, 1e-3)
    half = 0.5 * weight
    for efforts, good in (
            (Efforts(), weight), (Efforts('motor_torque', gravity=False), none),
            (Efforts('joint_torque'), 0.9 * weight),
            (Efforts('motor_current', constants=CONSTANTS), weight / CONSTANTS),
            (Efforts('external_torque'), none), (Efforts(), half),
            (Efforts(), np.zeros(6))):  # brakes
        assert efforts.contradiction(robot, q, good) == ''
    for efforts, effort, words in (
            (Efforts(), none, 'do they lack gravity'),
            (Efforts(), -weight, 'sign is reversed'),
            (Efforts(), 20.0 * weight, 'are they currents, or in another unit'),
            (Efforts('motor_torque', gravity=False), weight, 'do they contain gravity'),
            (Efforts('motor_current', constants=CONSTANTS), weight, 'another unit'),
            (Efforts('external_torque'), weight, 'none of external torques')):
        assert words in efforts.contradiction(robot, q, effort)
    upright = Robot(replace(ARM, gravity=np.zeros(3)))
    assert Efforts().contradiction(upright, q, weight) == ''


@pytest.mark.parametrize(('arguments', 'words'), [
    (('force',), "efforts: 'force'; expected one of motor_current"),
    (('motor_torque', 'no'), "gravity: 'no'; expected True or False"),
    (('motor_current',), 'without constants; expected the torque constants'),
    (('motor_torque', True, [1.0]), 'motor_torque with constants; expected these with')])
def test_an_invalid_kind_of_effort_is_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        Efforts(*arguments)


def test_external_torques_need_accelerations_and_constants_fit_the_joints(
        robot, recording):
    q = recording.q[0]
    u = recording.u[0]
    tau = recording.tau[0]
    with pytest.raises(InputError, match='udot: missing'):
        Efforts('external_torque').torque(robot, q, u, tau)
    with pytest.raises(InputError, match='constants: '):
        Efforts('motor_current', constants=[1.0, 2.0]).torque(robot, q, u, tau)
    with pytest.raises(InputError,
                       match=r'constants of joint .*_pan_joint.*: 0; expected another'):
        Efforts('motor_current', constants=0.0).torque(robot, q, u, tau)
    with pytest.raises(InputError, match=r'nan; expected a finite number'):
        Efforts('motor_current', constants=np.nan).torque(robot, q, u, tau)
