"""xacro files load like URDFs, with and without ROS."""

from kane_dynamics import expand_xacro, load_urdf
from kane_dynamics.cli.commands.sweep_command import read_sweep
from kane_dynamics.errors import InputError, UrdfError
from kane_dynamics.urdf.xacro_file import arguments_of
import pytest

pytest.importorskip('xacro')

ARM = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm">
  <xacro:arg name="mass" default="2.0"/>
  <xacro:arg name="tool" default="false"/>
  <xacro:include filename="$(find tool_description)/tool.xacro"/>
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 0.25"/><mass value="$(arg mass)"/>
    <inertia ixx="${0.1 * 2}" iyy="0.2" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="${-pi / 2}" upper="${pi / 2}" effort="50" velocity="2"/>
  </joint>
  <xacro:if value="$(arg tool)"><xacro:tool on="upper"/></xacro:if>
</robot>"""  # noqa: E501
TOOL = (
    """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="tool" params="on">
  <link name="tool"><inertial><mass value="0.5"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="flange" type="fixed"><parent link="${on}"/><child link="tool"/></joint>
</xacro:macro></robot>""")  # noqa: E501


@pytest.fixture
def arm(tmp_path, monkeypatch):
    """Return a xacro file in a source package, including one beside it."""
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    for package in ('arm_description', 'tool_description'):
        (tmp_path / package / 'urdf').mkdir(parents=True)
        (tmp_path / package / 'package.xml').write_text(
            f'<package format="3"><name>{package}</name></package>')
    (tmp_path / 'tool_description' / 'tool.xacro').write_text(TOOL)
    path = tmp_path / 'arm_description' / 'urdf' / 'arm.urdf.xacro'
    path.write_text(ARM)
    return path


def test_a_xacro_file_loads_by_its_name_with_packages_beside_it(arm):
    model = load_urdf(arm)
    assert model.joint_names == ('shoulder',)
    assert model.bodies[0].inertial.mass == 2.0
    assert model.bodies[0].joint.limits.upper == pytest.approx(1.5707963267948966)


def test_arguments_change_the_robot(arm):
    model = load_urdf(expand_xacro(arm, {'mass': 3, 'tool': True}))
    assert model.bodies[0].inertial.mass == 3.5


def test_arguments_of_the_command_line_are_name_and_value():
    assert arguments_of(['mass:=3', 'name:=a:=b']) == {'mass': '3', 'name': 'a:=b'}
    with pytest.raises(InputError, match=r"'mass=3'; expected NAME:=VALUE"):
        arguments_of(['mass=3'])


@pytest.mark.parametrize(('old', 'new', 'message'), [
    ('tool_description', 'no_such_package',
     "package 'no_such_package': not installed"),
    ('<xacro:arg name="mass" default="2.0"/>', '', 'mass'),
    ('${0.1 * 2}', '${0.1 *}', '0.1'),
    ('</robot>', '', 'expected a file that xacro expands'),
])
def test_an_error_of_xacro_is_raised_with_its_reason(arm, old, new, message):
    arm.write_text(ARM.replace(old, new))
    with pytest.raises(UrdfError, match=message) as refused:
        load_urdf(arm)
    assert str(arm) in str(refused.value)


def test_a_package_without_package_xml_is_found_by_the_name_of_its_folder(
        arm, monkeypatch):
    arm.write_text(ARM.replace('tool_description', 'my_tools'))
    folder = arm.parent / 'elsewhere' / 'my_tools'
    folder.mkdir(parents=True)
    (folder / 'tool.xacro').write_text(TOOL)
    with pytest.raises(UrdfError, match='ROS_PACKAGE_PATH'):
        load_urdf(arm)
    monkeypatch.setenv('ROS_PACKAGE_PATH', str(folder.parent))
    by_path = load_urdf(arm)
    monkeypatch.delenv('ROS_PACKAGE_PATH')
    inside = folder / 'arm.urdf.xacro'
    inside.write_text(arm.read_text())
    assert load_urdf(inside).digest() == by_path.digest()


def test_a_missing_file_and_an_argument_of_another_type_are_named(arm):
    with pytest.raises(UrdfError, match=r"no such file: 'nowhere.xacro'; expected"):
        load_urdf('nowhere.xacro')
    with pytest.raises(InputError,
                       match=r"xacro argument 'mass': \[1\]; expected a text"):
        expand_xacro(arm, {'mass': [1]})


def test_a_sweep_passes_arguments_to_its_xacro_file(arm):
    path = arm.parent / 'sweep.yaml'
    path.write_text('{urdf: arm.urdf.xacro, xacro: {mass: 3, tool: true}, samples: 1}')
    assert read_sweep(path).robot.model.bodies[0].inertial.mass == 3.5
    path.write_text('{urdf: arm.urdf.xacro, xacro: [mass, 3], samples: 1}')
    with pytest.raises(InputError,
                       match=r'xacro: .*expected a mapping of the arguments'):
        read_sweep(path)
