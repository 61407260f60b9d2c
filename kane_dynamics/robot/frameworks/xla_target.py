"""Machine code that XLA calls: handlers of batch functions, registered with JAX."""

import ctypes
from functools import cache
import math
from pathlib import Path
import re
import sys

import jax
from kane_dynamics._util.fork_safety import ForkSafeLock
from kane_dynamics.errors import CompileError
from kane_dynamics.native.backends.llvm_math import size_limit
from kane_dynamics.native.backends.llvm_simd import width
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime.loops import loops, SOURCE
from kane_dynamics.native.runtime.threads import thread_count
from kane_dynamics.robot.frameworks.batch_function import BatchFunction

MAJOR = 0  # of the version of XLA's interface whose layout is used
WORK = 2_000_000  # operations of a thread at least; some 0.3 ms
Described = SOURCE.structures['described']
# A function of XLA's interface: of a call alone.
HANDLER = """
define ptr @handler(ptr %call) {{
  %error = call ptr inttoptr (i64 {handle} to ptr)(ptr %call, ptr inttoptr (i64 {batch} to ptr))
  ret ptr %error
}}
"""
VERSION = re.compile(r'#define XLA_FFI_API_(MAJOR|MINOR) (\d+)')
_targets: dict[str, object] = {}  # by name; XLA may call them until the process ends
_lock = ForkSafeLock()


@cache
def interface() -> tuple[int, int]:
    """Return the version of XLA's interface for foreign functions, major and minor."""
    header = Path(jax.ffi.include_dir(), 'xla', 'ffi', 'api', 'c_api.h')
    try:
        numbers = dict(VERSION.findall(header.read_text(encoding='utf-8')))
        return int(numbers['MAJOR']), int(numbers['MINOR'])
    except (OSError, KeyError) as error:
        raise CompileError(f'{header}: {error}; expected the version of its '
                           'interface') from None


def require_interface() -> None:
    """Raise CompileError unless handlers are made for this version of the interface."""
    if sys.maxsize < 2**63 - 1 or interface()[0] != MAJOR:
        raise CompileError(f'XLA foreign functions: version {interface()[0]}; expected '
                           f'{MAJOR} on a processor of 64 bits')


def registered(function: BatchFunction) -> str:
    """Return the name of the target that evaluates a function, after registering it."""
    name = f'kane_dynamics_{function.identity}'
    with _lock.held():
        if name not in _targets:
            _targets[name] = _handler(function, name), function.kernel
    return name


def _handler(function: BatchFunction, name: str) -> object:
    """Compile and register the handler of a function."""
    # The operands: the arguments, the block of parameters, the result. Only
    # positions have a finite limit of size.
    sizes = []
    limits = []
    for argument in function.arguments:
        sizes.append(math.prod(argument.shape))
        limits.append(min(size_limit(argument.name), sys.float_info.max))
    sizes += [len(function.parameters), math.prod(function.shape)]
    limits += 2 * [min(size_limit(''), sys.float_info.max)]

    # The number of operations decides from which batch on threads share the work.
    kernel = function.kernel
    count = kernel.traced().operation_count()
    operations = count.multiplications + count.additions
    kept = ((ctypes.c_int64 * len(sizes))(*sizes), (ctypes.c_double * len(limits))(*limits))
    batch = Described(
        kernel.compile_lanes(), len(sizes), width(), max(1, WORK // max(operations, 1)),
        thread_count(), interface()[1], *[ctypes.addressof(array) for array in kept])
    text = HANDLER.format(handle=loops().address('handle'), batch=ctypes.addressof(batch))
    code = llvm.Code(llvm.assemble(text, 2, optimise=True))
    handler = code.function('handler', ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p))
    jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(handler), platform='cpu')
    return handler, batch, kept
