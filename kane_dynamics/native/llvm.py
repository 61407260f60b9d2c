"""LLVM, through llvmlite: assembly in, machine code out. Nothing else imports llvmlite."""

from functools import cache
from typing import Any

from kane_dynamics.errors import CompileError
import llvmlite.binding as llvm

Address = int


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
    machine = _target_machine(level)
    try:
        module = llvm.parse_assembly(text)
        module.verify()
    except RuntimeError as error:
        raise CompileError(f'LLVM refuses the assembly: {error}') from None
    module.triple = llvm.get_default_triple()
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
