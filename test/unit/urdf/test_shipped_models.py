"""Shipped models: manufacturers' data, expected warnings, agreement with peers."""

import math
from pathlib import Path
import warnings

from kane_dynamics import load_urdf, ModelWarning, Robot
from kane_dynamics.urdf.supplement import read_supplement
import mujoco
import numpy as np
import pinocchio
import pytest

FOLDER = Path(__file__).resolve().parents[3] / 'urdf'
NAMES = sorted(path.stem for path in FOLDER.glob('*.urdf'))
SOLID = ['fr3', 'human_hand', 'palletizer', 'two_link', 'two_link_planar', 'ur10e']
# MuJoCo refuses particles and thin rods.
WARNINGS = {  # semidefinite inertias on purpose: a particle and two thin rods
    'spring_mass_pendulum': ['pendulum'],
    'two_rods': ['rod_a', 'rod_b'],
}
UR10E = [  # Denavit-Hartenberg: a, d, alpha
    (0.0, 0.1807, math.pi / 2), (-0.6127, 0.0, 0.0), (-0.57155, 0.0, 0.0),
    (0.0, 0.17415, math.pi / 2), (0.0, 0.11985, -math.pi / 2), (0.0, 0.11655, 0.0)]
FR3 = [  # Denavit-Hartenberg after Craig: a, d, alpha; the flange last
    (0.0, 0.333, 0.0), (0.0, 0.0, -math.pi / 2), (0.0, 0.316, math.pi / 2),
    (0.0825, 0.0, math.pi / 2), (-0.0825, 0.384, -math.pi / 2), (0.0, 0.0, math.pi / 2),
    (0.088, 0.0, math.pi / 2), (0.0, 0.107, 0.0)]


def load(name, **options):
    """Load a shipped model without its known warnings, which have their own test."""
    with warnings.catch_warnings():
        if name in WARNINGS:
            warnings.simplefilter('ignore', ModelWarning)
        return load_urdf(FOLDER / f'{name}.urdf', **options)


def text(name):
    """Return the XML."""
    return (FOLDER / f'{name}.urdf').read_text()


def screw(axis, angle, shift):
    """Return a rotation about x (0) or z (2) with a shift along it, (4, 4)."""
    T = np.eye(4)
    i, j = (1, 2) if axis == 0 else (0, 1)
    T[i, i] = T[j, j] = math.cos(angle)
    T[j, i] = math.sin(angle)
    T[i, j] = -T[j, i]
    T[axis, 3] = shift
    return T


def flange_ur10e(q):
    """Return the flange pose by the maker's table; base_link turned by pi."""
    T = screw(2, math.pi, 0.0)
    for angle, (a, d, alpha) in zip(q, UR10E, strict=True):
        T = T @ screw(2, angle, d) @ screw(0, alpha, a)
    return T


def flange_fr3(q):
    """Return the flange pose from the manufacturer's table."""
    T = np.eye(4)
    for angle, (a, d, alpha) in zip([*q, 0.0], FR3, strict=True):
        T = T @ screw(0, alpha, a) @ screw(2, angle, d)
    return T


ARMS = {'ur10e': ('tool0', flange_ur10e), 'fr3': ('fr3_link8', flange_fr3)}


def random_positions(model, rng):
    """Return a position within the limits, or within two turns where there are none."""
    limits = [joint.limits for joint in model.coordinate_joints]
    return np.array(
        [rng.uniform(max(one.lower, -6.0), min(one.upper, 6.0)) for one in limits])


@pytest.mark.parametrize('name', NAMES)
def test_every_model_loads_with_the_announced_warnings_only(name):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        load_urdf(FOLDER / f'{name}.urdf')
    assert len(caught) == (name in WARNINGS)
    for warning in caught:
        assert issubclass(warning.category, ModelWarning)
        assert str(warning.message).endswith(': ' + ', '.join(WARNINGS[name]))


def test_models_named_in_the_documentation_exist():
    assert NAMES == ['fr3', 'human_hand', 'palletizer', 'spring_mass_pendulum',
                     'two_link', 'two_link_planar', 'two_rods', 'ur10e']
    readme = (FOLDER / 'README.md').read_text()
    for path in FOLDER.iterdir():
        assert f'`{path.name}`' in readme or path.name == 'README.md'


@pytest.mark.parametrize('path', sorted(
    {*FOLDER.glob('*.yaml')} - {*FOLDER.glob('*.constraints.yaml')}),
                         ids=lambda path: path.stem)
def test_every_supplement_fits_its_model(path):
    name = path.name.split('.')[0]
    model = load(name, supplement=path)
    for joint, values in read_supplement(path).joints.items():
        loaded = next(body.joint for body in model.bodies if body.joint.name == joint)
        for key, value in values.items():
            assert getattr(loaded, key) == value


@pytest.mark.parametrize('name', NAMES)
def test_no_shape_is_a_mesh(name):
    assert '<mesh' not in text(name) and '<visual>' in text(name)


@pytest.mark.parametrize('name', NAMES)
def test_every_inertia_is_physically_possible(name):
    model = load(name)
    for inertial in (model.base_inertial, *(body.inertial for body in model.bodies)):
        low, middle, high = np.linalg.eigvalsh(inertial.inertia)
        assert low >= 0.0 and high <= (low + middle) * (1.0 + 1e-12)


@pytest.mark.parametrize(('name', 'hand', 'total', 'tolerance'), [
    ('ur10e', (), 33.5, 0.015),  # the data sheet's includes the cable
    ('fr3', ('fr3_hand', 'fr3_leftfinger', 'fr3_rightfinger'), 18.0, 0.01),
])
def test_masses_add_up_to_the_data_sheet(name, hand, total, tolerance):
    model = load(name, tip=ARMS[name][0], drop=hand)
    mass = model.base_inertial.mass + sum(body.inertial.mass for body in model.bodies)
    assert mass == pytest.approx(total, rel=tolerance)


@pytest.mark.parametrize('name', ARMS)
def test_flange_pose_matches_the_manufacturers_dh_table(name):
    tip, flange = ARMS[name]
    model = load(name, tip=tip)
    robot = Robot(model)
    rng = np.random.default_rng(1)
    for _ in range(5):
        q = random_positions(model, rng)
        np.testing.assert_allclose(robot.frame_pose(tip, q), flange(q), atol=1e-14)


def test_the_ur10e_reaches_its_data_sheets_1300_mm():
    # stretched horizontally, wrist 1 rotated so that wrist 2 is in line
    q = np.array([0.0, 0.0, 0.0, -math.pi / 2, 0.0, 0.0])
    pose = Robot(load('ur10e')).frame_pose('wrist_2_link', q)
    assert abs(pose[0, 3]) == pytest.approx(1.300, rel=0.004)


def test_the_palletizer_has_the_published_lengths_and_ranges_and_mass():
    robot = Robot(load('palletizer'))
    q = np.zeros(10)
    # m: x, z at zero
    published = {'lower_arm': (0.26, 0.745), 'upper_arm': (0.26, 0.745 + 0.945),
                 'wrist': (
                     0.26 + 1.025, 1.69), 'tool': (0.26 + 1.025 + 0.225, 1.69 - 0.2515)}
    for frame, place in published.items():
        np.testing.assert_allclose(robot.frame_pose(frame, q)[[0, 2], 3], place,
                                   atol=1e-12)
    for joint, *degrees in (('swivel', -165, 165, 145), ('shoulder', -40, 85, 110),
                            ('lever_drive', -20, 120, 120), ('turn', -300, 300, 400)):
        limits = robot.model.coordinate_joints[robot.joint_names.index(joint)].limits
        np.testing.assert_allclose(
            np.degrees([limits.lower, limits.upper, limits.velocity]),
            degrees, atol=0.003)
    mass = sum(body.inertial.mass for body in robot.model.bodies)
    assert mass + 329.0 == pytest.approx(925.0)  # kg; the base is fixed


def test_the_research_3_reaches_its_data_sheets_855_mm():
    # from the shoulder's center to the flange, over the positions that the limits allow
    model = load('fr3', tip='fr3_link8')
    robot = Robot(model)
    elbow = model.coordinate_joints[3].limits
    wrist = model.coordinate_joints[5].limits
    angles = np.linspace(wrist.lower, wrist.upper, 200)
    q = np.zeros((angles.size, robot.n))
    q[:, 3] = elbow.upper
    q[:, 5] = angles
    reach = []
    for one in q:
        reach.append(np.linalg.norm(robot.frame_pose('fr3_link8', one)[:3, 3]
                                    - [0.0, 0.0, 0.333]))
    assert max(reach) == pytest.approx(0.855, rel=0.01)


@pytest.mark.parametrize('name', NAMES)
def test_pinocchio_finds_the_same_mass_matrix(name):
    model = load(name, tip='fr3_link8' if name == 'fr3' else None)
    robot = Robot(model)
    rng = np.random.default_rng(2)
    peer = pinocchio.buildModelFromXML(text(name))
    data = peer.createData()
    columns = [peer.joints[peer.getJointId(joint)].idx_v for joint in model.joint_names]
    for _ in range(5):
        q = random_positions(model, rng)
        u = np.zeros(peer.nv)
        u[columns] = q
        full = pinocchio.integrate(peer, pinocchio.neutral(peer), u)
        M = pinocchio.crba(peer, data, full)
        M = (np.triu(M) + np.triu(M, 1).T)[np.ix_(columns, columns)]
        np.testing.assert_allclose(robot.mass_matrix(q), M, atol=1e-12 * np.abs(M).max())


@pytest.mark.parametrize('name', SOLID)
def test_mujoco_and_pinocchio_agree_on_the_mass_matrix(name):
    plant = mujoco.MjModel.from_xml_string(text(name))
    state = mujoco.MjData(plant)
    peer = pinocchio.buildModelFromXML(text(name))
    data = peer.createData()
    joints = [plant.joint(k).name for k in range(plant.njnt)]
    columns = [peer.joints[peer.getJointId(joint)].idx_v for joint in joints]
    assert sorted(columns) == list(range(plant.nv)) == list(range(peer.nv))
    rng = np.random.default_rng(3)
    for _ in range(5):
        state.qpos[:] = rng.uniform(*plant.jnt_range.T)
        mujoco.mj_forward(plant, state)
        M = np.zeros((plant.nv, plant.nv))
        mujoco.mj_fullM(plant, state, M)
        q = np.zeros(peer.nq)
        q[columns] = state.qpos
        peer_matrix = pinocchio.crba(peer, data, q)
        peer_matrix = np.triu(peer_matrix) + np.triu(peer_matrix, 1).T
        np.testing.assert_allclose(M, peer_matrix[np.ix_(columns, columns)], atol=1e-9)


@pytest.mark.parametrize(('name', 'configuration'), [
    ('ur10e', [0.0, -1.2, 1.4, -1.7, -1.57, 0.0]),
    ('fr3', [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785, 0.02, 0.02])])
def test_arm_has_no_self_collision_in_its_home_configuration(name, configuration):
    plant = mujoco.MjModel.from_xml_string(text(name))
    state = mujoco.MjData(plant)
    state.qpos[:] = configuration
    mujoco.mj_forward(plant, state)
    assert state.ncon == 0
