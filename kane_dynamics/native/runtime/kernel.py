"""
Kernel: one compiled program with its input checks, parameters and entry points.

An `Argument` is the name, shape and default of an input, and checks the values given for
it. A `Kernel` compiles a program and calls it for one state, a batch, or rows one after
the other. `batch_kernel` makes the kernel of a function of arrays alone.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
import math
import sys
from typing import Any

from kane_dynamics._util.fork_safety import ForkSafeLock
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.native.backends.llvm_math import size_limit
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.native.backends.llvm_simd import lane_text, width
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.machine_code.compiling import gc_paused, logged
from kane_dynamics.native.python_call import entry
from kane_dynamics.native.python_call.entry import (CallForm, EntryTable, KernelFunction,
                                                    Lanes, ResultPart, Signature)
from kane_dynamics.native.runtime.loops import (address, BAD_INPUT, loops,
                                                most_of_one_thread, PROBE_CALLS, repeat,
                                                run_batch)
from kane_dynamics.native.tracing.program import origin, Program, Shape, trace_program
import numpy as np
from numpy.typing import NDArray

SYMBOL = 'kernel'  # name of the kernel function in its object file
_TRACING = ForkSafeLock()  # concurrent tracing would only contend for the GIL
ResultCheck = Callable[[dict[str, Array]], 'Kernel | None']
NO_NUMBERS: Mapping[str, NDArray[np.intp]] = {}
MAX_RESULTS = 2**31  # entries of one batch's result; a larger number is likely a mistake


@dataclass(frozen=True)
class Argument:
    """
    Name, shape and default of a kernel argument.

    Attributes
    ----------
    name : str
    shape : tuple of int
        Shape for a single state; a batch has one more leading axis.
    labels : tuple of str
        Names of the entries of the last axis, for messages.
    default : array, optional
        Used when the argument is not given; read at each call.

    """

    name: str
    shape: Shape
    labels: tuple[str, ...] = ()
    default: Array | None = None


def checked(argument: Argument, value: Any) -> Array:
    """Return a value as a finite C-contiguous float64 array; else raise InputError."""
    array = converted(argument, value)
    require_finite(argument, array)
    return array


def converted(argument: Argument, value: Any) -> Array:
    """Return a value as a C-contiguous float64 array of one state or a batch."""
    name = argument.name
    shape = argument.shape
    # By the attribute, since numpy.ma is slow to import.
    masked = getattr(value, 'mask', None) if isinstance(value, np.ndarray) else None
    if masked is not None and np.any(masked):
        raise InputError(f'{name}: a masked array with {np.count_nonzero(masked)} '
                         f'masked entries; expected numbers of shape {_shapes(shape)}')
    try:
        array = np.asarray(value)
    except ValueError:
        raise InputError(f'{name}: not a rectangular array; expected shape '
                         f'{_shapes(shape)}') from None
    # Kinds of numbers: floats, signed and unsigned integers; neither bool nor object.
    if array.dtype.kind not in 'fiu':
        raise InputError(f'{name}: dtype {array.dtype}; expected numbers of shape '
                         f'{_shapes(shape)}')
    if array.shape != shape and array.shape[1:] != shape:
        expected = _shapes(shape)
        if argument.labels:
            expected += f', of {", ".join(argument.labels)}'
        raise InputError(f'{name}: shape {array.shape}; expected {expected}')
    return np.asarray(array, dtype=np.float64, order='C')


def _shapes(shape: Shape) -> str:
    """Return the shapes of one state and of a batch as text."""
    return f'{shape} or (N, {", ".join(map(str, shape))})'


def require_finite(argument: Argument, array: Array) -> None:
    """Raise InputError that names the first entry that is not finite or too large."""
    limit = size_limit(argument.name)
    # NaN compares as false, infinity exceeds the largest number.
    good = np.abs(array) <= min(limit, sys.float_info.max)
    if good.all():
        return
    place = tuple(np.argwhere(~good)[0].tolist())
    number = array[place]
    entry = argument.name
    if place:
        entry += f'[{", ".join(map(str, place))}]'
    if argument.labels:
        entry += f" (joint '{argument.labels[place[-1]]}')"
    expected = 'a finite number'
    if np.isfinite(number):  # only positions have a limit
        expected += f' of at most {limit:g} rad or m'
    raise InputError(f'{entry}: {number}; expected {expected}')


def require_writable(name: str, out: Any, shape: Shape) -> None:
    """Raise InputError unless a result of a shape can be written to `out`."""
    if not (isinstance(out, np.ndarray) and out.dtype == np.float64
            and out.shape == shape and out.flags.writeable):
        described = type(out).__name__
        if isinstance(out, np.ndarray):
            described = f'{out.dtype} array of shape {out.shape}'
        raise InputError(f'{name}: out: {described}; expected a writeable '
                         f'float64 array of shape {shape}')


def _same_rows(a: Array, b: Array) -> bool:
    """Return whether the rows of two arrays share the same memory."""
    return address(a) == address(b) and a.strides[:1] == b.strides[:1]


def windows(rows: Array, length: int, step: int = 1) -> Array:
    """Return overlapping views of `length` rows each, which begin `step` rows apart."""
    count = (len(rows) - length) // step + 1
    stride = rows.strides[0]
    return np.ndarray((count, length, *rows.shape[1:]), rows.dtype, rows, 0,
                      (step * stride, *rows.strides))


class Kernel:
    """
    Compiled program; its code for single states and that for batches, each at first use.

    Parameters
    ----------
    name : str
        Name used in messages.
    program : callable
        Traces the program; called if the cache does not hold its code for single states
        or for batches.
    key : str or None
        Everything the program depends on, for the cache, beside its inputs, its result
        and what `origin` tells. None always traces and uses the generated code as the
        key.
    arguments : sequence of Argument
        In the program's order; those with a default come last.
    parameters : array
        Passed after the arguments; read at each call, copied for a batch.
    shape : tuple of int
        Shape of the result for one state.
    reason : callable, optional
        Called with the arguments of a state whose result is not finite; raises an error
        that explains it, or returns another kernel that answers in its place, or None.
    single : callable, optional
        Traces the program for single states, if it is another one of the same function.
    in_order : bool
        Keep the order of the program in the machine code of single states, as in that of
        batches. LLVM's scheduler would move uses of constraint rows and of their inverse
        apart, and spill more of them.
    unread : int
        Number of further arguments with which calls may end, and which nothing reads: the
        time, where the robot does not depend on it.

    """

    def __init__(self, name: str, program: Callable[[], Program], key: str | None,
                 arguments: Sequence[Argument], parameters: Array, shape: Shape,
                 reason: ResultCheck | None = None,
                 single: Callable[[], Program] | None = None,
                 in_order: bool = False, unread: int = 0) -> None:
        """Store the program, and what its calls are checked with."""
        self.name = name
        self.shape = shape
        self.arguments = tuple(arguments)
        self.parameters = parameters
        self._reason = reason
        # Programs are traced when code is needed: a hit of the cache traces nothing.
        self._program = program
        self._in_order = in_order
        self._of_one = program if single is None else single
        self.defaults: list[Array] = []
        # Of the arguments that every call must have; a scalar is an array of one number.
        shapes: list[Shape] = []
        self._ranks = []  # axes of the arguments, the parameters and one state's result
        inputs = []
        default_sizes = []
        limits = []
        for argument in self.arguments:
            if argument.default is None:
                shapes.append(argument.shape or (1,))
            else:
                self.defaults.append(argument.default)
                default_sizes.append(argument.default.size)
            limits.append(size_limit(argument.name))
            self._ranks.append(len(argument.shape))
            inputs.append((argument.name, argument.shape))
        self._ranks += [parameters.ndim, len(shape)]
        size = math.prod(shape)
        parts = (ResultPart(shape, 0, 1, size, size),) if shape else ()
        self._signature = Signature(tuple(shapes), tuple(default_sizes), tuple(limits),
                                    size, parts, unread=unread)
        self._lanes = Lanes()  # of entry points; copies with other parameters share them
        self._key: str | None = None
        if key:
            origin_of_single = origin(single) if single else ''
            self._key = '|'.join([key, origin(program), origin_of_single,
                                  f'{inputs} {parameters.shape} {shape}'])
        self._compiling = ForkSafeLock()
        # By kind of code; copies with other parameters share it.
        self._functions: dict[str, KernelFunction] = {}

    def _function(self, kind: str, text: Callable[[], str],
                  in_order: bool = False) -> KernelFunction:
        """
        Return the machine code of a text: compiled once, or from the cache on disk.

        Without a key, the text is traced now and is the key itself.
        """
        def assembled() -> bytes:
            with logged(self.name):
                with _TRACING.held():
                    source = text()
                return llvm.assemble(source, in_order=in_order)
        with self._compiling.held(), gc_paused():
            if kind in self._functions:  # another thread was faster
                return self._functions[kind]
            key = self._key
            if key is None:
                with _TRACING.held():
                    key = text()
                text = partial(str, key)  # not traced again
            objects = llvm.cached(assembled, self.name, key, kind)
            code = llvm.Code(objects)
            function = KernelFunction(code, code.address(SYMBOL))
            self._functions[kind] = function
        return function

    def with_parameters(self, parameters: Array,
                        reason: ResultCheck | None = None) -> 'Kernel':
        """Return a kernel with the same machine code and other parameters."""
        kernel = object.__new__(Kernel)
        kernel.__dict__.update(self.__dict__)  # `copy` takes several times as long
        kernel.parameters = parameters
        kernel._reason = reason
        return kernel

    def traced(self) -> Program:
        """Trace the program."""
        return self._program()

    @property
    def is_compiled(self) -> bool:
        """Return whether it has code, of single states or of batches."""
        return bool(self._functions)

    def compile(self) -> KernelFunction:  # noqa: A003
        """Return the code of single states, compiled if that was not done yet."""
        kind = ''
        if kind in self._functions:
            return self._functions[kind]
        return self._function(kind, lambda: module_text(self._of_one(), SYMBOL),
                              self._in_order)

    def compile_entry(self) -> None:
        """Compile the entry points of calls with one state, and the code of single states."""
        self.compile()
        entry.supported()

    def compile_lanes(self) -> llvm.Address:
        """Return the address of the code of batches, compiled if that was not done yet."""
        kind = f'{width()} lanes'
        if kind not in self._functions:
            # Lanes need many registers: in program order fewer values are spilled.
            code = self._function(kind, lambda: lane_text(self._program(), SYMBOL, width()),
                                  in_order=True)
            driver = loops()
            self._lanes.run = driver.address('run_batch')
            self._lanes.driver = driver  # its code lives as long as its address
            self._lanes.width = width()
            self._lanes.most = PROBE_CALLS * width()
            self._lanes.kernel = code.address
        return self._functions[kind].address

    @property
    def address(self) -> llvm.Address:
        """Return the address of the code of single states, compiled at the first use."""
        return self.compile().address

    def entry(self, doc: str, fallback: Callable[..., Any],
              parts: Sequence[ResultPart] | None = None) -> Callable[..., Any]:
        """
        Return a native entry point, or the fallback without support for it.

        With parts, the arrays of the result that its calls return as a tuple.
        """
        if 0 in self.shape:  # nothing to compute, and no code
            return fallback
        signature = self._signature
        if parts is not None:
            signature = replace(signature, parts=tuple(parts))
        return entry.entry(self.name, doc, self.compile(), signature,
                           [*self.defaults, self.parameters], fallback,
                           lanes=self._lanes)

    def entry_with_memory(self, doc: str, memory: str,
                          fallback: Callable[..., Array] | None = None
                          ) -> Callable[..., Array]:
        """
        Return a native entry point that updates one of its arguments.

        The last entries of the kernel's result, a row, replace those of the argument, and
        the first ones are returned; a call that raises an error changes nothing.

        Parameters
        ----------
        doc : str
            Docstring of the function.
        memory : str
            Name of the argument, a row without a default.
        fallback : callable, optional
            Called with the same arguments where they do not match exactly, in place of
            the kernel; returns its result.

        """
        place, signature = self._with_memory(memory)
        returned = signature.parts[0].width
        call = fallback or self

        def divided(*values: Any) -> Array:
            row = call(*values)
            values[place][:] = row[returned:]
            return row[:returned]
        return entry.entry(self.name, doc, self.compile(), signature,
                           [*self.defaults, self.parameters], divided)

    def entry_by_name(self, doc: str, form: CallForm, fallback: Callable[..., Array],
                      memory: str | None = None) -> Callable[..., Array]:
        """
        Return a native entry point with keywords and optional arguments.

        Parameters
        ----------
        doc : str
            Docstring of the function.
        form : CallForm
            Of the arguments without a default.
        fallback : callable
            Called with the same arguments where they do not match; returns what the
            entry point does.
        memory : str, optional
            As of `entry_with_memory`.

        """
        signature = self._signature
        if memory is not None:
            _, signature = self._with_memory(memory)
        return entry.entry(self.name, doc, self.compile(), signature,
                           [*self.defaults, self.parameters], fallback, form)

    def _with_memory(self, memory: str) -> tuple[int, Signature]:
        """Return the number of an argument, and the signature of calls that update it."""
        place = [argument.name for argument in self.arguments].index(memory)
        return place, self._signature.with_memory(place)

    def bind(self, arguments: Sequence[Array], result: Array, doc: str) -> Callable[[],
                                                                                    Any]:
        """Return a function without arguments that calls the kernel on fixed arrays."""
        return entry.bound(self.name, doc, self.compile(), self._signature,
                           [*arguments, self.parameters, result],
                           self._fallback(arguments, result))

    def table(self, arguments: Sequence[Array], result: Array) -> EntryTable:
        """Return the table of a native method that calls the kernel on fixed arrays."""
        return entry.bound_table(self.compile(), self._signature,
                                 [*arguments, self.parameters, result],
                                 self._fallback(arguments, result))

    def _fallback(self, arguments: Sequence[Array], result: Array) -> Callable[[], Any]:
        """Return the call for arrays that the machine code does not accept."""
        read = ', '.join(argument.name for argument in self.arguments)
        out = result if self.shape else None  # a number is returned, not written

        def call(*values: Any, **named: Any) -> Any:
            if values or named:
                passed = [type(value).__name__ for value in values]
                passed += named
                raise InputError(f'workspace: {self.name}({", ".join(passed)}); expected no '
                                 f'arguments: it reads the arrays of the workspace ({read})')
            return self(*arguments, out=out)
        return call

    def __call__(self, *values: Any, out: Any = None) -> Any:
        """
        Evaluate one state or a batch of convertible arguments.

        None, or an argument left out at the end, selects the default.

        Raises
        ------
        InputError
            If an argument has a wrong type or shape or is not finite, or the result is
            not finite.

        """
        # Arguments that nothing reads come last; those that are left out have defaults.
        count = len(self.arguments)
        if count < len(values) <= count + self._signature.unread:
            values = values[:count]
        elif len(values) > count:
            names = ', '.join(argument.name for argument in self.arguments)
            raise InputError(f'{self.name}: {len(values)} arguments; expected at most '
                             f'{count}: {names}')
        values += (None,) * (count - len(values))
        arrays = []
        for argument, value in zip(self.arguments, values, strict=True):
            if value is None:
                arrays.append(self._default(argument))
            else:
                arrays.append(converted(argument, value))
        states = self._count(values, arrays)
        shape = self.shape if states is None else (states, *self.shape)
        if math.prod(shape) > MAX_RESULTS:
            raise InputError(f'{self.name}: {states} states give {math.prod(shape)} '
                             f'numbers; expected at most {MAX_RESULTS} per call')
        result = np.empty(shape) if out is None else self._result(out, shape)
        if states is None:
            self._single(arrays, result)
        else:
            # A result may overwrite an argument row by row. Where rows differ, one would
            # be overwritten before it is read, so the result is computed elsewhere.
            for array in arrays:
                if np.may_share_memory(result, array) and not _same_rows(result, array):
                    result = np.empty(shape)
                    break
            self._batch(arrays, result, states)
        if out is not None:
            if result is not out:
                out[...] = result
            return out
        return float(result) if shape == () else result

    def _single(self, arrays: Sequence[Array], result: Array) -> None:
        """Compute the result of one state."""
        for argument, array in zip(self.arguments, arrays):
            require_finite(argument, array)
        if not result.size:  # such as the rows of a robot without constraints
            return
        blocks = [*arrays, self.parameters, result]
        repeat(self.compile().address, [address(block) for block in blocks], [0] * len(blocks), 1)
        self._check(result, arrays, None)

    def _batch(self, arrays: Sequence[Array], result: Array, count: int) -> None:
        """Compute the results of a batch; the native code flags non-finite numbers."""
        flags = BAD_INPUT
        if result.size:
            flags = self.run(arrays, result, count)
        if flags & BAD_INPUT:
            for argument, array in zip(self.arguments, arrays):
                require_finite(argument, array)
        if flags:
            self._check(result, arrays, count)

    def scan(self, inputs: Sequence[Array], result: Array, *,
             constants: Array | None = None, reverse: bool = False) -> None:
        """
        Compute the rows of a result one after the other.

        Numbers are not checked; the GIL is released.

        A row may depend on an earlier one (a carry): pass views of one array that are
        shifted by a row, such as ``states[:-1]`` as an input and ``states[1:]`` as the
        result.

        Parameters
        ----------
        inputs : sequence of float64 arrays
            The arguments, each with a row for each row of the result, or of one state,
            which all share. Each row is C-contiguous.
        result : float64 array
            Each row is C-contiguous; at least one row.
        constants : float64 array, optional
            In place of the kernel's parameters.
        reverse : bool
            From the last row to the first.

        """
        if constants is None:
            constants = self.parameters
        count = len(result)
        blocks = (*inputs, constants, result)
        addresses = list(map(address, blocks))
        # A stride of 0 shares a block that has no axis of rows.
        strides = []
        for k, (block, rank) in enumerate(zip(blocks, self._ranks, strict=True)):
            stride = block.strides[0] if block.ndim > rank else 0
            if stride:
                self._require_rows(f'input {k}', block, count)
            strides.append(stride)
        if reverse:  # begin at the last rows, step back
            for k, stride in enumerate(strides):
                addresses[k] += (count - 1) * stride
                strides[k] = -stride
        repeat(self.compile().address, addresses, strides, count)

    def rollout(self, inputs: Sequence[Array], result: Array, steps: int, *,
                constants: Array | None = None,
                extremes: tuple[Array, Array] | None = None) -> int:
        """
        Compute several steps of N states, as `scan` for each, in SIMD lanes and threads.

        Parameters
        ----------
        inputs : sequence of float64 arrays
            The arguments, each (N, steps, ...), or of one state; all states share an
            axis N of length 1, all steps an axis of steps of length 1.
        result : float64 array
            (N, steps, ...), or (N, 1, ...), where each step overwrites the last one.
        steps : int
            At least 1.
        constants : float64 array, optional
            In place of the kernel's parameters.
        extremes : two (N, size) arrays, optional
            Updated with the minimum and maximum of each state's results over the steps.

        Returns
        -------
        int
            Combination of `BAD_INPUT` and `BAD_RESULT`.

        """
        if constants is None:
            constants = self.parameters.copy()  # other threads may change them meanwhile
        blocks = [*inputs, constants, result]
        # Distances in memory from state to state and from step to step; 0 where all
        # share one.
        rows = []
        for block, rank in zip(blocks, self._ranks, strict=True):
            lane = 0
            step = 0
            if block.ndim > rank and block.shape[0] > 1:
                lane = block.strides[0]
            if block.ndim > rank and block.shape[1] > 1:
                step = block.strides[1]
            if block.ndim > rank and len(block):
                self._require_rows('a block', block[0], 1)
            rows.append((address(block), lane, step, 0))
        return run_batch(self.compile_lanes(), rows, len(result), steps=steps,
                         extremes=extremes)

    def run(self, arrays: Sequence[Array], result: Array, count: int,
            numbers: Mapping[str, NDArray[np.intp]] = NO_NUMBERS,
            constants: Array | None = None) -> int:
        """
        Compute the results of a batch, without checks of numbers.

        Parameters
        ----------
        arrays : sequence of float64 arrays
            The arguments, each of one state, which all share, or of `count` states. Each
            state is C-contiguous.
        result : float64 array
            Of `count` results, each C-contiguous.
        count : int
            At least 1.
        numbers : mapping
            By name of an argument, the number of the row of each of the states,
            (count,).
        constants : float64 array, optional
            In place of the kernel's parameters.

        Returns
        -------
        int
            Combination of `BAD_INPUT` and `BAD_RESULT`; 0 if all numbers are finite.

        """
        if constants is None:
            constants = self.parameters.copy()  # other threads may change them meanwhile
        # As in `rollout`, but with numbers that choose the rows of an argument.
        rows = []
        ranks = self._ranks[:len(self.arguments)]
        for array, argument, rank in zip(arrays, self.arguments, ranks, strict=True):
            stride = array.strides[0] if array.ndim > rank else 0
            row_numbers = numbers.get(argument.name)
            if stride:
                chosen = array if row_numbers is None else row_numbers
                self._require_rows(argument.name, chosen, count)
            rows.append((address(array), stride, 0,
                         0 if row_numbers is None else address(row_numbers)))
        self._require_rows('result', result, count)
        rows.append((address(constants), 0, 0, 0))
        rows.append((address(result), result.strides[0], 0, 0))
        flags = run_batch(self.compile_lanes(), rows, count)
        self._lanes.most = most_of_one_thread(self._lanes.kernel)
        return flags

    def _require_rows(self, name: str, rows: NDArray[Any], count: int) -> None:
        """Raise InputError for arrays that are too short, and for rows that are not contiguous."""
        if len(rows) < count:
            raise InputError(f'{self.name}: {name} has {len(rows)} rows; expected {count}')
        if count and not rows[0].flags.c_contiguous:
            raise InputError(f'{self.name}: {name} has rows with strides '
                             f'{rows[0].strides}; expected C-contiguous rows')

    def _check(self, result: Array, arrays: Sequence[Array], count: int | None) -> None:
        """Raise InputError if the result is not finite."""
        if np.isfinite(result).all():
            return
        rows = result.reshape(count or 1, -1)
        invalid = ~np.isfinite(rows).all(axis=1)
        self.answer(result, arrays, count, np.flatnonzero(invalid).tolist())

    def answer(self, result: Array, arrays: Sequence[Array], count: int | None,
               places: Sequence[int]) -> None:
        """Compute the results of some states by another kernel, or raise InputError."""
        rows = result.reshape(count or 1, -1)
        # Another kernel explains a result, or answers: one in regular speeds, for
        # example.
        for bad in places:
            state = {}
            for argument, array, rank in zip(self.arguments, arrays, self._ranks):
                state[argument.name] = array[bad] if array.ndim > rank else array
            kernel = None if self._reason is None else self._reason(state)
            if kernel is None:
                place = '' if count is None else f' of state {bad}'
                raise InputError(
                    f'{self.name}: the result{place} is not finite: the arguments are '
                    'too large, or the mass matrix is singular at this configuration (a '
                    'body without mass moves alone, or a thin rod turns about itself); '
                    'expected a finite result')
            rows[bad] = np.ravel(kernel(*state.values()))

    def _default(self, argument: Argument) -> Array:
        if argument.default is None:
            raise InputError(f'{self.name}: {argument.name} is missing; expected an '
                             f'array of shape {argument.shape}')
        return argument.default

    def _count(self, values: Sequence[Any], arrays: Sequence[Array]) -> int | None:
        """Return the length of the batch, None for one state; arguments must agree."""
        # Single states have no length: mixed with batches, they are an error.
        lengths: list[int | None] = []
        for argument, value, array in zip(self.arguments, values, arrays):
            if value is not None:  # a default is one that all states share
                is_batch = array.ndim > len(argument.shape)
                lengths.append(array.shape[0] if is_batch else None)
        if len(set(lengths)) > 1:
            shapes = [f'{argument.name} {array.shape}' for argument, value, array
                      in zip(self.arguments, values, arrays) if value is not None]
            raise InputError(f'{self.name}: arguments {", ".join(shapes)}; expected all '
                             'single states or all batches of one length')
        return lengths[0]

    def _result(self, out: Any, shape: Shape) -> Array:
        """Check `out`; return the array to write to, `out` itself if possible."""
        require_writable(self.name, out, shape)
        # Only such memory can be written by machine code; else the result is copied
        # there.
        direct = out.flags.c_contiguous and out.flags.aligned and out.dtype.isnative
        return out if direct else np.empty(shape)


def batch_kernel(name: str, function: Callable[..., Any],
                 inputs: Sequence[tuple[str, Shape]], shape: Shape, *,
                 ahead: bool = True) -> Kernel:
    """
    Return the kernel of a function without parameters.

    Parameters
    ----------
    name : str
        A C identifier.
    function : callable
        Takes traced arrays; `origin` must tell it from others.
    inputs : sequence of (str, shape)
        Names and shapes of the arrays.
    shape : tuple of int
        Shape of the result.
    ahead : bool
        Compile the code of single states now; else at its first use, if ever.

    """
    # The block of parameters that every kernel has is empty.
    def program() -> Program:
        return trace_program(name, lambda *arrays: function(*arrays[:-1]), [
            *inputs, ('parameters', (0,))])
    arguments = [Argument(key, value) for key, value in inputs]
    kernel = Kernel(name, program, f'{name} {inputs}', arguments, np.zeros(0), shape)
    if ahead:
        kernel.compile()
    return kernel
