"""The table of the plant node's parameters; what it shares with the dynamics node is the same."""

from dataclasses import replace

from kane_dynamics.ros.parameters.parameter_table import BY_NAME, live, Spec
from kane_dynamics.simulation.step_kernels import INTEGRATORS


def _shared(*names: str) -> tuple[Spec, ...]:
    return tuple(BY_NAME[name] for name in names)


SPECS = (
    Spec('robot_description', 'text', '', 'URDF as text; wins over `urdf`'),
    Spec('urdf', 'text', '', 'path of a URDF file'),
    *_shared('supplement', 'base', 'tip', 'joints', 'prefix', 'gravity', 'payload.frame'),
    replace(BY_NAME['payload.mass'], description='what the arm carries, kg; the dynamics node '
            'need not know of it'),
    *_shared('payload.com', 'payload.inertia', 'payload.max_mass', 'payload.max_distance'),
    Spec('rate', 'number', 500.0, "joint states for each second of the plant's time, 1/s",
         low=0.01, high=10_000.0),
    Spec('substeps', 'count', 2, 'integration steps from one joint state to the next', low=1.0,
         high=1000.0),
    Spec('integrator', 'text', 'rk4', 'rk4, or implicit: for friction, springs and beams that '
         'would take very many substeps', choices=INTEGRATORS),
    Spec('publish_clock', 'flag', False, 'keep a time of its own, which starts at 1 s, and '
         'publish it on /clock, for nodes with use_sim_time; false: stamps are of the system'),
    live('rate_factor', 'number', 1.0, 'speed of that time: 2 is twice real time, 0.1 slow '
         'motion; without publish_clock it must be 1', low=1e-3, high=1e3),
    live('reset_clock', 'flag', False, '~/reset sets that time back to 1 s'),
    Spec('start_paused', 'flag', False, 'stand still until ~/pause says otherwise'),
    live('initial.position', 'per_joint', [], 'where the arm is at the start and after ~/reset, '
         'at rest, rad or m; empty: at 0, or at the limit next to it'),
    live('hold_until_command', 'flag', True, 'brakes hold the arm until the first command; '
         'false: it falls at once'),
    live('command_timeout', 'number', 0.1, "age of the last command, in s of the plant's time, "
         'from which on it is late', positive=True, low=0.0, high=3600.0),
    live('after_timeout', 'text', 'zero', 'torque while the command is late: none, or the last '
         'one, as most effort controllers have it', choices=('zero', 'hold')),
    replace(BY_NAME['limits.effort'], description='largest effort of the motors, N m or N; the '
            'smaller of this and of the URDF holds; empty: the URDF alone'),
    Spec('wrench.frames', 'names', [], 'frames that ~/wrench may push on; empty: none'),
    live('wrench.timeout', 'number', 0.5, 'how long a push lasts if no other follows on its '
         "frame, s of the plant's time", positive=True, low=0.0, high=3600.0),
    *_shared('wrench.max_force', 'wrench.max_moment'),
    live('noise.position', 'per_joint', 0.0, 'standard deviation of the positions sent, rad or m',
         low=0.0),
    live('noise.velocity', 'per_joint', 0.0, 'standard deviation of the velocities sent, rad/s '
         'or m/s', low=0.0),
    live('noise.effort', 'per_joint', 0.0, 'standard deviation of the efforts sent, N m or N',
         low=0.0),
    live('delay.states', 'number', 0.0, 'how much later than measured joint states are sent, s '
         "of the plant's time, up to the next tick; their stamp is that of the measurement",
         low=0.0, high=10.0),
    live('delay.commands', 'number', 0.0, 'how much later than received commands act, s of the '
         "plant's time, up to the next tick", low=0.0, high=10.0),
    live('dropout.states', 'number', 0.0, 'share of joint states that are lost', low=0.0,
         high=1.0),
    live('dropout.commands', 'number', 0.0, 'share of commands that are lost', low=0.0, high=1.0),
    live('seed', 'count', 0, 'of noise and dropouts, which ~/reset begins again', low=0.0,
         high=1e9),
    *_shared('diagnostics_rate'),
)
