"""Promises of exciting motions: above the floor, and links away from each other."""

from functools import cache
import json
from pathlib import Path

from kane_dynamics import InputError, load_urdf, Robot
from kane_dynamics.cli.parser import main
from kane_dynamics.identification import excite
from kane_dynamics.identification.excitation.clearance import (Clearance, closest_points,
                                                               DISTANCE, lower_bounds)
from kane_dynamics.identification.excitation.design_criterion import DENSE
from kane_dynamics.urdf.link_shapes import load_collision_shapes
import numpy as np
import pytest

FOLDER = Path(__file__).resolve().parents[3] / 'urdf'


@cache
def loaded(name):
    """Return a model and the shapes of its links."""
    return load_urdf(FOLDER / f'{name}.urdf'), load_collision_shapes(
        FOLDER / f'{name}.urdf')


def surface(shape):
    """Return points on a cylinder's rims or a box's corners, in the link's axes."""
    if shape.kind == 'cylinder':
        angle = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)
        ring = shape.size[0] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points = np.vstack([np.column_stack([ring, np.full(36, z)]) for z in (
            -0.5 * shape.size[1], 0.5 * shape.size[1])])
    else:
        points = 0.5 * shape.size * np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(
            3, -1).T
    return points @ shape.pose[:3, :3].T + shape.pose[:3, 3]


@pytest.mark.timeout(600)
@pytest.mark.slow
@pytest.mark.parametrize('name', ['ur10e', 'fr3'])
def test_default_motion_keeps_above_the_floor_and_away_from_itself_between_samples(name):
    model, shapes = loaded(name)
    excitation = excite(model, starts=1, floor=0.0, shapes=shapes)
    # More than the samples that are checked, and of another spacing: most are between
    # them.
    t = np.linspace(0.0, 10.0, 100 * DENSE + 11, endpoint=False)
    q = excitation.sample(t)[0]
    clearance = Clearance(model, shapes, 0.0, DISTANCE)
    of_parts = [clearance.distances(part).min(axis=0) for part in np.array_split(q, 200)]
    least = np.min(of_parts, axis=0)
    assert (least >= clearance.needed).all() and (clearance.needed > 0.0).all()
    assert least.min() >= excitation.nearest[2] >= 0.9 * least.min()
    robot = Robot(model)
    lowest = np.inf
    fixed = {frame.name for frame in model.frames if frame.body < 0}
    for shape in shapes:
        if shape.link in fixed or shape.link == model.bodies[0].name:
            continue
        poses = robot.frame_pose(shape.link, q)
        for point in surface(shape):
            lowest = min(lowest, (poses[:, 2, :3] @ point + poses[:, 2, 3]).min())
    assert lowest >= excitation.lowest[1] >= 0.0


def test_command_prints_lowest_point_and_smallest_distance_and_takes_none(
        tmp_path, capsys):
    urdf = str(FOLDER / 'ur10e.urdf')
    out = str(tmp_path / 'motion.csv')
    short = ['excite', urdf, '--out', out, '--starts', '1', '--velocity', '0.3',
             '--harmonics', '2']
    assert main([*short, '--distance', '0.03', '--json']) == 0
    record = json.loads(capsys.readouterr().out)
    assert record['lowest'][1] > 0.0 and record['nearest'][2] > 0.0
    assert main(short) == 0
    assert 'missed' not in capsys.readouterr().err
    # wrist_1_link and wrist_3_link are nearer than twice 0.05 m at rest.
    assert main([*short, '--distance', '0.05']) == 1
    assert "0.05 m is missed, exit code 1: 'wrist_1_link' and" in capsys.readouterr().err
    assert main([*short, '--floor', 'none', '--distance', 'none']) == 0
    printed = capsys.readouterr().out
    assert 'lowest point: ' in printed and 'distance between links' not in printed
    with pytest.raises(SystemExit):
        main([*short, '--floor', 'low'])
    assert "--floor: 'low'; expected a number of m, or none" in capsys.readouterr().err


def test_slope_of_shortfalls_is_that_of_differences():
    rng = np.random.default_rng(0)
    for name in ('ur10e', 'fr3'):
        model, shapes = loaded(name)
        clearance = Clearance(model, shapes, 0.3, 0.2)
        q, direction = 0.8 * rng.normal(size=(2, 40, model.n))
        rise = (clearance.shortfall(q + 1e-6 * direction).sum()
                - clearance.shortfall(q - 1e-6 * direction).sum()) / 2e-6
        assert np.sum(clearance.shortfall_slope(q) * direction) == pytest.approx(
            rise, rel=1e-4)


def test_closest_points_of_segments_are_those_of_a_search():
    rng = np.random.default_rng(1)
    a, b, c, d = rng.normal(size=(4, 50, 3))
    b[0], d[1], d[2] = 0.0, 0.0, b[2]  # points, and parallel ones
    first, second = closest_points(a, b, c, d)
    s = np.linspace(-1.0, 1.0, 401)[:, None]
    for k in range(50):
        every = np.linalg.norm((a[k] + s * b[k])[:, None] - (c[k] + s * d[k])[None],
                               axis=2)
        assert np.linalg.norm(first[k] - second[k]) == pytest.approx(every.min(),
                                                                     abs=2e-4)


def test_links_that_a_joint_connects_or_that_touch_at_rest_are_left_out():
    model, shapes = loaded('ur10e')
    clearance = Clearance(model, shapes, None, 0.05)
    pairs = {(clearance.shapes[j].name, clearance.shapes[i].name)
             for i, j in clearance.pairs}
    assert ('shoulder_link', 'wrist_3_link') in pairs
    assert ('base_link', 'forearm_link') in pairs
    assert not pairs & {('base_link', 'shoulder_link'),
                        ('shoulder_link', 'upper_arm_link')}
    assert (clearance.distances(np.zeros((1, 6)))[0] > 0.0).all()


def test_between_samples_no_function_falls_below_the_bound():
    t = np.linspace(0.0, 1.0, 64, endpoint=False)
    phases = np.random.default_rng(2).uniform(0.0, 1.0, 200)

    def values(t):
        wave = np.cos(2.0 * np.pi * 3.0 * (t[:, None] + phases))
        return np.concatenate([wave, np.abs(wave)], axis=1)
    assert (lower_bounds(values(t)) <= values(np.linspace(0.0, 1.0,
                                                          100_001)).min(axis=0)).all()


def test_links_of_meshes_and_without_shapes_have_boxes_and_rods(tmp_path):
    corners = (
        'v 0 0 0\nv 0.2 0 0\nv 0 0.1 0\nv 0 0 0.4\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n')
    (tmp_path / 'link.obj').write_text(corners)
    text = """<robot name="r"><link name="a"/><link name="b"><collision>
      <origin xyz="1 0 0" rpy="0 0 0"/>
      <geometry><mesh filename="link.obj" scale="1 2 1"/></geometry></collision></link>
      <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""  # noqa: E501
    (tmp_path / 'r.urdf').write_text(text)
    shape, = load_collision_shapes(tmp_path / 'r.urdf')
    assert shape.kind == 'box' and np.allclose(shape.size, [0.2, 0.2, 0.4])
    assert np.allclose(shape.pose[:3, 3], [1.1, 0.1, 0.2])


@pytest.mark.parametrize('distance', [-0.1, float('nan'), float('inf')])
def test_distance_that_is_none_is_refused(distance):
    model, shapes = loaded('ur10e')
    with pytest.raises(InputError, match=r'distance: .*; expected a finite number >= 0'):
        excite(model, shapes=shapes, distance=distance)
