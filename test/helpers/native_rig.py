"""A native torque path without a thread: a manual clock, and publishers in Python."""

import ctypes
import time
from types import SimpleNamespace

from kane_dynamics.ros.torque_path.native_path import NativeTorquePath

CLOCK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int64))
STEADY = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.POINTER(ctypes.c_int64))
PUBLISH = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
COMMANDS, TORQUES, STAMPED, REQUESTS = 1, 2, 3, 4  # stand for the handles of publishers


def native_path(controller, commands, torques, now, *arguments, stamped=None, **named):
    """Return a native torque path that runs in the calling thread."""
    path = NativeTorquePath(controller, commands, torques, now, *arguments, **named)
    loop = path.native
    loop.publish_to(COMMANDS, TORQUES, None if stamped is None else STAMPED)
    path.outputs = {COMMANDS: (commands, loop.command), TORQUES: (torques, loop.torques),
                    STAMPED: (stamped, loop.stamped)}

    def clock(handle, nanoseconds):
        nanoseconds[0] = now()
        return 0

    def steady(kind, seconds):
        """Write seconds and nanoseconds of the steady clock, which tests may replace."""
        seconds[0], seconds[1] = divmod(round(time.perf_counter() * 1e9), 10**9)
        return 0

    def publish(publisher, message, allocation):
        to, prepared = path.outputs[publisher]
        to.publish(prepared.serialized())
        return 0
    callbacks = SimpleNamespace(clock=CLOCK(clock), publish=PUBLISH(publish),
                                steady=STEADY(steady))
    path.callbacks = callbacks  # alive as long as the path
    loop.use_clock(address(callbacks.clock), 0)
    loop.use_publisher(address(callbacks.publish))
    loop._set(STEADY=address(callbacks.steady))
    return path


def guarded(path, link):
    """Let a native path follow the rules of a link to torque_guard."""
    path.outputs[REQUESTS] = link.requests, path.native.request
    path.use_guard(link, REQUESTS)
    path.arbiter = link


def address(function):
    return ctypes.cast(function, ctypes.c_void_p).value
