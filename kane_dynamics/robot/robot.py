"""`Robot`: a model with its dynamics compiled, what users hold."""

from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property, partial
import os
from pathlib import Path
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelError
from kane_dynamics.mechanics.constraints import Constraint
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.independent_speeds import choose_independent
from kane_dynamics.mechanics.recursive.tree_equations import TORQUE_TERMS, TreeEquations
from kane_dynamics.model.model import Inertial, Model
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.native.tracing.program import OperationCount
from kane_dynamics.robot.constraint_methods import ConstraintMethods, raise_where_singular
from kane_dynamics.robot.dynamics_methods import DynamicsMethods
from kane_dynamics.robot.export_c import DEFAULT_KERNELS, write_c
from kane_dynamics.robot.frame_methods import FrameMethods
from kane_dynamics.robot.kernel_set import KernelSet
from kane_dynamics.robot.parameters import JointLimits, Parameters
from kane_dynamics.robot.workspace import Workspace
import numpy as np

__all__ = ['Robot', 'TORQUE_TERMS']


class Robot(DynamicsMethods, FrameMethods, ConstraintMethods):
    """
    The dynamics of one manipulator or mechanism, compiled for it.

    M(q) udot + bias(q, u) = tau + external, with u = q' unless speeds are chosen, and everything
    in SI units and world axes. Every method takes one state, (n,) arrays, or a batch, (N, n)
    arrays, and answers in kind. Kernels compile on first use and are kept in a cache on disk.
    Batches have kernels of their own, which take several states at once and leave other Python
    threads free; where that pays they use as many threads as there are processors, or as
    ``KANE_DYNAMICS_THREADS`` says.

    Parameters
    ----------
    model : Model
    speeds : Speeds or callable, optional
        Generalized speeds u = Y(q, t) q' + Z(q, t): a choice such as `absolute_rates`, or your
        own functions; joint rates by default.
    constraints : sequence of constraints
        What holds besides: `Closure`, `Coupling`, `PointVelocity`, `knife_edge`, `Rolling`,
        `Prescribed`, `DependentSpeeds`. u are then the n independent speeds, tau is dual to
        them, and q keeps n_q > n entries.
    independent : sequence of str, optional
        Names of the speeds to take as independent; the best conditioned by default.
    actuated : sequence of str, optional
        The joints that have actuators (see `joint_torques`).
    wrench_frames : sequence of str
        Frames on which the environment may push (`wrench=`, one row each).
    payload_frame : str, optional
        Frame in which `parameters.payload` is given.
    friction : bool
        Whether damping and Coulomb friction are part of the equations.
    frame_reduction : bool
        Use Denavit-Hartenberg-like frames inside the kernels, link by link where that saves
        arithmetic (`operation_count` tells). The numbers are the same.

    Raises
    ------
    InputError
        No such frame; the message lists the valid ones.
    ConstraintError
        The constraints contradict each other, cannot be met, leave no freedom, or name what the
        model does not have; or the speeds are singular.

    """

    def __init__(self, model: Model, *, speeds: Any = None,
                 constraints: Sequence[Constraint] = (), independent: Sequence[str] | None = None,
                 actuated: Sequence[str] | None = None, wrench_frames: Sequence[str] = (),
                 payload_frame: str | None = None, friction: bool = True,
                 frame_reduction: bool = True) -> None:
        """Prepare the equations; nothing is compiled yet."""
        if not isinstance(model, Model):
            raise InputError(f'model is a {type(model).__name__}; expected a Model '
                             '(load_urdf returns one)')
        if isinstance(wrench_frames, str):
            raise InputError(f"wrench_frames is the string '{wrench_frames}'; expected a sequence "
                             'of frame names')
        self._options: dict[str, Any] = {
            'wrench_frames': tuple(wrench_frames), 'payload_frame': payload_frame,
            'friction': bool(friction), 'frame_reduction': bool(frame_reduction)}
        self._choices: dict[str, Any] = {
            'speeds': speeds, 'constraints': tuple(constraints), 'independent': independent,
            'actuated': actuated}
        self.model = model
        self.friction = bool(friction)
        tree = self.equations = TreeEquations(model, **self._options)
        key: str | None = model.digest() + repr(sorted(self._options.items()))
        reason = None
        if any(value not in (None, ()) for value in self._choices.values()):
            mechanism = choose_independent(model, speeds, constraints, independent)
            self.equations = ConstrainedEquations(tree, mechanism, actuated)
            key = mechanism.key and f'{key}{mechanism.key}{actuated!r}'
            reason = partial(raise_where_singular, mechanism)
        self.parameters = Parameters(model, tree.payload_frame)
        self.kernels = KernelSet(self.equations, key, self.parameters.block, reason)
        self._entries = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as model, options and parameters; kernels load again from the cache."""
        return _restored, (self.model, {**self._choices, **self._options}, self.parameters.gravity,
                           self.parameters.payload)

    def copy(self) -> 'Robot':
        """
        Return a robot on the same machine code, with parameters of its own.

        For another thread, which may then carry another payload; nothing is compiled twice.
        """
        other = object.__new__(type(self))
        for name in ('_options', '_choices', 'model', 'friction', 'equations'):
            setattr(other, name, getattr(self, name))
        other.parameters = self.parameters.copy()
        other.kernels = self.kernels.with_parameters(other.parameters.block)
        other._entries = {}
        return other

    @property
    def n(self) -> int:
        """Return the number of independent generalized speeds."""
        return self.equations.n

    @property
    def n_q(self) -> int:
        """Return the number of coordinates."""
        return self.equations.n_q

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints that move freely, in the order of q."""
        return self.model.joint_names

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the entries of q."""
        return self.model.coordinate_names

    @cached_property
    def limits(self) -> JointLimits:
        """Bounds of the joints, as the model states them."""
        limits = [joint.limits for joint in self.model.coordinate_joints]
        return JointLimits(*(np.array([getattr(limit, name) for limit in limits])
                             for name in ('lower', 'upper', 'velocity', 'effort')))

    def bind(self) -> Workspace:
        """Return arrays with zero-argument calls on them, for a loop that must not allocate."""
        return Workspace(self.kernels)

    def compile(self, *names: str, batches: bool = False) -> None:  # noqa: A003
        """
        Compile kernels now that would compile at their first use.

        Parameters
        ----------
        *names : str
            Which; without any, all but those of frames and joint reactions.
        batches : bool
            Also for batches, which take several states at once by kernels of their own.

        Raises
        ------
        InputError
            No such kernel; the message lists the valid names.

        """
        names = names or self.kernels.names
        run_concurrently([partial(self._compile, name, batches) for name in names])

    def _compile(self, name: str, batches: bool) -> None:
        with suppress(ModelError):  # no forward dynamics with massless joints; a call says so
            kernel = self.kernels.quantity(name)
            if batches:
                kernel.compile_lanes()
            getattr(self, name)

    def verify(self, states: int = 5) -> float:
        """
        Compare the compiled kernels with Kane's equations as defined, at random states.

        Returns
        -------
        float
            The largest error found, relative to the largest entry of its quantity. Forward
            dynamics is judged by the torque that its answer asks for.

        Raises
        ------
        InputError
            Not at least one state.
        CompileError
            An error is larger than 1e-9: names the quantity and the error.

        """
        from kane_dynamics.robot.verification import verified  # and with it the definition
        return verified(self, states)

    def operation_count(self) -> dict[str, OperationCount]:
        """Return the arithmetic of one call of every kernel."""
        return {name: self.kernels.program(name).operation_count() for name in self.kernels.names}

    def export_c(self, path: str | os.PathLike[str], kernels: Sequence[str] = DEFAULT_KERNELS,
                 *, scalar: str = 'float64', self_test: bool = True) -> tuple[Path, Path]:
        """
        Write kernels as C99 that needs libm alone: a source, and a header that documents it.

        The parameters of now are its defaults. `<stem>_self_test()` compares every function with
        results of this library. Sines and cosines are computed by code that compilers vectorise;
        ``-D'<STEM>_SINCOS(x, s, c)=...'`` puts another function in their place, such as one of
        the processor's vendor.

        Parameters
        ----------
        path : path
            Of the source, `<stem>.c`; the header is `<stem>.h` beside it, and every name in them
            begins with `<stem>_`. Files that an earlier export wrote are replaced, others never.
        kernels : sequence of str
            Names of quantities, as `operation_count` lists them; of a frame
            ``'frame_pose:<frame>'`` and ``'jacobian:<frame>'`` (or ``'partial_velocities:...'``).
        scalar : {'float64', 'float32'}
            Of arguments, results and arithmetic. The tolerance of the self-test is then what
            single precision reaches.
        self_test : bool
            Whether to write it; ``-D<STEM>_NO_SELF_TEST`` leaves it out when compiling.

        Returns
        -------
        (Path, Path)
            The source and the header.

        Raises
        ------
        InputError
            No such kernel, or the path cannot be written; names it.

        """
        return write_c(self, path, kernels, scalar, self_test)


def _restored(model: Model, options: dict[str, Any], gravity: Array,
              payload: Inertial | None) -> Robot:
    robot = Robot(model, **options)
    robot.parameters.gravity = gravity
    if payload is not None:
        robot.parameters.payload = payload
    return robot
