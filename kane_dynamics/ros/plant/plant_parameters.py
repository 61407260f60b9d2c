"""The table of the plant node's parameters; shared ones come from the dynamics node."""

from dataclasses import replace

from kane_dynamics.mechanics.integrators import INTEGRATORS
from kane_dynamics.ros.parameters.parameter_table import AUTO, BY_NAME, live, Spec


def _shared(*names: str) -> tuple[Spec, ...]:
    return tuple(BY_NAME[name] for name in names)


SPECS = (
    Spec('robot_description', 'text', '', 'URDF as text; overrides `urdf`'),
    Spec('urdf', 'text', '', 'path of the URDF or xacro file'),
    *_shared('supplement', 'base', 'tip', 'root_joint', 'joints'),
    replace(BY_NAME['constraints'],
            description='path of a YAML file with loop closures and other '
            'constraints; `commands` are then of its `actuated` joints; empty: none'),
    Spec('measured', 'names', [], 'joints in joint_states; empty: all'),
    replace(BY_NAME['drives.sensor_side'],
            description='where joint states of elastic joints (drives in the supplement) '
            'are measured: motor (divided by the gear ratio) or link'),
    *_shared('prefix', 'gravity', 'payload.frame'),
    replace(BY_NAME['payload.mass'],
            description='mass of the payload, kg; the dynamics node may '
            'assume another one'),
    *_shared('payload.com', 'payload.inertia', 'payload.max_mass'),
    Spec('rate', 'number', 500.0, "rate of joint states, 1/s of the plant's time",
         low=0.01, high=10_000.0),
    Spec('substeps', 'count', 2, 'integration steps between two joint states', low=1.0,
         high=1000.0),
    Spec('integrator', 'text', AUTO,
         'integrator; auto: rk4, or implicit where friction, springs or beams need more '
         'substeps with rk4', choices=(AUTO, *INTEGRATORS)),
    Spec('sticking', 'flag', False,
         'exact Coulomb friction: joints stick below breakaway friction; false: the '
         'smooth law, with which they creep'),
    replace(BY_NAME['simulation.contacts'], name='contacts',
            description='path of a YAML file with contacts of points of the robot with '
            'surfaces; empty: none'),
    Spec('publish_clock', 'flag', False,
         'publish simulated time on /clock, starting at 1 s, for '
         'nodes with use_sim_time; false: use system time'),
    live('rate_factor', 'number', 1.0,
         'rate of simulated time relative to real time; 1 unless '
         'publish_clock is true', low=1e-3, high=1e3),
    live('reset_clock', 'flag', False, 'let ~/reset set simulated time back to 1 s'),
    Spec('start_paused', 'flag', False, 'start paused; ~/pause resumes'),
    live('initial.position', 'per_joint', [],
         'initial positions, at rest, at the start and after '
         '~/reset, rad or m; empty: 0, or the middle of limits that exclude it, or the '
         'configuration of the constraints file; with closed loops those of the '
         'independent joints count'),
    Spec('arm_compensates', 'terms', ['none'],
         'torque terms that the simulated arm adds to '
         'commanded efforts itself, all but inertia; efforts in joint_states are '
         'without them'),
    *_shared('commands.form', 'commands.stiffness'),
    replace(BY_NAME['commands.damping'],
            description='damping of the drives with commands of position_offset, N m s/rad '
            'or N s/m'),
    replace(BY_NAME['efforts.scale'],
            description='torque of the drives per effort of `commands` and joint_states'),
    live('hold_until_command', 'flag', True,
         'hold the arm with brakes until the first command; '
         'false: the arm moves freely from the start'),
    live('command_timeout', 'number', 0.1,
         "age, s of the plant's time, above which the last "
         'command has timed out', positive=True, low=0.0, high=3600.0),
    live('after_timeout', 'text', 'zero',
         'torque after a command timeout: zero, or the last '
         'command, as in most effort controllers', choices=('zero', 'hold')),
    replace(BY_NAME['limits.effort'],
            description='effort limit of the motors, N m or N, in '
            'addition to that of the URDF; the smaller one applies; empty: only that of '
            'the URDF'),
    Spec('wrench.frames', 'names', [], 'frames at which ~/wrench may act; empty: none'),
    live('wrench.timeout', 'number', 0.5,
         'time for which a wrench acts unless another one '
         "follows at its frame, s of the plant's time", positive=True, low=0.0,
         high=3600.0),
    live('wrench.max_force', 'number', 1000.0,
         'largest accepted component of a force, N', positive=True, low=0.0),
    live('wrench.max_moment', 'number', 300.0,
         'largest accepted component of a moment, N m', positive=True, low=0.0),
    live('noise.position', 'per_joint', 0.0,
         'noise of published positions, standard deviation, '
         'rad or m', low=0.0),
    live('noise.velocity', 'per_joint', 0.0,
         'noise of published velocities, standard deviation, '
         'rad/s or m/s', low=0.0),
    live('noise.effort', 'per_joint', 0.0,
         'noise of published efforts, standard deviation, N m '
         'or N', low=0.0),
    live('delay.states', 'number', 0.0,
         'delay from measurement to publication of joint states, s '
         "of the plant's time, rounded up to a tick; stamps are those of the "
         'measurement', low=0.0,
         high=10.0),
    live('delay.commands', 'number', 0.0,
         'delay from reception to effect of commands, s of the '
         "plant's time, rounded up to a tick", low=0.0, high=10.0),
    live('dropout.states', 'number', 0.0, 'fraction of joint states that are dropped',
         low=0.0, high=1.0),
    live('dropout.commands', 'number', 0.0, 'fraction of commands that are dropped',
         low=0.0, high=1.0),
    live('seed', 'count', 0, 'seed of noise and dropouts; ~/reset restarts the sequence',
         low=0.0, high=1e9),
    *_shared('diagnostics_rate'),
)
