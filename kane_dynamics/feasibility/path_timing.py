"""The motion along a path with given squared path velocities, and its use of the limits."""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.feasibility.path_geometry import kernels as path_kernels, Section
from kane_dynamics.feasibility.path_limits import Bounds, bounds_kernel, torque_kernel
from kane_dynamics.feasibility.reachability import compile_passes
from kane_dynamics.feasibility.segment_peaks import peaks_kernel, SegmentPeaks
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.motion.uniform_spline import kernels as compile_spline
from kane_dynamics.native.runtime.batch_kernel import batch_kernel
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
import numpy as np

PAUSE = 1e-6  # s of rest between two sections
# Places in a segment: as many where friction changes, and times the root of the range elsewhere,
# so that a smooth share is found to 3e-4 of the limit.
DENSE, SMOOTH = 200, 60.0
STEP = 0.5  # of s between vertices
FLAT, TERMS = 0.1, 8  # largest argument of the series, exact to rounding, and its terms
TURNING = 4.0  # speeds of friction, below which friction changes


class Checked(NamedTuple):
    """
    The points of a section, and the largest uses of the limits between them.

    Attributes
    ----------
    points : ControllerPoints
        The N + 2 points.
    largest : (4, N + 1, n) array
        The largest shares in the segments.
    tau : (N + 2, n) array
        Torques at the points.

    """

    points: ControllerPoints
    largest: Array
    tau: Array


def timed(section: Section, x: Array) -> ControllerPoints:
    """
    Return points of the motion along a section with squared path velocities x at its vertices.

    The points are both ends and the middles between vertices. There x and its slope are those of
    the polygon through the vertices, so x(s) is a quadratic spline, which rounds the corners of
    the polygon, and the acceleration is continuous.
    """
    count, n = len(x) + 1, section.q.shape[1]
    profile = np.empty((count + 1, 3))  # x, s'' and the step to the next point, one in addition
    profile[1:-2, 0], profile[1:-2, 1], profile[:, 2] = 0.5 * (x[1:] + x[:-1]), (
        x[1:] - x[:-1]), STEP
    profile[0] = x[0], profile[1, 1], 0.5 * STEP
    profile[-2:] = x[-1], profile[-3, 1], 0.0
    profile[-3, 2] = 0.5 * STEP
    places = np.arange(-1, len(section.q) + 1, 2)
    places[0], places[-1] = 0, len(section.q) - 1
    out = np.empty((count, 3 * n + 1))
    point_kernel(n).run([*section[:3], profile, profile[1:]], out, count,
                        dict.fromkeys(Section._fields[:3], places))
    t = np.zeros(count)
    np.cumsum(out[:-1, -1], out=t[1:])
    return ControllerPoints(t, *(out[:, k * n:(k + 1) * n] for k in range(3)))


@cache
def point_kernel(n: int) -> Kernel:
    """Return the kernel of the state at a point and the time to the next, (3 n + 1,)."""
    def values(q: Any, first: Any, second: Any, here: Any, following: Any) -> Any:
        x, slope, step = here
        root = np.sqrt(x)
        total = root + np.sqrt(following[0])
        time = 2.0 * step / total * _lengthening(step * (following[1] - slope) / (total * total))
        return np.array([*q, *(root * first), *(x * second + slope * first), time])
    return batch_kernel('path_point', values, [
        *((name, (n,)) for name in Section._fields[:3]), ('here', (3,)), ('following', (3,))],
        (3 * n + 1,))


def _lengthening(z: Any) -> Any:
    """
    Return artanh(r) / r for z = r^2, and arctan(r) / r for z = -r^2, without cancellation.

    For a quadratic x(s) with the coefficient c of s^2, the integral of ds / sqrt(x) over a step h
    is 2 h / t times this with z = c h^2 / t^2, where t is the sum of sqrt(x) at both ends.
    """
    root, series = np.sqrt(select(z < 0.0, -z, z)), 0.0
    for k in reversed(range(TERMS)):
        series = 1.0 / (2 * k + 1) + z * series
    curved = select(z < 0.0, np.arctan(root), 0.5 * np.log((1.0 + root) / (1.0 - root))) / root
    return select(root < FLAT, series, curved)


def duration(x: Array) -> float:
    """Return the duration along the polygon x, in intervals; an end may be near zero."""
    root = np.sqrt(x)
    return float((2.0 / (root[1:] + root[:-1])).sum())


def checked(robot: Robot, points: ControllerPoints, bounds: Bounds,
            peaks_of: Callable[..., SegmentPeaks] = SegmentPeaks) -> Checked:
    """Return the uses of the limits along the quintics between points."""
    peaks = peaks_of(robot, np.array(bounds), points)
    found, turning = peaks.middles(), _turning(robot, points.u)
    segments = np.flatnonzero((found.estimate > 1.0) | turning)
    if not segments.size:
        return Checked(points, found.shares.swapaxes(0, 1), peaks.tau)
    places = np.where(turning[segments], DENSE, np.minimum(
        1.0 + SMOOTH * np.sqrt(found.change[segments]), DENSE)).astype(np.intp)
    found.shares[segments] = np.maximum(found.shares[segments], peaks.inside(segments, places))
    return Checked(points, found.shares.swapaxes(0, 1), peaks.tau)


def _turning(robot: Robot, u: Array) -> Flags:
    """Return whether the Coulomb friction of a joint changes much within each segment."""
    found = np.zeros(len(u) - 1, dtype=bool)
    for body in robot.model.bodies if robot.friction else ():
        joint = body.joint
        if joint.friction:
            rate = joint.multiplier * u[:, joint.coordinate]
            slow = np.abs(rate) < TURNING * joint.friction_speed
            found |= (rate[1:] * rate[:-1] <= 0.0) | slow[1:] | slow[:-1]
    return found


def joined(parts: Sequence[ControllerPoints]) -> tuple[ControllerPoints, Callable[[], Array]]:
    """Return the points of all sections, and a function that returns the coefficients between."""
    begin, times = 0.0, []
    for part in parts:
        times.append(begin + part.t)
        begin = times[-1][-1] + PAUSE
    return ControllerPoints(np.concatenate(times), *(
        np.concatenate(rows) for rows in list(zip(*parts))[1:])), partial(_coefficients, parts)


def _coefficients(parts: Sequence[ControllerPoints]) -> Array:
    """Return the coefficients of the sections and of the rests between them."""
    found = []
    for part in parts:
        rest = np.zeros((1, 6, part.q.shape[1]))
        rest[0, 0] = part.q[0]
        found += [rest, part.coefficients]
    return np.concatenate(found[1:])


def compile_timing(robot: Robot) -> None:
    """Compile what `time_optimal` needs for limits of effort and velocity."""
    n = robot.n
    compile_passes(int(np.isfinite(robot.limits.effort).sum()) or 1)
    compile_spline(n)
    for kernel in (*path_kernels(n), torque_kernel(robot), bounds_kernel(n), point_kernel(n),
                   peaks_kernel(robot), robot.kernels.quantity('inverse_dynamics')):
        kernel.compile_lanes()
