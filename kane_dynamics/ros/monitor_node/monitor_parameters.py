"""The parameters of `monitor_node`: its own, and those of the arm."""

from kane_dynamics.ros.parameters.parameter_table import BY_NAME, Spec

# What this node reads of the dynamics node's parameter file: names and first parts.
SHARED = ('robot_description', 'urdf', 'supplement', 'base', 'tip', 'root_joint',
          'joints', 'constraints', 'prefix', 'gravity', 'payload',
          'arm_compensates', 'arm_gravity', 'arm_payload', 'efforts', 'commands', 'wrench',
          'limits')
SPECS = (
    Spec('node', 'text', 'kane_dynamics',
         'name of the dynamics node whose torques, wrenches and payload are used'),
    *(BY_NAME[name] for name in ('observer.torque', 'diagnostics_rate')),
    Spec('estimator.rate', 'number', 2.0, 'rate of ~/payload_estimate, 1/s', low=1e-3,
         high=100.0),
    Spec('estimator.memory', 'number', 20.0,
         'time in which the estimator forgets measurements '
         '(time constant), s', positive=True, low=0.0, high=1e5),
    Spec('estimator.torque_deviation', 'per_joint', [],
         'standard deviation of the torque '
         'residual of the model, N m or N; empty: 1 % of the effort limits',
         positive=True, low=0.0),
    Spec('watch.reference', 'text', '',
         'recording of the sound arm (CSV, npz or bag) in motion, with which the arm is '
         'compared while it works, without payload but that of the model; empty: no watch '
         'over the model'),
    Spec('watch.window', 'number', 30.0,
         'time in motion after which ~/model_watch says what has changed, s', low=2.0,
         high=60.0),
    Spec('watch.smallest', 'number', 0.42,
         'smallest torque of a change that is an alarm, relative to the friction of a joint '
         'and the error of the model in the reference', low=0.0, high=100.0),
)
ALL = (*SPECS, *(spec for name, spec in BY_NAME.items()
                 if name.partition('.')[0] in SHARED))
