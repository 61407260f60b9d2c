"""Errors for unknown attributes and refused assignments, with the name that is meant."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import FrozenInstanceError
import difflib
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Any, TYPE_CHECKING, TypeVar

Class = TypeVar('Class', bound=type)
Function = TypeVar('Function', bound=Callable[..., Any])

# Names in Pinocchio, Drake, MuJoCo and RBDL, in lower case without underscores.
COUNTERPARTS = {
    'inverse_dynamics(q, u, udot)': 'rnea rne calcinversedynamics inversedynamics id '
                                    'mjinverse tau',
    'forward_dynamics(q, u, tau)': 'aba forwarddynamics fd calcforwarddynamics '
                                   'mjforward',
    'mass_matrix(q)': 'crba calcmassmatrix m inertiamatrix inertia jointspaceinertia '
                      'massmatrix h',
    'inverse_mass_matrix(q)': 'computeminverse minverse minv',
    'bias_force(q, u)': 'nle nonlineareffects calcbiasterm bias qfrcbias biasforces',
    'gravity_force(q)': 'computegeneralizedgravity calcgravitygeneralizedforces '
                        'gravitycompensation gravitytorque gravityvector g '
                        'generalizedgravity gravload gravity_load gravityload',
    'coriolis_matrix(q, u)': 'computecoriolismatrix coriolis c',
    'jacobian(frame, q)': 'jac framejacobian computeframejacobian getframejacobian '
                          'jacobians computejointjacobians computejointjacobian mjjac j '
                          'calcjacobianspatialvelocity geometricjacobian '
                          'calcbodyjacobian jacobianmatrix jacob0 jacobe '
                          'partialvelocities partialvelocity',
    'jacobian_rate(frame, q, u)': 'jacobiandot jdot jacobiantimederivative djacobian '
                                  'computejointjacobianstimevariation '
                                  'jacobianderivative partialvelocityrates',
    'frame_pose(frame, q)': 'fk fkine forward_kinematics forwardkinematics '
                            'framesforwardkinematics updateframeplacements pose omf '
                            'calcrelativetransform transform placement frameposes',
    'closed_configuration(q)': 'closedposture closeloops loopclosure assemble',
    'center_of_mass(q)': 'com centerofmass calccenterofmasspositioninworld subtreecom',
    'center_of_mass_jacobian(q)': 'jacobiancenterofmass comjacobian jcom '
                                  'calcjacobiancenterofmasstranslationalvelocity',
    'frame_velocity(frame, q, u)': 'getframevelocity velocity calcspatialvelocity twist',
    'frame_acceleration(frame, q, u, udot)': 'getframeacceleration '
                                             'getframeclassicalacceleration '
                                             'acceleration',
    'operational_space_inertia(frame, q)': 'lambda lambdamatrix taskspaceinertia '
                                           'operationalspaceinertiamatrix',
    'random_configuration()': 'randomconfiguration randomq',
    'neutral()': 'neutralconfiguration qzero q0',
    'regressor(q, u, udot)': 'computejointtorqueregressor',
    'inverse_dynamics_derivatives(q, u, udot)': 'computerneaderivatives rneaderivatives',
    'forward_dynamics_derivatives(q, u, tau)': 'computeabaderivatives abaderivatives',
    'kinetic_energy(q, u)': 'computekineticenergy calckineticenergy',
    'potential_energy(q)': 'computepotentialenergy calcpotentialenergy',
    'n': 'nv numvelocities dof dofs ndof numdofs degreesoffreedom njoints numjoints',
    'n_q': 'nq numpositions',
    'joint_names': 'names joints jointnames',
    'frame_names': 'frames links linknames framenames bodies bodynames',
    'limits': 'jointlimits lowerpositionlimit upperpositionlimit velocitylimit '
              'effortlimit effortlimits torquelimits lowerlimits upperlimits '
              'positionlimits',
    'parameters.gravity': 'gravity setgravity gravityfield',
    'parameters.payload': 'payload setpayload tool load',
    'model.name': 'name',
}
_BY_NAME = {name: ours for ours, names in COUNTERPARTS.items() for name in names.split()}
# Members of Robot by their names, for those who look for them in the package.
_OF_ROBOT = {ours.partition('(')[0].replace('_', ''): ours for ours in COUNTERPARTS}
# What is no method of Robot here, but one in other libraries.
FUNCTIONS = {
    'kane_dynamics.inverse_kinematics(robot, frame, target)':
        'inversekinematics ik ikine ikinelm iksolve solveik computeinversekinematics',
    'kane_dynamics.simulate(robot, q0, u0, duration)':
        'simulate simulation sim fdyn step rollout',
    'kane_dynamics.load_urdf(path), and Robot(model)':
        'fromurdf loadurdf buildmodelfromurdf buildfromurdf buildmodelfromxml parseurdf '
        'addmodels addmodelfromfile load urdf read frommodel',
    'kane_dynamics.load_mjcf(path), and Robot(model, **options)':
        'frommjcf loadmjcf buildmodelfrommjcf fromxmlpath',
    'the functions of kane_dynamics.plot': 'plot plots draw plottorque plottorques '
                                           'plotmotion',
    'kane_dynamics.pose_from(position, rpy=...), a (4, 4) array':
        'se3 transform pose homogeneous rigidtransform',
    'kane_dynamics.view.Window(robot)': 'teach view show display viewer visualize '
                                        'render',
    'sum(body.inertial.mass for body in model.bodies)': 'mass totalmass '
                                                        'computetotalmass',
    'kane_dynamics.Motion.from_points(times, positions, joint_names=...)':
        'trajectory jtraj plan',
    'kane_dynamics.feasibility.time_optimal(robot, waypoints)':
        'timeoptimal toppra retime retiming timeparameterization',
    'kane_dynamics.identification.identify(model, recording)':
        'identify identification sysid',
    'kane_dynamics.load_urdf(path), which expands xacro': 'loadxacro fromxacro',
}
# What is no method of Model here, but one in other libraries.
MODEL_FUNCTIONS = {
    'robot.with_payload(frame, payload), robot = Robot(model)':
        'withpayload payload addpayload setpayload attachpayload',
    'kane_dynamics.with_tool(model, on, name, inertial)':
        'withtool addtool attachtool tool addlink addbody attach',
    'kane_dynamics.with_model(model, other, on)':
        'withmodel append appendmodel merge addmodel combine',
    'kane_dynamics.with_locked(model, positions)':
        'withlocked lock lockjoint lockjoints freeze freezejoints buildreducedmodel',
    'kane_dynamics.with_names(model, names)': 'withnames rename renamejoint renamelink',
    'kane_dynamics.with_drives(model, drives)': 'withdrives drives elasticjoints',
    'kane_dynamics.with_beam(model, link, beam)': 'withbeam flexiblelink',
}
_FUNCTION_OF_MODEL = {name: ours for ours, names in MODEL_FUNCTIONS.items()
                      for name in names.split()}
_FUNCTION_BY_NAME = {name: ours for ours, names in FUNCTIONS.items()
                     for name in names.split()}
# Keyword arguments of other libraries, with ours in the order of preference.
KEYWORDS = {
    'dt': ('step',), 'timestep': ('step',), 'h': ('step',), 'stepsize': ('step',),
    't': ('duration',), 'time': ('duration',), 'tf': ('duration',),
    'tend': ('duration',),
    'tau': ('torque',), 'torques': ('torque',), 'control': ('torque',),
    'method': ('integrator',),
    'solver': ('integrator',), 'qd0': ('u0',), 'v0': ('u0',), 'dq0': ('u0',),
    'payloadlink': ('payload_frame',), 'toollink': ('payload_frame', 'tip'),
    'payload': ('payload_frame',), 'tool': ('tip', 'payload_frame'),
    'endeffector': ('tip', 'frame'), 'ee': ('tip', 'frame'), 'eelink': ('tip',),
    'tiplink': ('tip',), 'endlink': ('tip',), 'baselink': ('base',), 'root': ('base',),
    'rootlink': ('base',), 'lockedjoints': ('locked',), 'lock': ('locked',),
    'jointstolock': ('locked',), 'activejoints': ('joints',),
    'floatingbase': ('root_joint',),
    'freeflyer': ('root_joint',), 'fixedbase': ('root_joint',),
    'fts': ('wrench_frames',),
    'wrenches': ('wrench_frames',), 'pose': ('target',), 'goal': ('target',),
    'tol': ('tolerance',), 'maxiter': ('iterations',), 'maxiterations': ('iterations',),
    'q': ('q0',), 'qinit': ('q0',), 'initialguess': ('q0',),
    'link': ('frame', 'payload_frame', 'tip'), 'linkname': ('frame',),
    'framename': ('frame',), 'body': ('frame',), 'm': ('mass',),
    'mass': ('inertial',), 'i': ('inertia',), 'cog': ('com',),
    'parent': ('on',), 'parentlink': ('on',), 'parentbody': ('on',), 'type': ('kind',),
    'jointtype': ('kind',), 'xyz': ('at',), 'origin': ('at',), 'position': ('at',),
    'translation': ('at',), 'orientation': ('rpy',), 'jointname': ('joint',),
}
SHOWN = 3  # optional arguments in the message for wrong ones
# Of other classes, where they have these attributes.
SHORT_NAMES = {name: ours for ours, names in {
    'tau': 'torque torques effort efforts', 'q': 'position positions configuration qpos',
    'u': 'velocity velocities speed speeds qd dq qdot v qvel',
    'udot': 'acceleration accelerations qdd ddq qddot a qacc', 't': 'time times',
    'times': 't',
    'com': 'centerofmass'}.items() for name in names.split()}


def guarded_class(cls: Class) -> Class:
    """
    Decorate a class: assigning an unknown attribute, or reading one, raises with a hint.

    Attributes that `__init__` made can be replaced later; of a frozen dataclass none
    can.
    """
    return _guarded(cls, lambda self, name: name not in self.__dict__)


def fixed(cls: Class) -> Class:
    """Decorate a class as `guarded_class` does; no public attribute can be assigned."""
    return _guarded(cls, lambda self, name: True)


def _guarded(cls: Class, refuses: Callable[[Any, str], bool]) -> Class:
    """Give a class the methods of the decorators."""
    # Three methods: for records, for other classes, and for names that do not exist.
    def refuse(self: Any, name: str, value: Any = None) -> None:
        raise FrozenInstanceError(refused(self, name))

    def assign(self: Any, name: str, value: Any) -> None:
        if name[0] != '_' and '_made' in self.__dict__ and refuses(self, name):
            settable = getattr(type(self), name, None)
            if not (isinstance(settable, property) and settable.fset):
                raise AttributeError(refused(self, name))
        object.__setattr__(self, name, value)

    def read(self: Any, name: str) -> Any:
        raise AttributeError(missing(self, name))
    _hint_constructor(cls)
    methods: dict[str, Any] = {'__getattr__': read}
    # Frozen dataclasses refuse everything; other classes from the end of `__init__` on.
    if '__dataclass_fields__' in vars(cls):
        methods.update(__setattr__=refuse, __delattr__=refuse)
    else:
        construct = vars(cls)['__init__']

        @wraps(construct)
        def make(self: Any, *values: Any, **named: Any) -> None:
            construct(self, *values, **named)
            if type(self) is cls:  # a subclass goes on
                self.__dict__['_made'] = True
        methods.update(__setattr__=assign, __init__=make)
    for name, method in methods.items():
        setattr(cls, name, method)
    return cls


def function_hint(name: str) -> str | None:
    """Return the hint for an attribute that is a name of another library, or None."""
    return _FUNCTION_BY_NAME.get(name.lower().replace('_', ''))


def module_hint(name: str, public: Sequence[str]) -> str:
    """Return a hint to what an unknown name of the package means, or an empty text."""
    if name.startswith('_'):
        return ''
    plain = name.lower().replace('_', '')
    text = _FUNCTION_BY_NAME.get(plain)
    of_robot = _BY_NAME.get(plain, _OF_ROBOT.get(plain))
    if text is None and of_robot is not None:
        text = f'robot.{of_robot}'
    if text is None:
        text = next(iter(difflib.get_close_matches(name, public, 1)), None)
    return '' if text is None else f'; expected {text}'


def keyword_error(what: str, given: Iterable[str], known: Sequence[str]) -> str | None:
    """Return the message for the first unknown keyword, with the closest, or None."""
    unknown = [name for name in given if name not in known]
    if not unknown:
        return None
    expected = f'some of {", ".join(known)}'
    meant = meant_keyword(unknown[0], known)
    if meant:
        expected = f'{meant}='
    return (f"{what}() got an unexpected keyword argument '{unknown[0]}'; expected "
            f'{expected}')


def meant_keyword(unknown: str, known: Sequence[str]) -> str | None:
    """Return the known keyword that an unknown one probably means, or None."""
    plain = unknown.lower().replace('_', '')
    counterparts = (*KEYWORDS.get(plain, ()), SHORT_NAMES.get(plain, ''))
    meant = [name for name in counterparts if name in known]
    if not meant:
        meant = difflib.get_close_matches(unknown, known, 1)
    return meant[0] if meant else None


def argument_error(error: TypeError, function: Callable[..., Any], name: str,
                   values: Sequence[Any], named: Mapping[str, Any], bound: int = 0,
                   caller: Callable[..., Any] | None = None) -> str | None:
    """
    Return the message for arguments that a function does not take, or None.

    None if it takes them: then the TypeError is of its body. The first `bound` arguments
    are those of a method's object or class. `caller` is the function, if another one,
    that was called and hands arguments on: its own may be meant too.
    """
    # The arguments fit: then the error is from within the function.
    stated = signature(function)
    parameters = list(stated.parameters.values())[bound:]
    call = stated.replace(parameters=parameters)
    try:
        call.bind(*values, **named)
    except TypeError:
        pass
    else:
        return None
    takes_any = any(parameter.kind is Parameter.VAR_KEYWORD for parameter in parameters)
    known = [*call.parameters]
    # The caller passes keywords on; its own names may be meant, too.
    if caller is not None:
        for parameter in list(signature(caller).parameters.values())[bound:]:
            if parameter.name not in known and parameter.kind is not Parameter.VAR_KEYWORD:
                known.append(parameter.name)
    message = None if takes_any else keyword_error(name, named, known)
    if message is not None:
        return message
    _, _, reason = str(error).partition('()')  # Python names the class that defines it
    return f'{name}(){reason}; expected {name}({_arguments(parameters)})'


def _arguments(parameters: Sequence[Parameter]) -> str:
    """Return the arguments of a call in words: names, the optional ones with '='."""
    words = []
    optional = 0
    for parameter in parameters:
        # All required arguments, and the first few optional ones.
        required = parameter.default is Parameter.empty
        if required and parameter.kind is not Parameter.VAR_KEYWORD:
            words.append(parameter.name)
        elif optional < SHOWN:
            optional += 1
            words.append(f'{parameter.name}=...')
        else:
            return ', '.join([*words, '...'])
    return ', '.join(words)


def hinting(function: Function) -> Function:
    """Decorate a function or class: arguments that it does not take raise with a hint."""
    if isinstance(function, type):
        _hint_constructor(function)
        return function
    return _hinted(function, function.__name__)


def hinting_method(method: Function) -> Function:
    """Decorate a method as `hinting` does a function."""
    return _hinted(method, '', bound=1)


def _hint_constructor(cls: type) -> None:
    """Decorate the constructor of a class as `hinting` does a function."""
    construct = vars(cls)['__init__']
    setattr(cls, '__init__', _hinted(construct, '', bound=1))  # noqa: B010


def _hinted(function: Function, name: str, bound: int = 0) -> Function:
    """
    Return a function whose TypeErrors for arguments it does not take have a hint.

    `name` is that of the call in the message, by default those of the object's class and
    of the method; `bound` is the number of arguments that are the object.
    """
    is_constructor = function.__name__ == '__init__'

    @wraps(function)
    def call(*values: Any, **named: Any) -> Any:
        try:
            return function(*values, **named)
        except TypeError as error:
            called = name
            caller = None
            if not name:
                kind = type(values[0])
                called = f'{kind.__name__}.{function.__name__}'
                if is_constructor:  # of the object's class, or of one above it
                    called = kind.__name__
                    caller = kind.__init__
            message = argument_error(error, function, called, values[bound:], named,
                                     bound, caller)
            if message is None:
                raise
            raise TypeError(message) from None
    return call  # type: ignore[return-value]


class HintingClass(type):
    """Class of classes whose unknown keywords and attributes raise errors with hints."""

    if not TYPE_CHECKING:  # type checkers report them themselves
        def __call__(cls, *values: Any, **named: Any) -> Any:
            try:
                return super().__call__(*values, **named)
            except TypeError as error:
                message = argument_error(error, cls.__init__, cls.__name__, values,
                                         named, bound=1)
                if message is None:
                    raise
                raise TypeError(message) from None

        @property
        def __signature__(cls) -> Signature:
            """Return the arguments of the constructor, for `help` and editors."""
            return Signature(list(signature(cls.__init__).parameters.values())[1:])

        def __getattr__(cls, name: str) -> Any:
            text = function_hint(name)
            hint = '' if text is None or name.startswith('_') else f'; expected {text}'
            raise AttributeError(
                f"type object '{cls.__name__}' has no attribute '{name}'{hint}")


def missing(owner: object, name: str) -> str:
    """Return the message for a missing attribute, with the closest existing one."""
    hint = _hint(owner, name)
    return f"'{type(owner).__name__}' object has no attribute '{name}'{hint}"


def refused(owner: object, name: str, options: tuple[str, ...] = ()) -> str:
    """Return the message for an attribute that must not be assigned."""
    setters = []  # methods that take the value
    # Methods that change the value, for the hint.
    for method in ('update', 'tune'):
        function = getattr(type(owner), method, None)
        if function is not None and name in signature(function).parameters:
            setters.append(method)
    known = hasattr(type(owner), name) or name in getattr(owner, '__dict__', ())
    why = 'it is not to be replaced' if known else 'no such attribute'
    if name in options:
        expected = f'{type(owner).__name__}(..., {name}=...)'
        why = f'it is fixed at construction; expected {expected}'
    elif setters:
        why += f'; expected {setters[0]}({name}=...)'
    elif not known:
        why += _hint(owner, name)
    elif hasattr(type(owner), '__dataclass_fields__'):
        why += f'; expected dataclasses.replace(..., {name}=...)'
    return f"'{type(owner).__name__}' attribute '{name}' cannot be assigned: {why}"


def _hint(owner: object, name: str) -> str:
    """Return a hint to the attribute that a name probably means, or an empty text."""
    if name.startswith('_'):
        return ''
    plain = name.lower().replace('_', '')
    is_robot = hasattr(type(owner), 'inverse_dynamics') and hasattr(type(owner), 'bind')

    # What a name may mean: an attribute, or a call by the name of its method.
    names = {known: known for known in dir(owner) if known[0] != '_'}
    is_model = hasattr(type(owner), 'joint_names') and 'bodies' in names
    prefix = ''
    function = None
    if is_robot:
        prefix = 'robot.'
        meant = _BY_NAME.get(plain)
        function = function_hint(name)
        for counterpart in COUNTERPARTS:
            call, _, _ = counterpart.partition('(')
            names[call.rpartition('.')[2]] = counterpart
    else:
        for short_name, full_name in SHORT_NAMES.items():
            if full_name in names:
                names[short_name] = full_name
        meant = names.get(plain)
        if is_model:
            function = _FUNCTION_OF_MODEL.get(plain, function_hint(name))

    # The same name in other libraries, a function here, or the most similar name.
    if meant is not None:
        return f'; expected {prefix}{meant}'
    if function is not None:
        return f'; expected {function}'
    near = difflib.get_close_matches(name, names, 1)
    if not near:
        return ''
    return f'; expected {prefix}{names[near[0]]}'
