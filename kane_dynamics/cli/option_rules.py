"""Refuse options that would have no effect, and results that would replace an input."""

from argparse import Namespace
from collections.abc import Collection, Mapping
import os
from pathlib import Path

from kane_dynamics.errors import InputError

# Options that act together with another one only, by command: one of these is needed.
Needs = Mapping[str, Mapping[str, tuple[str, ...]]]
NEEDS: Needs = {
    'torque': {'out': ('motion',), 'step': ('motion',), 'plot': ('motion',),
               'plot_of': ('plot',)},
    'simulate': {'kp': ('motion',), 'kd': ('motion',), 'plot_of': ('plot',)},
    'identify': {'unbounded': ('friction_only',), 'ratio': ('drives',),
                 'skew': ('drives',),
                 'constraints': ('payload', 'drives')},
    'replay': {'smallest': ('reference',)},
    'calibrate': {**dict.fromkeys(('gain', 'margin', 'drift', 'commands',
                                   'constraints', 'efforts', 'efforts_without_gravity',
                                   'torque_constants', 'no_friction'), ('collision',)),
                  **dict.fromkeys(('save', 'move', 'floor'), ('live',)),
                  **dict.fromkeys(('load', 'load_mass', 'load_com'), ('loaded',)),
                  'loaded': ('load',)},
    'excite': {'loads': ('friction',)},
    'feasible': {'acceleration': ('time_optimal',), 'jerk': ('time_optimal',),
                 'torque_rate': ('time_optimal',), 'payload_com': ('payload_frame',)},
    'doctor': {'commands': ('live',), 'joint_states': ('live',), 'efforts': ('live',),
               'efforts_without_gravity': ('live',), 'torque_constants': ('live',),
               'namespace': ('live', 'config'), 'prefix': ('live', 'config')},
    'send': {'duration': ('by',)},
}
# Options that an option of the command leaves without effect, or contradicts.
OF_FIT = ('friction_only', 'unbounded', 'weight', 'friction')
EXCLUDED: Needs = {
    'torque': {'motion': ('q', 'u', 'udot')},
    'inspect': {'against': ('constraints',)},
    'equations': {'json': ('format',)},
    'identify': {'payload': (*OF_FIT, 'standstill', 'base_parameters'),
                 'base_parameters': ('friction_only',),
                 'drives': (*OF_FIT, 'standstill', 'payload', 'base_parameters',
                            'as_recorded', 'derive_speeds', 'cutoff', 'resample', 'topic',
                            'plot', 'efforts', 'efforts_without_gravity',
                            'torque_constants')},
    'calibrate': {'collision': ('live', 'loaded', 'load', 'load_mass', 'load_com'),
                  'save': ('loaded', 'out')},
    'excite': {'friction': ('duration', 'periods', 'harmonics', 'starts', 'velocity',
                            'acceleration')},
    'feasible': {'time_optimal': ('speed', 'payload_frame', 'step')},
    'view': {'export': ('host', 'port', 'no_open')},
}
# Endings of the names of results; a name without an ending has the only one.
CSV = {'out': ('.csv',)}
ENDINGS: Needs = {
    'torque': CSV, 'feasible': CSV, 'excite': CSV, 'replay': CSV,
    'simulate': {'out': ('.npz', '.csv')}, 'calibrate': {'out': ('.yaml',)},
    'view': {'export': ('.html',)}}
INPUTS = ('urdf', 'recording', 'reference', 'loaded', 'motion', 'torque', 'supplement',
          'constraints', 'config', 'sweep')


def check_options(options: Namespace) -> None:
    """
    Refuse a stated option without effect, and a file that is both input and result.

    Parameters
    ----------
    options : Namespace
        Of a command; `stated` has its stated options, as they were written.

    Raises
    ------
    InputError
        The message names the option, and the one that it needs or contradicts.

    """
    stated: Mapping[str, str] = options.stated
    for name, needed in NEEDS.get(options.command, {}).items():
        if name in stated and not set(needed) & set(stated):
            others = ' or '.join(map(_flag, needed))
            raise InputError(f'{stated[name]}: given without {others}; expected both')
    for name, excluded in EXCLUDED.get(options.command, {}).items():
        for other in excluded:
            if name in stated and other in stated:
                raise InputError(f'{stated[other]}: given with {stated[name]}; expected '
                                 'one of them')
    for name, endings in ENDINGS.get(options.command, {}).items():
        path = Path(getattr(options, name) or '')
        if path.name and path.suffix not in endings and (path.suffix or len(endings) > 1):
            raise InputError(f"{_flag(name)}: '{path}'; expected a name that ends in "
                             f'{" or ".join(endings)}')
    refuse_inputs(options, result_files(options))


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def result_files(options: Namespace) -> list[str]:
    """Return the files that a command is told to write."""
    files = []
    for name in ('out', 'plot', 'export', 'save'):
        path = getattr(options, name, None)
        if path:
            files.append(path)
    out = getattr(options, 'out', None)
    # Some commands write two files.
    if out and options.command == 'identify':
        stem = out.removesuffix('.urdf')
        files += [f'{stem}.urdf', f'{stem}.supplement.yaml']
    elif out and options.command == 'calibrate' and not options.collision:
        files.append(f"{out.removesuffix('.yaml')}.node.yaml")
    elif out and options.command == 'export':
        files.append(f"{out.removesuffix('.c')}.h")
    return files


def refuse_inputs(options: Namespace, results: Collection[str]) -> None:
    """Raise InputError if a result has the name of a file that the command reads."""
    inputs: dict[str, str] = {}
    for name in INPUTS:
        value = getattr(options, name, None)
        for path in [value] if isinstance(value, str) else value or []:
            if os.path.exists(path):
                inputs[os.path.realpath(path)] = name
    for result in results:
        name = inputs.get(os.path.realpath(result), '')
        if name:
            raise InputError(f"--out: '{result}' is the input {name}; expected another "
                             'file, as the input would be replaced')
