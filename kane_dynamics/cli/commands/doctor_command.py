"""The command `doctor`: problems of a URDF, of the node's configuration and of a live graph."""

from argparse import Namespace
from collections.abc import Sequence
import math
from pathlib import Path
from warnings import catch_warnings, simplefilter

from kane_dynamics._util.optional_imports import extra
from kane_dynamics.analysis.model_checks import examine_model, Finding, print_findings
from kane_dynamics.cli.printing import brief, print_json
from kane_dynamics.cli.robot_options import constraints_of, load_robot, source_of
from kane_dynamics.errors import InputError, ModelError, ModelWarning, UrdfError
from kane_dynamics.identification.efforts import Efforts
from kane_dynamics.mjcf import is_mjcf
from kane_dynamics.model.flexible_model import stiffened
from kane_dynamics.model.link_shapes import LinkShape
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf.document import read_source
from kane_dynamics.urdf.link_shapes import load_collisions, load_visuals


def doctor(options: Namespace) -> int:
    """Examine a URDF, a configuration, a live graph; return 1 if there is a problem."""
    if options.live is not None and not 0.0 < options.live < math.inf:
        raise InputError(f'--live: {options.live}; expected a positive, finite time in '
                         's')
    model_texts: list[str] = []
    source = source_of(options)
    if not is_mjcf(source):
        read_source(source)  # a file that is missing or no text is an error of the call
    try:
        model, robot = load_robot(options, model_texts)
    except (ModelError, UrdfError) as error:
        faults = error.faults or (str(error),)
        _print([*(Finding('problem', fault) for fault in faults),
                Finding('cannot judge', 'all else, until these are mended')], options)
        return 1
    if model.flexible:  # modes have no limits and are in no message
        model = stiffened(model)
        robot = Robot(model, **constraints_of(options))

    # The configuration of a node, and the robot that it describes.
    of_configuration: list[Finding] = []
    node_robot: Robot | None = None
    if options.config:
        configuration = extra('kane_dynamics.ros.doctor.configuration', 'ros',
                              '--config')
        of_configuration, node_robot = configuration.examine_configuration(
            Path(options.config), read_source(source_of(options)), prefix=options.prefix,
            namespace=options.namespace, told=model_texts)
    if node_robot is not None and not options.constraints:
        # The node's robot has the constraints, motors and loads of the configuration.
        robot = node_robot
        model = node_robot.model
    findings = [*examine_model(model, robot, model_texts, _shapes(source)),
                *of_configuration]

    # The running nodes, which may have prefixed names.
    if options.live:
        if node_robot is None:
            constraints = constraints_of(options, options.prefix)
            node_robot = Robot(model.prefixed(options.prefix), **constraints)
        live_graph = extra('kane_dynamics.ros.doctor.live_graph', 'ros', '--live')
        findings += live_graph.examine_graph(
            node_robot, options.live, options.namespace, options.commands,
            options.joint_states,
            _stated_efforts(options), _locked(options, node_robot))

    _print(findings, options)
    return int(any(finding.level == 'problem' for finding in findings))


def _locked(options: Namespace, robot: Robot) -> dict[str, float]:
    """Return the joints of a URDF that the robot has at 0, and how far they may be from it."""
    source = source_of(options)
    if is_mjcf(source):
        return {}
    files = extra('kane_dynamics.ros.common.configuration_files', 'ros', '--live')
    locked: dict[str, float] = files.locked_joints(source, options.prefix, robot.model)
    return locked


def _shapes(source: str | bytes) -> tuple[LinkShape, ...]:
    """Return the shapes of the links for collisions, or else as drawn; none of MJCF."""
    if is_mjcf(source):
        return ()
    with catch_warnings():
        simplefilter('ignore', ModelWarning)  # a mesh that is missing cannot be judged
        shapes = load_collisions(source)
        covered = {shape.link for shape in shapes}
        drawn = load_visuals(source)
    return (*shapes, *(shape for shape in drawn if shape.link not in covered))


def _print(findings: Sequence[Finding], options: Namespace) -> None:
    """Print findings; long lists of names are shortened on a terminal."""
    if options.json:
        print_json([{'level': finding.level, 'words': finding.words}
                    for finding in findings])
    elif options.verbose:
        print_findings(findings)
    else:
        print_findings([Finding(finding.level, brief(finding.words))
                        for finding in findings])


def _stated_efforts(options: Namespace) -> Efforts | None:
    """Return the meaning of efforts by the options, or else by the node's configuration."""
    from kane_dynamics.cli.commands.identify_command import stated_efforts
    if options.efforts or options.efforts_without_gravity or options.torque_constants:
        return stated_efforts(options)
    if not options.config:
        return None
    configuration = extra('kane_dynamics.ros.doctor.configuration', 'ros', '--config')
    efforts: Efforts | None = configuration.configured_efforts(Path(options.config),
                                                               options.namespace)
    return efforts
