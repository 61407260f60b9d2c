"""`Robot`: a model with its compiled dynamics, the main class of the library."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from inspect import isfunction
import os
from pathlib import Path
from typing import Any, Self

from kane_dynamics._util.checks import integer
from kane_dynamics._util.fixed_attributes import refused
from kane_dynamics._util.notebook import html_table
from kane_dynamics._util.text import SHORT, short
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints import (checked_constraints, checked_names,
                                                 Constraint)
from kane_dynamics.mechanics.constraints.conditioning import (EXCESS, in_lengths, LIMITS,
                                                              limits_of, loosened, RANK,
                                                              SINGULAR)
from kane_dynamics.mechanics.constraints.independent_speeds import (choose_independent,
                                                                    coordinates_by_name)
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.friction import checked_feedforward, DESIRED_SPEED
from kane_dynamics.mechanics.recursive.tree_equations import TORQUE_TERMS, TreeEquations
from kane_dynamics.model.model import Inertial, Model, with_payload
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.robot.export_c import DEFAULT_KERNELS, write_c
from kane_dynamics.robot.kernel_set import KernelSet
from kane_dynamics.robot.methods.configuration_methods import Configurations
from kane_dynamics.robot.methods.framework_methods import FrameworkMethods
from kane_dynamics.robot.parameters import checked_limits, JointLimits, Parameters
from kane_dynamics.robot.speed_sets import SpeedSets
from kane_dynamics.robot.workspace import Workspace
import numpy as np

__all__ = ['Robot', 'TORQUE_TERMS']

CLOSURE_TOLERANCE = 1e-4  # lengths of the mechanism, and rad
# Attributes that variants of a robot share.
SHARED = ('_options', '_choices', 'model', 'friction', '_bare', '_carried', 'speed_sets',
          'parameters')


class Robot(FrameworkMethods, Configurations):
    """
    The compiled dynamics of one manipulator or mechanism.

    M(q) udot + bias(q, u) = tau + external, with u = q' unless speeds are chosen, and
    everything in SI units and world axes. Every method accepts one state, (n,) arrays,
    or a batch, (N, n) arrays, and returns the same. Kernels compile on first use and are
    cached on disk. Batches use SIMD kernels, which release the GIL; for large batches
    they run on as many threads as there are processors, or on ``KANE_DYNAMICS_THREADS``.

    Parameters
    ----------
    model : Model
        With ball joints, q has n_q > n entries, and u the angular velocities on the
        bodies' axes.
    speeds : Speeds or callable, optional
        Generalized speeds u = Y(q, t) q' + Z(q, t): a choice such as `absolute_rates`,
        or user-defined functions; joint rates by default.
    constraints : sequence of constraints
        `Closure`, `Coupling`, `PointVelocity`, `knife_edge`, `Rolling`, `Prescribed`,
        `DependentSpeeds`. u are then the n independent speeds, tau is dual to them, and
        q keeps n_q > n entries.
    independent : sequence of str, optional
        Names of the independent speeds. By default the best conditioned ones; `simulate`
        then changes to others where these become ill-conditioned.
    actuated : sequence of str or mapping of str to float, optional
        The joints that have actuators, or their weights (see `joint_torques`).
    configuration : (n_q,) array_like, or mapping of joints to numbers, optional
        A closed or nearly closed configuration, rad or m: speeds and rows are chosen
        there, and `closed_configuration` with fixed coordinates stays on its branch,
        unless it is given a start. By default configurations within the limits are tried.
    closure_tolerance : float, (float, float) or None
        Largest residual of loops and other position constraints that calls accept, m and
        rad; None accepts any. The first is that of the largest loop, those of others are
        smaller as their loops are. Default: 1e-4 times the length of a loop (the longest
        distance between its neighbouring joints), and 1e-4 rad.
        `parameters.closure_tolerance` changes it.
    rank_tolerance : float
        Singular values of the constraint rows up to this fraction of the largest count
        as zero. A larger value accepts loops with a rounded description (a URDF's
        rpy="1.5708"); their residual may then be up to this value, in rad or in lengths
        of the mechanism.
    wrench_frames : sequence of str
        Frames whose external wrenches are arrays, one row each, in `wrench=`; others are
        given by name, as a mapping.
    payload_frame : str, optional
        Frame in which `parameters.payload` is given; `with_payload` chooses another.
    friction : bool
        Include damping and Coulomb friction.
    feedforward_friction : 'desired_speed', 'ahead', 'none' or float
        The friction that commands compensate at rest and at reversals, where it may have
        any value of an interval: that of the desired speed; that of the desired speed a
        time ahead, by the desired acceleration, so that friction is there as a motion
        begins; or none up to `friction_speed` of a joint. A number is the time ahead, s;
        default of 'ahead': `friction_speed` over 1 rad/s^2. It changes no other quantity
        than the commands of control laws and filled trajectories.

    Raises
    ------
    InputError
        An unknown frame; the message lists the valid ones.
    ConstraintError
        The constraints contradict each other, cannot be met, leave no degree of freedom,
        or name an unknown joint or frame; or the speeds are singular.

    """

    def __init__(self, model: Model, *, speeds: Any = None,
                 constraints: Sequence[Constraint] = (),
                 independent: Sequence[str] | None = None,
                 actuated: Sequence[str] | Mapping[str, float] | None = None,
                 configuration: Any = None, closure_tolerance: Any = CLOSURE_TOLERANCE,
                 rank_tolerance: float = RANK, wrench_frames: Sequence[str] = (),
                 payload_frame: str | None = None, friction: bool = True,
                 feedforward_friction: str | float = DESIRED_SPEED) -> None:
        """Prepare the equations without compiling kernels."""
        if not isinstance(model, Model):
            raise InputError(f'model: a {type(model).__name__}; expected a Model '
                             '(load_urdf returns one)')
        if isinstance(wrench_frames, str):
            raise InputError(f"wrench_frames: the string '{wrench_frames}'; expected a "
                             'sequence of frame names')
        if not isinstance(friction, bool | np.bool_):
            raise InputError(f'friction: {friction!r}; expected True or False')
        # What a copy of the robot is built from, as the user gave it.
        self._options: dict[str, Any] = {
            'wrench_frames': checked_names(wrench_frames, 'wrench_frames') or (),
            'payload_frame': payload_frame,
            'friction': bool(friction),
            'feedforward_friction': checked_feedforward(feedforward_friction)}
        self._choices: dict[str, Any] = {
            'speeds': speeds, 'constraints': checked_constraints(constraints),
            'independent': checked_names(independent, 'independent'),
            'actuated': (dict(actuated) if isinstance(actuated, Mapping) else
                         checked_names(actuated, 'actuated')),
            'configuration': coordinates_by_name(model, configuration),
            'rank_tolerance': rank_tolerance}
        start = self._choices['configuration']
        if isinstance(start, np.ndarray):  # callers may change their array
            start = self._choices['configuration'] = start.copy()
            start.flags.writeable = False
        self.model, self.friction = model, bool(friction)
        # The model without the payloads of `with_payload` at other frames, and those.
        self._bare = model
        self._carried: dict[str, Inertial] = {}
        actuated = self._choices['actuated']
        # The mechanism, its equations, and the block of parameters that kernels read.
        mechanism = choose_independent(
            model, speeds, self._choices['constraints'], self._choices['independent'],
            self._choices['configuration'], rank_tolerance)
        tree = TreeEquations(model, **self._options)
        limits = LIMITS if mechanism.labels else 0
        self.parameters = Parameters(model, tree.payload_frame, limits,
                                     loosened(mechanism, EXCESS))
        if limits:
            self.parameters.block[-limits:] = limits_of(SINGULAR)
        # By default, loops are closed to a tolerance relative to the mechanism's size.
        if closure_tolerance is CLOSURE_TOLERANCE:
            closure_tolerance = in_lengths(
                mechanism, loosened(mechanism, CLOSURE_TOLERANCE)) if limits else None
        self.parameters.closure_tolerance = closure_tolerance
        # In joint rates the choices change nothing; elsewhere they are part of the key
        # of kernels.
        key = model.digest() + repr(sorted(self._options.items()))
        if not mechanism.in_joint_rates:
            key += repr(actuated)
        self.speed_sets = SpeedSets(mechanism, partial(Equations, tree, actuated=actuated),
                                    key, self.parameters)
        self.kernels = self.speed_sets.kernels(mechanism.free, mechanism.kept)
        self.equations = self.kernels.equations
        # Robots with other wrench frames. From here on, attributes cannot be assigned.
        self._others: dict[tuple[str, ...], Self] = {}

    def __setattr__(self, name: str, value: Any) -> None:
        """Raise AttributeError for all attributes but `limits`."""
        if '_others' in self.__dict__ and name != 'limits':
            raise AttributeError(refused(self, name, (*self._choices, *self._options)))
        if name == 'limits':
            if not isinstance(value, JointLimits):
                raise InputError(f'limits: {SHORT.repr(value)}; expected JointLimits, '
                                 'such as dataclasses.replace(robot.limits, '
                                 'velocity=...)')
            value = checked_limits(value, self.coordinate_names, self.joint_names)
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        """Return name, size and joints on one line."""
        return (f"<Robot '{self.model.name}': {self.n} degrees of freedom, q of "
                f'{short(self.coordinate_names)}>')

    def _repr_html_(self) -> str:
        """Return coordinates, limits and constraints as a table for notebooks."""
        # Speeds and efforts belong to joints, of which a quaternion's entries are none.
        limits, names = self.limits, self.coordinate_names
        efforts = dict(zip(self.joint_names, zip(limits.velocity, limits.effort)))
        rows = [[name, lower, upper, *efforts.get(name, ('', ''))]
                for name, lower, upper in zip(names, limits.lower, limits.upper)]
        constraints = ', '.join(self.constraint_names)
        closed = f', constraints {constraints}' if constraints else ''
        return html_table(f'Robot {self.model.name}: {self.n} degrees of '
                          f'freedom{closed}',
                          ['coordinate', 'lower', 'upper', 'speed', 'effort'], rows)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle model, options, limits and parameters; kernels load from the cache."""
        return _restored, (self.model, self.options, self.parameters.gravity,
                           self.parameters.payload, self.__dict__.get('limits'),
                           self._bare, self._carried)

    @property
    def options(self) -> dict[str, Any]:
        """Keyword arguments of `Robot` that describe this robot in addition to its model."""
        return {**self._choices, **self._options,
                'closure_tolerance': self.parameters.closure_tolerance}

    def copy(self) -> Robot:
        """
        Return a robot with the same machine code and a copy of the parameters.

        For use in another thread, with another payload or gravity, without compiling
        again.
        """
        # Kernels keep their machine code and read the copy's parameters.
        parameters = self.parameters.copy()
        speed_sets = self.speed_sets.with_parameters(parameters)
        kernels = speed_sets.kernels(self.mechanism.free, self.mechanism.kept)
        other = self._variant(kernels, parameters=parameters, speed_sets=speed_sets)
        other.limits = self.limits  # a copy
        return other

    def _variant(self, kernels: KernelSet, **changed: Any) -> Self:
        """Return the robot with other kernels and other attributes, without a copy."""
        other = object.__new__(type(self))
        for name in SHARED:
            vars(other)[name] = changed.get(name, getattr(self, name))
        # What belongs to one robot: entries of calls, and robots with other frames.
        vars(other).update(kernels=kernels, equations=kernels.equations, _others={})
        return other

    def with_payload(self, frame: str, payload: Inertial | None) -> Robot:
        """
        Return a robot that carries a payload at a frame.

        It has the present gravity and limits. Its kernels compile at their first use,
        unless `frame` is the `payload_frame`: then only a parameter changes. Payloads at
        other frames stay, as parts of the model, until another call for their frame.

        Parameters
        ----------
        frame : str
            One of `frame_names`; the payload is given from its origin and in its axes.
        payload : Inertial or None
            None takes it off.

        Raises
        ------
        InputError
            The frame is unknown, or the payload is no possible Inertial.

        """
        if frame == self._options['payload_frame']:
            robot = self.copy()
        else:
            # At another frame: the present payload becomes part of the model, and
            # kernels compile again.
            carried = dict(self._carried)
            if self.parameters.payload is not None:
                carried[self._options['payload_frame']] = self.parameters.payload
            carried.pop(frame, None)
            model = self._bare
            for other_frame, load in carried.items():
                model = with_payload(model, other_frame, load)
            robot = _restored(model, {**self.options, 'payload_frame': frame},
                              self.parameters.gravity, None, self.limits, self._bare,
                              carried)
        robot.parameters.payload = payload
        return robot

    def _declaring(self, frames: tuple[str, ...]) -> Self:
        """Return this robot with other wrench frames, which shares the parameters."""
        other = self._others.get(frames)
        if other is None:
            other = type(self)(self.model, **{**self.options, 'wrench_frames': frames})
            kernels = other.speed_sets.with_parameters(self.parameters).kernels(
                other.mechanism.free, other.mechanism.kept)
            # The robot is not in use yet, so that its attributes may still change.
            other.__dict__.update(kernels=kernels, parameters=self.parameters)
            self._others[frames] = other
        return other

    def equals(self, other: Robot) -> bool:
        """Return whether another robot has the same equations and current parameters."""
        return self is other or bool(
            self.kernels.key is not None and self.kernels.key == other.kernels.key
            and np.array_equal(self.parameters.block, other.parameters.block))

    def compiled(self, function: Callable[..., Any], *, shape: Shape,
                 name: str | None = None,
                 **inputs: Shape) -> Kernel:
        """
        Return a function over any scalar as native code, for single states and batches.

        The result is called with the inputs in their order, then with `wrench` and `t`
        if the function asks for them and the robot has them. Batches, with one more
        leading axis, are computed in SIMD lanes and threads. The code is compiled once;
        that for batches at the first one.

        Parameters
        ----------
        function : callable
            Traced once. It takes an array for each input, or a scalar where the shape is
            (), and uses arithmetic, the methods of `robot.equations`, and `sin`, `cos`,
            `tanh`, `exp`, `log`, `sqrt` and `arctan` of numpy. It may not branch on the
            value of an input. By name it may ask for `parameters`, gravity (3,) and,
            where a payload frame is declared, the payload (10,); for `t`, the time, s, 0
            where the equations do not depend on it; and for `wrench`, the external
            wrenches (k, 6) at the declared frames, None without any.
        shape : tuple of int
            Shape of the result for one state.
        name : str, optional
            A C identifier, which errors begin with. Default: that of the function.
        **inputs : tuple of int
            Shape of each input for one state, in the order of the function.

        Raises
        ------
        InputError
            The name is no identifier, there is no input, a shape is none, the function
            asks for something else, or its result has another shape.
        TypeError
            The function branches on the value of an input.

        """
        # The name is part of the symbol of the code.
        if name is None:
            name = getattr(function, '__name__', '')
        if not (name.isascii() and name.isidentifier()):
            raise InputError(f'name: {name!r}; expected an identifier, such as '
                             "name='power'")
        if not inputs:
            raise InputError(f'{name}: no inputs; expected at least one, such as '
                             f'q=({self.n_q},)')
        shapes = {}
        for key, value in inputs.items():
            shapes[key] = _checked_shape(value, f'shape of {key}')
        return self.kernels.compiled(function, name, shapes, _checked_shape(shape, 'shape'))

    def bind(self) -> Workspace:
        """Return a workspace: preallocated arrays with calls that allocate nothing."""
        return Workspace(self.kernels)

    def verify(self, states: int = 5) -> float:
        """
        Compare the compiled kernels with the definition of Kane's equations.

        Returns
        -------
        float
            The largest error, relative to the largest entry of its quantity. The error
            of forward dynamics is that of the torque of its result.

        Raises
        ------
        InputError
            `states` is less than 1.
        CompileError
            An error is larger than 1e-9; names the quantity and the error.

        """
        from kane_dynamics.robot.verification import verified  # imports the definition
        return verified(self, states)

    def export_c(self, path: str | os.PathLike[str],
                 kernels: Sequence[str | Kernel] = DEFAULT_KERNELS, *,
                 scalar: str = 'float64',
                 self_test: bool = True) -> tuple[Path, Path]:
        """
        Write kernels as C99 that needs libm alone: a source and a header.

        The header documents the source. The current parameters are its defaults.
        `<stem>_self_test()` compares every function with results of this library. Sines
        and cosines are computed by code that compilers vectorise; ``-D'<STEM>_SINCOS(x,
        s, c)=...'`` replaces them by another function, such as one of the processor's
        vendor. Names and limits of the joints are constants, and `<stem>_check_state`
        refuses numbers that are not finite, or positions beyond 1e12.

        Parameters
        ----------
        path : path
            The source, `<stem>.c`; the header is `<stem>.h` beside it, and every name in
            them begins with `<stem>_`. Only files of an earlier export are overwritten.
        kernels : sequence of str or Kernel
            Names of quantities, as `operation_count` lists them; of a frame
            ``'frame_pose:<frame>'``, ``'jacobian:<frame>'``, ``'frame_velocity:<frame>'``
            and so on; of a joint ``'joint_reaction:<joint>'``; of a controller those of
            `control.controller_kernels`.
        scalar : {'float64', 'float32'}
            Type of arguments, results and arithmetic. The self-test of 'float32' has the
            tolerance of single precision.
        self_test : bool
            Write the self-test; ``-D<STEM>_NO_SELF_TEST`` leaves it out when compiling.

        Returns
        -------
        (Path, Path)
            The source and the header.

        Raises
        ------
        InputError
            An unknown kernel, or a path that cannot be written; names it.

        """
        return write_c(self, path, kernels, scalar, self_test)


def in_choice(robot: Robot, free: Sequence[int], kept: Sequence[int]) -> Robot:
    """
    Return a robot with other independent speeds and constraint rows, given by index.

    The result shares the parameters; its u and tau are in the other speeds.
    """
    kernels = robot.speed_sets.kernels(free, kept)
    if kernels is robot.kernels:
        return robot
    choices = {**robot._choices, 'independent': kernels.equations.speed_names}
    other = robot._variant(kernels, _choices=choices)
    vars(other)['limits'] = robot.limits  # the same arrays
    return other


def in_regular_speeds(robot: Robot, state: dict[str, Array]) -> Robot | None:
    """Return a robot in speeds that are regular at a state, or None if there are none."""
    regular = robot.speed_sets.instead(robot.equations.mechanism, state)
    if regular is None or regular.equations.in_joint_rates:
        return None
    choice = regular.equations.mechanism
    return in_choice(robot, choice.free, choice.kept)


# Errors of Python name a method by its class: the one that users know.
for _base in Robot.__mro__[1:-1]:
    for _name, _method in vars(_base).items():
        _function = getattr(_method, 'checked', _method)
        if isfunction(_function):
            _function.__qualname__ = f'Robot.{_name}'


def _checked_shape(value: Any, what: str) -> Shape:
    """Return a shape as a tuple of integers; raise InputError for anything else."""
    if not isinstance(value, tuple | list):
        raise InputError(f'{what}: {SHORT.repr(value)}; expected a tuple of integers, '
                         'such as (6,)')
    return tuple(integer(size, what, 0) for size in value)


def _restored(model: Model, options: dict[str, Any], gravity: Array,
              payload: Inertial | None, limits: JointLimits | None, bare: Model,
              carried: dict[str, Inertial]) -> Robot:
    # Gravity, payload and limits are no options: they may have changed since.
    robot = Robot(model, **options)
    # The robot is not in use yet, so that its attributes may still change.
    vars(robot).update(_bare=bare, _carried=carried)
    if limits is not None:
        robot.limits = limits
    robot.parameters.gravity = gravity
    if payload is not None:
        robot.parameters.payload = payload
    return robot
