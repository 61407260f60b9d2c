"""Promises of exported C: the library's numbers from plain C, and a self-test."""

import ctypes
from pathlib import Path
import re
import shutil
import subprocess
import sys

from kane_dynamics import (absolute_rates, box, Coupling, Inertial, InputError,
                           load_urdf, Model, ModelBuilder, Robot)
from kane_dynamics._util.resources import package_version, resource_path
from kane_dynamics.native.backends.c99 import c_functions, prototype
from kane_dynamics.native.backends.c99_math import elementary_functions, PRECISIONS
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.export_c import DEFAULT_KERNELS
from kane_dynamics.robot.kernel_set import CONSTRAINED, FRAME_QUANTITIES, QUANTITIES
from linkages import at_angle, four_bar
from mechanisms import random_model
import numpy as np
import pytest
from random_loops import random_loops

pytestmark = pytest.mark.skipif(shutil.which('gcc') is None, reason='no C compiler')
STRICT = ['-Wall', '-Wextra', '-Wpedantic', '-Wdouble-promotion', '-Werror', '-O1',
          '-fPIC', '-shared']
UNOPTIMIZED = ('gcc', '-std=c99', '-O0')  # in a fraction of the time
SOLVED = ('forward_dynamics', 'inverse_mass_matrix')


def arm(name):
    """Return a shipped arm."""
    return Robot(load_urdf(resource_path('urdf', f'{name}.urdf')))


def mechanism():
    """Return a tree with slides, mimics, friction, springs, wrenches, payload."""
    robot = Robot(random_model(3, 6, mimics=2), wrench_frames=['frame3', 'frame6'],
                  payload_frame='frame5')
    robot.parameters.payload = Inertial(2.0, [0.1, 0.0, -0.2], np.diag([0.1, 0.2, 0.15]))
    return robot


def built(source, tmp_path, compiler=('gcc', '-std=c99')):
    """Compile a source with every warning an error, and load it."""
    library = tmp_path / f'{compiler[0]}_{len(list(tmp_path.glob("*.so")))}.so'
    # Options of the compiler last, so that they count.
    command = [compiler[0], *STRICT, *compiler[1:], str(source), '-o', str(library),
               '-lm']
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(library))


def call_exported(function, arguments, shape):
    """Call an exported function on arrays; None is NULL."""
    result = np.full(shape, np.nan)
    pointers = []
    for x in (*arguments, result):
        pointers.append(None if x is None else x.ctypes.data_as(ctypes.c_void_p))
    function.restype = None
    function(*pointers)
    return result


def check(robot, library, prefix, kernels):
    """Hold every kernel against the library at random states."""
    rng = np.random.default_rng(1)
    for name in kernels:
        kernel = robot.kernels.kernel(name)
        function = getattr(library, f'{prefix}_{name}')
        for _ in range(20):
            inputs = [rng.uniform(-2.0, 2.0, a.shape) for a in kernel.arguments]
            expected = np.asarray(kernel(*inputs))
            tolerance = 1e-12
            if name in SOLVED:
                condition = np.linalg.cond(robot.mass_matrix(inputs[0]))
                tolerance = max(tolerance, 10.0 * np.finfo(float).eps * condition)
            got = call_exported(function, [*inputs, robot.parameters.block],
                                kernel.shape)
            assert np.abs(got - expected).max() <= tolerance * np.abs(
                expected).max(), name


@pytest.mark.parametrize('name', ['ur10e', 'fr3'])
def test_exported_arms_give_the_librarys_numbers(name, tmp_path):
    robot = arm(name)
    source, header = robot.export_c(tmp_path / f'{name}.c')
    assert (source, header) == (tmp_path / f'{name}.c', tmp_path / f'{name}.h')
    library = built(source, tmp_path, ('gcc', '-std=c99', '-O2'))
    check(robot, library, name, DEFAULT_KERNELS)
    assert getattr(library, f'{name}_self_test')() == 0


def test_every_kernel_of_a_mechanism_with_everything_gives_the_librarys_numbers(
        tmp_path):
    robot = mechanism()
    source, _ = robot.export_c(tmp_path / 'tree.c', tuple(QUANTITIES))
    library = built(source, tmp_path, UNOPTIMIZED)
    check(robot, library, 'tree', QUANTITIES)
    assert library.tree_self_test() == 0


def test_the_self_test_accepts_results_that_are_rounding_alone(tmp_path):
    """The mass matrix of this mechanism is constant in its speeds: C vanishes."""
    loops = random_loops(37)
    robot = Robot(loops.model, constraints=loops.constraints, configuration=loops.q0,
                  speeds=absolute_rates)
    source, _ = robot.export_c(tmp_path / 'loops.c', ['coriolis_matrix'])
    assert built(source, tmp_path, UNOPTIMIZED).loops_self_test() == 0


def test_subroutines_are_static_functions_that_give_the_librarys_numbers(tmp_path):
    robot = Robot(random_model(5, 26, branching=0.6, passive=False))  # M^-1 by calls
    source, _ = robot.export_c(tmp_path / 'tree.c', ['inverse_mass_matrix'])
    assert 'static void tree_inverse_mass_matrix_solution(' in source.read_text()
    library = built(source, tmp_path, UNOPTIMIZED)
    check(robot, library, 'tree', ['inverse_mass_matrix'])
    symbols = subprocess.run(['nm', '-D', '--defined-only', library._name], text=True,
                             capture_output=True, check=True).stdout
    assert sorted(re.findall(r' T (\w+)', symbols)) == [
        'tree_check_state', 'tree_inverse_mass_matrix', 'tree_self_test']


def test_null_stands_for_the_parameters_at_export_and_for_no_wrench(tmp_path):
    robot = mechanism()
    robot.parameters.gravity = [1.0, 2.0, -3.0]
    library = built(robot.export_c(tmp_path / 'tree.c', ['inverse_dynamics'])[0],
                    tmp_path)
    q, u, udot = np.random.default_rng(0).uniform(-1.0, 1.0, (3, robot.n))
    expected = robot.inverse_dynamics(q, u, udot)
    got = call_exported(library.tree_inverse_dynamics, [q, u, udot, None, None], robot.n)
    np.testing.assert_allclose(got, expected,
                               rtol=0.0, atol=1e-12 * np.abs(expected).max())


def test_a_result_may_be_written_over_an_argument(tmp_path):
    robot = arm('two_link')
    library = built(robot.export_c(tmp_path / 'arm.c', ['inverse_dynamics'])[0],
                    tmp_path)
    q, u, udot = np.random.default_rng(0).uniform(-1.0, 1.0, (3, robot.n))
    expected = robot.inverse_dynamics(q, u, udot)
    pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in (q, u, udot)]
    library.arm_inverse_dynamics(*pointers, None, pointers[1])
    np.testing.assert_allclose(u, expected, rtol=1e-12)


def test_there_is_no_state_and_no_call_but_to_libm(tmp_path):
    source, _ = mechanism().export_c(tmp_path / 'tree.c')
    subprocess.run(
        ['gcc', '-std=c99', '-O2', '-c', str(source), '-o', str(tmp_path / 'tree.o')],
        check=True)
    listed = subprocess.run(['nm', str(tmp_path / 'tree.o')],
                            capture_output=True, text=True, check=True).stdout
    symbols = re.findall(r'(\w) ([\w.]+)$', listed, re.MULTILINE)
    # code, constants, undefined: no data
    assert {kind for kind, _ in symbols} <= set('TtrRU')
    assert {name for kind, name in symbols if kind == 'U'} <= {
        'sin', 'cos', 'sincos', 'tanh', 'sqrt', '_GLOBAL_OFFSET_TABLE_',
        '__stack_chk_fail'}


@pytest.mark.parametrize('kernel', DEFAULT_KERNELS)
def test_the_self_test_fails_with_the_functions_number_when_a_reference_is_altered(
        kernel, tmp_path):
    source, _ = arm('two_link').export_c(tmp_path / 'arm.c')
    text = source.read_text()
    at = text.index('=', text.index(f'{kernel}_2_expected['))
    number = re.search(r'-?\d[\d.e-]*', text[at:])
    value = float(number[0])
    start = at + number.start()
    source.write_text(text[:start] + repr(value + 1e-6 * (1.0 + abs(value)))
                      + text[at + number.end():])
    library = built(source, tmp_path)
    assert library.arm_self_test() == 1 + DEFAULT_KERNELS.index(kernel)


def test_the_self_test_fails_on_nan(tmp_path):
    source, _ = arm('two_link').export_c(tmp_path / 'arm.c')
    source.write_text(source.read_text().replace('cosine = ', 'cosine = (0.0 / 0.0) * '))
    assert built(source, tmp_path).arm_self_test() != 0


def test_the_header_says_what_it_is_and_serves_cpp(tmp_path):
    robot = arm('fr3')
    source, header = robot.export_c(tmp_path / 'fr3.c')
    text = header.read_text()
    count = robot.operation_count()['inverse_dynamics']
    assert f'"{robot.model.digest()}"' in text and '#define FR3_MODEL_NAME "fr3"' in text
    assert f'"kane_dynamics {package_version()}"' in text
    assert (f'fr3_inverse_dynamics: {count.multiplications} multiplications, '
            f'{count.additions} additions') in text
    assert 'FR3_JOINT_FR3_JOINT1 = 0,' in text and f'#define FR3_N {robot.n} ' in text
    if shutil.which('g++'):
        user = tmp_path / 'user.cpp'
        user.write_text(f'#include "{header.name}"\n#include "{source.name}"\n'
                        'extern "C" int size() { return FR3_MASS_MATRIX_SIZE; }\n')
        library = built(user, tmp_path, ('g++', '-std=c++11'))
        assert library.size() == robot.n ** 2 and library.fr3_self_test() == 0


def test_names_that_c_cannot_hold_do_no_harm(tmp_path):
    joints = ['a*/ int x = "1;??/', 'a-/ int x = "1;??/', 'größe\n#error']
    model = random_model(0, 3)
    bodies = []
    for k, b in enumerate(model.bodies):
        if j := b.joint:
            bodies.append(type(b)(b.name, b.parent, type(j)(joints[k], j.kind, j.axis,
                                                            coordinate=k), b.inertial))
    robot = Robot(Model('/* "\\\n*/', tuple(bodies), tuple(joints)))
    source, _ = robot.export_c(tmp_path / '7-axis armé.c', ['gravity_force'])
    assert built(source, tmp_path).x7_axis_arm__self_test() == 0
    for name in ('a"b.c', 'a\\b.c', 'a\nb.c', 'a??b.c', 'a\udcffb.c'):
        with pytest.raises(InputError,
                           match='because C includes the header by its name'):
            robot.export_c(tmp_path / name)


@pytest.mark.parametrize('kernels, words', [
    (['inverse_dynamic'],
     "no kernel 'inverse_dynamic'; expected some of inverse_dynamics, "),
    ([], 'kernels: none; expected some of inverse_dynamics, '),
    ('mass_matrix', "the string 'mass_matrix'")])
def test_an_unknown_kernel_is_named_with_the_valid_ones(kernels, words, tmp_path):
    with pytest.raises(InputError, match=words):
        arm('two_link').export_c(tmp_path / 'arm.c', kernels)
    assert not list(tmp_path.iterdir())


def test_quantities_of_rows_are_refused_for_a_robot_without_rows(tmp_path):
    for name in ('constraint_forces', 'constraint_residual',
                 'constraint_velocity_residual'):
        with pytest.raises(InputError, match=f"'{name}' of a robot without constraints"):
            arm('two_link').export_c(tmp_path / 'arm.c', [name])


def gantry(kind):
    """Return a robot without sines: joints that slide, two of them coupled or not."""
    b = ModelBuilder('gantry')
    on = 'world'
    for name, axis in (('x', (1, 0, 0)), ('y', (0, 1, 0)), ('z', (0, 0, 1))):
        b.body(name, on, kind='prismatic', axis=axis, inertial=box(2.0, (0.3, 0.2, 0.1)))
        on = name
    b.frame('tool', 'z', at=(0.0, 0.0, -0.1))
    rows = [Coupling('y', {'x': 0.5})] if kind == 'coupled' else []
    return Robot(b.model(), constraints=rows)


@pytest.mark.parametrize('kind', ['tree', 'coupled'])
def test_every_quantity_is_exported_alone_also_without_sines(kind, tmp_path):
    robot = gantry(kind)
    rng = np.random.default_rng(0)
    state = {name: rng.normal(size=robot.n) for name in ('u', 'udot', 'tau')}
    state['q'] = robot.closed_configuration(rng.normal(size=3))
    rates = {'joint_rates', 'joint_torques', 'joint_accelerations'}
    names = {*robot.kernels.names, *rates,
             *(f'{name}:tool' for name in FRAME_QUANTITIES),
             'jacobian:tool', 'jacobian_rate:tool', 'joint_reaction:y'}
    for k, name in enumerate(sorted(names)):
        source, _ = robot.export_c(tmp_path / f'g{k}.c', [name])
        library = built(source, tmp_path, UNOPTIMIZED)
        assert getattr(library, f'g{k}_self_test')() == 0, name
        if name in rates:
            arguments = [state[key] for key in CONSTRAINED[name].arguments]
            expected = getattr(robot, name)(*arguments)
            got = call_exported(getattr(library, f'g{k}_{name}'), [*arguments, None],
                                expected.shape)
            np.testing.assert_allclose(got, expected, atol=1e-14, err_msg=name)


def test_a_bad_path_is_named_and_only_files_of_ours_are_replaced(tmp_path):
    robot = arm('two_link')
    with pytest.raises(InputError, match=r"'arm.cpp'; expected .* \.c"):
        robot.export_c('arm.cpp')
    with pytest.raises(InputError, match=f"no directory '{tmp_path}/none'; expected"):
        robot.export_c(tmp_path / 'none' / 'arm.c')
    source, header = robot.export_c(tmp_path / 'arm.c')
    first = header.read_text()
    robot.export_c(source, ['mass_matrix'])
    assert header.read_text() != first
    header.write_text('#define MINE\n')
    with pytest.raises(InputError, match=r'arm\.h.*was not written by export_c'):
        robot.export_c(source)
    assert header.read_text() == '#define MINE\n'
    assert sorted(path.name for path in tmp_path.iterdir()) == ['arm.c', 'arm.h']


def test_a_process_exports_from_the_command_line(tmp_path):
    def run(*arguments):
        return subprocess.run(
            [sys.executable, '-m', 'kane_dynamics.cli', 'export',
             str(resource_path('urdf', 'ur10e.urdf')), *arguments], capture_output=True,
            text=True, check=False, timeout=100)
    path = tmp_path / 'arm.c'
    done = run('-o', str(path), '--kernel', 'inverse_dynamics', 'gravity_force',
               '--wrench-frames', 'tool0', '--payload-frame', 'tool0')
    assert done.returncode == 0 and str(path) in done.stdout, done.stderr
    text = Path(path.with_suffix('.h')).read_text()
    assert 'ARM_N_WRENCHES 1' in text and 'ARM_N_PARAMETERS 13' in text
    assert built(path, tmp_path).arm_self_test() == 0
    done = run('-o', str(path), '--kernel', 'torque')
    assert done.returncode == 2 and "no kernel 'torque'; expected some of" in done.stderr


def test_poses_and_jacobians_of_frames_are_among_the_kernels(tmp_path):
    robot = arm('ur10e')
    source, header = robot.export_c(tmp_path / 'arm.c',
                                    ['jacobian:tool0', 'frame_pose:tool0'])
    assert 'void arm_jacobian_tool0(const double *q, ' in header.read_text()
    library = built(source, tmp_path)
    assert library.arm_self_test() == 0
    q = np.random.default_rng(2).uniform(-2.0, 2.0, robot.n)
    for function, expected in ((library.arm_jacobian_tool0, robot.jacobian('tool0', q)),
                               (library.arm_frame_pose_tool0,
                                robot.frame_pose('tool0', q))):
        got = call_exported(function, [q, None], expected.shape)
        np.testing.assert_allclose(got, expected, atol=1e-14)
    with pytest.raises(InputError, match=r"'nose'.*tool0"):
        robot.export_c(tmp_path / 'arm.c', ['jacobian:nose'])
    with pytest.raises(InputError,
                       match=r"no kernel 'jacobians:tool0'.*jacobian:<frame>"):
        robot.export_c(tmp_path / 'arm.c', ['jacobians:tool0'])


@pytest.mark.parametrize('name', ['ur10e', 'fr3', 'mechanism'])
def test_single_precision_has_a_self_test_to_fit(name, tmp_path):
    robot = mechanism() if name == 'mechanism' else arm(name)
    source, header = robot.export_c(tmp_path / 'arm.c', scalar='float32')
    assert 'double' not in re.sub(r'/\*.*?\*/', '',
                                  source.read_text() + header.read_text(),
                                  flags=re.DOTALL)
    text = source.read_text()
    options = [[], ['-O3', '-march=native'],
               ['-DARM_PORTABLE']] if name == 'fr3' else [[]]
    for further in options:
        library = built(source, tmp_path, ('gcc', '-std=gnu99', *further))
        assert library.arm_self_test() == 0
    rng = np.random.default_rng(5)
    for _ in range(20):
        inputs = rng.uniform(-1.0, 1.0, (3, robot.n)).astype(np.float32)
        result = np.empty(robot.n, np.float32)
        extra = [None] * (len(robot.kernels.kernel('inverse_dynamics').arguments) - 2)
        library.arm_inverse_dynamics(
            *(x if x is None else x.ctypes.data_as(ctypes.c_void_p)
              for x in (*inputs, *extra, result)))
        expected = robot.inverse_dynamics(*inputs.astype(np.float64))
        assert np.abs(result - expected).max() < 1e-5 * np.abs(expected).max()
    # and it fits closely: an error of a thousandth is found
    wrong = re.sub(r'(arm_inverse_dynamics_0_expected\[\d+\] = \{\s*)(-?[\d.e+-]+)f',
                   lambda match: f'{match[1]}{1.003 * float(match[2]):.9g}f', text)
    number = re.search(r'inverse_dynamics_0_expected\[\d+\] = \{([^}]*)\}', text)[1]
    values = np.abs([float(x.strip(' f')) for x in number.replace('\n', '').split(',')])
    if values[0] > 0.5 * values.max():
        assert wrong != text
        source.write_text(wrong)
        assert built(source, tmp_path).arm_self_test() == 1


def test_another_sine_and_cosine_can_be_put_in(tmp_path):
    robot = arm('fr3')
    kernels = ('inverse_dynamics', 'mass_matrix')
    source, _ = robot.export_c(tmp_path / 'arm.c', kernels)
    hook = ['-DARM_SINCOS(x,s,c)=(*(s)=sin(x),*(c)=cos(x))', '-DARM_TANH(x)=tanh(x)']
    library = built(source, tmp_path, ('gcc', '-std=c99', *hook))
    assert library.arm_self_test() == 0
    check(robot, library, 'arm', kernels)
    wrong = built(source, tmp_path,
                  ('gcc', '-std=c99', '-DARM_SINCOS(x,s,c)=(*(s)=x,*(c)=1)'))
    assert wrong.arm_self_test() == 1


def test_sines_and_tanh_hold_at_every_size_of_their_argument(tmp_path):
    robot = arm('fr3')
    library = built(robot.export_c(tmp_path / 'arm.c', ['bias_force'])[0], tmp_path)
    source, _ = robot.export_c(tmp_path / 'pose.c', ['frame_pose:fr3_link8'])
    pose = built(source, tmp_path).pose_frame_pose_fr3_link8
    rng = np.random.default_rng(7)
    for size in (1e-300, 1e-9, 0.1, 3.0, 1e3, 9.9e4, 1e7, 1e12):
        q, u = rng.uniform(-size, size, (2, robot.n))
        expected = robot.frame_pose('fr3_link8', q)
        got = call_exported(pose, [q, None], (4, 4))
        np.testing.assert_allclose(got, expected, atol=3e-15)
        u = np.minimum(np.abs(u), 1e3) * np.sign(u)
        want = robot.bias_force(np.zeros(robot.n), u)
        got = call_exported(library.arm_bias_force, [np.zeros(robot.n), u, None],
                            robot.n)
        assert np.abs(got - want).max() <= 1e-12 * np.abs(want).max()


def test_the_self_test_can_be_left_out_when_writing_and_when_compiling(tmp_path):
    robot = arm('two_link')
    source, header = robot.export_c(tmp_path / 'arm.c', self_test=False)
    assert 'self_test' not in source.read_text() + header.read_text()
    assert not hasattr(built(source, tmp_path), 'arm_self_test')
    source, header = robot.export_c(tmp_path / 'arm.c')
    assert 'self_test' in header.read_text()
    library = built(source, tmp_path, ('gcc', '-std=c99', '-DARM_NO_SELF_TEST'))
    assert not hasattr(library, 'arm_self_test')
    with pytest.raises(InputError, match=r"scalar: 'half'; expected float64 or float32"):
        robot.export_c(tmp_path / 'arm.c', scalar='half')


def test_every_operation_that_is_traced_is_written(tmp_path):
    def f(x):
        return np.array([np.exp(-x[0]) * np.log(2.0 + x[0] ** 2) + np.arctan(x[0]),
                         np.floor(3.0 * x[0]), (x[0] < 0.5).select(x[0] ** 1.5, 2.0),
                         np.tanh(x[0]) - np.sqrt(x[0])])
    program = trace_program('f', f, [('x', (1,))])
    source = tmp_path / 'f.c'
    double = PRECISIONS['float64']
    source.write_text('\n'.join([
        *(f'#include <{name}.h>' for name in ('math', 'stddef', 'stdint', 'string')),
        elementary_functions('F', double, {'tanh_each'}),
        f'{prototype(program, "f", double)};',
        c_functions(program, 'f', {}, double, ''), '']))
    function = built(source, tmp_path).f
    for x in (0.3, 0.7, 2.4):
        want = [np.exp(-x) * np.log(2.0 + x * x) + np.arctan(x), np.floor(3.0 * x),
                x**1.5 if x < 0.5 else 2.0, np.tanh(x) - np.sqrt(x)]
        np.testing.assert_allclose(call_exported(function, [np.array([x])], 4), want,
                                   rtol=1e-14)


def test_a_closed_loop_names_its_speeds_and_refuses_open_configurations(tmp_path):
    robot = four_bar('crank')
    source, header = robot.export_c(tmp_path / 'loop.c', (
        'inverse_dynamics', 'constraint_residual', 'constraint_velocity_residual'))
    text = header.read_text()
    assert '#define LOOP_N 1 ' in text and '#define LOOP_N_Q 3 /* coordinates: ' in text
    assert 'LOOP_SPEED_CRANK = 0' in text and 'LOOP_JOINT_ROCKER = 2' in text
    library = built(source, tmp_path)
    assert library.loop_self_test() == 0
    q = at_angle(1.1)
    u = np.array([2.0])
    udot = np.array([-1.0])
    tau = call_exported(library.loop_inverse_dynamics, [q, u, udot, None], 1)
    np.testing.assert_allclose(tau, robot.inverse_dynamics(q, u, udot), rtol=1e-11)
    assert np.isnan(call_exported(library.loop_inverse_dynamics,
                                  [q + 0.1, u, udot, None], 1))[0]
