"""
The loop of the native torque path: `message_loop.c` as machine code, and its structures.

The structures and the constants are those that the C text declares. The machine code is
compiled from the LLVM text that clang has made of it, `message_loop.ll`.
"""

import ctypes
from functools import cache
from pathlib import Path
import re
from typing import Any

from kane_dynamics.native.machine_code import llvm

SOURCE = Path(__file__).with_suffix('.c')
_KINDS = {'int64_t': ctypes.c_int64, 'double': ctypes.c_double}


def _plain_text() -> str:
    """Return the C text without comments and qualifiers."""
    text = re.sub(r'/\*.*?\*/', '', SOURCE.read_text(encoding='utf-8'), flags=re.DOTALL)
    return re.sub(r'\b_Atomic\b', '', text)


def _constants(text: str) -> dict[str, int]:
    """Return the constants of a C text by name."""
    constants = {}
    for body in re.findall(r'^enum \{(.*?)\};', text, re.DOTALL | re.MULTILINE):
        following = 0
        for constant in body.split(','):
            name, _, value = constant.partition('=')
            following = int(value or following)
            constants[name.strip()] = following
            following += 1
    return constants


def _structures(text: str) -> dict[str, type[ctypes.Structure]]:
    """Return the structures of a C text by name; a field is a number or a pointer."""
    kinds: dict[str, Any] = dict(_KINDS)
    for body, name in re.findall(r'^typedef struct \{(.*?)\n\} (\w+);', text,
                                 re.DOTALL | re.MULTILINE):
        fields = []
        for declaration in body.split(';')[:-1]:
            kind, declared = declaration.split(maxsplit=1)
            for field in declared.split(','):
                is_pointer = '*' in field
                fields.append((field.strip(' *'),
                               ctypes.c_void_p if is_pointer else kinds[kind]))
        kinds[name] = type(name, (ctypes.Structure,), {'_fields_': fields})
    return {name: kind for name, kind in kinds.items() if name not in _KINDS}


CONSTANTS = _constants(_plain_text())
STRUCTURES = _structures(_plain_text())
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
    text = SOURCE.with_suffix('.ll').read_text(encoding='utf-8')
    return llvm.library('message_loop', text)


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
