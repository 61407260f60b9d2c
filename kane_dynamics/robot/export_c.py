"""Export of a robot's kernels as C99, for targets without Python and LLVM."""

from collections.abc import Iterable, Sequence
import os
from pathlib import Path
import re
from typing import Any

from kane_dynamics._util.resources import package_version
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.native.backends.c99 import (c_functions, c_identifier, c_literal,
                                               comment, string)
from kane_dynamics.native.backends.c99_math import (elementary_functions, Precision,
                                                    PRECISIONS)
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import evaluate, Program
from kane_dynamics.robot.c_header import (CKernel, constrained, header_text,
                                          joint_limits, limit_size)
from kane_dynamics.robot.kernel_set import CONSTRAINED, FRAME_QUANTITIES
import numpy as np

DEFAULT_KERNELS = ('inverse_dynamics', 'forward_dynamics', 'mass_matrix', 'bias_force',
                   'gravity_force')
# First line of exported files; others are not overwritten.
MARK = '/* Written by kane_dynamics'
TEST_STATES = 3
DEFLECTION = 1e-2  # of modal coordinates in the self-test, relative to joint angles
TOLERANCE = 1e-12  # relative to a result's largest entry
RESIDUALS = ('constraint_residual', 'constraint_velocity_residual')  # 0 but for rounding
SOLVING = ('forward_dynamics', 'forward_dynamics_derivatives', 'inverse_mass_matrix')

AGREE = """\
/* Agree to `tolerance`, relative to the largest of the expected numbers; NaN never does. */
static int agree(const REAL *result, const REAL *expected, int count, REAL tolerance, REAL least)
{
    REAL largest = least;
    int k;
    for (k = 0; k < count; ++k)
        if (FABS(expected[k]) > largest) largest = FABS(expected[k]);
    for (k = 0; k < count; ++k)
        if (!(FABS(result[k] - expected[k]) <= tolerance * largest)) return 0;
    return 1;
}
"""
SPARE = 16.0  # times the error of float32 that is measured at the test states
# Quantities of a frame by the names that users give, and of a frame or joint.
FRAME_NAMES = {'jacobian': 'partial_velocities', 'jacobian_rate': 'partial_velocity_rates',
               **{name: name for name in FRAME_QUANTITIES}}
PART_NAMES = {**FRAME_NAMES, 'joint_reaction': 'joint_reaction'}


def write_c(robot: Any, path: str | os.PathLike[str], kernels: Sequence[str | Kernel],
            scalar: str = 'float64', self_test: bool = True) -> tuple[Path, Path]:
    """
    Write a Robot's kernels as C; see `Robot.export_c`.

    Returns
    -------
    (Path, Path)
        The source and the header.

    """
    if scalar not in PRECISIONS:
        raise InputError(f'scalar: {scalar!r}; expected {" or ".join(PRECISIONS)}')
    precision = PRECISIONS[scalar]
    source, header = _checked_paths(path)
    prefix = c_identifier(source.stem)

    # The laws of a controller come with their kernels; quantities are named.
    laws = _checked_laws(robot, kernels)
    quantities: Sequence[Any] = kernels
    if laws:
        quantities = [name for name in kernels if not isinstance(name, Kernel)]
    chosen = []
    if quantities or not laws:
        for name in _checked_names(robot, quantities):
            chosen.append(_kernel(robot, prefix, name, precision))
    for law in laws:
        chosen.append(_reference(robot, prefix, law, law.name, law.name, precision))

    # Both files begin alike, and the header declares what the source has.
    about = _about(robot, chosen)
    _write(header, header_text(robot, prefix, about, chosen, precision, self_test))
    text = _source_text(robot, prefix, header.name, about, chosen, precision, self_test)
    _write(source, text)
    return source, header


def _checked_paths(path: str | os.PathLike[str]) -> tuple[Path, Path]:
    """Return the paths of source and header; InputError if they cannot be written."""
    source = Path(path).expanduser()
    if source.suffix != '.c':
        raise InputError(f"path: '{source}'; expected the name of a C source, which ends "
                         'in .c')
    source = source.resolve()
    header = source.with_suffix('.h')
    # These end the name, or begin a trigraph, in an #include of C.
    ends_a_name = re.search(r'["\\]|\?\?', header.name)  # in an #include of C
    if not header.name.isprintable() or ends_a_name:
        raise InputError(f'path: {str(source)!r}; expected printable characters without ", \\ '
                         'and ??, because C includes the header by its name')
    for file in (source, header):
        _check_place(file)
    return source, header


def _checked_laws(robot: Any, kernels: Sequence[Any]) -> list[Kernel]:
    """Return the kernels of a controller; InputError for those of another robot."""
    if isinstance(kernels, Kernel) or not isinstance(kernels, Iterable):
        raise InputError(f'kernels: a {type(kernels).__name__}; expected a sequence of '
                         'names and kernels')
    # A kernel listed twice is exported once.
    laws = {kernel.name: kernel for kernel in kernels if isinstance(kernel, Kernel)}
    for law in laws.values():
        # A kernel's constants are those of the robot that compiled it.
        if law.parameters is not robot.parameters.block:
            raise InputError(f"kernels: '{law.name}' of another robot; expected those of "
                             'controller_kernels(robot) of the robot to export')
    return list(laws.values())


def _checked_names(robot: Any, kernels: Sequence[Any]) -> list[str]:
    """Return the names of the kernels; raise InputError for an unknown one."""
    if isinstance(kernels, str):
        raise InputError(f"kernels: the string '{kernels}'; expected a sequence of "
                         'names')
    names = list(dict.fromkeys(kernels))
    refused = None if names else 'kernels: none'
    for name in names:
        # A quantity of a frame or joint is written as quantity:frame.
        quantity, _, part = name.partition(':')
        of_part = quantity in PART_NAMES and part
        # A quantity with a row for each constraint may have none.
        if name in CONSTRAINED and 0 in robot.kernels.signature(name)[1]:
            refused = f"kernels: '{name}' of a robot without constraints, which is empty"
        elif not of_part and name not in robot.kernels.names and name not in CONSTRAINED:
            refused = f"no kernel '{name}'"
        if refused is not None:
            break
    if refused is not None:
        of_frames = ', '.join(f'{name}:<frame>' for name in FRAME_NAMES)
        raise InputError(f'{refused}; expected some of {", ".join(robot.kernels.names)}; of '
                         f'a frame: {of_frames}; joint_reaction:<joint>')
    return names


def _check_place(file: Path) -> None:
    """Raise InputError for a path without directory or with a file not of export_c."""
    if not file.parent.is_dir():
        raise InputError(f"path '{file}': no directory '{file.parent}'; expected an "
                         'existing one')
    # Overwrite only what an earlier export wrote: its first line says so.
    if not file.exists():
        return
    try:
        with open(file, encoding='utf-8', errors='replace') as stream:
            ours = stream.read(len(MARK)) == MARK
    except OSError as error:
        raise InputError(f"path '{file}': {error.strerror}; expected a writable "
                         'path') from None
    if not ours:
        raise InputError(f"path '{file}': exists and was not written by export_c; expected a "
                         'new path')


def _write(file: Path, text: str) -> None:
    """Write a file atomically."""
    temporary = file.with_name(f'.{file.name}.{os.getpid()}')
    # Rename a complete file into place, so that no reader sees a part of it.
    try:
        try:
            temporary.write_text(text, encoding='utf-8')
            temporary.replace(file)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"path '{file}': {error.strerror}; expected a writable "
                         'path') from None


def _kernel(robot: Any, prefix: str, name: str, precision: Precision) -> CKernel:
    """Trace the kernel of a quantity and compute its reference results."""
    quantity, _, part = name.partition(':')
    quantity = PART_NAMES.get(quantity, quantity)
    kernel = robot.kernels.kernel(quantity, part)
    return _reference(robot, prefix, kernel, quantity, name, precision)


def _reference(robot: Any, prefix: str, kernel: Kernel, quantity: str, name: str,
               precision: Precision) -> CKernel:
    """Return a kernel with its reference results."""
    # Results at random states, for the self-test of the exported code.
    rng = np.random.default_rng(0)
    program = kernel.traced()
    is_double = precision.name == 'float64'
    tolerance = TOLERANCE if is_double else float(precision.epsilon)
    inputs = []
    results = []
    for _ in range(TEST_STATES):
        q, t, growth = _configuration(robot, rng)
        state = {'q': q, 'link_position': _of_links(robot, q), 't': np.array(t)}
        arguments = []
        for argument in kernel.arguments:
            if argument.name in state:
                arguments.append(state[argument.name])
            else:
                arguments.append(rng.uniform(-2.0, 2.0, argument.shape))
        result = np.asarray(kernel(*arguments))
        inputs.append(arguments)
        results.append(result)
        # The tolerance of this program: rounding, magnified where a system is solved.
        if is_double:
            if quantity in SOLVING:  # rounding error of a solution of M x = b
                growth *= float(np.linalg.cond(robot.mass_matrix(q, t=t)))
            error = 10.0 * float(np.finfo(float).eps) * growth
            # Entries that all cancel, such as C of constant M, are rounding alone.
            error = max(error, SPARE * _rounding(program, [*arguments, kernel.parameters]))
        else:
            # Measured: the program in single precision on the same arguments.
            rounded = evaluate(program, [*arguments, kernel.parameters], np.float32)
            difference = np.abs(rounded - result).max(initial=0.0)
            size = np.abs(result).max(initial=float(quantity in RESIDUALS)) or 1.0
            error = SPARE * float(difference / size)
        tolerance = max(tolerance, error)
    symbol = c_identifier(f'{prefix}_{name}')
    return CKernel(quantity, symbol, program, tolerance, inputs, results)


def _rounding(program: Program, arguments: Sequence[Any]) -> float:
    """Return the rounding error of a program, relative to its largest result; 0 for none."""
    rounded = evaluate(program, arguments)
    exact = evaluate(program, arguments, np.longdouble)
    error = float(np.abs(rounded - exact).max(initial=0.0))
    size = float(np.maximum(np.abs(rounded), np.abs(exact)).max(initial=0.0))
    return error / size if error > 0.0 else 0.0


def _configuration(robot: Any, rng: np.random.Generator) -> tuple[Array, float, float]:
    """Return a configuration, (n_q,), a time, and the growth of rounding."""
    # Constrained robots: a closed configuration, away from singular ones.
    if constrained(robot):
        from kane_dynamics.robot.verification import conditioning, regular_state
        q, t = regular_state(robot, rng)
        return q, t, conditioning(robot, q, t)**2
    # Within the limits; joints without any turn at most half a turn.
    lower = np.maximum(robot.limits.lower, -np.pi)
    q = rng.uniform(lower, np.maximum(np.minimum(robot.limits.upper, np.pi), lower))
    q[list(robot.model.modal_coordinates)] *= DEFLECTION
    return q, 0.0, 1.0


def _of_links(robot: Any, q: Array) -> Array:
    """Return a configuration without the motors of elastic joints."""
    model = robot.model
    motors = [model.places[elastic.motor] for elastic in model.drives]
    return np.delete(q, motors)


def _about(robot: Any, kernels: Sequence[CKernel]) -> list[str]:
    """Return the first lines of both files."""
    model = robot.model
    equations = robot.equations
    # Choices of the robot that are part of the code.
    wrench_frames = ', '.join(frame.name for frame in equations.wrench_frames)
    payload_frame = ''
    if equations.payload_frame:
        payload_frame = equations.payload_frame.name
    friction = 'in' if robot.friction else 'left out'

    # What the numbers depend on, then what a call costs.
    lines = [f'Robot {model.name}, model {model.digest()}.',
             f'Damping and friction: {friction}.',
             (f'Frames that carry a wrench: {wrench_frames or "none"}. Frame of the '
              f'payload: {payload_frame or "none"}.'),
             'Arithmetic of one call (functions are sines, cosines, tanh and square roots):']
    for kernel in kernels:
        count = kernel.program.operation_count()
        lines.append(f'  {kernel.symbol}: {count.multiplications} multiplications, '
                     f'{count.additions} additions, {count.divisions} divisions, '
                     f'{count.functions} functions')
    commented = [f' * {comment(line)}' for line in lines]
    return [f'{MARK} {package_version()}.', *commented, ' */']


def _source_text(robot: Any, prefix: str, header: str, about: Sequence[str],
                 kernels: Sequence[CKernel], precision: Precision, self_test: bool) -> str:
    """Return the source: the functions, then the self-test."""
    # C interprets no escapes in the name of an included header.
    lines = [*about, f'#include "{header}"', '', '#include <float.h>', '#include <math.h>',
             '#include <stddef.h>', '#include <stdint.h>', '',
             _array('default_parameters', robot.parameters.block, precision)]
    defaults = {'parameters': 'default_parameters', 'wrench': 'no_wrench'}
    functions = []
    has_wrench = False
    for kernel in kernels:
        # NULL stands for the default of an argument that has one.
        inputs = dict(kernel.program.inputs)
        has_wrench = has_wrench or 'wrench' in inputs
        used_defaults = {name: c for name, c in defaults.items() if name in inputs}
        functions += ['', c_functions(kernel.program, kernel.symbol, used_defaults, precision,
                                      f'{prefix.upper()}_VERSIONS')]
    if has_wrench:
        lines.append(_array('no_wrench', robot.kernels.no_wrench, precision))
    lines += ['', *_joint_data(robot, prefix, precision)]
    # Elementary functions stand before those that call them.
    called = set()
    for name in ('sin_cos', 'tanh_each'):
        if any(f'{name}(' in text for text in functions):
            called.add(name)
    lines += ['', elementary_functions(prefix.upper(), precision, called)]
    test = _self_test(prefix, kernels, precision) if self_test else []
    return '\n'.join([*lines, *functions, '', *test, ''])


def _joint_data(robot: Any, prefix: str, precision: Precision) -> list[str]:
    """Return the definitions of joint names and limits, and the state check."""
    upper = prefix.upper()
    number = precision.c
    size = f'fabs{precision.suffix}'
    # C has no empty array: a robot without joints gets one empty name.
    names = [f'    {string(name)},' for name in robot.joint_names] or ['    ""']
    lines = [f'const char {prefix}_joint_names[{upper}_N_JOINTS][{upper}_NAME_SIZE] = {{',
             *names, '};']
    # Limits by kind, infinite where a joint has none.
    for name, limits in joint_limits(robot).items():
        entries = []
        for limit in limits:
            entry = f'({number})INFINITY'
            if np.isfinite(limit):
                entry = c_literal(limit, precision)
            elif limit < 0.0:
                entry = f'-{entry}'
            entries.append(entry)
        lines.append(f'const {number} {prefix}_{name}[{limit_size(robot, name, upper)}] = {{'
                     + ', '.join(entries) + '};')
    # `!(x <= limit)` refuses not-a-number too.
    return [*lines, '', f'int {prefix}_check_state(const {number} *q, const {number} *u)', '{',
            '    int k;',
            f'    for (k = 0; k < {robot.n_q}; ++k)',
            f'        if (!({size}(q[k]) <= {upper}_LARGEST_POSITION)) return 1 + k;',
            f'    for (k = 0; k < {robot.n}; ++k)',
            f'        if (!isfinite(u[k])) return {1 + robot.n_q} + k;',
            '    return 0;', '}']


def _array(name: str, values: Array, precision: Precision) -> str:
    """Return the definition of a constant array, of at least one entry as C requires."""
    flat = [c_literal(x, precision) for x in np.ravel(values)] or ['0']
    # Four entries a line.
    rows = []
    for k in range(0, len(flat), 4):
        rows.append('    ' + ', '.join(flat[k:k + 4]))
    entries = ',\n'.join(rows)
    return f'static const {precision.c} {name}[{len(flat)}] = {{\n{entries}\n}};'


def _self_test(prefix: str, kernels: Sequence[CKernel],
               precision: Precision) -> list[str]:
    """Return the reference data and the function that checks them."""
    agree = AGREE.replace('REAL', precision.c)
    agree = agree.replace('FABS', f'fabs{precision.suffix}')
    lines = [f'#ifndef {prefix.upper()}_NO_SELF_TEST', agree]
    body = []
    for number, kernel in enumerate(kernels, 1):
        count = len(kernel.program.outputs)
        tolerance = c_literal(kernel.tolerance, precision)
        least = c_literal(float(kernel.name in RESIDUALS), precision)
        # Each kernel is called with its reference arguments; the number of the first
        # that disagrees is returned.
        body += ['    {', f'        {precision.c} result[{max(count, 1)}];']
        for k, (arguments, expected) in enumerate(zip(kernel.inputs, kernel.results)):
            names = []
            for (name, _), values in zip(kernel.program.inputs, arguments):
                names.append(f'{kernel.symbol}_{k}_{name}')
                lines.append(_array(names[-1], values, precision))
            reference = f'{kernel.symbol}_{k}_expected'
            lines.append(_array(reference, expected, precision))
            passed = ', '.join([*names, 'NULL', 'result'])
            agrees = f'agree(result, {reference}, {count}, {tolerance}, {least})'
            body += [f'        {kernel.symbol}({passed});',
                     f'        if (!{agrees}) return {number};']
        body.append('    }')
    # 0 where all kernels agree.
    return [*lines, '', f'int {prefix}_self_test(void)', '{', *body, '    return 0;', '}',
            '#endif']
