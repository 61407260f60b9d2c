"""The commands `export` and `equations`: the dynamics as C code, and in closed form."""

from argparse import Namespace

from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.progress import progress_bar
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli.printing import as_json, print_files, print_json
from kane_dynamics.cli.robot_options import load_robot, split


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
    """Print or write the closed form of a small mechanism's equations of motion."""
    texts = extra('kane_dynamics.closed_forms.closed_form_text', 'equations',
                  'equations in closed form')  # errors early
    from kane_dynamics.closed_forms import closed_form
    model, robot = load_robot(options)
    with progress_bar('deriving', 1.0) as progress:
        form = closed_form(model, numbers=options.numbers, friction=robot.friction,
                           progress=progress)
    # All formats are made of one form; data also count the operations of the compiled
    # code.
    if options.json:
        text = as_json(texts.as_data(form, robot.operation_count())) + '\n'
    elif options.format == 'text':
        text = texts.as_text(form, robot.operation_count())
    else:
        text = getattr(texts, f'as_{options.format}')(form)
    if not options.out:
        print(text, end='')
        return
    with whole_file(options.out) as stream:
        stream.write(text)
    print_files([options.out])
