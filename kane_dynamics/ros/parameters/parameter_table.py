"""
The table of the node's parameters: what each is called, means, and may be.

Numbers and lists are declared with dynamic typing, so that ``100`` does for ``100.0`` and one
number does for a list with one per joint.
"""

from dataclasses import dataclass
import math
from typing import Any, Literal

from kane_dynamics.control.controller import Mode
from kane_dynamics.simulation.step_kernels import INTEGRATORS

Kind = Literal['text', 'flag', 'number', 'count', 'names', 'vector', 'six', 'numbers',
               'per_joint']


@dataclass(frozen=True)
class Spec:
    """
    What one parameter is.

    `live` parameters may change while the node is active; the others describe the robot, so they
    may change only while the node is unconfigured. `low` and `high` bound numbers (zero is
    excluded where `positive` holds, infinity unless `infinite` does).
    """

    name: str
    kind: Kind
    default: Any
    description: str
    live: bool = False
    low: float = -math.inf
    high: float = math.inf
    positive: bool = False
    infinite: bool = False
    choices: tuple[str, ...] = ()
    read_only: bool = False

    @property
    def constraint(self) -> str:
        """Say in words which values are valid."""
        if self.choices:
            return 'one of ' + ', '.join(self.choices)
        number = ('positive' if self.positive else 'finite' if self.low == -math.inf else
                  f'at least {self.low:g}')
        if self.high < math.inf:
            number += f', at most {self.high:g}'
        number += ' or infinite' if self.infinite else ''
        return {'text': 'text', 'flag': 'true or false', 'names': 'a list of names, each once',
                'vector': 'three finite numbers', 'six': 'six finite numbers',
                'numbers': f'a list of whole numbers, each {number}',
                'number': f'a number, {number}',
                'count': f'a whole number, {number}',
                'per_joint': f'one number or one per joint, each {number}'}[self.kind]


def live(name: str, kind: Kind, default: Any, description: str, **bounds: Any) -> Spec:
    """Return the Spec of a parameter that may change while the node is active."""
    return Spec(name, kind, default, description, live=True, **bounds)


SPECS = (
    Spec('autostart', 'flag', True, 'configure and activate as soon as the URDF is known',
         read_only=True),
    Spec('robot_description', 'text', '', 'URDF as text; wins over `urdf` and over the topic'),
    Spec('urdf', 'text', '', 'path of a URDF file; wins over the topic robot_description'),
    Spec('supplement', 'text', '', 'path of the YAML beside the URDF: springs, armature, '
         'friction, payload; empty: none'),
    Spec('base', 'text', '', 'first link of the part that moves; empty: the root'),
    Spec('tip', 'text', '', 'last link of the part that moves; empty: all branches'),
    Spec('joints', 'names', [], 'joints that move, in the order of `commands`; every other one '
         'is locked; empty: all, parents first'),
    Spec('constraints', 'text', '', 'path of a YAML with closed loops and other constraints; the '
         'node then answers requests and commands nothing; empty: none'),
    Spec('prefix', 'text', '', 'put before the names of joints and frames in all messages, for '
         'two arms of one URDF; parameters and supplement have the names of the URDF'),
    live('gravity', 'vector', [0.0, 0.0, -9.81], 'gravity in world axes, m/s^2'),
    Spec('payload.frame', 'text', '', 'frame in which a payload is given and on whose link it is '
         'carried; empty: the node carries none'),
    live('payload.mass', 'number', 0.0, 'what the arm carries, kg, until ~/set_payload or this '
         'parameter changes it', low=0.0),
    live('payload.com', 'vector', [0.0, 0.0, 0.0], 'mass centre of that payload from the origin '
         'of payload.frame, in its axes, m'),
    live('payload.inertia', 'six', [0.0] * 6, 'inertia xx, xy, xz, yy, yz, zz of that payload '
         'about its mass centre, kg m^2'),
    live('payload.max_mass', 'number', 50.0, 'largest payload accepted, kg', positive=True,
         low=0.0),
    live('payload.max_distance', 'number', 2.0, 'largest distance of its mass centre from the '
         'frame, m', positive=True, low=0.0),
    Spec('imu.topic', 'text', '', 'sensor_msgs/Imu at rest on the base of the arm, from which '
         'the direction of gravity is taken; its magnitude stays that of `gravity`; empty: none'),
    Spec('imu.frame', 'text', '', 'frame of the IMU, fixed to the base; empty: the one that its '
         'messages name'),
    live('imu.time_constant', 'number', 1.0, 'low-pass of the direction, s; it is used after as '
         'long at rest', positive=True, low=0.0, high=3600.0),
    Spec('wrench.frames', 'names', [], 'frames at which ~/wrench may tell what the environment '
         'exerts on the robot; the torques make up for it, but in gravity_compensation; empty: '
         'none'),
    live('wrench.timeout', 'number', 0.1, 'age of a wrench, in s, from which on its frame counts '
         'as unloaded', positive=True, low=0.0, high=3600.0),
    live('wrench.max_force', 'number', 1000.0, 'largest component of a force accepted, N',
         positive=True, low=0.0),
    live('wrench.max_moment', 'number', 300.0, 'largest component of a torque accepted, N m',
         positive=True, low=0.0),
    live('mode', 'text', 'inverse_dynamics', 'what `commands` holds', choices=tuple(Mode)),
    live('compensate.gravity', 'flag', True, 'let `commands` carry gravity; false for an arm '
         'that adds it itself'),
    live('compensate.coriolis', 'flag', True, 'let `commands` carry Coriolis and centrifugal '
         'terms'),
    live('compensate.inertia', 'flag', True, 'let `commands` carry M(q) udot'),
    live('compensate.friction', 'flag', True, 'let `commands` carry joint friction'),
    live('gains.kp', 'per_joint', 100.0, 'computed torque: position gain, 1/s^2', low=0.0),
    live('gains.kd', 'per_joint', 20.0, 'computed torque: velocity gain, 1/s', low=0.0),
    live('limits.effort', 'per_joint', [], 'largest effort, N m or N; the smaller of this and '
         'of the URDF holds; empty: the URDF alone', positive=True, infinite=True, low=0.0),
    live('limits.rate', 'per_joint', [], 'largest change of effort, N m/s or N/s; empty: none',
         positive=True, infinite=True, low=0.0),
    Spec('observer.enabled', 'flag', False, 'estimate external torques, publish them and a '
         'collision flag'),
    live('observer.torque', 'text', 'auto', 'torque that acts on the arm: the effort of the joint '
         'states, the own command (right only if nothing else commands the arm), or auto: effort '
         'where each joint has one', choices=('auto', 'effort', 'command')),
    live('observer.gain', 'per_joint', 50.0, 'bandwidth of the estimate, 1/s: a push is found to '
         '63 % after 1/gain', positive=True, low=0.0, high=1e4),
    live('observer.threshold', 'per_joint', [], 'external torque that is a collision, N m or N; '
         'it must exceed what the model lacks, friction above all; empty: 2 % of the effort '
         'limits', positive=True, infinite=True, low=0.0),
    live('observer.confirm', 'number', 0.005, 'time beyond a threshold after which it is a '
         'collision, s', low=0.0, high=10.0),
    live('observer.release', 'number', 0.5, 'share of the thresholds below which a collision '
         'ends', positive=True, low=0.0, high=1.0),
    live('observer.clear', 'number', 0.2, 'time below that after which it ends, s', low=0.0,
         high=60.0),
    Spec('observer.frame', 'text', '', 'frame of ~/external_wrench; empty: `tip`, or the last '
         'link'),
    live('observer.rate', 'number', 100.0, 'external torques and wrenches published, at most, '
         '1/s', low=1e-3, high=1e4),
    Spec('estimator.enabled', 'flag', False, 'estimate what the arm carries, by recursive least '
         'squares, and publish it; the torques do not follow it'),
    Spec('estimator.rate', 'number', 2.0, 'estimates published, 1/s', low=1e-3, high=100.0),
    Spec('estimator.memory', 'number', 20.0, 'time constant of forgetting, s', positive=True,
         low=0.0, high=1e5),
    Spec('estimator.torque_deviation', 'per_joint', [], 'standard deviation of what the model '
         'leaves of the torques, N m or N; empty: 1 % of the effort limits', positive=True,
         low=0.0),
    Spec('explanation.rate', 'number', 0.0, 'messages on ~/torque_by_source, 1/s; 0: none',
         low=0.0, high=100.0),
    live('state_timeout', 'number', 0.1, 'age of the joint states, in s, from which on zeros '
         'are commanded and the desired motion is forgotten', low=1e-3, high=3600.0),
    live('diagnostics_rate', 'number', 1.0, 'reports on /diagnostics, 1/s', low=1e-3, high=100.0),
    live('trajectory.max_points', 'count', 10_000, 'longest desired motion accepted, points',
         low=1.0, high=1e6),
    live('simulation.max_duration', 'number', 3600.0, 'longest simulation accepted, s',
         positive=True, low=0.0),
    live('simulation.max_steps', 'count', 1_000_000, 'most steps of one simulation', low=1.0,
         high=1e8),
    live('simulation.max_points', 'count', 2000, 'most points in one simulated trajectory; the '
         'torque path waits while thousands are converted', low=2.0, high=1e6),
    Spec('simulation.integrator', 'text', 'rk4', 'rk4, or implicit: for friction, springs and '
         'beams that would take very short steps', choices=INTEGRATORS),
    live('simulation.max_waiting', 'count', 8, 'simulations that may wait for their turn; '
         'further ones are told that the node is busy', low=1.0, high=1000.0),
    Spec('realtime.priority', 'count', 0, 'SCHED_FIFO priority of the torque path; 0: ordinary '
         'scheduling', low=0.0, high=99.0),
    Spec('realtime.cpus', 'numbers', [], 'processors for the torque path; empty: all', low=0.0),
    Spec('realtime.lock_memory', 'flag', False, 'keep the process in memory (mlockall)'),
    Spec('realtime.collect_rarely', 'flag', False, 'collect garbage with the diagnostics only, '
         'not whenever the interpreter thinks fit'),
)
BY_NAME = {spec.name: spec for spec in SPECS}
