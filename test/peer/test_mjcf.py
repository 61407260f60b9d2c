"""Mechanisms from MJCF have the dynamics that MuJoCo itself gives them."""

from pathlib import Path
import re
import warnings

from kane_dynamics import Closure, load_mjcf, Robot
from kane_dynamics.cli.commands.sweep_command import read_sweep
from kane_dynamics.errors import InputError, ModelError, ModelWarning
from kane_dynamics.mechanics.definition import kane
import numpy as np
import pytest

mujoco = pytest.importorskip('mujoco')

# Every feature at once: references, anchors off the origin, several joints a body, a
# ball, a free body, springs, two loops and a gear.
EVERYTHING = """
<mujoco model="everything"><compiler angle="radian"/><option gravity="0.5 0 -9.81"/>
<worldbody>
  <body name="a"><joint name="j1" axis="0 1 0" ref="0.3" damping=".1" stiffness="2"
      springref=".2"/><geom type="capsule" fromto="0 0 0 0 0 .5" size=".02"/>
    <body name="b" pos="0 0 .5" euler="0.1 .7 .2">
      <joint name="j2" axis="0 1 0" pos="0.02 0 0.01"/>
      <joint name="slide" type="slide" axis="1 0 0.4" ref=".1" range="-1 1" limited="true"/>
      <geom type="capsule" fromto="0 0 0 .9 0 0" size=".02"/>
      <body pos=".9 0 0"><joint name="socket" type="ball" damping=".2"/>
        <geom type="box" size=".1 .05 .02" pos=".1 0 0"/>
        <site name="b" pos=".1 0 0" euler="1 2 3"/></body></body></body>
  <body name="c" pos="1 0 0"><joint name="j3" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 .5" size=".02"/>
    <body name="d" pos="0 0 .5"><joint name="j4" axis="0 0 1" armature=".3" frictionloss=".4"/>
      <geom type="box" size=".1 .1 .05" pos=".1 .1 0"/></body></body>
  <body name="f" pos="3 0 1" euler=".3 .2 .1"><freejoint name="flying"/>
    <geom type="box" size=".1 .2 .05" pos=".1 .1 0"/></body>
</worldbody>
<equality><connect name="pin" body1="b" body2="c" anchor=".9 0 0"/>
  <joint name="gear" joint1="j4" joint2="j3" polycoef=".1 2 0 0 0"/>
  <weld name="glue" body1="f" body2="d"/></equality>
<actuator><motor joint="j1" gear="3" forcerange="-2 2"/><position joint="j3" kp="3"/></actuator>
</mujoco>
"""  # noqa: E501


def gymnasium_models():
    """Return the MJCF files of the package gymnasium: models by other authors."""
    gymnasium = pytest.importorskip('gymnasium')
    return sorted(Path(gymnasium.__file__).parent.glob('envs/mujoco/assets/*.xml'))


def loaded(source):
    """Return MuJoCo's model and ours, without the warnings of either."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        mechanism = load_mjcf(source)
    text = isinstance(source, str)
    load = mujoco.MjModel.from_xml_string if text else mujoco.MjModel.from_xml_path
    return load(source if text else str(source)), mechanism


def random_state(model, rng):
    """Return MuJoCo's data at a random state, and our q and u of that state."""
    data = mujoco.MjData(model)
    data.qpos = model.qpos0
    mujoco.mj_integratePos(model, data.qpos, 0.5 * rng.normal(size=model.nv), 1.0)
    data.qvel = rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    q = data.qpos.copy()
    for joint, start in enumerate(model.jnt_qposadr):
        kind = int(model.jnt_type[joint])
        if kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            first = start + (3 if kind == mujoco.mjtJoint.mjJNT_FREE else 0)
            q[first:first + 4] = np.roll(data.qpos[first:first + 4], -1)
    return data, q, data.qvel.copy()


def check_unconstrained_dynamics(model, mechanism, count=5):
    """Compare the mass matrix and the bias force of the tree."""
    robot = Robot(mechanism.model, friction=False)
    rng = np.random.default_rng(1)
    for _ in range(count):
        data, q, u = random_state(model, rng)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        bias = data.qfrc_bias - data.qfrc_spring
        np.testing.assert_allclose(robot.mass_matrix(q), M,
                                   rtol=0, atol=1e-11 * abs(M).max())
        np.testing.assert_allclose(robot.bias_force(q, u), bias, rtol=0,
                                   atol=1e-11 * abs(bias).max())


@pytest.mark.filterwarnings('ignore')
@pytest.mark.parametrize('name',
                         ['ant', 'half_cheetah', 'humanoid', 'inverted_double_pendulum',
                          'pusher', 'reacher', 'swimmer', 'walker2d'])
def test_dynamics_of_published_models_are_those_of_mujoco(name):
    path = next(path for path in gymnasium_models() if path.stem == name)
    model, mechanism = loaded(path)
    check_unconstrained_dynamics(model, mechanism, count=2)


def test_every_kind_of_joint_has_the_dynamics_of_mujoco():
    check_unconstrained_dynamics(*loaded(EVERYTHING))


def numbers(rng, count, size=1.0):
    """Return random numbers as text."""
    return ' '.join(f'{x:.6g}' for x in size * rng.normal(size=count))


def random_body(rng, index, inner):
    """Return a body with joints, orientation and inertia of any form, and its tree."""
    forms = ('', f'quat="{numbers(rng, 4)}"', f'euler="{numbers(rng, 3, 60.0)}"',
             f'axisangle="{numbers(rng, 4)}"', f'xyaxes="{numbers(rng, 6)}"')
    joints = []
    for k in range(rng.integers(0 if index else 1, 4)):
        name = f'j{index}_{k}'
        kind = rng.choice(['hinge', 'slide', 'ball'], p=[0.6, 0.3, 0.1])
        text = f'name="{name}" type="{kind}" pos="{numbers(rng, 3, 0.1)}" damping="0.7"'
        if kind != 'ball':
            text += (f' axis="{numbers(rng, 3)}" ref="{numbers(rng, 1)}"'
                     f' armature="{rng.uniform():.4g}" '
                     f'stiffness="{rng.uniform(0, 9):.4g}"'
                     f' springref="{numbers(rng, 1)}"')
        joints.append(f'<joint {text}/>')
        if kind == 'ball':
            break  # other joints behind a ball are no MJCF
    shape = rng.choice(['sphere', 'box', 'capsule', 'cylinder', 'ellipsoid'])
    geom = (f'<geom type="{shape}" size="0.1 0.2 0.15" pos="{numbers(rng, 3, 0.2)}" '
            f'{rng.choice(forms)} density="{rng.uniform(100, 2000):.4g}"/>')
    return (f'<body name="b{index}" pos="{numbers(rng, 3, 0.4)}" {rng.choice(forms)}>'
            f'{"".join(joints)}{geom}{inner}</body>')


def random_file(seed):
    """Return a random chain in MJCF with motors: gear, armature and damping."""
    rng = np.random.default_rng(seed)
    chain = ''
    for index in reversed(range(rng.integers(1, 5))):
        chain = random_body(rng, index, chain)
    motors = []
    for name, kind in re.findall(r'name="(j\S*)" type="(\w*)"', chain):
        if kind != 'ball' and rng.random() < 0.5:
            motors.append(f'<motor joint="{name}" gear="{numbers(rng, 1, 10.0)}" '
                          'armature="0.002" damping="0.01"/>')
    sequence = rng.choice(['xyz', 'ZYX', 'zxz'])
    return (f'<mujoco><compiler angle="degree" eulerseq="{sequence}"/><option gravity='
            f'"{numbers(rng, 3, 5.0)}"/><worldbody>{chain}</worldbody><actuator>'
            f'{"".join(motors)}</actuator></mujoco>')


@pytest.mark.parametrize('seed', range(60))
def test_random_files_have_the_inertia_and_forces_of_mujoco(seed):
    model, (tree, _) = loaded(random_file(seed))
    data, q, u = random_state(model, np.random.default_rng(seed))
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    force = kane.inverse_dynamics(tree, q, u, 0.0 * u)
    peer = data.qfrc_bias - data.qfrc_passive
    np.testing.assert_allclose(kane.mass_matrix(tree, q), M,
                               rtol=0, atol=1e-11 * M.max())
    np.testing.assert_allclose(force, peer, rtol=0,
                               atol=1e-9 * max(M.max(), abs(peer).max()))


def test_damping_of_every_joint_is_that_of_mujoco():
    model, mechanism = loaded(EVERYTHING)
    data, q, u = random_state(model, np.random.default_rng(2))
    without_loss = Robot(mechanism.model)
    dissipated = without_loss.bias_force(q, u) - Robot(mechanism.model,
                                                       friction=False).bias_force(q, u)
    smooth_loss = model.dof_frictionloss * np.tanh(u / 0.05)
    np.testing.assert_allclose(dissipated, -data.qfrc_damper + smooth_loss, atol=1e-12)


def test_residuals_of_loops_are_those_of_mujoco():
    model, mechanism = loaded(EVERYTHING)
    robot = Robot(mechanism.model)
    data, q, _ = random_state(model, np.random.default_rng(3))
    residuals = {}
    for constraint in mechanism.options['constraints']:
        if isinstance(constraint, Closure):
            first = robot.frame_pose(constraint.first, q)
            second = robot.frame_pose(constraint.second, q)
            residuals[constraint.name] = first[:3, 3] - second[:3, 3]
    np.testing.assert_allclose(residuals['pin'], data.efc_pos[:3], atol=1e-12)
    np.testing.assert_allclose(residuals['glue'], data.efc_pos[4:7], atol=1e-12)
    names = mechanism.model.coordinate_names
    j3 = q[names.index('j3')]
    j4 = q[names.index('j4')]
    assert j4 - 2.0 * j3 - 0.1 == pytest.approx(data.efc_pos[3], abs=1e-12)


WELDED = """
<mujoco><option jacobian="dense"/><worldbody>
  <body name="a"><freejoint/><geom type="box" size=".1 .2 .05"/>
    <site name="on_a" pos=".1 .2 .3"/></body>
  <body name="b" pos=".3 .1 .2"><freejoint/><geom type="box" size=".2 .1 .05"/>
    <site name="on_b" pos="-.2 .1 .1"/></body></worldbody>
<equality><weld {ends} torquescale="{scale}"/></equality></mujoco>
"""


@pytest.mark.parametrize('ends', ['body1="a" body2="b"', 'site1="on_a" site2="on_b"'])
@pytest.mark.parametrize(('scale', 'rows'), [('0', 3), ('0.3', 6)])
def test_a_weld_whose_rotations_have_no_force_leaves_them_free(ends, scale, rows):
    model, mechanism = loaded(WELDED.format(ends=ends, scale=scale))
    data, _, _ = random_state(model, np.random.default_rng(0))
    J = data.efc_J.reshape(-1, model.nv)[:data.ne]
    assert np.linalg.matrix_rank(J) == rows
    assert Robot(mechanism.model, **mechanism.options).n == model.nv - rows


FOUR_BAR = """
<mujoco model="four bar"><compiler angle="radian"/><worldbody>
  <body name="crank"><joint name="crank" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 .3" size=".02"/>
    <body name="coupler" pos="0 0 .3"><joint name="elbow" axis="0 1 0" damping=".1"/>
      <geom type="capsule" fromto="0 0 0 .8 0 0" size=".02"/></body></body>
  <body name="rocker" pos=".8 0 0"><joint name="rocker" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 .3" size=".02"/></body>
</worldbody>
<equality><connect name="pin" body1="coupler" body2="rocker" anchor=".8 0 0"/></equality>
<actuator><motor joint="crank"/></actuator></mujoco>
"""


def test_closed_loop_moves_as_mujoco_does_with_stiff_constraints():
    model, mechanism = loaded(FOUR_BAR)
    robot = Robot(mechanism.model, **mechanism.options, independent=['crank'])
    assert robot.actuated_names == ('crank',)
    q = robot.closed_configuration([0.4, 0.0, 0.0])
    accelerations = robot.forward_dynamics(q, [0.0], [1.5])
    data = mujoco.MjData(model)
    data.qpos = q
    data.ctrl[0] = 1.5
    mujoco.mj_forward(model, data)
    # The accelerations that keep MuJoCo's own constraint rows at rest, without its
    # softness.
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    J = data.efc_J.reshape(-1, model.nv)[:data.ne]
    J = J[np.abs(J).max(axis=1) > 1e-9]
    system = np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])
    forces = data.qfrc_actuator - data.qfrc_bias
    solution = np.linalg.lstsq(system, np.concatenate([forces, np.zeros(len(J))]),
                               rcond=None)[0]
    assert accelerations[0] == pytest.approx(solution[0], rel=1e-9)


UNDERACTUATED = """
<mujoco model="hanging loop"><compiler angle="radian"/><worldbody>
  <body name="base"><freejoint name="root"/><geom type="box" size=".2 .1 .1"/>
    <body name="left" pos="-.1 0 -.1"><joint name="left" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/>
      <body name="foot" pos="0 0 -.3"><joint name="ankle" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/></body></body>
    <body name="right" pos=".1 0 -.1"><joint name="right" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/></body></body></worldbody>
<equality><connect name="pin" body1="foot" body2="right" anchor=".2 0 0"/></equality>
<actuator><motor joint="left"/></actuator></mujoco>
"""


def test_fewer_actuators_than_independent_speeds_still_make_a_robot():
    with pytest.warns(ModelWarning,
                      match=r'which joints have actuators \(left\), for they are '
                      'fewer than the 7 independent speeds'):
        mechanism = load_mjcf(UNDERACTUATED)
    robot = Robot(mechanism.model, **mechanism.options)
    assert robot.n == 7 and 'actuated' not in mechanism.options
    q = robot.feasible_configuration()
    falling = robot.forward_dynamics(q, np.zeros(7), np.zeros(7))
    z = robot.speed_names.index('root/z')
    assert falling[z] == pytest.approx(-9.81)


def test_joints_of_a_tree_without_actuators_are_said_to_be_actuated():
    with pytest.warns(ModelWarning,
                      match=r'which joints have actuators \(left\), for they are '
                      'fewer than the 9 independent speeds'):
        mechanism = load_mjcf(re.sub('<equality>.*</equality>', '', UNDERACTUATED))
    assert mechanism.options == {}
    with pytest.raises(InputError, match='source: NoneType; expected a path'):
        load_mjcf(None)


def test_limits_are_those_of_joints_and_actuators():
    _, mechanism = loaded(EVERYTHING)
    joints = {body.joint.name: body.joint for body in mechanism.model.bodies}
    assert joints['j1'].limits.effort == 6.0
    assert (joints['slide'].limits.lower, joints['slide'].limits.upper) == (-1.0, 1.0)
    assert joints['j4'].friction == 0.4
    assert joints['j4'].armature == 0.3


ARM = """<mujoco><option><flag {flags}/></option><worldbody>
<body><joint name="a"/><geom size=".1" pos="1 0 0"/>
<body pos="1 0 0"><joint name="b" range="-9 9"/><geom size=".1" pos="0 1 0"/></body></body>
</worldbody><equality><joint joint1="b" joint2="a" polycoef="0 2 0 0 0"/></equality>
<actuator>{actuators}</actuator></mujoco>"""  # noqa: E501


@pytest.mark.filterwarnings('ignore::kane_dynamics.errors.ModelWarning')
@pytest.mark.parametrize(('flags', 'actuators', 'effort'), [
    ('', '<motor joint="b" gear="-3" ctrlrange="-2 1"/>', 6.0),
    ('', '<general joint="b" gear="3" gainprm="5" ctrlrange="-2 2" forcerange="-4 4"/>',
     12.0),
    ('', '<motor joint="b" forcerange="-2 2"/><motor joint="b"/>', np.inf),
    ('', '<motor joint="b" forcerange="-2 2"/><motor joint="b" ctrlrange="-1 1"/>', 3.0),
    ('', '<general joint="b" dyntype="integrator" ctrlrange="-1 1"/>', np.inf),
    ('clampctrl="disable"', '<motor joint="b" ctrlrange="-1 1"/>', np.inf)])
def test_the_effort_of_a_joint_is_what_all_its_actuators_reach_together(
        flags, actuators, effort):
    model, _ = load_mjcf(ARM.format(flags=flags, actuators=actuators))
    assert model.bodies[1].joint.limits.effort == effort


CUBIC = """<mujoco><compiler angle="radian"/><option gravity="1 -2 -9.81"/><worldbody>
<body><joint name="driver" axis="0 1 0" ref="0.2" pos="0 0 0"/><geom type="capsule" fromto="0 0 0 .2 0 0" size=".01"/>
<body pos=".2 0 0"><joint name="follower" axis="0 1 0" ref="-0.1"/>
<geom type="capsule" fromto="0 0 0 .2 0 .1" size=".02"/></body></body></worldbody>
<equality><joint joint1="follower" joint2="driver" polycoef="0.05 .8 -.2 .3 .1"/></equality>
<actuator><motor joint="driver"/></actuator></mujoco>"""  # noqa: E501


def test_a_polynomial_coupling_moves_both_joints_as_one_degree_of_freedom():
    with pytest.warns(ModelWarning, match='contacts'):
        mechanism = load_mjcf(CUBIC)
    robot = Robot(mechanism.model, **mechanism.options)
    assert robot.n == 1
    compiled = mujoco.MjModel.from_xml_string(CUBIC)
    data = mujoco.MjData(compiled)
    a = compiled.eq_data[0, :5]
    rng = np.random.default_rng(4)
    for _ in range(20):
        x, rate, acceleration = rng.normal(size=3)
        # The polynomial and its derivatives, with MuJoCo's reference positions.
        p = np.polynomial.Polynomial(a)(np.polynomial.Polynomial([-0.2, 1.0])) - 0.1
        slope, curvature = p.deriv(), p.deriv(2)
        q = np.array([x, p(x)])
        ratio = np.array([1.0, slope(x)])
        data.qpos[:] = q
        data.qvel[:] = ratio * rate
        data.qacc[:] = ratio * acceleration + [0.0, curvature(x) * rate**2]
        tau = np.zeros(2)
        mujoco.mj_kinematics(compiled, data)
        mujoco.mj_comPos(compiled, data)
        mujoco.mj_comVel(compiled, data)
        mujoco.mj_rne(compiled, data, 1, tau)
        expected = ratio @ tau
        assert robot.speed_names == ('driver',)
        torque = robot.inverse_dynamics(q, [rate], [acceleration])
        assert torque == pytest.approx([expected], abs=1e-12)


@pytest.mark.parametrize('limits', ['forcerange="-2 5"', 'ctrlrange="-2 1"'])
def test_unequal_limits_of_force_are_named(limits):
    with pytest.warns(ModelWarning,
                      match='the smaller of two unequal limits .* of strong'):
        load_mjcf(
            ARM.format(flags='', actuators=f'<motor name="strong" joint="b" {limits}/>'))


@pytest.mark.parametrize(('flags', 'words'), [
    ('equality="disable"', ''),
    ('constraint="disable"', 'friction loss and position limits')])
def test_constraints_that_the_file_disables_are_left_out(flags, words):
    with pytest.warns(ModelWarning, match=words):
        assert load_mjcf(ARM.format(flags=flags, actuators='')).options == {}
    with pytest.warns(ModelWarning):
        assert load_mjcf(ARM.format(flags='', actuators='')).options['constraints']


def test_unused_elements_of_mjcf_are_named_in_one_warning():
    with pytest.warns(ModelWarning,
                      match=r'contacts of 6 geoms; control laws of actuators: '
                      'actuator_1') as warned:
        load_mjcf(EVERYTHING)
    assert len(warned) == 1


TENDON = """<mujoco><worldbody><body><joint name="a"/><geom size=".1" pos="1 0 0"/>
<body pos="1 0 0"><joint name="b"/><geom size=".1" pos="0 1 0"/></body></body></worldbody>
<tendon><fixed name="both"><joint joint="a" coef="1"/><joint joint="b" coef="1"/></fixed>
</tendon><equality><tendon name="taut" tendon1="both"/></equality></mujoco>"""  # noqa: E501


def test_a_constraint_that_is_not_read_is_refused_unless_not_strict():
    with pytest.raises(ModelError, match='taut; expected connect, weld or joint'):
        load_mjcf(TENDON)
    with pytest.warns(ModelWarning, match='equality constraints: taut'):
        assert load_mjcf(TENDON, strict=False).model.n == 2


@pytest.mark.parametrize(('source', 'error', 'message'), [
    ('nowhere.xml', InputError, "no such file: 'nowhere.xml'; expected"),
    ('<mujoco><worldbody><body/></worldbody></mujoco>', ModelError,
     'no joint; expected'),
    ('<mujoco><nonsense/></mujoco>', ModelError,
     r'(?s)nonsense.*expected a file that MuJoCo'),
])
def test_a_file_that_is_no_mechanism_is_refused(source, error, message):
    with pytest.raises(error, match=message):
        load_mjcf(source)


def test_a_sweep_of_mjcf_keeps_the_equality_constraints(tmp_path):
    (tmp_path / 'linkage.xml').write_text(FOUR_BAR)
    path = tmp_path / 'sweep.yaml'
    path.write_text('{urdf: linkage.xml, samples: 1}')
    _, mechanism = loaded(FOUR_BAR)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ModelWarning)
        robot = read_sweep(path).robot
    assert robot.n == 1
    assert robot.constraint_names == Robot(
        mechanism.model, **mechanism.options).constraint_names
