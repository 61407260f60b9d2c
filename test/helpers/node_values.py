"""Values of the node's parameters, as the node checks them."""

import math

from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
from kane_dynamics.ros.loads.wrench_input import WrenchFrames
from kane_dynamics.ros.monitor_node.monitor_parameters import (
    ALL as MONITOR_SPECS)
from kane_dynamics.ros.parameters.parameter_checks import read
from kane_dynamics.ros.parameters.parameter_table import BY_NAME, CONSTANTS, SPECS
from kane_dynamics.ros.services.served_robot import ServedRobot
import numpy as np

# For tests whose states are of no arm: these jump, and the first one is answered.
UNCHECKED = {'state_check.speed_factor': math.inf,
             'state_check.position_margin': math.inf,
             'trajectory.start_tolerance': math.inf}


def node_values(changes=None):
    """Return all parameters, with changes by name."""
    values = CONSTANTS | {spec.name: read(spec, spec.default) for spec in SPECS}
    values['arm_compensates'] = ('none',)
    for name, value in (changes or {}).items():
        values[name] = value if name in CONSTANTS else read(BY_NAME[name], value)
        if isinstance(CONSTANTS.get(name), np.ndarray):
            values[name] = np.array(value, np.float64)
    return values


def monitor_values(changes):
    """Return all parameters of a monitor, with changes by name."""
    values = node_values()
    for spec in MONITOR_SPECS:
        if spec.name != 'arm_compensates':
            values[spec.name] = read(spec, changes.get(spec.name, spec.default))
    return values


def update_laws(modes, values):
    """Use parameters in all laws; return whether the law of the mode changes."""
    changed = {mode: law.update(values) for mode, law in modes.laws.items()}
    return changed.get(values['mode'], False)


def served_robot(robot, changes=None, measured=lambda: None, speeds=lambda: None):
    """Return a robot as the services have it, with parameters by name."""
    robot = robot.copy()
    return ServedRobot(robot, robot, GravityAndPayload(robot.parameters.gravity),
                       node_values(changes), WrenchFrames(robot), measured=measured,
                       measured_speeds=speeds)
