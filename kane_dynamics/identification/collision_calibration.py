"""Thresholds of collision detection, calibrated from a recording without contact."""

from collections.abc import Iterator
from dataclasses import dataclass

from kane_dynamics._util.checks import instance, number
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.control.collision_detection import CollisionDetector
from kane_dynamics.control.friction_error import FrictionError
from kane_dynamics.control.momentum_observer import MomentumObserver
from kane_dynamics.errors import InputError
from kane_dynamics.identification.payload.recorded_motion import recorded_joints, recorded_motion
from kane_dynamics.identification.recordings.recording import check_recording, Recording
from kane_dynamics.mechanics.friction import coulomb as coulomb_shape
from kane_dynamics.robot.robot import Robot
import numpy as np

MARGIN = 1.4  # threshold over the largest estimate without contact; above 1 / release
DRIFT = 0.1  # relative change of friction between the recording and use
MEMORY = 20.0  # s, of the friction's adaptation
SPEEDS = np.geomspace(0.005, 0.2, 12)  # candidates of friction speeds, rad/s or m/s
MOVING = 0.02  # rad/s or m/s, of a joint whose friction is fitted
LEAST_ROWS = 50  # in motion, of a joint whose friction is fitted; after settling, of a recording
SETTLED = 5.0  # time constants of the observer that are left out after it starts
LEAST = 0.005  # smallest threshold, relative to the largest torque of the joint
STEPS = 3.0  # mean steps of time: after a longer one the observer restarts
CONTACT = 4.0  # largest over the 99th percentile of estimates: suspect of a contact


@dataclass(frozen=True, eq=False)
class CollisionCalibration:
    """
    Thresholds of collision detection, and friction beyond the model.

    The result of `calibrate_collision`.

    Attributes
    ----------
    joint_names : tuple of n str
        Independent joints.
    threshold : (n,) array
        For `CollisionDetector`, N m or N.
    error : (n,) array
        Largest external torque that the observer estimates without contact, friction
        beyond the model removed, N m or N.
    error_before : (n,) array
        The same with the friction of the model.
    error_time : (n,) array
        When `error` occurs, s.
    coulomb, damping, offset, friction_speed : (n,) arrays
        Friction beyond the model, as of `FrictionError`.
    suspected : tuple of str
        Joints in which single estimates are far beyond all others: a contact or an
        outlier in the recording would make the thresholds too large.
    unmoved : tuple of str
        Joints that move too little for their friction to be fitted.
    held_out_alarms : int
        Number of collisions that thresholds and friction of the first half raise in the
        second.
    gain : float
        Of the observer, 1/s.

    """

    joint_names: tuple[str, ...]
    threshold: Array
    error: Array
    error_before: Array
    error_time: Array
    coulomb: Array
    damping: Array
    offset: Array
    friction_speed: Array
    suspected: tuple[str, ...]
    unmoved: tuple[str, ...]
    held_out_alarms: int
    gain: float

    def friction_error(self, *, memory: float = MEMORY) -> FrictionError:
        """Return the friction beyond the model, for `MomentumObserver`; memory in s."""
        return FrictionError(self.joint_names, coulomb=self.coulomb,
                             damping=self.damping,
                             offset=self.offset, friction_speed=self.friction_speed,
                             memory=memory, largest=self.threshold)


@dataclass(frozen=True, eq=False)
class _Estimates:
    """External torques (N, n) along a recording, and the regressors of friction."""

    t: Array
    u: Array
    torque: Array
    coulomb: Array  # (speeds, N, n): Coulomb friction of coefficient 1 behind the low-pass
    damping: Array
    offset: Array
    settled: Flags  # (N,)

    def rows(self, chosen: slice) -> '_Estimates':
        """Return some of the rows."""
        return _Estimates(self.t[chosen], self.u[chosen], self.torque[chosen],
                          self.coulomb[:, chosen], self.damping[chosen],
                          self.offset[chosen], self.settled[chosen])


def calibrate_collision(robot: Robot, recording: Recording, *, gain: float = 50.0,
                        margin: float = MARGIN, drift: float = DRIFT, held: bool = False
                        ) -> CollisionCalibration:
    """
    Return thresholds of collision detection from a recording without contact.

    `MomentumObserver` runs over the recording. What the model's friction lacks (Coulomb
    friction, damping, offset of each joint) is fitted to its estimates. Thresholds are
    `margin` times the sum of the largest estimates that remain and of `drift` times the
    friction.

    The recording should be of the task at its speeds, with the payload and at the
    temperature of use, at the rate of the states that the observer will get.

    Parameters
    ----------
    robot : Robot
        Tree, or closed loops with a recording of the joints with actuators.
    recording : Recording
        Unfiltered: a filter would remove noise that the observer meets later.
    gain : float
        Of the observer, 1/s; thresholds are valid for it only.
    margin : float
        At least 1.25, so that errors as in the recording are below the level of 0.8
        times the threshold at which `CollisionDetector` clears the flag.
    drift : float
        Relative change of friction that raises no alarm, for example by temperature; >=
        0.
    held : bool
        True if the torques are commands that act until the next row, False if they are
        measured.

    Raises
    ------
    InputError
        The recording has other joints or too few rows, or an argument is out of range.

    """
    instance(robot, Robot, 'robot')
    gain = number(gain, 'gain', 'a positive number, 1/s', lambda x: 0.0 < x < np.inf)
    margin = number(margin, 'margin', 'a number of at least 1.25',
                    lambda x: 1.25 <= x < np.inf)
    drift = number(drift, 'drift', 'a finite number >= 0', lambda x: 0.0 <= x < np.inf)
    if not isinstance(held, bool):
        raise InputError(f'held: {held!r}; expected True or False')
    names = recorded_joints(robot)
    check_recording(robot.model, recording, joints=names)
    motion = recorded_motion(robot, names, recording)
    estimates = _estimates(robot, motion, gain, held)
    if estimates.settled.sum() < LEAST_ROWS:
        raise InputError(f'recording: {int(estimates.settled.sum())} rows after the '
                         f'observer has settled; expected at least {LEAST_ROWS}')
    # Without contact, what the fitted friction leaves of the estimates is error.
    friction, unmoved_joints = _fitted_friction(estimates)
    errors = np.abs(_remaining(estimates, friction))[estimates.settled]
    error = errors.max(axis=0)
    error_time = estimates.t[estimates.settled][errors.argmax(axis=0)]
    unfitted = np.abs(estimates.torque[estimates.settled]).max(axis=0)

    # What may change between the recording and use: friction.
    largest_torque = np.abs(motion[3]).max(axis=0)
    allowed = drift * _largest_friction(robot, estimates, friction)
    allowed = np.maximum(allowed, LEAST * largest_torque)

    # An error far above the usual ones of its joint is probably a contact.
    usual = np.quantile(errors, 0.99, axis=0)
    suspected_joints = np.flatnonzero(error > CONTACT * usual + allowed)
    speed_names = robot.speed_names
    suspected = tuple(speed_names[j] for j in suspected_joints)
    unmoved = tuple(speed_names[j] for j in unmoved_joints)
    alarms = _held_out_alarms(estimates, speed_names, allowed, margin)
    return CollisionCalibration(speed_names, margin * (error + allowed), error, unfitted,
                                error_time, *friction, suspected, unmoved, alarms,
                                float(gain))


def _largest_friction(robot: Robot, estimates: _Estimates,
                      friction: tuple[Array, Array, Array, Array]) -> Array:
    """Return the largest friction of each independent joint without its offset, (n,)."""
    coulomb, damping, _, _ = friction
    joints = {body.joint.name: body.joint for body in robot.model.bodies}
    speed = np.abs(estimates.u).max(axis=0)
    largest = np.zeros(robot.n)
    # The friction of the model and what the estimates add to it, at the largest speed.
    for j, name in enumerate(robot.speed_names):
        # A speed that is no joint rate has no friction of the model.
        of_model = joints.get(name) if robot.friction else None
        if of_model is None:
            total = coulomb[j], damping[j]
        else:
            total = of_model.friction + coulomb[j], of_model.damping + damping[j]
        largest[j] = abs(total[0]) + abs(total[1]) * speed[j]
    return largest


def _estimates(robot: Robot, motion: tuple[Array, ...], gain: float,
               held: bool) -> _Estimates:
    """Run the observer along a motion; apply its low-pass to the regressors of friction too."""
    q, u, _, tau, t = motion
    longest = STEPS * float(np.diff(t).mean())
    observer = MomentumObserver(robot, gain=gain, max_gap=longest, held=held)
    # The estimate of the external torque, which should be zero: what remains is error.
    torque = np.array([observer.update(*row) for row in zip(t, q, u, tau)])
    shapes = np.stack([coulomb_shape(u, speed) for speed in SPEEDS])
    regressors = np.concatenate([shapes, [u, np.ones_like(u)]])
    filtered = np.zeros_like(regressors)
    settled, start = np.zeros(len(t), dtype=bool), t[0]
    # The observer is a low-pass of its gain; regressors pass the same one to fit its
    # output.
    for k, elapsed in enumerate(np.diff(t), start=1):
        if elapsed > longest:  # the observer restarts, and so does the low-pass
            start = t[k]
            continue
        forgotten = np.exp(-gain * elapsed)
        mean = 0.5 * (regressors[:, k - 1] + regressors[:, k])
        filtered[:, k] = forgotten * filtered[:, k - 1] + (1.0 - forgotten) * mean
        # After a restart the estimate begins at zero and settles with time.
        settled[k] = t[k] - start > SETTLED / gain
    count = len(SPEEDS)
    return _Estimates(t, u, torque, filtered[:count], filtered[count],
                      filtered[count + 1],
                      settled)


def _fitted_friction(estimates: _Estimates) -> tuple[tuple[Array, Array, Array, Array],
                                                     list[int]]:
    """Return coulomb, damping, offset and friction speed of each joint, and unmoved joints."""
    n = estimates.u.shape[1]
    coulomb = np.zeros(n)
    damping = np.zeros(n)
    offset = np.zeros(n)
    speed = np.full(n, float(SPEEDS[-1]))
    unmoved = []
    rows = estimates.settled
    for j in range(n):
        # The estimate is external torque, which has the sign opposite to friction.
        friction = -estimates.torque[rows, j]
        moving = np.abs(estimates.u[rows, j]) > MOVING
        if moving.sum() < LEAST_ROWS:
            unmoved.append(j)
            offset[j] = friction.mean()
            continue
        # One fit for each friction speed; the one with the smallest residual is kept.
        fits = [_least_squares(columns, friction) for columns in _columns(estimates, j)]
        residuals = [residual for _, residual in fits]
        best = int(np.argmin(residuals))
        coulomb[j], damping[j], offset[j] = fits[best][0]
        speed[j] = SPEEDS[best]
    return (coulomb, damping, offset, speed), unmoved


def _columns(estimates: _Estimates, j: int) -> Iterator[Array]:
    """Yield the regressor of a joint's friction, (rows, 3), for each friction speed."""
    rows = estimates.settled
    for shape in estimates.coulomb:
        yield np.column_stack([shape[rows, j], estimates.damping[rows, j],
                               estimates.offset[rows, j]])


def _least_squares(A: Array, b: Array) -> tuple[Array, float]:
    """Return the solution and the norm of its residual."""
    x: Array = np.asarray(np.linalg.lstsq(A, b, rcond=1e-6)[0])
    return x, float(np.linalg.norm(b - A @ x))


def _remaining(estimates: _Estimates, friction: tuple[Array, Array, Array,
                                                      Array]) -> Array:
    """Return the external torques with friction beyond the model removed, (N, n)."""
    coulomb, damping, offset, speed = friction
    chosen = np.searchsorted(SPEEDS, speed)
    shape = np.column_stack([estimates.coulomb[k, :, j] for j, k in enumerate(chosen)])
    friction_torque = coulomb * shape + damping * estimates.damping + offset * estimates.offset
    return np.asarray(estimates.torque + friction_torque)


def _held_out_alarms(estimates: _Estimates, names: tuple[str, ...], allowed: Array,
                     margin: float) -> int:
    """Return how many collisions a calibration to the first half raises in the second."""
    middle = len(estimates.t) // 2
    first, second = estimates.rows(slice(None, middle)), estimates.rows(slice(middle,
                                                                              None))

    # The first half fits friction and thresholds, the second half only tests them.
    if not first.settled.any():
        return 0
    friction, _ = _fitted_friction(first)
    error = np.abs(_remaining(first, friction))[first.settled].max(axis=0)
    detector = CollisionDetector(names, margin * (error + allowed))
    alarms = 0
    # Alarms are counted when they begin.
    for t, torque, settled in zip(second.t, _remaining(second, friction),
                                  second.settled):
        if settled and detector.update(t, torque) and detector.collision:
            alarms += 1
    return alarms
