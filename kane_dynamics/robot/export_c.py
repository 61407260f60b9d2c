"""Export of a robot's kernels as C99, for targets without Python and LLVM."""

from collections.abc import Sequence
import inspect
import os
from pathlib import Path
from typing import Any, NamedTuple

from kane_dynamics._util.resources import package_version
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.native.backends.c99 import (c_functions, comment, constant, identifier,
                                               prototype, string)
from kane_dynamics.native.backends.c99_math import elementary_functions, Precision, PRECISIONS
from kane_dynamics.native.tracing.program import evaluate, Program
import numpy as np

DEFAULT_KERNELS = ('inverse_dynamics', 'forward_dynamics', 'mass_matrix', 'bias_force',
                   'gravity_force')
MARK = '/* Written by kane_dynamics'  # first line of exported files; others are not overwritten
TEST_STATES = 3
TOLERANCE = 1e-12  # relative to a result's largest entry
SOLVING = ('forward_dynamics', 'forward_dynamics_derivatives', 'inverse_mass_matrix')

AGREE = """\
/* Agree to `tolerance`, relative to the largest of the expected numbers; NaN never does. */
static int agree(const REAL *result, const REAL *expected, int count, REAL tolerance)
{
    REAL largest = 0;
    int k;
    for (k = 0; k < count; ++k)
        if (FABS(expected[k]) > largest) largest = FABS(expected[k]);
    for (k = 0; k < count; ++k)
        if (!(FABS(result[k] - expected[k]) <= tolerance * largest)) return 0;
    return 1;
}
"""
SPARE = 16.0  # times the error of float32 that is measured at the test states
FRAME_NAMES = {'jacobian': 'partial_velocities', 'frame_pose': 'frame_pose',
               'partial_velocities': 'partial_velocities'}


class _Kernel(NamedTuple):
    """A kernel to export as a C function, with its test states and reference results."""

    name: str  # of the quantity
    symbol: str  # in C
    program: Program
    tolerance: float
    inputs: list[list[Array]]  # of each test state, without the parameters
    results: list[Array]


def write_c(robot: Any, path: str | os.PathLike[str], kernels: Sequence[str],
            scalar: str = 'float64', self_test: bool = True) -> tuple[Path, Path]:
    """
    Write a Robot's kernels as C; see `Robot.export_c`.

    Returns
    -------
    (Path, Path)
        The source and the header.

    """
    if isinstance(robot.equations, ConstrainedEquations):
        raise InputError('export_c: a robot with chosen speeds or constraints; expected one in '
                         'joint rates without constraints')
    if scalar not in PRECISIONS:
        raise InputError(f'scalar: {scalar!r}; expected {" or ".join(PRECISIONS)}')
    source = Path(path).expanduser()
    if source.suffix != '.c':
        raise InputError(f"path: '{source}'; expected the name of a C source, which ends in .c")
    source = source.resolve()
    header = source.with_suffix('.h')
    if not header.name.isprintable() or any(part in header.name for part in ('"', '\\', '??')):
        raise InputError(f'path: {str(source)!r}; expected printable characters without ", \\ '
                         'and ??, because C includes the header by its name')
    for file in (source, header):
        _check_place(file)
    prefix, precision = identifier(source.stem), PRECISIONS[scalar]
    chosen = [_kernel(robot, prefix, name, precision)
              for name in _checked_names(robot, kernels)]
    about = _about(robot, chosen)
    _write(header, _header_text(robot, prefix, about, chosen, precision, self_test))
    _write(source, _source_text(robot, prefix, header.name, about, chosen, precision, self_test))
    return source, header


def _checked_names(robot: Any, kernels: Sequence[str]) -> list[str]:
    """Return the names of the kernels, each once; raise InputError for an unknown one."""
    if isinstance(kernels, str):
        raise InputError(f"kernels: the string '{kernels}'; expected a sequence of names")
    names = list(dict.fromkeys(kernels))
    unknown = [name for name in names if name not in robot.kernels.names
               and name.partition(':')[0] not in FRAME_NAMES]
    if unknown or not names:
        given = f"no kernel '{unknown[0]}'" if unknown else 'kernels: none'
        raise InputError(f'{given}; expected some of {", ".join(robot.kernels.names)}; of a '
                         f'frame: {", ".join(f"{name}:<frame>" for name in FRAME_NAMES)}')
    for name in names:
        quantity, _, frame = name.partition(':')
        if quantity in FRAME_NAMES:
            robot.model.frame(frame)  # raises InputError for an unknown frame
    return names


def _check_place(file: Path) -> None:
    """Raise InputError for a path without directory or with a file not of export_c."""
    if not file.parent.is_dir():
        raise InputError(f"path '{file}': no directory '{file.parent}'; expected an existing one")
    if not file.exists():
        return
    try:
        with open(file, encoding='utf-8', errors='replace') as stream:
            ours = stream.read(len(MARK)) == MARK
    except OSError as error:
        raise InputError(f"path '{file}': {error.strerror}; expected a writable path") from None
    if not ours:
        raise InputError(f"path '{file}': exists and was not written by export_c; expected a "
                         'new path')


def _write(file: Path, text: str) -> None:
    """Write a file atomically."""
    temporary = file.with_name(f'.{file.name}.{os.getpid()}')
    try:
        try:
            temporary.write_text(text, encoding='utf-8')
            temporary.replace(file)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"path '{file}': {error.strerror}; expected a writable path") from None


def _kernel(robot: Any, prefix: str, name: str, precision: Precision) -> _Kernel:
    """Trace a kernel and compute its reference results."""
    quantity, _, frame = name.partition(':')
    quantity = FRAME_NAMES.get(quantity, quantity)
    kernel = (robot.kernels.at_frame(quantity, frame) if frame
              else robot.kernels.quantity(quantity))
    rng, program = np.random.default_rng(0), kernel.traced()
    lower = np.maximum(robot.limits.lower, -np.pi)
    upper = np.maximum(np.minimum(robot.limits.upper, np.pi), lower)
    inputs, results = [], []
    tolerance = TOLERANCE if precision.name == 'float64' else float(precision.epsilon)
    for _ in range(TEST_STATES):
        q = rng.uniform(lower, upper)
        inputs.append([q if a.name == 'q' else rng.uniform(-2.0, 2.0, a.shape)
                       for a in kernel.arguments])
        results.append(np.asarray(kernel(*inputs[-1])))
        if precision.name == 'float32':
            rounded = evaluate(program, [*inputs[-1], kernel.parameters], np.float32)
            error = np.abs(rounded - results[-1]).max(initial=0.0)
            size = np.abs(results[-1]).max(initial=0.0) or 1.0
            tolerance = max(tolerance, SPARE * float(error / size))
        elif quantity in SOLVING:  # rounding error of a solution of M x = b
            condition = np.linalg.cond(robot.mass_matrix(q))
            tolerance = max(tolerance, float(10.0 * np.finfo(float).eps * condition))
    return _Kernel(quantity, identifier(f'{prefix}_{name}'), program, tolerance, inputs, results)


def _about(robot: Any, kernels: Sequence[_Kernel]) -> list[str]:
    """Return the first lines of both files."""
    model, equations = robot.model, robot.equations
    loaded = ', '.join(frame.name for frame in equations.wrench_frames) or 'none'
    payload = equations.payload_frame.name if equations.payload_frame else 'none'
    friction = 'in' if robot.friction else 'left out'
    lines = [f'Robot {model.name}, model {model.digest()}.',
             f'Damping and friction: {friction}.',
             f'Frames that carry a wrench: {loaded}. Frame of the payload: {payload}.',
             'Arithmetic of one call (functions are sines, cosines, tanh and square roots):']
    for kernel in kernels:
        count = kernel.program.operation_count()
        lines.append(f'  {kernel.symbol}: {count.multiplications} multiplications, '
                     f'{count.additions} additions, {count.divisions} divisions, '
                     f'{count.functions} functions')
    return [f'{MARK} {package_version()}.', *(f' * {comment(line)}' for line in lines), ' */']


def _header_text(robot: Any, prefix: str, about: Sequence[str], kernels: Sequence[_Kernel],
                 precision: Precision, self_test: bool) -> str:
    """Return the header: sizes, the order of the joints, prototypes."""
    upper, equations = prefix.upper(), robot.equations
    lines = [*about, f'#ifndef {upper}_H', f'#define {upper}_H', '',
             f'#define {upper}_MODEL_NAME {string(robot.model.name)}',
             f'#define {upper}_MODEL_DIGEST {string(robot.model.digest())}',
             f'#define {upper}_GENERATOR {string(f"kane_dynamics {package_version()}")}',
             f'#define {upper}_N {robot.n} /* joints: entries of q, u, udot and tau */',
             f'#define {upper}_N_WRENCHES {len(equations.wrench_frames)}',
             f'#define {upper}_N_PARAMETERS {len(robot.parameters.block)}',
             f'#define {upper}_REAL {precision.c}',
             *(f'#define {kernel.symbol.upper()}_SIZE {kernel.program.n_outputs} /* numbers */'
               for kernel in kernels), '', *_joint_enum(robot, upper), '',
             '/*', *(f' * {line}'.rstrip() for line in _conventions(robot, prefix)), ' */', '',
             '#ifdef __cplusplus', 'extern "C" {', '#endif']
    for kernel in kernels:
        doc = inspect.getdoc(getattr(type(robot), kernel.name, None)) or kernel.name
        words = ' '.join(doc.split('\n\n')[0].split())
        shape = ' x '.join(map(str, kernel.program.shape)) or '1'
        lines += ['', f'/* {comment(words)}', f' * result: {shape}, C order. */',
                  f'{prototype(kernel.program, kernel.symbol, precision)};']
    if self_test:
        lines += [
            '', f'#ifndef {upper}_NO_SELF_TEST',
            '/* Return 0 if every function gives the results embedded in the source, to the',
            ' * tolerance stated there, else the number of the first function that does not. */',
            f'int {prefix}_self_test(void);', '#endif']
    lines += ['', '#ifdef __cplusplus', '}', '#endif', '', '#endif', '']
    return '\n'.join(lines)


def _joint_enum(robot: Any, upper: str) -> list[str]:
    """Return the lines of the enumeration of joints; empty without joints."""
    lines, used = [], set()
    for k, joint in enumerate(robot.model.coordinate_joints):
        name = f'{upper}_JOINT_{identifier(joint.name).upper()}'
        name = name if name not in used else f'{name}_{k}'
        used.add(name)
        unit = 'm, m/s, N' if joint.kind == 'prismatic' else 'rad, rad/s, N m'
        lines.append(f'    {name} = {k}{"," if k < robot.n - 1 else ""} '
                     f'/* {comment(joint.name)}: {joint.kind}; {unit} */')
    return [f'enum {upper.lower()}_joint {{', *lines, '};'] if lines else []


def _conventions(robot: Any, prefix: str) -> list[str]:
    """Return the lines of the calling conventions."""
    upper = prefix.upper()
    gravity = ', '.join(f'{x:g}' for x in robot.parameters.gravity)
    lines = ['M(q) udot + bias(q, u) = tau + external, u = dq/dt, SI units, world axes.', '',
             f'Arguments are arrays of {upper}_REAL: q, u, udot and tau have one entry per joint,',
             'in the order above. A result may overlay an argument. Nothing is allocated, no',
             'state is kept: any thread may call anything at any time. Arguments are not',
             'checked.', '', 'parameters: gravity, the acceleration of free fall, m/s^2']
    lines += [] if robot.equations.payload_frame is None else [
        '  then the payload, in its frame: mass, mass x center of mass (3), and the integrals',
        '  of xx, xy, xz, yy, yz, zz over its mass; kg, kg m, kg m^2']
    lines.append(f'  NULL selects the values at export: gravity ({gravity})'
                 + (' and the payload at export.' if robot.equations.payload_frame else '.'))
    if robot.equations.wrench_frames:
        lines += ['wrench: for each frame that carries one, the force (N) then the moment (N m)',
                  '  that the environment exerts at its origin, world axes; NULL means none']
    return [comment(line) for line in lines]


def _source_text(robot: Any, prefix: str, header: str, about: Sequence[str],
                 kernels: Sequence[_Kernel], precision: Precision, self_test: bool) -> str:
    """Return the source: the functions, then the self-test."""
    # C interprets no escapes in the name of an included header.
    lines = [*about, f'#include "{header}"', '', '#include <float.h>', '#include <math.h>',
             '#include <stddef.h>', '#include <stdint.h>', '',
             _array('default_parameters', robot.parameters.block, precision)]
    no_wrench = robot.kernels.no_wrench
    if any(name == 'wrench' for kernel in kernels for name, _ in kernel.program.inputs):
        lines.append(_array('no_wrench', no_wrench, precision))
    texts = []
    for kernel in kernels:
        defaults = {'parameters': 'default_parameters', 'wrench': 'no_wrench'}
        inputs = dict(kernel.program.inputs)
        texts += ['', c_functions(kernel.program, kernel.symbol,
                                  {k: v for k, v in defaults.items() if k in inputs}, precision,
                                  f'{prefix.upper()}_VERSIONS')]
    lines += ['', elementary_functions(prefix.upper(), precision,
                                       {name for name in ('sin_cos', 'tanh_each')
                                        if any(f'{name}(' in text for text in texts)})]
    test = _self_test(prefix, kernels, precision) if self_test else []
    return '\n'.join([*lines, *texts, '', *test, ''])


def _array(name: str, values: Array, precision: Precision) -> str:
    """Return the definition of a constant array, of at least one entry as C requires."""
    flat = [constant(x, precision) for x in np.ravel(values)] or ['0']
    text = f'static const {precision.c} {name}[{len(flat)}] = {{\n'
    rows = [', '.join(flat[k:k + 4]) for k in range(0, len(flat), 4)]
    return text + ''.join(f'    {row},\n' for row in rows).removesuffix(',\n') + '\n};'


def _self_test(prefix: str, kernels: Sequence[_Kernel], precision: Precision) -> list[str]:
    """Return the reference data and the function that checks them."""
    agree = AGREE.replace('REAL', precision.c).replace('FABS', f'fabs{precision.suffix}')
    lines, body = [f'#ifndef {prefix.upper()}_NO_SELF_TEST', agree], []
    for number, kernel in enumerate(kernels, 1):
        count, tolerance = kernel.program.n_outputs, constant(kernel.tolerance, precision)
        body += ['    {', f'        {precision.c} result[{max(count, 1)}];']
        for k, (given, expected) in enumerate(zip(kernel.inputs, kernel.results)):
            names = [f'{kernel.symbol}_{k}_{name}' for (name, _), _ in
                     zip(kernel.program.inputs, given)]
            lines += [_array(name, values, precision) for name, values in zip(names, given)]
            reference = f'{kernel.symbol}_{k}_expected'
            lines.append(_array(reference, expected, precision))
            agrees = f'agree(result, {reference}, {count}, {tolerance})'
            body += [f'        {kernel.symbol}({", ".join([*names, "NULL", "result"])});',
                     f'        if (!{agrees}) return {number};']
        body.append('    }')
    return [*lines, '', f'int {prefix}_self_test(void)', '{', *body, '    return 0;', '}',
            '#endif']
