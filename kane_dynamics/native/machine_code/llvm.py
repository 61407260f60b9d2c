"""LLVM, through llvmlite: assembly in, machine code out. Nothing else imports llvmlite."""

from collections.abc import Callable
from functools import cache
from typing import Any

from kane_dynamics.errors import CompileError
import llvmlite.binding as llvm

Address = int
# A processor that every machine can generate code for, so that its size is one number everywhere.
REFERENCE_TRIPLE, REFERENCE_CPU = 'x86_64-unknown-linux-gnu', 'x86-64-v3'


@cache
def _initialised() -> None:
    """Register this processor's code generator, once."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()


@cache
def _processor() -> tuple[str, str]:
    """Return this processor's name and features, as LLVM writes them."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _target_machine(level: int) -> Any:
    """Return a code generator for this very processor."""
    _initialised()
    name, features = _processor()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=name, features=features, opt=level, jit=True)


@cache
def features() -> dict[str, bool]:
    """Return what this processor can do, by LLVM's names."""
    return dict(llvm.get_host_cpu_features())


@cache
def fingerprint() -> str:
    """Name everything about compiler and processor that machine code depends on."""
    return '|'.join([llvm.get_default_triple(), *_processor(),
                     '.'.join(map(str, llvm.llvm_version_info))])


def assemble(text: str, level: int = 1, optimise: bool = False) -> bytes:
    """
    Compile LLVM assembly to an object file in memory.

    Parameters
    ----------
    text : str
        A module.
    level : int
        Effort of the code generator, 0 to 3. Straight-line code gains nothing past 1.
    optimise : bool
        Run LLVM's own pass pipeline first; a traced program is folded and shared already, so
        only hand-written loops profit.

    Raises
    ------
    CompileError
        LLVM refuses the text.

    """
    return _assembled(text, _target_machine(level), optimise)


def code_size(text: str) -> int:
    """
    Return the bytes of machine code that a module amounts to on the reference processor.

    Raises
    ------
    CompileError
        LLVM refuses the text, or cannot generate code for that processor.

    """
    _initialised()
    try:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        target = llvm.Target.from_triple(REFERENCE_TRIPLE)
    except RuntimeError as error:
        raise CompileError(f'no code for {REFERENCE_TRIPLE}: {error}') from None
    machine = target.create_target_machine(cpu=REFERENCE_CPU, opt=1, jit=True)
    objects = llvm.ObjectFileRef.from_data(_assembled(text, machine))
    return sum(int(section.size()) for section in objects.sections() if section.is_text())


def _assembled(text: str, machine: Any, optimise: bool = False) -> bytes:
    """Compile LLVM assembly for a target machine."""
    try:
        module = llvm.parse_assembly(text)
        module.verify()
    except RuntimeError as error:
        raise CompileError(f'LLVM refuses the assembly: {error}') from None
    module.triple = machine.triple
    module.data_layout = str(machine.target_data)
    if optimise:
        options = llvm.create_pipeline_tuning_options(speed_level=2)
        builder = llvm.create_pass_builder(machine, options)
        builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))


class Code:
    """Machine code in executable memory; keep this alive while an address is in use."""

    def __init__(self, objects: bytes) -> None:
        """Load an object file."""
        machine = _target_machine(1)
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(''), machine)
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(objects))
        self._engine.finalize_object()

    def address(self, name: str) -> Address:
        """Return where a function starts; CompileError when there is none of that name."""
        address = int(self._engine.get_function_address(name))
        if not address:
            raise CompileError(f"the object file holds no function '{name}'")
        return address

    def function(self, name: str, prototype: Callable[[Address], Any]) -> Any:
        """Return a function as ctypes calls it; it keeps this code alive."""
        function = prototype(self.address(name))
        function.code = self
        return function
