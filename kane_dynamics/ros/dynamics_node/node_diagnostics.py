"""The diagnostics of the dynamics node, and what it logs about other nodes."""

from collections import Counter
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from kane_dynamics.loop_tracking.loop_error import (BRANCH, CONTRADICTION, SINGULAR,
                                                    UNKNOWN)
from kane_dynamics.ros.common.command_topic import several_commanders
from kane_dynamics.ros.common.lost_messages import WARNING_SHARE
from kane_dynamics.ros.common.stamped_numbers import FUTURE
from kane_dynamics.ros.dynamics_node.configured_robot import ConfiguredRobot
from kane_dynamics.ros.torque_path.drop_reasons import (FALSE_SPEEDS, JUMP, MISSING, NO_CLOCK,
                                                        NO_VELOCITY, OUTSIDE, REFUSED,
                                                        STALE, TOO_FAST, UNEXPLAINED)

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
REMINDER = 10.0  # s between two log lines that say what the node waits for
SEVERAL_STATES = ('publishers on joint_states: expected one with joints of this arm, '
                  'stop the others (those of other joints, such as of a gripper, may go '
                  'on)')
# What to do in a lifecycle state without commands.
REMEDIES = {
    'unconfigured': ': no robot; the log says why, then configure and activate the node',
    'inactive': ': no commands; activate the node',
    'finalized': ': shut down; restart the process'}
# What to do about states that are dropped, by reason.
DROP_REMEDIES = {
    MISSING: 'compare parameter joints with the names of the driver',
    NO_VELOCITY: 'let the driver publish velocities',
    STALE: 'check delay, clocks and use_sim_time of the driver',
    FUTURE: 'synchronize the clocks',
    NO_CLOCK: 'start what publishes /clock, or set use_sim_time false',
    SINGULAR: 'move the arm away from it',
    BRANCH: 'compare the constraints file with the arm',
    CONTRADICTION: 'check the encoders, the constraints file and closure.tolerance',
    UNKNOWN: 'publish all joints, or move the arm to the configuration of the '
    'constraints '
             'file, deactivate and activate the node',
    JUMP: 'check the encoders, the speed limits of the URDF, limits.velocity and '
          'state_check.*',
    TOO_FAST: 'check the encoders, the speed limits of the URDF and '
    'state_check.speed_factor',
    UNEXPLAINED: 'publish states more often than every state_check.grace, with speeds that '
    'fit the positions',
    OUTSIDE: 'check units (rad), encoders and the position limits of the URDF',
    REFUSED: 'keep motions away from singular configurations'}


def state_in_words(state: str) -> str:
    """Return a lifecycle state, and what to do in it."""
    return state + REMEDIES.get(state, '')


def arm_figures(arm: ConfiguredRobot, mode: str) -> dict[str, str]:
    """Return the figures of a configured robot."""
    # Figures that every arm has; then those of parts that are switched on.
    payload = arm.loads.payload
    payload_mass = 0.0 if payload is None else payload.mass
    gravity = ' '.join(f'{component:.3f}' for component in arm.loads.gravity)
    figures = {
        'mode': mode,
        'torque path': arm.torque_path,
        'joints': ', '.join(arm.robot.joint_names),
        'kernels verified to': f'{arm.verified:.1e}',
        'gravity': f'{gravity} m/s^2',
        'payload': f'{payload_mass:g} kg',
        'faults of joint states': str(arm.statistics.faults),
        'publishers of joint states': str(arm.state_publishers),
        'publishers of commands': str(len(arm.commanders))}
    figures |= arm.optional_topics.figures()
    if arm.attached_objects is not None:
        figures |= arm.attached_objects.figures()
    if arm.path.loops is not None:
        figures |= arm.path.loops.figures()
    if arm.guard is None:
        figures['guard'] = 'none: the last torque would stay if this process died'
    else:
        figures['guard'] = arm.guard.warning or 'watching'
    return figures


def active_status(arm: ConfiguredRobot, rate: float, dropped: Counter[str],
                  lost_share: float) -> tuple[bytes, str]:
    """
    Return level and message of an active node: what is wrong, and what to do.

    Parameters
    ----------
    arm : ConfiguredRobot
        The robot, whose torque path runs.
    rate : float
        Commands per second in the reporting period.
    dropped : Counter
        States dropped in the period, by reason.
    lost_share : float
        Share of the states that were lost in the period.

    """
    level, message = _path_status(arm, rate)
    warnings = _warnings(arm, dropped, lost_share)
    if warnings:
        level = max(level, WARN)
    if len(arm.commanders) > 1:
        level = ERROR
    return level, '; '.join([message, *warnings])


def _path_status(arm: ConfiguredRobot, rate: float) -> tuple[bytes, str]:
    """Return level and message of the torque path alone."""
    path = arm.path
    if path.timed_out:
        age = f' for {path.state_age:.2f} s' if path.now else ''
        reaction = 'commanding zeros' if path.last_update else 'no commands yet'
        return ERROR, (f'no valid joint state{age}: {reaction}; check the driver, its '
                       'topic and its stamps')
    if path.fault:
        return ERROR, (f'joint states impossible for {path.state_age:.2f} s: '
                       f'{path.fault}; {path.reaction}')
    if arm.left_mode:
        return ERROR, f'{arm.left_mode}; change it, then set the mode again'
    if path.false_speeds:
        return ERROR, f'joint states: {", ".join(path.false_speeds)}: {FALSE_SPEEDS}'
    if path.failure:
        return ERROR, (f'{path.failure}; the desired motion was stopped; read the log, '
                       'deactivate and activate the node')
    if arm.guard is not None and arm.guard.waiting:
        return WARN, 'active, waiting for torque_guard to hand over `commands`'
    return OK, f'active, {rate:.0f} commands/s'


def _warnings(arm: ConfiguredRobot, dropped: Counter[str],
              lost_share: float) -> list[str]:
    """Return the warnings about all parts but the torque path."""
    # Each warning names what to do, in the order of its urgency.
    warnings = []
    if arm.optional_topics.collision is not None:
        warnings.append(f"collision at joint '{arm.optional_topics.collision}': check "
                        'the arm')
    if arm.drift is not None and arm.drift.warning:
        warnings.append(arm.drift.warning)

    if arm.path.speeds_unjudged:
        warnings.append('joint states: cannot judge whether velocities fit positions: '
                        f'{arm.path.speeds_unjudged}')

    # Joint states that came and were refused, then those that never came.
    if dropped:
        reasons = []
        for reason in dropped:
            remedy = DROP_REMEDIES.get(reason)
            reasons.append(f'{reason} ({remedy})' if remedy else reason)
        warnings.append(f'{dropped.total()} joint states dropped: {", ".join(reasons)}')
    if lost_share > WARNING_SHARE:
        warnings.append(f'{lost_share:.0%} of the joint states lost: the node or the '
                        'network is too slow for their rate; lower it, free a '
                        'processor, or set realtime.*')

    # Other nodes on the same topics, whose messages mix with those expected.
    if arm.state_publishers > 1:
        warnings.append(f'{arm.state_publishers} {SEVERAL_STATES}')
    if arm.parts_of_states:
        warnings.append(in_parts(arm.parts_of_states))
    if len(arm.commanders) > 1:
        warnings.append(f'commands: {several_commanders(arm.commanders)}')
    if arm.guard is not None and arm.guard.warning:
        warnings.append(arm.guard.warning)
    return warnings


def in_parts(parts: list[tuple[str, ...]]) -> str:
    """Return the warning that each joint-state message has only some of the joints."""
    lists = ' and '.join(f'[{", ".join(part)}]' for part in parts)
    return (f'joint_states: in parts, {lists}, which give no torques; expected all '
            'joints of the arm in each message, as joint_state_broadcaster or '
            'joint_state_publisher with source_list publish them')


class GraphLog:
    """
    Logs what concerns other nodes: once, when it begins, and when the guard is found.

    Parameters
    ----------
    log : rclpy logger

    """

    def __init__(self, log: Any) -> None:
        self._log = log
        self._reminded_at = time.monotonic()
        self._state_publishers = 1  # at the last update
        self._commanders: list[str] = []
        self._reported_parts = False
        self._unguarded = False

    def update(self, state: str, waiting_for: str, arm: ConfiguredRobot | None) -> None:
        """Log what changed since the last update."""
        # A reminder from time to time, and each change once.
        now = time.monotonic()
        if now - self._reminded_at > REMINDER:
            self._reminded_at = now
            if waiting_for:
                self._log.warning(f'{state}: {waiting_for}')
        # Without an arm nothing is known of others: the next is reported again.
        if arm is None:
            self._state_publishers = 1
            self._commanders = []
            return
        # What others publish, compared with the last update.
        if arm.state_publishers > 1 and arm.state_publishers != self._state_publishers:
            self._log.warning(f'{arm.state_publishers} {SEVERAL_STATES}')
        self._state_publishers = arm.state_publishers
        if arm.parts_of_states and not self._reported_parts:
            self._reported_parts = True
            self._log.error(in_parts(arm.parts_of_states))
        if len(arm.commanders) > 1 and arm.commanders != self._commanders:
            self._log.error(f'commands: {several_commanders(arm.commanders)}')
        self._commanders = arm.commanders
        if arm.guard is not None and arm.guard.overdue:
            self._log_guard(arm.guard.warning)

    def _log_guard(self, warning: str) -> None:
        """Log that the guard is lost, or found again."""
        if bool(warning) == self._unguarded:
            return
        self._unguarded = bool(warning)
        if warning:
            self._log.warning(warning)
        else:
            self._log.info('torque_guard watches')
