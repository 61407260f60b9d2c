"""A native torque path without a thread: a manual clock, and publishers in Python."""

import ctypes
from types import SimpleNamespace

from kane_dynamics.ros.torque_path.native_path import NativeTorquePath

CLOCK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int64))
PUBLISH = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
COMMANDS, TORQUES = 1, 2  # stand for the handles of publishers


def native_path(controller, commands, torques, now, *arguments, **named):
    """Return a native torque path that runs in the calling thread."""
    path = NativeTorquePath(controller, commands, torques, now, *arguments, **named)
    loop = path.native
    messages = {COMMANDS: (commands, loop.command), TORQUES: (torques, loop.torques)}

    def clock(handle, time):
        time[0] = now()
        return 0

    def publish(publisher, message, allocation):
        to, prepared = messages[publisher]
        to.publish(prepared.serialized())
        return 0
    callbacks = SimpleNamespace(clock=CLOCK(clock), publish=PUBLISH(publish))
    path.callbacks = callbacks  # alive as long as the path
    loop.use_clock(ctypes.cast(callbacks.clock, ctypes.c_void_p).value, 0)
    loop.use_publisher(ctypes.cast(callbacks.publish, ctypes.c_void_p).value, COMMANDS, TORQUES)
    return path
