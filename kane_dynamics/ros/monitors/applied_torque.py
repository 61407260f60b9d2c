"""The torque that acts on the joints, measured or commanded."""

from collections.abc import Callable, Mapping
from typing import Any

from kane_dynamics.analysis.known_arms import EffortKind
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.identification.efforts import actuated_joints, Efforts
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.command_form import EFFORT, effort_scale
from kane_dynamics.ros.parameters.parameter_checks import per_joint, terms
from kane_dynamics.ros.torque_path.closed_loop_reader import commanded_joints
import numpy as np

AT_REST = 1e-2  # largest speed of a joint at rest, rad/s or m/s


def stated_efforts(values: Mapping[str, Any], robot: Robot) -> Efforts:
    """
    Return the meaning of the efforts of joint states: parameters efforts.*.

    Raises
    ------
    InputError
        They do not fit each other or the robot, or efforts are external torques, which
        the observer cannot use.

    """
    constants = values['efforts.constants']
    try:
        efforts = Efforts(values['efforts.kind'], values['efforts.gravity'],
                          constants if constants.size else None)
    except InputError as error:
        raise InputError(f"parameters 'efforts.*': {error}") from None
    if values['observer.torque'] == 'command':
        return efforts  # not used
    if efforts.kind is EffortKind.EXTERNAL_TORQUE:
        raise InputError("parameter 'efforts.kind': external_torque, which observer and "
                         'estimator would have to find; expected the torque of the arm '
                         'itself, or '
                         "observer.torque 'command'")
    # Constants are stated for joints with motors only.
    per_joint(values, 'efforts.constants', actuated_joints(robot), 1.0)
    return efforts


class AppliedTorque:
    """
    Determines the torque that acts on the joints.

    Parameter `observer.torque` selects the effort of the joint states, converted by its
    meaning (efforts.*) and compared with the model once at rest, or the command of the
    node plus the terms that the arm adds itself (arm_compensates).

    Of an arm with beams it is the torque on the rigid model: without what the
    quasi-static deflection at the measured state, without acceleration, adds to its
    inverse dynamics.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path.
    values : mapping
        The node's parameters.
    reject : callable
        Called with the reason and the details of each state without velocities, or
        without the effort that `observer.torque` requires.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model.

    Attributes
    ----------
    measured : bool
        Whether the latest torque is the effort of the joint states.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any],
                 reject: Callable[[str, str], None],
                 bending: QuasiStatic | None = None) -> None:
        self._bending = bending
        self._robot = robot
        self._reject = reject
        self._zero = np.zeros(robot.n)
        self._actuated: list[int] | None = None
        # With closed loops, torques of actuators become generalized forces.
        if robot.constraint_names:
            self._actuated = list(commanded_joints(robot, robot.speed_names))
        self.measured = False
        robot.compile('torque_terms', 'inverse_dynamics')
        if bending is not None:
            bending.robot.compile('torque_terms', 'inverse_dynamics')
        self.update(values)

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        self._source = values['observer.torque']
        self._efforts = stated_efforts(values, self._robot)
        self._efforts.compile(self._robot)
        self._factor = values['efforts.factor']
        self._scale = effort_scale(values, actuated_joints(self._robot))
        # A drive with feedback adds a torque that the node does not know.
        self._drive_feedback = (values['commands.form'] != EFFORT
                                and values['mode'] == Mode.INVERSE_DYNAMICS)
        self._compared = False  # whether efforts at rest were compared with the weight
        on = terms(values)
        self._arm = None if on.arm is None else on.arm.entry(self._robot)
        # Terms that the arm adds to a command; it cannot add inertia, which needs udot.
        self._arm_terms = np.array([name != 'inertia' and not getattr(on, name, True)
                                    for name in TORQUE_TERMS], dtype=np.float64)

    def torque(self, state: Any, tau: Array, external: Array | None) -> Array | None:
        """
        Return the torque that acts on the joints, (n,) N m or N; None if it is unknown.

        With closed loops it is the generalized force of the independent joints.

        Parameters
        ----------
        state : JointStateReader or the like
            q, u and effort, and which of them the message had.
        tau : (n_q,) array
            The command.
        external : (n,) array or None
            Joint torques of known wrenches.

        """
        if not state.has_velocity:
            self._reject('no velocity',
                         'joint states without velocities; the observer needs them')
            return None
        self.measured = self._source != 'command' and state.has_effort
        if not self.measured and self._drive_feedback:
            self._reject('no effort', 'the drives have feedback of their own; expected '
                         'their efforts in the joint states')
            return None
        if self._source == 'effort' and not self.measured:
            self._reject('no effort',
                         'joint states without a finite effort for each joint; '
                         "observer.torque is 'effort'")
            return None
        torque = self._converted(state) if self.measured else tau
        beyond = self.measured and self._beyond(torque)
        if beyond:
            self._reject('effort beyond its limit', beyond)
            return None
        if self._actuated is not None:
            torque = self._generalized(torque, state.q)
        source = self._bending or self._robot  # whose terms the command lacks
        try:
            if not self.measured and self._arm_terms.any():
                torque = torque + self._arm_terms @ source.torque_terms(state.q, state.u,
                                                                        self._zero)
            if not self.measured and self._arm is not None:
                torque = torque + self._arm(state.q, 0.0)
            if self._bending is not None:
                if self.measured and not self._efforts.gravity:
                    # The gravity of the rigid model was added.
                    torque = (torque + self._bending.gravity_force(state.q)
                              - self._robot.gravity_force(state.q))
                torque = torque - self._deflection_torque(self._bending, state.q,
                                                          state.u)
        except KaneError as error:  # no equilibrium, or loops that do not close
            if self._bending is None:
                raise
            self._reject('no deflection', str(error))
            return None
        return torque if external is None else torque + external

    def _beyond(self, torque: Array) -> str:
        """Return the joint whose measured torque no motor has; empty without any."""
        names = actuated_joints(self._robot)
        limits = np.asarray(self._robot.limits.effort)
        largest = self._factor * limits[list(map(self._robot.joint_names.index, names))]
        beyond = np.flatnonzero(~(np.abs(torque) <= largest))
        if not len(beyond):
            return ''
        j = int(beyond[0])
        return (f"'{names[j]}': {torque[j]:.4g}; expected at most {largest[j]:.4g}, its limit "
                'times efforts.factor')

    def _converted(self, state: Any) -> Array:
        """
        Return the measured torques.

        Compare them with the weight, the first time at rest.
        """
        efforts = self._efforts
        effort = state.effort * self._scale
        q = state.q
        at_rest = np.abs(state.u).max(initial=0.0) < AT_REST
        # At rest, efforts must hold the weight: compared once.
        if not self._compared and at_rest and effort.any():
            self._compared = True
            if words := efforts.contradiction(self._robot, q, effort):
                self._reject('efforts contradict the model', words)
        return efforts.torque(self._robot, q, state.u, effort)

    def _deflection_torque(self, bending: QuasiStatic, q: Array, u: Array) -> Array:
        """Return the torque due to the deflection, without acceleration."""
        flexible = bending.inverse_dynamics(q, u, self._zero)
        rigid = self._robot.inverse_dynamics(q, u, self._zero)
        return np.asarray(flexible - rigid)

    def _generalized(self, torque: Array, q: Array) -> Array:
        """Return the generalized force, (n,), of all torques or of the actuators'."""
        whole = torque
        if self.measured:
            whole = np.zeros(len(q))
            whole[self._actuated] = torque
        return self._robot.generalized_force(whole, q)
