"""Watch over the model of an arm while it works."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.identification.model_watch import (FEWEST_ROWS, ModelWatch,
                                                      WatchReport)
from kane_dynamics.identification.recordings.reader import read_recording
from kane_dynamics.identification.recordings.recording import (NAMES, Recording,
                                                               STANDSTILL)
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.monitor_node.torque_samples import MAX_GAP, PERIOD, TorqueSample
from kane_dynamics.ros.monitors.applied_torque import stated_efforts
import numpy as np

FEWEST_IN_STRETCH = 5  # consecutive samples whose speeds give accelerations


def model_watch(values: Mapping[str, Any], robot: Robot) -> ModelWatch:
    """
    Return the watch over the model of a robot, with its reference recording.

    Raises
    ------
    InputError
        The robot is no tree in joint rates, or the file cannot be read, or has other
        joints or too few rows.

    """
    if not robot.equations.in_joint_rates:
        raise InputError("parameter 'watch.reference': for a robot with chosen speeds or "
                         'constraints; expected a tree in joint rates, with a torque of '
                         'each joint')
    if not Path(values['watch.reference']).exists():
        raise InputError(f"parameter 'watch.reference': {values['watch.reference']!r}; "
                         'expected the path of a recording')
    names = robot.joint_names
    try:
        recording = read_recording(values['watch.reference'], names, numbered=names)
        # The reference is of the model as it is, without what the node has been told since.
        reference = stated_efforts(values, robot).applied(Robot(robot.model), recording)
        return ModelWatch(robot.model, reference, smallest=values['watch.smallest'])
    except (InputError, OSError) as error:
        raise InputError(f"parameter 'watch.reference': {error}") from None


class ModelWatchMonitor:
    """
    Compares the arm in motion with its model and a sound recording, window by window.

    Gravity, payload and wrenches that the robot knows are no change of the model.

    Parameters
    ----------
    robot : Robot
        With the gravity and the payload of now.
    values : mapping
        Parameters efforts.* and watch.*.
    publish : callable
        Called with a DiagnosticArray after each window.
    log : rcutils logger
    reject : callable
        Called with the reason and the details of each window that cannot be used.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any],
                 publish: Callable[[DiagnosticArray], object], log: Any,
                 reject: Callable[[str, str], None]) -> None:
        self._robot = robot
        self._publish = publish
        self._log = log
        self._reject = reject
        self._watch = model_watch(values, robot)
        self._bare = Robot(robot.model)
        self._rows = max(round(values['watch.window'] * NANO / PERIOD), FEWEST_ROWS)
        self.report: WatchReport | None = None
        for model_of_arm in (robot, self._bare):
            model_of_arm.compile('inverse_dynamics', batches=True)
        self._newest = 0  # stamp of the latest sample, ns
        self._origin = 0  # stamp of the first sample of the window, ns
        self.on_loads_changed()

    def on_loads_changed(self) -> None:
        """Begin a window: samples before and after new loads do not belong together."""
        self._stretch: list[TorqueSample] = []
        self._window: list[Recording] = []

    def add(self, sample: TorqueSample) -> None:
        """Add a sample of the moving arm to the window; report on it when it is full."""
        # At rest, friction is not known.
        if np.abs(sample.u).max(initial=0.0) <= STANDSTILL:
            return
        # Consecutive samples are a stretch; a break ends it, a reset clock drops it.
        gap = sample.stamp - self._newest
        if gap <= 0:  # the clock has been set back
            self.on_loads_changed()
        elif gap > MAX_GAP * PERIOD:
            self._end_stretch()
        self._newest = sample.stamp
        self._stretch.append(sample)
        # A full window is reported and dropped.
        if len(self._stretch) + sum(map(len, self._window)) < self._rows:
            return
        self._end_stretch()
        window = self._window
        self._window = []
        if sum(map(len, window)) >= FEWEST_ROWS:
            self._make_report(window)

    def _end_stretch(self) -> None:
        """Add the consecutive samples to the window, with their accelerations."""
        stretch = self._stretch
        self._stretch = []
        if len(stretch) < FEWEST_IN_STRETCH:
            return
        # Seconds since the window began; stamps in seconds have too few digits.
        if not self._window:
            self._origin = stretch[0].stamp
        t = np.array([sample.stamp - self._origin for sample in stretch]) / NANO
        q = np.array([sample.q for sample in stretch])
        u = np.array([sample.u for sample in stretch])
        udot = np.gradient(u, t, axis=0)
        tau = np.array([sample.torque for sample in stretch])
        # What the node knows of gravity and payload is no change of the model.
        try:
            known = self._robot.inverse_dynamics(q, u, udot)
            tau = tau - (known - self._bare.inverse_dynamics(q, u, udot))
        except KaneError as error:  # overflow from finite numbers
            self._reject('not finite', str(error))
            return
        # The accelerations at both ends are one-sided differences.
        self._window.append(Recording(t, q, u, udot, tau).rows(slice(1, -1)))

    def _make_report(self, window: list[Recording]) -> None:
        """Compare a window with the reference, publish the report and log its alarms."""
        try:
            report = self._watch.report(_joined(window))
        except KaneError as error:  # overflow from finite numbers
            self._reject('no report', str(error))
            return
        self._log_changes(report)
        self.report = report
        self._publish(report_message(report, self._newest))

    def _log_changes(self, report: WatchReport) -> None:
        """Log alarms that the previous report had not, and the end of all alarms."""
        previous: tuple[tuple[str, str], ...] = ()
        if self.report is not None:
            previous = _causes(self.report)
        for alarm in report.alarms:
            if (alarm.joint, alarm.cause) not in previous:
                self._log.warning(f'model watch: {alarm}')
        if previous and not report.alarms:
            self._log.info('model watch: the model describes the arm again')

    # For the diagnostics.

    @property
    def alarm(self) -> str | None:
        """Return the first change of the latest window in words, if there is one."""
        report = self.report
        return str(report.alarms[0]) if report is not None and report.alarms else None

    def figures(self) -> dict[str, str]:
        """Return the entries for the diagnostics."""
        report = self.report
        if report is None:
            return {'model watch': 'no window yet; it fills while the arm moves'}
        words = '; '.join(map(str, report.alarms)) or 'no change'
        # The joint that deviates most, in units of the reference.
        ratios = np.array(report.residual) / np.maximum(report.reference, 1e-12)
        worst = int(ratios.argmax())
        return {'model watch': words,
                'model watch: largest residual, relative to the reference':
                    f"{ratios[worst]:.2f} at joint '{report.joint_names[worst]}'"}


def _joined(window: Sequence[Recording]) -> Recording:
    """Return stretches of a recording as one, in their order."""
    columns: dict[str, Any] = {}
    for name in ('t', *NAMES):
        columns[name] = np.concatenate([getattr(stretch, name) for stretch in window])
    return Recording(**columns)


def _causes(report: WatchReport) -> tuple[tuple[str, str], ...]:
    """Return joints and causes of the alarms of a report."""
    return tuple((alarm.joint, alarm.cause) for alarm in report.alarms)


def report_message(report: WatchReport, moment: int) -> DiagnosticArray:
    """
    Return a report as a message: a status of each joint, and of all other alarms.

    Parameters
    ----------
    report : WatchReport
        Of a window.
    moment : int
        Stamp of the latest sample, ns.

    """
    message = DiagnosticArray()
    stamp = message.header.stamp
    stamp.sec, stamp.nanosec = divmod(moment, NANO)
    statuses = {}
    for name, residual, reference in zip(report.joint_names, report.residual,
                                         report.reference, strict=True):
        status = DiagnosticStatus(level=DiagnosticStatus.OK, name=name,
                                  message='as in the reference')
        status.values = [KeyValue(key='residual', value=f'{residual:.6g}'),
                         KeyValue(key='reference', value=f'{reference:.6g}')]
        statuses[name] = status
    # An alarm replaces the status of its joint; those of all joints have one of their
    # own.
    for alarm in report.alarms:
        status = statuses.setdefault(alarm.joint, DiagnosticStatus(name=alarm.joint))
        status.level = DiagnosticStatus.WARN
        status.message = str(alarm)
        for key, value in (('cause', alarm.cause), ('size', f'{alarm.size:.6g}'),
                           ('deviation', f'{alarm.deviation:.6g}')):
            status.values.append(KeyValue(key=key, value=value))
    message.status = list(statuses.values())
    return message
