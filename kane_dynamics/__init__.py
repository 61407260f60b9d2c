"""Manipulator dynamics by Kane's method, compiled for one robot at a time."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # each name is imported at its first use: numpy and LLVM take a while
    from kane_dynamics.analysis.linearization import equilibrium, Linearization, linearized
    from kane_dynamics.analysis.power_balance import power_balance
    from kane_dynamics.analysis.vibration import natural_vibration
    from kane_dynamics.control.collision_detection import CollisionDetector, frame_wrench
    from kane_dynamics.control.computed_torque import ComputedTorque
    from kane_dynamics.control.controller import Controller, Mode
    from kane_dynamics.control.elastic_control import MotorSideControl
    from kane_dynamics.control.elastic_feedforward import ElasticFeedforward
    from kane_dynamics.control.exported_controller import controller_kernels
    from kane_dynamics.control.friction_error import FrictionError
    from kane_dynamics.control.joint_torque_feedback import JointTorqueFeedback
    from kane_dynamics.control.link_side_control import LinkSideControl
    from kane_dynamics.control.momentum_observer import MomentumObserver
    from kane_dynamics.control.motor_tracking import MotorTracking
    from kane_dynamics.control.quasi_static import QuasiStatic
    from kane_dynamics.control.terms import Terms
    from kane_dynamics.control.trajectory_feedforward import (fill_trajectory,
                                                              FilledTrajectory)
    from kane_dynamics.errors import (CompileError, ConstraintError, InputError,
                                      KaneError, ModelError, ModelWarning, SweepError, UrdfError)
    from kane_dynamics.kinematics import (inverse_kinematics, InverseKinematics, pose_error,
                                          pose_exp, pose_from, pose_log, rotation_exp,
                                          rotation_log, rotation_quaternion, rotation_rpy)
    from kane_dynamics.kinematics.cartesian_motion import cartesian_motion, CartesianMotion
    from kane_dynamics.kinematics.pose_motion import PoseLimits, PoseMotion
    from kane_dynamics.kinematics.pose_path import PosePath
    from kane_dynamics.loop_tracking.loop_error import LoopError
    from kane_dynamics.loop_tracking.loop_tracker import LoopTracker
    from kane_dynamics.mechanics.constraints import (Closure, Coupling, DependentSpeeds,
                                                     knife_edge, PointVelocity, Prescribed,
                                                     Rolling)
    from kane_dynamics.mechanics.constraints.speeds import (absolute_rates, body_angular_velocity,
                                                            momenta, Speeds)
    from kane_dynamics.mechanics.constraints.yaml_file import load_constraints
    from kane_dynamics.mjcf import load_mjcf
    from kane_dynamics.model.builder import ModelBuilder
    from kane_dynamics.model.drive import Drive, StiffnessCurve
    from kane_dynamics.model.editing import with_locked, with_model, with_names, with_tool
    from kane_dynamics.model.elastic_model import with_drives, with_rigid_joints
    from kane_dynamics.model.flexible_link import FlexibleLink
    from kane_dynamics.model.flexible_model import stiffened, with_beam
    from kane_dynamics.model.link_shapes import LinkShape
    from kane_dynamics.model.mode_shapes import Bending, Torsion
    from kane_dynamics.model.model import Body, Frame, Inertial, Joint, Limits, Model
    from kane_dynamics.model.primitive_inertias import ball, box, disc, point_mass, rod
    from kane_dynamics.motion.motion import Motion
    from kane_dynamics.motion.smooth_motion import SmoothMotion
    from kane_dynamics.robot.robot import Robot
    from kane_dynamics.simulation.contact import (Contact, CylinderSurface, load_contacts,
                                                  PlaneSurface, SphereSurface)
    from kane_dynamics.simulation.simulate import simulate
    from kane_dynamics.simulation.step_size import longest_step
    from kane_dynamics.simulation.trajectory import ContactMode, Trajectory
    from kane_dynamics.task_space.cartesian_impedance import CartesianImpedance
    from kane_dynamics.task_space.hand_guiding import HandGuiding
    from kane_dynamics.task_space.hybrid_force import HybridForce
    from kane_dynamics.task_space.joint_impedance import JointImpedance
    from kane_dynamics.task_space.operational_space import OperationalSpace
    from kane_dynamics.task_space.pose_filter import PoseFilter
    from kane_dynamics.task_space.task_space import TaskSpace
    from kane_dynamics.task_space.task_speeds import in_task_speeds
    from kane_dynamics.urdf import expand_xacro, load_urdf
    from kane_dynamics.urdf.link_shapes import load_collision_shapes

__all__ = ['Bending', 'Body', 'CartesianImpedance', 'CartesianMotion', 'Closure',
           'CollisionDetector', 'CompileError', 'ComputedTorque', 'ConstraintError',
           'Contact', 'ContactMode',
           'Controller', 'controller_kernels', 'Coupling', 'CylinderSurface', 'DependentSpeeds',
           'Drive',
           'ElasticFeedforward', 'FilledTrajectory', 'FlexibleLink', 'Frame', 'FrictionError',
           'HandGuiding', 'HybridForce', 'Inertial', 'InputError',
           'InverseKinematics', 'Joint', 'JointImpedance',
           'JointTorqueFeedback', 'KaneError', 'Limits',
           'Linearization', 'LinkShape', 'LinkSideControl', 'LoopError',
           'LoopTracker', 'Mode', 'Model', 'ModelBuilder', 'ModelError', 'ModelWarning',
           'MomentumObserver', 'Motion', 'MotorSideControl', 'MotorTracking',
           'OperationalSpace', 'PlaneSurface', 'PointVelocity',
           'PoseFilter',
           'PoseLimits', 'PoseMotion', 'PosePath',
           'Prescribed', 'QuasiStatic', 'Robot',
           'Rolling', 'SmoothMotion', 'Speeds', 'SphereSurface', 'StiffnessCurve', 'SweepError',
           'TaskSpace',
           'Terms', 'Torsion', 'Trajectory', 'UrdfError',
           'absolute_rates', 'ball', 'body_angular_velocity', 'box', 'cartesian_motion', 'disc',
           'equilibrium', 'expand_xacro',
           'fill_trajectory', 'frame_wrench', 'in_task_speeds', 'inverse_kinematics', 'knife_edge',
           'linearized',
           'load_collision_shapes', 'load_constraints', 'load_contacts', 'load_mjcf', 'load_urdf',
           'longest_step',
           'momenta', 'natural_vibration', 'point_mass', 'pose_error', 'pose_exp', 'pose_from',
           'pose_log', 'power_balance', 'rod', 'rotation_exp', 'rotation_log',
           'rotation_quaternion', 'rotation_rpy', 'simulate', 'stiffened',
           'with_beam', 'with_drives',
           'with_locked', 'with_model', 'with_names', 'with_rigid_joints', 'with_tool']

_PACKAGES = ('analysis', 'closed_forms', 'control', 'errors', 'feasibility',
             'identification', 'kinematics', 'mechanics', 'model', 'motion', 'optimal_control',
             'plot', 'robot', 'simulation', 'sweep', 'task_space', 'urdf', 'view')


if not TYPE_CHECKING:  # or a type checker would take every name for a public one

    def __getattr__(name: str) -> object:
        """Import a public name, or a subpackage, at its first use."""
        from importlib import import_module
        if name == '__version__':
            from kane_dynamics._util.resources import package_version
            return package_version()
        if name in __all__:
            value = getattr(import_module(_module_of(name)), name)
            globals()[name] = value
            return value
        module = f'{__name__}.{name}'
        if not name.startswith('__'):
            try:
                return import_module(module)
            except ModuleNotFoundError as error:
                if error.name != module:
                    raise
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def _module_of(name: str) -> str:
    """Return the module from which the lines for type checkers import a public name."""
    from pathlib import Path
    import re
    source = Path(__file__).read_text(encoding='utf-8')
    imports = re.findall(r'from (kane_dynamics\.\S+) import (\([^)]*\)|.*)', source)
    modules = [module for module, names in imports if re.search(rf'\b{name}\b', names)]
    return str(modules[0])


def __dir__() -> list[str]:
    """Return the public names, the subpackages and the version."""
    special = [name for name in globals() if name.startswith('__')]
    return sorted({*__all__, *_PACKAGES, *special, '__version__'})
