"""The commands `inspect`, `export`, `equations`, `doctor` and `demo`."""

from argparse import Namespace
import math
from pathlib import Path
import warnings

from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.progress import progress_bar
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.analysis import model_checks
from kane_dynamics.cli.commands import inspect_command
from kane_dynamics.cli.shared import (as_json, brief, constraints_of, load, print_json, selection,
                                      source_of, split)
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.model.flexible_model import stiffened
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf import load_urdf
from kane_dynamics.urdf.document import read_source


def inspect(options: Namespace) -> int:
    """Print the properties of a robot; on request compare it with Pinocchio."""
    caught: list[str] = []
    model, robot = load(options, caught)
    if not options.verbose:
        caught = [brief(text) for text in caught]
    facts = inspect_command.describe(model, robot, caught,
                                     operations=options.operations or options.json,
                                     frames=options.frames or options.json)
    if options.against and options.constraints:
        raise InputError('--against: given with --constraints; expected one of them, because '
                         'Pinocchio reads no constraints from these files')
    if options.against:
        # Pinocchio reads no supplement; friction is compared for neither.
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', ModelWarning)
            bare = load_urdf(source_of(options), **selection(options))
        facts['against'] = inspect_command.compare_pinocchio(source_of(options), bare)
    if options.json:
        print_json(facts)
    else:
        inspect_command.print_facts(facts)
    return 0 if facts.get('against', {'agrees': True})['agrees'] else 1


def export(options: Namespace) -> None:
    """Write C source and header; print their paths."""
    _, robot = load(options, wrench_frames=options.wrench_frames,
                    payload_frame=options.payload_frame)
    files = robot.export_c(options.out, split(options.kernel),
                           scalar='float32' if options.float32 else 'float64',
                           self_test=not options.no_self_test)
    if options.json:
        print_json({'files': [str(file) for file in files],
                    'digest': robot.model.digest()})
        return
    for file in files:
        print(f'wrote {file}')


def equations(options: Namespace) -> None:
    """Print or write the closed form of a small mechanism's equations of motion."""
    texts = extra('kane_dynamics.closed_forms.closed_form_text', 'equations',
                  'equations in closed form')  # errors early
    from kane_dynamics.closed_forms import closed_form
    model, robot = load(options)
    with progress_bar('deriving', 1.0) as progress:
        form = closed_form(model, numbers=options.numbers, friction=robot.friction,
                           progress=progress)
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
    print(f'wrote {options.out}')


def doctor(options: Namespace) -> int:
    """Examine a URDF, a configuration, a live graph; return 1 if there is a problem."""
    if options.live is not None and not 0.0 < options.live < math.inf:
        raise InputError(f'--live: {options.live}; expected a positive, finite time in s')
    caught: list[str] = []
    model, robot = load(options, caught)
    if model.flexible:  # modes have no limits and are in no message
        model = stiffened(model)
        robot = Robot(model, **constraints_of(options))
    more: list[model_checks.Finding] = []
    arm = None
    if options.config:
        files = extra('kane_dynamics.ros.doctor.configuration', 'ros', '--config')
        more, arm = files.examine_configuration(
            Path(options.config), read_source(source_of(options)), prefix=options.prefix,
            namespace=options.namespace, told=caught)
    if arm is not None and arm.constraint_names and not options.constraints:
        model, robot = arm.model, arm  # the tree would have other motors and loads
    found = [*model_checks.examine_model(model, robot, caught), *more]
    if options.live:
        from kane_dynamics.cli.commands.identify_command import stated_efforts
        efforts = None
        if options.efforts or options.efforts_without_gravity or options.torque_constants:
            efforts = stated_efforts(options)
        elif options.config:
            efforts = files.configured_efforts(Path(options.config), options.namespace)
        found += extra('kane_dynamics.ros.doctor.live_graph', 'ros', '--live').examine_graph(
            arm or Robot(model.prefixed(options.prefix),
                         **constraints_of(options, options.prefix)),
            options.live, options.namespace, options.commands, options.joint_states, efforts)
    if options.json:
        print_json([{'level': finding.level, 'words': finding.words} for finding in found])
    else:
        model_checks.print_findings(found if options.verbose else [
            model_checks.Finding(each.level, brief(each.words)) for each in found])
    return int(any(finding.level == 'problem' for finding in found))


def demo(options: Namespace) -> int:
    """Run the demo with the arguments that follow."""
    return int(extra('kane_dynamics.demo', 'demo', 'the demo').main(options.rest) or 0)
