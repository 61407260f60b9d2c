"""
Compile LLVM IR to machine code with llvmlite, and keep the machine code on disk.

Only this module imports llvmlite.

A fork waits until no other thread is inside LLVM, so that LLVM and its lock are usable
in the child.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
import os
from threading import local
from typing import Any
from weakref import finalize

from kane_dynamics._util import disk_cache
from kane_dynamics.errors import CompileError, InputError
import llvmlite.binding as llvm
import numpy as np

Address = int
# Fixed target, so that the reported code size does not depend on the machine.
REFERENCE_TRIPLE = 'x86_64-unknown-linux-gnu'
REFERENCE_CPU = 'x86-64-v3'
# The pass manager of older llvmlite fails at pointers without an element type. Without
# passes, batches are some percent slower.
PASSES = hasattr(llvm, 'create_pass_builder')
# The widest SIMD extension of x86 that is used, and LLVM's name of it.
SIMD_VARIABLE = 'KANE_DYNAMICS_SIMD'
SIMD = {'avx512': 'avx512f', 'avx2': 'avx2', 'sse2': 'sse2'}
# Beginnings of LLVM's names of the features that need wider registers or their encoding.
WIDER: dict[str, tuple[str, ...]] = {
    'avx512': (), 'avx2': ('avx512', 'avx10', 'evex512'),
    'sse2': ('avx', 'fma', 'f16c', 'xop', 'vaes', 'vpclmulqdq', 'evex512', 'sha512', 'sm3',
             'sm4')}
# Of the instruction scheduler, for long straight-line programs: loads pass stores to other
# memory, and loads of neighbors do not have to be neighbors. Fewer values are spilled.
SCHEDULER = ('-enable-aa-sched-mi', '-misched-cluster=false')
LONG = 10_000  # lines of IR: without instruction scheduling
_own = local()  # of each thread: code generators, each for one module at a time

_lock = llvm.ffi.lib._lock  # llvmlite holds it in every call of LLVM
os.register_at_fork(before=_lock.__enter__, after_in_parent=_lock.__exit__,
                    after_in_child=_lock.__exit__)


@cache
def _initialized() -> None:
    """Register the code generator of this processor."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    for option in SCHEDULER:
        llvm.set_option('', option)


def _context_of_opaque_pointers() -> Any:
    """Return the context in which modules are parsed: one that knows the type `ptr`."""
    if llvm.llvm_version_info[0] == 14:
        llvm.set_option('', '-opaque-pointers')
    if llvm.llvm_version_info[0] == 15:
        return llvm.context.ContextRef(llvm.ffi.lib.LLVMPY_ContextCreate(True))
    return llvm.context.get_global_context()


_context = _context_of_opaque_pointers()


@cache
def features() -> dict[str, bool]:
    """
    Return the features of this processor by LLVM's names, as `KANE_DYNAMICS_SIMD` allows.

    Raises
    ------
    InputError
        If ``KANE_DYNAMICS_SIMD`` names no SIMD extension that this processor has.

    """
    # A narrower instruction set than the processor's is chosen by switching features
    # off.
    host = dict(llvm.get_host_cpu_features())
    setting = os.environ.get(SIMD_VARIABLE)
    if setting is None:
        return host
    valid = [name for name, feature in SIMD.items() if host.get(feature)]
    if setting not in valid:
        expected = f"one of {', '.join(valid)}" if valid else 'no value on this processor'
        raise InputError(f'{SIMD_VARIABLE}: {setting!r}; expected {expected}')
    wider = WIDER[setting]
    for feature in host:
        if feature.startswith(wider):
            host[feature] = False
    return host


@cache
def _processor() -> tuple[str, str]:
    """Return LLVM's name and feature string of this processor."""
    present = []
    absent = []
    for feature, is_present in features().items():
        if is_present:
            present.append(f'+{feature}')
        else:
            absent.append(f'-{feature}')
    # A feature switches on those that it needs: what is absent comes last.
    return llvm.get_host_cpu_name(), ','.join(present + absent)


def _target_machine(level: int) -> Any:
    """Return a code generator for this processor."""
    _initialized()
    name, features = _processor()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=name, features=features, opt=level, jit=True)


@cache
def fingerprint() -> str:
    """Return a text that identifies the compiler and the processor."""
    return '|'.join([llvm.get_default_triple(), *_processor(),
                     '.'.join(map(str, llvm.llvm_version_info))])


def cached(make: Callable[[], bytes], *parts: str) -> bytes:
    """Return the machine code of these parts from the cache, made if it is missing."""
    name = disk_cache.key('code', *parts, fingerprint())
    code = disk_cache.load(name)
    if code is None:
        code = make()
        disk_cache.store(name, code)
    return code


def assemble(text: str, level: int = 1, optimise: bool = False,
             in_order: bool = False) -> bytes:
    """
    Compile LLVM IR to an object file in memory.

    Parameters
    ----------
    text : str
        LLVM IR of a module.
    level : int
        Optimization level of the code generator, 0 to 3. Straight-line code gains
        nothing above 1.
    optimise : bool
        Run LLVM's optimization passes first. Traced programs are folded already; only
        hand-written loops profit.
    in_order : bool
        Keep the order of instructions, as for long programs.

    Raises
    ------
    CompileError
        If LLVM rejects the text.

    """
    machines = vars(_own).setdefault('machines', {})
    if level not in machines:
        machines[level] = _target_machine(level)
    return _assembled(text, machines[level], optimise, in_order)


def code_size(text: str) -> int:
    """
    Return the size in bytes of a module's machine code on the reference processor.

    Raises
    ------
    CompileError
        If LLVM rejects the text or cannot generate code for that processor.

    """
    # The same processor everywhere, so that the number does not depend on the machine.
    machine = _foreign(REFERENCE_TRIPLE).create_target_machine(cpu=REFERENCE_CPU, opt=1,
                                                               jit=True)
    objects = llvm.ObjectFileRef.from_data(_assembled(text, machine))
    size = 0
    for section in objects.sections():
        if section.is_text():
            size += int(section.size())
    return size


def _foreign(triple: str) -> Any:
    """Return a target other than this processor."""
    _initialized()
    try:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        return llvm.Target.from_triple(triple)
    except RuntimeError as error:
        raise CompileError(f'{triple}: {error}; expected a target that LLVM '
                           'supports') from None


def _parsed(text: str, machine: Any) -> Any:
    """Return the module of LLVM IR for a target machine."""
    try:
        module = llvm.parse_assembly(text, _context)
        module.verify()
    except RuntimeError as error:
        raise CompileError(f'LLVM IR: {error}; expected a valid module') from None
    module.triple = machine.triple
    module.data_layout = str(machine.target_data)
    return module


def _assembled(text: str, machine: Any, optimise: bool = False,
               in_order: bool = False) -> bytes:
    """Compile LLVM IR for a target machine."""
    module = _parsed(text, machine)
    if optimise and PASSES:
        options = llvm.create_pipeline_tuning_options(speed_level=2)
        builder = llvm.create_pass_builder(machine, options)
        builder.getModulePassManager().run(module, builder)
    with _in_program_order() if in_order or text.count('\n') > LONG else nullcontext():
        return bytes(machine.emit_object(module))


@contextmanager
def _in_program_order() -> Iterator[None]:
    """
    Switch LLVM's instruction scheduler off, while no other thread compiles.

    The processor schedules instructions itself. LLVM's scheduler lengthens the lives of
    the values of a long program, of which the register allocator then spills more: a
    third more time to compile, a tenth more code and time to run.
    """
    with _lock:
        llvm.set_option('', '-enable-misched=false')
        try:
            yield
        finally:
            llvm.set_option('', '-enable-misched=true')


class Code:
    """
    Machine code in executable memory; must outlive every use of its addresses.

    The code is unloaded when an array that only this object holds is freed. The garbage
    collector does not track arrays. An engine that it could find would be finalized,
    hence unloaded, before other finalizers of the same garbage, which may call the code.
    """

    def __init__(self, objects: bytes) -> None:
        """Load an object file into memory."""
        _initialized()
        # The engine wants a module and a code generator, but generates no code: the first
        # address that is asked for makes the object file executable.
        loader = llvm.Target.from_default_triple().create_target_machine(opt=0, jit=True)
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(''), loader)
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(objects))
        self._loaded = np.empty(0)
        # At the exit, threads may still run the code.
        finalize(self._loaded, self._engine.close).atexit = False

    def address(self, name: str) -> Address:
        """Return the address of a function; raise CompileError if it does not exist."""
        address = int(self._engine.get_function_address(name))
        if not address:
            raise CompileError(f"object file: no function '{name}'; expected one of "
                               'that name')
        return address

    def function(self, name: str, prototype: Callable[[Address], Any]) -> Any:
        """Return a ctypes function, which keeps this code alive."""
        function = prototype(self.address(name))
        function.code = self
        return function


def library(name: str, text: str) -> Code:
    """Return the code of a hand-written module, optimized by LLVM's passes."""
    return Code(cached(lambda: assemble(text, 2, optimise=True), name, text))
