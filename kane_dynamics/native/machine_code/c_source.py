"""C sources of the package: their constants, structures and machine code."""

import ctypes
from functools import cached_property
from pathlib import Path
import re
from typing import Any

from kane_dynamics.native.machine_code import llvm

_KINDS = {'int64_t': ctypes.c_int64, 'int32_t': ctypes.c_int32, 'double': ctypes.c_double}


class CSource:
    """
    A C source, and the LLVM text that clang has made of it, with the suffix `.ll`.

    Parameters
    ----------
    path : Path
        The source. Its structures are those of the form ``typedef struct {...} name;``
        over several lines, with fields that are numbers, pointers or structures.

    """

    def __init__(self, path: Path) -> None:
        """Read the source."""
        self.path = path
        text = re.sub(r'/\*.*?\*/', '', path.read_text(encoding='utf-8'), flags=re.DOTALL)
        self._text = re.sub(r'\b_Atomic\b', '', text)

    @cached_property
    def constants(self) -> dict[str, int]:
        """Constants of the enumerations by name."""
        constants = {}
        for body in re.findall(r'^enum \{(.*?)\};', self._text, re.DOTALL | re.MULTILINE):
            following = 0
            for constant in body.split(','):
                name, _, value = constant.partition('=')
                following = int(value, 0) if value else following
                constants[name.strip()] = following
                following += 1
        return constants

    @cached_property
    def structures(self) -> dict[str, Any]:
        """Structures by name, as classes of ctypes."""
        kinds: dict[str, Any] = dict(_KINDS)
        for body, name in re.findall(r'^typedef struct \{\n(.*?)\n\} (\w+);', self._text,
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

    @cached_property
    def code(self) -> llvm.Code:
        """Machine code of the LLVM text."""
        text = self.path.with_suffix('.ll').read_text(encoding='utf-8')
        return llvm.library(self.path.stem, text)
