"""
An effort loop that does what joint_trajectory_controller's documentation says.

Interpolation: docs.ros.org/en/jazzy/p/joint_trajectory_controller/doc/trajectory.html.
Positions alone are interpolated linearly, with velocities by cubics, with accelerations
too by quintics, and efforts linearly. If the first point is later than now, a first
segment leads to it from the measured state. After the last point it is held. Control law
(doc/userdoc.html, "effort" without "position"): PID on the errors of position and
velocity, plus the trajectory's effort.

Run as a program, it drives the topics of a robot; scipy interpolates, so that it shares
nothing with the code that it tests.
"""

from dataclasses import dataclass
import json
import sys

import numpy as np
from scipy.interpolate import BPoly


@dataclass
class Gains:
    """Parameters gains.<joint>.p, i, d and ff_velocity_scale, (n,) arrays or numbers."""

    p: object = 0.0
    i: object = 0.0
    d: object = 0.0
    ff_velocity_scale: object = 0.0


class Spline:
    """The sampled trajectory; fields that a trajectory lacks are None."""

    def __init__(self, t, q, u=None, udot=None, effort=None):
        self.t, self.q, self.effort = np.asarray(t), np.asarray(q), effort
        fields = [field for field in (q, u, udot) if field is not None]
        self._curve = None if len(t) < 2 else BPoly.from_derivatives(
            self.t, np.stack(fields, axis=1))
        self._last = [np.asarray(q)[-1],
                      np.zeros_like(q[-1]) if u is None else np.asarray(u)[-1]]

    def sample(self, t):
        """Return desired position, velocity and effort."""
        effort = 0.0 if self.effort is None else np.array(
            [np.interp(t, self.t, column) for column in np.transpose(self.effort)])
        if self._curve is None or t >= self.t[-1]:
            return *self._last, effort
        t = max(t, self.t[0])
        return self._curve(t), self._curve(t, 1), effort


class EffortLoop:
    """
    The controller with command interface `effort`, states `position` and `velocity`.

    `ahead` is the time by which the effort is sampled after the state, s: the period in
    versions from 4.17 on ("Sample at t + dT instead of the beginning of the control
    cycle"), else 0.
    """

    def __init__(self, gains, ahead=0.0):
        self.gains = gains
        self._ahead = ahead
        self._spline = None
        self._sum = 0.0
        self._start = 0.0

    @property
    def end(self):
        """Return the time of the last point."""
        return self._start + self._spline.t[-1]

    def accept(self, start, q, t, points, u=None, udot=None, effort=None):
        """Execute a trajectory from `start`, s; q is the measured position."""
        # From the measured state, at rest; the first segment has no effort.
        if t[0] > 0.0:
            def with_first(field, first):
                return None if field is None else np.vstack([first, field])
            at_rest = np.zeros_like(q)
            t = np.concatenate([[0.0], t])
            points = np.vstack([q, points])
            u = with_first(u, at_rest)
            udot = with_first(udot, at_rest)
            effort = with_first(effort, at_rest)
        self._spline = Spline(t, points, u, udot, effort)
        self._start = start

    def desired(self, now):
        """Return the desired position."""
        return self._spline.sample(now - self._start)[0]

    def update(self, now, period, q, u):
        """Return the effort command."""
        if self._spline is None:
            return None
        q_d, u_d, _ = self._spline.sample(now - self._start)
        _, ahead, effort = self._spline.sample(now - self._start + self._ahead)
        error = q_d - q
        self._sum = self._sum + error * period
        return (effort + self.gains.ff_velocity_scale * ahead + self.gains.p * error
                + self.gains.i * self._sum + self.gains.d * (u_d - u))


def drive(joints, gains, hold):
    """
    Execute the trajectories on /jtc/joint_trajectory at the rate of the joint states.

    Each starts at the next joint state. `hold` s after its end, print the RMS error of
    position of each joint, and stop commanding.
    """
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.experimental.events_executor import EventsExecutor
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64MultiArray
    from trajectory_msgs.msg import JointTrajectory
    rclpy.init()
    node = rclpy.create_node('jtc')
    commands = node.create_publisher(Float64MultiArray, 'commands', 1)
    waiting = []
    errors = []
    loop = None
    last = 0.0

    def on_state(message):
        nonlocal loop, last
        now = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        index = [list(message.name).index(name) for name in joints]
        q = np.array(message.position)[index]
        u = np.array(message.velocity)[index]
        if waiting:
            loop = EffortLoop(gains)
            last = now
            loop.accept(now, q, *fields(waiting.pop()))
            errors.clear()
        if loop is None:
            return
        torques = loop.update(now, now - last, q, u)
        commands.publish(Float64MultiArray(data=torques.tolist()))
        last = now
        errors.append(q - loop.desired(now))
        if now > loop.end + hold:
            loop = None
            rms = np.sqrt(np.mean(np.square(errors), axis=0))
            print(json.dumps(rms.tolist()), flush=True)

    def fields(message):
        index = [list(message.joint_names).index(name) for name in joints]
        yield np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec
                        for p in message.points])
        for name in ('positions', 'velocities', 'accelerations', 'effort'):
            rows = [getattr(point, name) for point in message.points]
            yield np.array(rows)[:, index] if len(rows[0]) else None

    node.create_subscription(JointState, 'joint_states', on_state, 1)
    node.create_subscription(JointTrajectory, '/jtc/joint_trajectory', waiting.append, 1)
    executor = EventsExecutor()
    executor.add_node(node)
    print('ready', flush=True)
    try:
        while True:
            executor.spin_once(0.5)
    except ExternalShutdownException:
        pass


if __name__ == '__main__':
    drive(sys.argv[1].split(','), Gains(p=float(sys.argv[2]), d=float(sys.argv[3])),
          float(sys.argv[4]))
