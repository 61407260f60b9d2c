"""
An arm with elastic joints in MuJoCo, an independent engine: two masses a joint.

The links are those of the URDF. The rotor of every elastic joint is a body of its own
that turns in the world, and a fixed tendon over both joints is the spring and damper of
the drive between them.
"""

from collections.abc import Sequence
import re
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.model.drive import ElasticJoint, StiffnessCurve
from kane_dynamics.model.model import Joint, Model
import mujoco
import numpy as np

ROTOR_MASS = 1e-6  # kg and kg m^2: MuJoCo asks for mass; the armature is the inertia
LINEAR_FRICTION = ('damping', 'friction')  # that MuJoCo's joints have too


class TwoMassArm:
    """
    An arm with elastic joints in MuJoCo, without contacts.

    Parameters
    ----------
    urdf : str
        Text of the URDF with rigid joints.
    model : Model
        The same arm `with_drives`: constant stiffness, Spong's reduced model. Joints of
        the URDF that it does not move are fixed at 0.
    step : float
        s.
    integrator : str
        Name of one of MuJoCo's integrators: 'EULER', 'IMPLICITFAST', 'RK4', ...
    friction : bool
        Include damping and friction of both sides.

    Raises
    ------
    ModelError
        A stiffness is no number, or a motor has more than damping and Coulomb friction.

    """

    def __init__(self, urdf: str, model: Model, step: float = 2.5e-4,
                 integrator: str = 'IMPLICITFAST', friction: bool = True) -> None:
        """Compile MuJoCo's model."""
        # Shapes would need their meshes, and contacts are off.
        without_shapes = re.sub(r'<(visual|collision)\b.*?</\1>', '', urdf,
                                flags=re.DOTALL)
        spec = mujoco.MjSpec.from_string(without_shapes)
        spec.compiler.fusestatic = False
        _delete_unmoved(spec, model.joint_names)
        # Each drive adds its motor as a body, with spring and damper to the link.
        motors = {body.joint.name: body.joint for body in model.bodies}
        for elastic in model.drives:
            _add_drive(spec, elastic, motors[elastic.drive.motor], friction)
        self.model = spec.compile()
        self.model.opt.timestep = step
        self.model.opt.integrator = getattr(mujoco.mjtIntegrator, f'mjINT_{integrator}')
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        if not friction:
            self.model.dof_damping[:] = 0.0
            self.model.dof_frictionloss[:] = 0.0
            self.model.tendon_damping[:] = 0.0
        self.data = mujoco.MjData(self.model)
        # Indices in MuJoCo's coordinates and speeds of the entries of q and u.
        self._q = []
        self._u = []
        for name in model.joint_names:
            joint = self.model.joint(name)
            self._q.append(int(joint.qposadr[0]))
            self._u.append(int(joint.dofadr[0]))

    @property
    def state(self) -> tuple[Array, Array]:
        """Return q and u, (n,) each: links and motors, in the order of the model."""
        return self.data.qpos[self._q].copy(), self.data.qvel[self._u].copy()

    def put(self, q: Array, u: Array) -> None:
        """Put the arm into a state, (n,) each."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self._q] = q
        self.data.qvel[self._u] = u
        mujoco.mj_forward(self.model, self.data)

    def accelerations(self, tau: Array) -> Array:
        """Return the accelerations, (n,), at the present state under torques, (n,)."""
        self.data.qfrc_applied[self._u] = tau
        mujoco.mj_forward(self.model, self.data)
        return np.asarray(self.data.qacc[self._u])

    def step(self, tau: Array, count: int = 1) -> None:
        """Advance by steps under held torques, (n,), of links and motors, N m."""
        self.data.qfrc_applied[self._u] = tau
        mujoco.mj_step(self.model, self.data, count)

    def position(self, link: str) -> Array:
        """Return the origin of a link, (3,), m, world axes."""
        return np.array(self.data.body(link).xpos)


def _delete_unmoved(spec: Any, moved: Sequence[str]) -> None:
    """Delete the other joints, such as those of fingers, and their couplings."""
    unmoved = [joint for joint in spec.joints if joint.name not in moved]
    names = {joint.name for joint in unmoved}
    for equality in list(spec.equalities):
        if names & {equality.name1, equality.name2}:
            spec.delete(equality)
    for joint in unmoved:
        spec.delete(joint)


def _add_drive(spec: 'mujoco.MjSpec', elastic: ElasticJoint, motor: Joint,
               friction: bool) -> None:
    """Add a drive's rotor to the world, and the spring between it and the link."""
    drive = elastic.drive
    what = f"joint '{elastic.name}'"
    if isinstance(drive.stiffness, StiffnessCurve) or drive.full_coupling:
        raise ModelError(f'{what}: a curve of stiffness or full_coupling; expected a '
                         "constant stiffness and Spong's reduced model in MuJoCo")
    others = [name for name in drive.friction if name not in LINEAR_FRICTION]
    if friction and others:
        raise ModelError(f'{what}: motor friction {others}; expected only '
                         f'{", ".join(LINEAR_FRICTION)}, which MuJoCo has')
    # The rotor turns about a fixed axis: all its inertia is armature; MuJoCo refuses a
    # body without mass, whose small inertia is subtracted again.
    rotor = spec.worldbody.add_body(name=motor.name, mass=ROTOR_MASS,
                                    inertia=[ROTOR_MASS] * 3, explicitinertial=True)
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    if motor.kind == 'prismatic':
        hinge = mujoco.mjtJoint.mjJNT_SLIDE
    rotor.add_joint(name=motor.name, type=hinge, axis=[0, 0, 1],
                    armature=motor.armature - ROTOR_MASS,
                    damping=[motor.damping, 0, 0], frictionloss=motor.friction)
    # A tendon as long as the difference of both positions is the spring between them.
    tendon = spec.add_tendon(name=elastic.name, stiffness=[drive.stiffness, 0, 0],
                             damping=[drive.damping, 0, 0], springlength=[0, 0])
    tendon.wrap_joint(motor.name, 1.0)
    tendon.wrap_joint(elastic.name, -1.0)
