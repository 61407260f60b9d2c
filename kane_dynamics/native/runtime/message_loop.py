"""
The loop of the native torque path: `message_loop.c` as machine code, and its structures.

The structures and the constants are those that the C text declares.
"""

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.machine_code.c_source import CSource

SOURCE = CSource(Path(__file__).with_suffix('.c'))
CONSTANTS = SOURCE.constants
STRUCTURES = SOURCE.structures
# Kinds of reports
ANSWERED, UNKNOWN, ELAPSED, HEARD = map(CONSTANTS.__getitem__, (
    'ANSWERED', 'UNKNOWN', 'ELAPSED', 'HEARD'))
INFORMATION_SIZE = CONSTANTS['INFORMATION_SIZE']
(Rule, Event, PathHead, Layout, MotionTable, Plan, Message, Input, Output, Slot,
 Block) = map(STRUCTURES.__getitem__, (
     'rule', 'event', 'path_head', 'layout', 'motion', 'plan', 'message', 'input',
     'output', 'slot', 'block'))


@cache
def message_loop() -> llvm.Code:
    """Return the machine code of the loop."""
    return SOURCE.code


@cache
def write_number() -> Any:
    """Return a function of an address and a number that publishes it to the thread."""
    return message_loop().function('write_number', ctypes.PYFUNCTYPE(
        None, ctypes.c_void_p, ctypes.c_int64))


@cache
def read_number() -> Any:
    """Return a function that reads a number of the thread at an address."""
    return message_loop().function('read_number', ctypes.PYFUNCTYPE(
        ctypes.c_int64, ctypes.c_void_p))
