"""The commands `export` and `equations`: the dynamics as C code, and on paper."""

from argparse import Namespace
from pathlib import Path
from runpy import run_path

from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli.printing import as_json, print_files, print_json
from kane_dynamics.cli.robot_options import load_robot, split
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot


def export(options: Namespace) -> None:
    """Write C source and header; print their paths."""
    _, robot = load_robot(options, wrench_frames=options.wrench_frames,
                          payload_frame=options.payload_frame)
    files = robot.export_c(options.out, split(options.kernel),
                           scalar='float32' if options.float32 else 'float64',
                           self_test=not options.no_self_test)
    paths = [str(file) for file in files]
    if options.json:
        print_json({'files': paths, 'digest': robot.model.digest()})
    else:
        print_files(paths)


def equations(options: Namespace) -> None:
    """Print or write the derivation of a small mechanism's equations of motion."""
    texts = extra('kane_dynamics.closed_forms.derivation_text', 'equations',
                  'equations on paper')  # errors early
    from kane_dynamics.closed_forms import derivation
    from kane_dynamics.closed_forms.derivation_code import as_code
    robot = _robot(options)
    form = derivation(robot, numbers=options.numbers, axes=options.axes,
                      points=split(options.points) or (), energy=options.energy,
                      auxiliary=split(options.auxiliary) or ())
    # All formats are made of one derivation; text and data also count the operations of
    # the compiled code.
    if options.json:
        text = as_json(texts.as_data(form, robot.operation_count())) + '\n'
    elif options.format == 'text':
        text = texts.as_text(form, robot.operation_count())
    elif options.format in ('c', 'python'):
        text = as_code(form, options.format)
    else:
        text = getattr(texts, f'as_{options.format}')(form)
    if not options.out:
        print(text, end='')
        return
    with whole_file(options.out) as stream:
        stream.write(text)
    print_files([options.out])


def _robot(options: Namespace) -> Robot:
    """Return the robot of a URDF, or the variable `robot` of a Python file."""
    path = Path(options.urdf)
    if path.suffix != '.py':
        return load_robot(options)[1]
    if not path.is_file():
        raise InputError(f"'{path}': no such file; expected a Python file that builds a "
                         'robot')
    robots = [value for value in run_path(str(path)).values() if isinstance(value, Robot)]
    if len(robots) != 1:
        raise InputError(f"'{path}': {len(robots)} variables with a Robot; expected one")
    return robots[0]
