"""Messages of the commands: lists are shortened, sentences and advice stay whole."""

from kane_dynamics.cli import main
from kane_dynamics.cli.printing import brief, LONGEST
import pytest

LINK = """<link name="{0}"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
# The second joint cannot be at 0, the third only up to its limit; gravity cancels at the
# middle.
AWAY = f"""<robot name="away"><link name="base"/>{''.join(map(LINK.format, 'abc'))}
<joint name="free" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
</joint>
<joint name="elbow" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.4 0 0"/>
<axis xyz="0 1 0"/><limit lower="-3.0" upper="-0.2" velocity="2" effort="50"/></joint>
<joint name="slide" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/>
<limit lower="-0.5" upper="-0.1" velocity="2" effort="50"/></joint></robot>"""  # noqa: E501


STEP = ('a step of 0.001 s is too long, with friction, springs, beams, rotors, gears, '
        'loads, joints, links, motors, brakes, belts and bearings of this arm. Use the '
        "integrator 'implicit', or shorten the step")
MASSES = ('no mass moves with a, b: no torque determines their acceleration, forward '
          'dynamics and simulation fail; expected an <inertial> on what they move, '
          'or an armature in the supplement, or a lock of these joints')


@pytest.mark.parametrize('text', [STEP, MASSES])
def test_sentences_with_commas_are_not_shortened(text):
    assert len(text) > LONGEST
    assert brief(text) == text


def test_long_lists_are_shortened_and_the_advice_behind_them_stays():
    names = [f"joint 'shoulder_of_arm_{k}'" for k in range(30)]
    advice = '; expected an <inertial> on each of them'
    text = f'moving links without <inertial>: {", ".join(names)}{advice}'
    shorter = brief(text)
    assert shorter.startswith(f'moving links without <inertial>: {names[0]}')
    assert shorter.endswith(f'more (--verbose names all){advice}')
    count = shorter.count("joint '")
    assert f'and {30 - count} more' in shorter and len(shorter) < LONGEST + 60
    values = [f'joint_{k} {45.5 + k} rad (limits -3.1 to 3.1)' for k in range(9)]
    degrees = f'far outside: {", ".join(values)}; expected rad: are these degrees?'
    assert brief(degrees).endswith('; expected rad: are these degrees?')


@pytest.fixture
def away(tmp_path):
    """Return the path of a URDF whose limits exclude 0."""
    path = tmp_path / 'away.urdf'
    path.write_text(AWAY)
    return str(path)


@pytest.mark.parametrize('command', ['torque', 'simulate'])
def test_commands_start_within_limits_that_exclude_zero_and_say_so(
        command, away, capsys):
    assert main([command, away]) == 0
    printed = capsys.readouterr().err
    assert 'middle of their limits: elbow -1.6, slide -0.3' in printed
    assert printed.count('\n') == 1


def test_positions_outside_the_limits_are_named(away, capsys):
    assert main(['torque', away, '--q', '0', '0', '-0.2']) == 0
    assert ('--q: outside the limits: elbow 0 (limits -3 to -0.2)'
            in capsys.readouterr().err)


def test_rounding_errors_of_torques_that_cancel_are_zero(tmp_path, capsys):
    path = tmp_path / 'folded.urdf'  # the two masses balance at half a turn
    path.write_text(
        AWAY.replace('lower="-3.0" upper="-0.2"', 'lower="3.1415" upper="3.1417"')
        .replace('xyz="0.4 0 0"', 'xyz="0 0 0"')
        .replace('lower="-0.5" upper="-0.1"', 'lower="-1" upper="1"')
        .replace('<link name="c"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>',
                 '<link name="c"><inertial><mass value="1"/>'))
    assert main(['torque', str(path), '--q', '0', '3.141592653589793', '0']) == 0
    printed = capsys.readouterr().out
    assert 'e-1' not in printed
    row = next(line for line in printed.splitlines() if line.startswith('free'))
    assert row.split()[1] == '0'


def test_gravity_upwards_is_one_warning(away, capsys):
    assert main(['torque', away, '--q', '0', '-1', '-0.3', '--gravity', '0', '0',
                 '9.81']) == 0
    line, = capsys.readouterr().err.splitlines()
    assert 'points upwards in the axes of the base; expected 0 0 -9.81' in line
    assert main(['torque', away, '--q', '0', '-1', '-0.3', '--gravity', '0', '0',
                 '-1.62']) == 0
    assert not capsys.readouterr().err
    # `inspect` prints the warnings of the model itself.
    main(['inspect', away, '--gravity', '0', '0', '9.81'])
    assert capsys.readouterr().out.count('points upwards in the axes of the base') == 1
