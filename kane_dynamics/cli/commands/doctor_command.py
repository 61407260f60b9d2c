"""The command `doctor`: problems of a URDF, of the node's configuration and of a live graph."""

from argparse import Namespace
import math
from pathlib import Path

from kane_dynamics._util.optional_imports import extra
from kane_dynamics.analysis.model_checks import examine_model, Finding, print_findings
from kane_dynamics.cli.printing import brief, print_json
from kane_dynamics.cli.robot_options import (constraints_of, load_robot, source_of,
                                             uncertainty_of)
from kane_dynamics.errors import InputError
from kane_dynamics.identification.efforts import Efforts
from kane_dynamics.model.flexible_model import stiffened
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf.document import read_source


def doctor(options: Namespace) -> int:
    """Examine a URDF, a configuration, a live graph; return 1 if there is a problem."""
    if options.live is not None and not 0.0 < options.live < math.inf:
        raise InputError(f'--live: {options.live}; expected a positive, finite time in '
                         's')
    model_texts: list[str] = []
    model, robot = load_robot(options, model_texts)
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
    findings = [*examine_model(model, robot, model_texts, uncertainty_of(options, model)),
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
            _stated_efforts(options))

    if options.json:
        data = []
        for finding in findings:
            data.append({'level': finding.level, 'words': finding.words})
        print_json(data)
    elif options.verbose:
        print_findings(findings)
    else:
        # Long lists of names are shortened on a terminal.
        shortened = []
        for finding in findings:
            shortened.append(Finding(finding.level, brief(finding.words)))
        print_findings(shortened)
    return int(any(finding.level == 'problem' for finding in findings))


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
