"""The diagnostics of the dynamics node."""

from collections import Counter
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from kane_dynamics.loop_tracking.loop_error import BRANCH, CONTRADICTION, SINGULAR, UNKNOWN
from kane_dynamics.ros.common.commanders import several_commanders
from kane_dynamics.ros.common.lost_messages import WARNING_SHARE
from kane_dynamics.ros.common.node_statistics import status
from kane_dynamics.ros.dynamics_node.configured_robot import ConfiguredRobot
from kane_dynamics.ros.torque_path.joint_state_reader import (FUTURE, MISSING, NO_CLOCK,
                                                              NO_VELOCITY, STALE)
from kane_dynamics.ros.torque_path.state_check import JUMP, OUTSIDE, TOO_FAST
from kane_dynamics.ros.torque_path.torque_path import REFUSED

if TYPE_CHECKING:
    from kane_dynamics.ros.dynamics_node.node import DynamicsNode

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
SEVERAL_STATES = ('publishers on joint_states: expected one with joints of this arm, stop the '
                  'others (those of other joints, such as of a gripper, may go on)')
# What to do, in words that follow the state or the reason.
REMEDIES = {'unconfigured': ': no robot; the log says why, then configure and activate the node',
            'inactive': ': no commands; activate the node',
            'finalized': ': shut down; restart the process'}
DROP_REMEDIES = {reason: f'{reason} ({remedy})' for reason, remedy in {
    MISSING: 'compare parameter joints with the names of the driver',
    NO_VELOCITY: 'let the driver publish velocities',
    STALE: 'check delay, clocks and use_sim_time of the driver',
    FUTURE: 'synchronize the clocks',
    NO_CLOCK: 'start what publishes /clock, or set use_sim_time false',
    SINGULAR: 'move the arm away from it, or raise closure.max_conditioning',
    BRANCH: 'compare the constraints file with the arm',
    CONTRADICTION: 'check the encoders, the constraints file and closure.tolerance',
    UNKNOWN: 'publish all joints, or move the arm to the configuration of the constraints file, '
             'deactivate and activate the node',
    JUMP: 'check the encoders, the speed limits of the URDF, limits.velocity and state_check.*',
    TOO_FAST: 'check the encoders, the speed limits of the URDF and state_check.speed_factor',
    OUTSIDE: 'check units (rad), encoders and the position limits of the URDF',
    REFUSED: 'keep motions away from singular configurations'}.items()}


def node_status(node: 'DynamicsNode', period: float) -> DiagnosticStatus:
    """Close a reporting period of `period` seconds and return its diagnostic status."""
    rate, dropped, figures = node.statistics.period(period)
    arm = node.arm
    level, message = WARN, f'{node.state}{REMEDIES.get(node.state, "")}'
    lost, figures['states lost'] = (0.0, '0') if arm is None else arm.lost_states.period(
        arm.all_state_publishers)
    if arm is not None and arm.path.running:
        level, message = _active(arm, rate, dropped, lost)
    elif waiting := node.waiting_for:
        message = f'{node.state}: {waiting}'
    elif node.state == 'inactive':
        level = OK
    if node.sim_time.warning:
        level = max(level, WARN)
        message += f'; {node.sim_time.warning}'
    figures['state'] = node.state
    if arm is not None:
        payload = arm.loads.payload
        figures |= {'mode': str(node.values['mode']), 'joints': ', '.join(arm.robot.joint_names),
                    'kernels verified to': f'{arm.verified:.1e}',
                    'gravity': ' '.join(f'{g:.3f}' for g in arm.loads.gravity) + ' m/s^2',
                    'payload': f'{0.0 if payload is None else payload.mass:g} kg',
                    'faults of joint states': str(node.statistics.faults),
                    'publishers of joint states': str(arm.state_publishers),
                    'publishers of commands': str(len(arm.commanders))}
        figures |= arm.optional_topics.figures()
        if arm.path.loops is not None:
            figures |= arm.path.loops.figures()
        if arm.guard is not None:
            figures['guard'] = arm.guard.warning or 'watching'
        else:
            figures['guard'] = 'none: the last torque would stay if this process died'
    return status(f'{node.get_fully_qualified_name()}: torques',
                  arm.robot.model.name if arm is not None else '', level, message, figures)


def in_parts(parts: list[tuple[str, ...]]) -> str:
    """Return the warning about joint states that have a part of the joints each."""
    lists = ' and '.join(f'[{", ".join(part)}]' for part in parts)
    return (f'joint_states: in parts, {lists}, which give no torques; expected all joints of the '
            'arm in each message, as joint_state_broadcaster or joint_state_publisher with '
            'source_list publish them')


def _active(arm: ConfiguredRobot, rate: float, dropped: Counter[str],
            lost: float) -> tuple[bytes, str]:
    """
    Return level and message of an active node: what is wrong, and what to do.

    Commands per second, the dropped states and the share of lost states are those of the period.
    """
    level, message = OK, f'active, {rate:.0f} commands/s'
    warnings = [f"collision at joint '{arm.optional_topics.collision}': check the arm"
                ] if arm.optional_topics.collision is not None else []
    if arm.path.timed_out:
        level = DiagnosticStatus.ERROR
        message = (('no valid joint state' if not arm.path.now else
                    f'no valid joint state for {arm.path.state_age:.2f} s') + ': '
                   + ('commanding zeros' if arm.path.last_update else 'no commands yet')
                   + '; check the driver, its topic and its stamps')
    elif arm.path.fault:
        level = DiagnosticStatus.ERROR
        message = (f'joint states impossible for {arm.path.state_age:.2f} s: '
                   f'{arm.path.fault}; {arm.path.reaction}')
    elif arm.guard is not None and arm.guard.waiting:
        level, message = WARN, 'active, waiting for torque_guard to hand over `commands`'
    if dropped:
        warnings.append(f'{dropped.total()} joint states dropped: '
                        + ', '.join(DROP_REMEDIES.get(each, each) for each in dropped))
    if lost > WARNING_SHARE:
        warnings.append(f'{lost:.0%} of the joint states lost: the node or the network is too '
                        'slow for their rate; lower it, free a processor, or set realtime.*')
    if arm.state_publishers > 1:
        warnings.append(f'{arm.state_publishers} {SEVERAL_STATES}')
    if arm.parts_of_states:
        warnings.append(in_parts(arm.parts_of_states))
    if len(arm.commanders) > 1:
        level = DiagnosticStatus.ERROR
        warnings.append(f'commands: {several_commanders(arm.commanders)}')
    if arm.guard is not None and arm.guard.warning:
        warnings.append(arm.guard.warning)
    return max(level, WARN) if warnings else level, '; '.join([message, *warnings])
