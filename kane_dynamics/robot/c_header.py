"""The header of exported C: sizes, order of joints and speeds, conventions."""

from collections.abc import Sequence
import inspect
from typing import Any, NamedTuple

from kane_dynamics._util.resources import package_version
from kane_dynamics._util.typing import Array
from kane_dynamics.native.backends.c99 import c_identifier, comment, prototype, string
from kane_dynamics.native.backends.c99_math import Precision
from kane_dynamics.native.backends.llvm_math import size_limit
from kane_dynamics.native.tracing.program import Program


class CKernel(NamedTuple):
    """A kernel to export as a C function, with its test states and reference results."""

    name: str  # of the quantity
    symbol: str  # in C
    program: Program
    tolerance: float
    inputs: list[list[Array]]  # of each test state, without the parameters
    results: list[Array]


def constrained(robot: Any) -> bool:
    """Return whether a robot has chosen speeds or constraints."""
    return not robot.equations.in_joint_rates


def header_text(robot: Any, prefix: str, about: Sequence[str], kernels: Sequence[CKernel],
                precision: Precision, self_test: bool) -> str:
    """Return the header: sizes, the order of the joints, prototypes."""
    # Sizes and names first, because the comment on the conventions and the prototypes
    # use them.
    upper = prefix.upper()
    lines = [*about, f'#ifndef {upper}_H', f'#define {upper}_H', '']
    lines += _constants(robot, upper, precision)
    for kernel in kernels:
        size = len(kernel.program.outputs)
        lines.append(f'#define {kernel.symbol.upper()}_SIZE {size} /* numbers */')
    lines += ['', *_joint_enum(robot, upper), '']

    # The calling conventions are one comment.
    lines.append('/*')
    for line in _conventions(robot, prefix):
        lines.append(f' * {line}'.rstrip())
    lines += [' */', '', '#ifdef __cplusplus', 'extern "C" {', '#endif']

    lines += _data_declarations(robot, prefix, upper)
    for kernel in kernels:
        lines += _function_declaration(robot, kernel, precision)
    if self_test:
        lines += [
            '', f'#ifndef {upper}_NO_SELF_TEST',
            '/* Return 0 if every function gives the results embedded in the source, to the',
            ' * tolerance stated there, else the number of the first function that does not. */',
            f'int {prefix}_self_test(void);', '#endif']
    lines += ['', '#ifdef __cplusplus', '}', '#endif', '', '#endif', '']
    return '\n'.join(lines)


def _constants(robot: Any, upper: str, precision: Precision) -> list[str]:
    """Return the definitions of what identifies the robot, and of its sizes."""
    # What identifies the robot first, then the sizes of the arrays of calls.
    generator = f'kane_dynamics {package_version()}'
    largest = f'{size_limit("q"):g}{precision.suffix}'
    return [f'#define {upper}_MODEL_NAME {string(robot.model.name)}',
            f'#define {upper}_MODEL_DIGEST {string(robot.model.digest())}',
            f'#define {upper}_GENERATOR {string(generator)}',
            *_sizes(robot, upper),
            f'#define {upper}_N_JOINTS {len(robot.joint_names)}',
            f'#define {upper}_NAME_SIZE {name_size(robot)} /* of the longest name, with its 0 */',
            f'#define {upper}_LARGEST_POSITION {largest} /* rad or m */',
            f'#define {upper}_N_WRENCHES {len(robot.equations.wrench_frames)}',
            f'#define {upper}_N_PARAMETERS {len(robot.parameters.block)}',
            f'#define {upper}_REAL {precision.c}']


def _function_declaration(robot: Any, kernel: CKernel,
                          precision: Precision) -> list[str]:
    """Return the declaration of a kernel, with the first paragraph of its documentation."""
    # The declaration repeats the summary of the method of `Robot`.
    method = getattr(type(robot), kernel.name, None)
    documentation = inspect.getdoc(method) or kernel.name
    summary, _, _ = documentation.partition('\n\n')
    words = ' '.join(summary.split())
    shape = ' x '.join(map(str, kernel.program.shape)) or '1'
    return ['', f'/* {comment(words)}', f' * result: {shape}, C order. */',
            f'{prototype(kernel.program, kernel.symbol, precision)};']


def _sizes(robot: Any, upper: str) -> list[str]:
    """Return the lines of the sizes of q and u."""
    if not constrained(robot):
        return [f'#define {upper}_N {robot.n} /* joints: entries of q, u, udot and tau */']
    return [f'#define {upper}_N {robot.n} /* independent speeds: entries of u, udot and tau */',
            f'#define {upper}_N_Q {robot.n_q} /* coordinates: entries of q */']


def name_size(robot: Any) -> int:
    """Return the size of an array of characters for every joint's name."""
    return 1 + max((len(name.encode()) for name in robot.joint_names), default=0)


def limit_size(robot: Any, name: str, upper: str) -> str:
    """Return the size of an array of limits in C; positions are by coordinate."""
    if name in ('lower_limits', 'upper_limits') and robot.n_q != len(robot.joint_names):
        return f'{upper}_N_Q'
    return f'{upper}_N_JOINTS'


def joint_limits(robot: Any) -> dict[str, Array]:
    """Return the limits of all joints by their names in C."""
    limits = robot.limits
    return {'lower_limits': limits.lower, 'upper_limits': limits.upper,
            'velocity_limits': limits.velocity, 'effort_limits': limits.effort}


def _data_declarations(robot: Any, prefix: str, upper: str) -> list[str]:
    """Return the declarations of joint names and limits, and of the state check."""
    number = f'{upper}_REAL'
    lines = [
        '',
        '/* Names and limits of the joints, in the order of their enumeration; limits of',
        ' * positions in the order of q. Infinite where there is none. rad or m, rad/s or m/s,',
        ' * N m or N. */',
        f'extern const char {prefix}_joint_names[{upper}_N_JOINTS][{upper}_NAME_SIZE];']
    # Sizes of positions are those of q, of the other limits those of the joints.
    for name in joint_limits(robot):
        size = limit_size(robot, name, upper)
        lines.append(f'extern const {number} {prefix}_{name}[{size}];')
    lines += [
        '',
        '/* Return 0 if a state may be used: q and u are finite, and no position is beyond',
        f' * {upper}_LARGEST_POSITION, where a number has lost the angle. Otherwise return',
        ' * 1 + the index of the first entry that is not, counted through q, then u. Results for',
        ' * such a state are undefined. */',
        f'int {prefix}_check_state(const {number} *q, const {number} *u);']
    return lines


def _joint_enum(robot: Any, upper: str) -> list[str]:
    """Return the enumerations of joints and of chosen or independent speeds."""
    model = robot.model
    joints = dict(zip(model.joint_names, model.coordinate_joints))
    entries = []
    # A quaternion's entries are no joints, but entries of q.
    for name in model.coordinate_names:
        if name not in joints:
            note = 'entry of a unit quaternion (x, y, z, w)'
        elif joints[name].kind == 'prismatic':
            note = 'prismatic; m, m/s, N'
        else:
            note = f'{joints[name].kind}; rad, rad/s, N m'
        entries.append((name, note))
    # With chosen speeds the entries of u are no joints.
    lines = _enum(upper, 'joint', entries)
    if constrained(robot):
        lines += _enum(upper, 'speed', [(name, 'entry of u') for name in robot.speed_names])
    return lines


def _enum(upper: str, kind: str, entries: Sequence[tuple[str, str]]) -> list[str]:
    """Return the lines of an enumeration of names with notes; empty without entries."""
    if not entries:
        return []
    lines = []
    used = set()
    for k, (entry, note) in enumerate(entries):
        # Different names may become the same identifier: a number keeps them apart.
        name = f'{upper}_{kind.upper()}_{c_identifier(entry).upper()}'
        if name in used:
            name = f'{name}_{k}'
        used.add(name)
        comma = ',' if k < len(entries) - 1 else ''
        lines.append(f'    {name} = {k}{comma} /* {comment(entry)}: {note} */')
    return [f'enum {upper.lower()}_{kind} {{', *lines, '};']


def _conventions(robot: Any, prefix: str) -> list[str]:
    """Return the lines of the calling conventions."""
    lines = [*_equation_of_motion(robot), '']
    lines.append(f'Arguments are arrays of {prefix.upper()}_REAL: q, u, udot and tau have '
                 'one entry per joint,')
    if constrained(robot):
        lines.append('or per independent speed (u, udot, and tau, which is dual to u),')
    lines += [
        'in the order above. A result may overlay an argument. Nothing is allocated, no',
        'state is kept: any thread may call anything at any time. Arguments are not',
        f'checked: call {prefix}_check_state before.', '']

    # The further arguments, in the order of the prototypes.
    # Parameters first, which every function has; time and wrench only where they count.
    lines += _parameter_block(robot)
    if robot.equations.timed:
        lines.append('t: pointer to the time, s')
    if robot.equations.wrench_frames:
        lines += [
            'wrench: for each frame that carries one, the force (N) then the moment (N m)',
            '  that the environment exerts at its origin, world axes; NULL means none']
    return [comment(line) for line in lines]


def _equation_of_motion(robot: Any) -> list[str]:
    """Return the line that states the equation; only u of joints are rates of q."""
    if constrained(robot):
        return ['M(q) udot + bias(q, u) = tau + external, SI units, world axes.']
    return ['M(q) udot + bias(q, u) = tau + external, u = dq/dt, SI units, world axes.']


def _parameter_block(robot: Any) -> list[str]:
    """Return the lines on the run-time parameters, in their order in the block."""
    lines = ['parameters: gravity, the acceleration of free fall, m/s^2']
    gravity = ', '.join(f'{entry:g}' for entry in robot.parameters.gravity)
    at_export = f'gravity ({gravity})'
    if robot.equations.payload_frame is not None:
        lines += [
            '  then the payload, in its frame: mass, mass x center of mass (3), and the integrals',
            '  of xx, xy, xz, yy, yz, zz over its mass; kg, kg m, kg m^2']
        at_export += ' and the payload at export'
    if robot.equations.watched:
        lines += [
            '  then the limits of a state, each as 1 / limit^2, 0 for none: conditioning of the',
            '  speeds, constraint residuals in m and in rad, violation of redundant constraints.',
            '  Beyond them the first entry of a result is NaN.']
    lines.append(f'  NULL selects the values at export: {at_export}.')
    return lines
