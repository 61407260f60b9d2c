"""Functions over any scalar, with what a robot supplies to them, as traced programs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
import hashlib
from inspect import signature
import re
from types import CodeType, FunctionType
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.native.runtime.kernel import Argument
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
import numpy as np

LIBRARY = __name__.partition('.')[0]
SUPPLIED = ('wrench', 't', 'parameters', 'limits')  # what a function may ask for by name
_ASKED: dict[tuple[CodeType | None, int], tuple[str, ...]] = {}  # by code and number of inputs


@dataclass(frozen=True)
class Supply:
    """
    The values that a robot supplies to functions that ask for them.

    Attributes
    ----------
    no_wrench : (k, 6) array
        The wrenches of a call without any, at the k declared frames.
    time : tuple of Argument
        The time, where the equations depend on it.
    block, physical : int
        Length of the block of parameters, and of its physical ones, which come first.

    """

    no_wrench: np.ndarray
    time: tuple[Argument, ...]
    block: int
    physical: int


class RobotFunction:
    """
    A function of a robot to trace.

    Parameters
    ----------
    function : callable
        Takes a traced array for each input, or a scalar where the shape is (), and by
        name those of `SUPPLIED` that it names.
    name : str
        A C identifier.
    inputs : mapping of str to shape, or to Argument
        In the order of the function.
    supply : Supply
        Of the robot.
    constants : shape, optional
        Of one more input, the last one, in place of the robot's parameters.
    shape : shape, optional
        Of the result; tracing raises InputError for another one.

    Attributes
    ----------
    arguments : list of Argument
        Those of the kernel: the inputs, then the wrench and the time if the function
        asks for them and the robot has them.
    unread : int
        1 if the function asks for the time and the robot does not depend on it, else 0:
        calls may end with a time that nothing reads.
    program : callable
        Traces the function.
    is_of_library : bool
        Whether `origin` identifies the function, as those of this library.

    Raises
    ------
    InputError
        The function asks for something that is neither an input nor supplied.

    """

    def __init__(self, function: Callable[..., Any], name: str,
                 inputs: Mapping[str, Shape | Argument], supply: Supply,
                 constants: Shape | None = None, shape: Shape | None = None) -> None:
        """Read what the function asks for."""
        original: Any = function
        while isinstance(original, partial):
            original = original.func
        module = str(getattr(original, '__module__', ''))
        self.is_of_library = module.partition('.')[0] == LIBRARY
        self.arguments: list[Argument] = []
        for key, value in inputs.items():
            if isinstance(value, Argument):
                self.arguments.append(value)
            else:
                self.arguments.append(Argument(key, tuple(value)))
        count = len(self.arguments)
        # The constants are one more input of the function, but none of calls of the
        # kernel.
        asked = _asked(function, name, count if constants is None else count + 1)
        if 'wrench' in asked and len(supply.no_wrench):
            none = supply.no_wrench
            self.arguments.append(Argument('wrench', none.shape, default=none))
        self.unread = 0
        if 't' in asked:
            self.arguments += supply.time
            self.unread = 1 - len(supply.time)
        block: Shape = (supply.block,) if constants is None else constants
        program_inputs = []
        for argument in self.arguments:
            program_inputs.append((argument.name, argument.shape))
        program_inputs.append(('parameters', block))
        # A partial function of plain values, since these are what its `origin`
        # describes.
        self.program = partial(_traced, function, name, tuple(program_inputs), count,
                               constants is not None, asked, supply.physical, shape)


def _asked(function: Callable[..., Any], name: str, count: int) -> tuple[str, ...]:
    """Return the names that a function asks for beside its `count` inputs."""
    # Functions of the same code ask for the same; to read a signature takes a while.
    key = getattr(function, '__code__', None), count
    if key in _ASKED:
        return _ASKED[key]
    parameters = list(signature(function).parameters.values())
    positional = []
    by_name = []
    gathers = False  # with `*inputs`, only what stands behind them is asked for by name
    for parameter in parameters:
        if parameter.kind is parameter.VAR_POSITIONAL:
            gathers = True
        elif parameter.kind is parameter.KEYWORD_ONLY:
            by_name.append(parameter)
        elif parameter.kind is not parameter.VAR_KEYWORD:
            positional.append(parameter)

    # Named behind `*inputs`, or behind as many positional parameters as there are
    # inputs.
    if not gathers:
        by_name += positional[count:]
    # What has a default is optional; all else must be something that the robot supplies.
    required = set()
    for parameter in by_name:
        if parameter.default is parameter.empty:
            required.add(parameter.name)
    if not required <= set(SUPPLIED) or (len(positional) < count and not gathers):
        names = ', '.join(parameter.name for parameter in parameters)
        raise InputError(f'{name}: the function takes {names}; expected {count} inputs, '
                         'then '
                         f'some of {", ".join(SUPPLIED)}')
    asked = []
    for parameter in by_name:
        if parameter.name in SUPPLIED:
            asked.append(parameter.name)
    if isinstance(function, FunctionType):
        _ASKED[key] = tuple(asked)
    return tuple(asked)


def _traced(function: Callable[..., Any], name: str, inputs: Sequence[tuple[str, Shape]],
            count: int, has_constants: bool, asked: Sequence[str], physical: int,
            shape: Shape | None) -> Program:
    """Trace a function of `count` inputs, constants, and what it asks for by name."""
    def traced(*arrays: Any) -> Any:
        values = []
        for x in arrays:
            values.append(x[()])  # a scalar, of an array without an axis
        # The last input is the block: parameters, then limits of a state.
        block = values[-1]
        positional = values[:count]
        if has_constants:
            positional.append(block)

        # What the function asks for by name; a robot may have no wrench or time.
        supplied: dict[str, Any] = {'wrench': None, 't': 0.0,
                                    'parameters': block[:physical],
                                    'limits': block[physical:]}
        for (key, _), value in zip(inputs[count:-1], values[count:]):
            supplied[key] = value
        by_name = {}
        for key in asked:
            by_name[key] = supplied[key]
        return function(*positional, **by_name)
    program = trace_program(name, traced, inputs)
    if shape not in (None, program.shape):
        raise InputError(f'{name}: the function returns shape {program.shape}; expected '
                         f'{shape}')
    return program


def identifier(*words: str | Sequence[str]) -> str:
    """
    Return a C identifier of these words, which other words do not have.

    Kernels of one robot differ in their names. Names of frames lose characters
    in an identifier, so that a digest of all words follows them.
    """
    parts: list[str] = []
    for word in words:
        if isinstance(word, str):
            parts.append(word)
        else:
            parts.extend(word)
    digest = hashlib.sha256(repr(parts).encode()).hexdigest()[:8]
    return re.sub('[^A-Za-z0-9]', '_', '_'.join([*parts, digest]))
