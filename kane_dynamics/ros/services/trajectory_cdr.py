"""Serialize joint trajectories with all fields."""

from kane_dynamics.control.trajectory_feedforward import FilledTrajectory
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.torque_path.cdr import HEAD, STAMP, STAMP_AT, Writer
from kane_dynamics.ros.torque_path.trajectory_input import TrajectoryHeader
import numpy as np


def serialized_trajectory(header: TrajectoryHeader, filled: FilledTrajectory) -> bytes:
    """
    Return a serialized JointTrajectory.

    All points have the same layout, which numpy writes at once: each field is a count, padding to
    8 bytes, and doubles; then the time. Only the first point may begin in the middle of 8 bytes;
    its first count then needs no padding.
    """
    writer = Writer()
    writer.reserve(4, 2)
    STAMP.pack_into(writer.data, STAMP_AT, *header.stamp)
    writer.text(header.frame_id)
    writer.texts(filled.joint_names)
    writer.word(len(filled.times))
    n = len(filled.joint_names)
    fields = ('positions', 'velocities', 'accelerations', 'efforts')
    points = np.zeros(len(filled.times), dtype=[
        *((name, [('count', '<u4'), ('padding', '<u4'), ('values', '<f8', (n,))])
          for name in fields), ('sec', '<i4'), ('nanosec', '<u4')])
    for name in fields:
        points[name]['count'] = n
        points[name]['values'] = getattr(filled, name)
    points['sec'], points['nanosec'] = np.divmod(np.rint(filled.times * NANO).astype(np.int64),
                                                 NANO)
    body = points.tobytes()
    if (len(writer.data) - HEAD) % 8:
        body = body[:4] + body[8:]
    return bytes(writer.data) + body
