"""`Workspace`: quantities on preallocated arrays, for loops without allocation."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.native.python_call import entry
from kane_dynamics.native.python_call.entry import EntryTable, refuse_uninitialized
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.kernel_set import ALL, FRAME_QUANTITIES, KernelSet
import numpy as np

# Results that are arrays of the state.
STATE_RESULTS = {'inverse_dynamics': 'tau', 'forward_dynamics': 'udot'}
PLACES = {name: place for place, name in enumerate(ALL)}  # indices of tables
DOCS = {name: f'Compute {name} from the arrays of the workspace; see `Robot.{name}`.'
        for name in ALL}


class _Quantity:
    """A quantity as a method, for interpreters without direct machine-code methods."""

    def __init__(self, name: str) -> None:
        self.name, self.__doc__ = name, DOCS[name]

    def __get__(self, workspace: Workspace | None, owner: type | None = None) -> Any:
        if workspace is None:
            return self
        if not hasattr(workspace, '_at'):  # not made by its class
            refuse_uninitialized(workspace)
        return workspace._function(self.name)


class Workspace(entry.NativeMethods):
    """
    Arrays of one robot's state, and its quantities as functions without arguments.

    Write into `q` (n_q,), `u`, `udot`, `tau` (n,) (SI units, zero at first) and, where
    the robot declares wrench frames, `wrench` (k, 6), and `t`, an array without axes,
    where its speeds or constraints are functions; then call any quantity of `Robot`
    without arguments. ``inverse_dynamics()`` writes to and returns `tau`,
    ``forward_dynamics()`` `udot`; every other quantity returns an array of its own, the
    same one at every call (derivatives (3, n, n), which unpacks), and energies return a
    float. A call allocates no array and runs no Python. It reads the robot's
    `parameters` as they are.

    The arrays cannot be rebound or resized. A workspace belongs to one thread. A
    quantity compiles on first use. A call raises InputError if an argument or the result
    is not finite; the array of the result is invalid then.

    Parameters
    ----------
    kernels : KernelSet
        The robot's; `Robot.bind` passes them.

    """

    __slots__ = ('__weakref__', '_at', '_kernels', '_owned', '_states', 'q', 't', 'tau',
                 'u', 'udot', 'wrench')
    _unmade: Array | None = None  # of the class: initial tables
    q: Array
    u: Array
    udot: Array
    tau: Array
    wrench: Array
    t: Array
    _kernels: KernelSet
    _states: dict[str, Array]
    _at: dict[tuple[str, str], Callable[[], Any]]
    _owned: dict[str, EntryTable]  # tables in use

    def __new__(cls, kernels: KernelSet) -> Workspace:
        """
        Allocate the arrays; quantities compile on first use.

        The class has machine-code methods where the interpreter supports them. A
        subclass has methods in Python.
        """
        if not isinstance(kernels, KernelSet):
            raise InputError(f'kernels: a {type(kernels).__name__}; expected those of a '
                             'robot: robot.bind() returns a workspace')
        # The class in machine code, where this interpreter has one.
        kind = cls
        if cls is Workspace and entry.supported():
            kind = _of_machine_code()
        self = object.__new__(kind)
        equations = kernels.equations
        states = {'q': _fixed((equations.n_q,))}
        for name in ('u', 'udot', 'tau'):
            states[name] = _fixed((equations.n,))
        if len(kernels.no_wrench):
            states['wrench'] = _fixed(kernels.no_wrench.shape)
        if equations.timed:
            states['t'] = _fixed(())
        tables = None if self._unmade is None else self._unmade.copy()
        # Attributes of a workspace cannot be assigned from outside.
        for name, value in {**states, '_kernels': kernels, '_states': states, '_at': {},
                            '_owned': {}, '_tables': tables}.items():
            object.__setattr__(self, name, value)
        return self

    def __setattr__(self, name: str, value: Any) -> None:
        """Raise InputError: the compiled calls read the existing memory."""
        raise InputError(f'workspace.{name}: assigned; expected a write into its array: '
                         f'workspace.{name}[:] = ...')

    def __delattr__(self, name: str) -> None:
        """Raise InputError: the compiled calls read the existing memory."""
        raise InputError(f"a workspace's {name} cannot be deleted; expected a workspace "
                         'that is dropped as a whole')

    def __reduce__(self) -> Any:
        """Raise TypeError: a workspace is bound to memory of this process."""
        raise TypeError('workspace: copied or pickled; expected robot.bind() again')

    def at_frame(self, name: str, frame: str) -> Callable[[], Any]:
        """
        Return a frame quantity as a function without arguments.

        Parameters
        ----------
        name : str
            One of `FRAME_QUANTITIES`: frame_pose, frame_velocity, frame_acceleration,
            partial_velocities, partial_velocity_rates.
        frame : str
            Of the robot's model.

        Raises
        ------
        InputError
            An unknown quantity or frame; the message lists the valid ones.

        """
        _require_name(name, 'name', "a frame quantity, such as 'frame_pose'")
        _require_name(frame, 'frame', 'a frame')
        if name not in FRAME_QUANTITIES:
            raise InputError(f"no frame quantity '{name}'; expected one of "
                             f'{", ".join(FRAME_QUANTITIES)}')
        return self._bound_at(self._kernels.kernel(name, frame), frame)

    def reaction(self, joint: str) -> Callable[[], Any]:
        """
        Return `Robot.joint_reaction` at a joint as a function without arguments.

        Raises
        ------
        InputError
            An unknown joint; the message lists the valid ones.

        """
        _require_name(joint, 'joint', 'a joint')
        return self._bound_at(self._kernels.kernel('joint_reaction', joint), joint)

    def _function(self, name: str) -> Callable[[], Any]:
        """Return a quantity as a bound function."""
        if (name, '') not in self._at:
            self._at[name, ''] = self._bound(self._kernels.kernel(name), DOCS[name])
        return self._at[name, '']

    def _table(self, name: str) -> EntryTable:
        """Return the entry table of a quantity on the memory of this workspace."""
        kernel = self._kernels.kernel(name)
        table: EntryTable = kernel.table(*self._memory(kernel))
        # Another thread may have been faster.
        table = self._owned.setdefault(name, table)
        self._tables[PLACES[name]] = id(table)
        return table

    def _memory(self, kernel: Kernel) -> tuple[list[Array], Array]:
        """Return the argument arrays and the result array of a kernel."""
        target = STATE_RESULTS.get(kernel.name)
        return ([self._states[argument.name] for argument in kernel.arguments],
                _fixed(kernel.shape) if target is None else self._states[target])

    def _bound_at(self, kernel: Kernel, at: str) -> Callable[[], Any]:
        if (kernel.name, at) not in self._at:
            self._at[kernel.name, at] = self._bound(kernel,
                                                    f'Compute {kernel.name} of {at}.')
        return self._at[kernel.name, at]

    def _bound(self, kernel: Kernel, doc: str) -> Callable[[], Any]:
        return kernel.bind(*self._memory(kernel), doc)


for _name in ALL:  # faster than `__getattr__`
    setattr(Workspace, _name, _Quantity(_name))


@cache
def _of_machine_code() -> type[Workspace]:
    """Return the class of workspaces with machine-code methods."""
    kind: type[Workspace] = type(Workspace.__name__, (Workspace,), {
        '__slots__': (), '__doc__': Workspace.__doc__,
        '__module__': Workspace.__module__})
    kind._unmade = entry.methods(kind, DOCS, Workspace._table)
    return kind


def _require_name(value: Any, what: str, kind: str) -> None:
    """Raise InputError if a value is no text."""
    if not isinstance(value, str):
        raise InputError(f'{what}: a {type(value).__name__}; expected the name of {kind}')


def _fixed(shape: tuple[int, ...]) -> Array:
    """Return zeros that cannot be resized, as a view of another array."""
    return np.zeros(shape)[...]
