"""The simulated arm: equations of motion, joint stops, motors and external wrenches."""

from collections.abc import Collection, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import NO_TERM, Terms
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.conditioning import described
from kane_dynamics.model.elastic_model import with_motors_at_links
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
from kane_dynamics.ros.loads.wrench_input import WrenchFrames
from kane_dynamics.ros.plant.simulated_drives import actuator_coordinates, settle_drives
from kane_dynamics.ros.torque_path.closed_loop_reader import commanded_joints
from kane_dynamics.simulation.contact import checked_contacts, Contact, require_open
from kane_dynamics.simulation.energy_balance import EnergyBalance
from kane_dynamics.simulation.motion_samples import motion_at, MotionSamples, speeds_in
from kane_dynamics.simulation.presliding import require_no_bristles
from kane_dynamics.simulation.step_kernels import (deflections_of, state_layout,
                                                   state_names, step_kernel, StepChoice)
from kane_dynamics.simulation.step_size import (stable_integrator, step_warning,
                                                without_coulomb)
from kane_dynamics.simulation.stepper import compile_rows, RowSteps
from kane_dynamics.simulation.torque_input import TorqueInput
import numpy as np

BLOCK = 2000  # steps that are kept and checked together


def added_terms(arm_compensates: Collection[str]) -> Array | None:
    """
    Return the weight of each torque term that the simulated arm adds itself.

    The result is None if it adds none.

    Raises
    ------
    InputError
        The list is empty or invalid, or has inertia, which needs a desired acceleration.

    """
    commanded = Terms.beside(arm_compensates)
    if not commanded.inertia:
        raise InputError(f"parameter 'arm_compensates': {list(arm_compensates)}; "
                         'expected no inertia, which needs a desired acceleration')
    if commanded.complete:
        return None
    # The rows are those of `torque_terms`; the springs are part of the arm.
    return np.array([not getattr(commanded, name, True) for name in TORQUE_TERMS],
                    dtype=np.float64)


def joint_count(robot: Robot) -> int:
    """Return the number of joints; flexible modes and the motors of drives come behind."""
    model = robot.model
    return robot.n_q - len(model.modal_coordinates) - len(model.drives)


class SimulatedArm:
    """
    An arm that is simulated with compiled steps, with constant torques in each.

    Motors, sensors and stops act on the joints, which come first among the coordinates.
    Flexible modes are simulated, but neither actuated nor measured. Of elastic joints the
    motors are actuated, and motors or links measured.

    With closed loops the state is that of the independent speeds; the loops are closed
    again in every step, and the motors act through `Robot.generalized_force`.

    The native step uses fixed memory. The stops are at the position limits; velocity
    limits are not enforced.

    Parameters
    ----------
    robot : Robot
        The robot of this arm; `use_parameters` reads its parameters.
    step : float
        Integration step, s.
    integrator : str, optional
        One of `mechanics.integrators.INTEGRATORS`. None is 'rk4', or 'implicit' where
        the step is too long for it at the configuration at the start.
    arm_compensates : collection of str
        Torque terms that the arm adds to the commanded torques itself, at the state at
        the start of each step; effort limits apply to the commanded torques only.
    sticking : bool
        Exact Coulomb friction, as of `simulate`.
    sensor_side : str
        Side of the gears of elastic joints on which sensors are: 'motor' or 'link'.
    contacts : sequence of Contact
        Contacts of named points, like in `simulate`.

    Attributes
    ----------
    joint_names : tuple of str
        Names of the n joints.
    q, u : (n,) arrays
        Positions and rates of the joints, rad or m, and s; in fixed memory. Of elastic
        joints those of the links.
    effort : (n,) array
        Commanded effort of the last step, within the limits, N m or N: without what the
        arm adds.
    effort_limit : (n,) array
        Effort limit of the motors in the model.
    limit : (n,) array
        Effort limit of the motors in use.
    lower, upper : (n,) arrays
        Positions of the stops.
    wrenches : dict
        Wrench of the environment on the arm by frame name, (6,): force then moment at
        the origin and in the axes of the frame, N and N m. Constant until changed.
    stop_contacts : int
        Number of steps with a joint at a stop.
    clamped : int
        Number of steps with a command above the effort limit.
    energy : EnergyCheck
        Check of the energy balance between contacts with stops.
    integrator_choice : str
        Why the integrator is 'implicit', where it was chosen by the step; else empty.

    """

    def __init__(self, robot: Robot, step: float, integrator: str | None = None,
                 arm_compensates: Collection[str] = (NO_TERM,),
                 sticking: bool = False, sensor_side: str = 'motor',
                 contacts: Sequence[Contact] = ()) -> None:
        """Compile the kernels of a step."""
        if sticking:
            require_no_bristles(robot, 'sticking')
        self._added = added_terms(arm_compensates)
        if self._added is not None:
            robot.compile('torque_terms')
        self._at_rest = np.zeros(robot.n)
        # The arm's own controller acts on joints, not on flexible modes.
        modes = {robot.model.coordinate_names[k] for k in robot.model.modal_coordinates}
        self._driven = np.array([name not in modes for name in robot.speed_names])
        # Of elastic joints it acts on the motors, which are speeds of their own.
        self._moved = [(robot.speed_names.index(elastic.name),
                        robot.speed_names.index(elastic.drive.motor))
                       for elastic in robot.drives if elastic.name in robot.speed_names]

        # The state is that of all coordinates; published is that of the joints.
        n = joint_count(robot)
        n_q = robot.n_q
        self.robot = robot
        self.joint_names = robot.joint_names[:n]
        self._actuators = actuator_coordinates(robot)[:n]
        self._sensors = self._actuators if sensor_side == 'motor' else list(range(n))
        self._constrained = bool(robot.constraint_names)
        self._bending = QuasiStatic(robot) if modes else None
        self._state, self._next = np.zeros((2, len(state_names(robot))))
        self._total = np.zeros((1, robot.n))
        self._q = self._state[:n_q]
        self._rates = self._state[state_layout(robot).v]
        self.q = self._q[:n]
        self.u = self._rates[:n]
        self.effort = np.zeros(n)
        self._joint_torques = np.zeros(n_q)
        self.effort_limit = robot.limits.effort[self._actuators]
        self.limit = self.effort_limit.copy()
        self.wrenches: dict[str, Array] = {}
        self.frames = WrenchFrames(robot)
        self.stop_contacts = self.clamped = 0
        self.lower = robot.limits.lower[:n]
        self.upper = robot.limits.upper[:n]
        self._state[:n_q] = self._next[:n_q] = robot.feasible_configuration()

        # The kernel of a step, with constants that follow the live parameters.
        self._integrator, self.integrator_choice = _chosen_integrator(
            robot, integrator, self._q, step, sticking)
        choice = StepChoice(False, self._integrator)
        kernel = step_kernel(robot, *choice)
        self._constants = kernel.parameters
        self._constants[0] = step
        self._contacts = checked_contacts(robot, contacts)
        self._rows = RowSteps(robot, step, 0.0, stops=True, sticking=sticking,
                              contacts=self._contacts)
        # Without them, rows are needed only where a step ends beyond a stop.
        self._in_rows = (sticking or bool(contacts)) and self._rows.any_rows
        self.energy = EnergyCheck(robot, step, self._integrator,
                                  self._rows if self._in_rows else None)
        self.use_parameters()
        self._advance = kernel.bind([self._state, self._total], self._next, 'Step.')
        self._source = TorqueInput(robot, kernel, choice, step, self._constants,
                                   self._total[None])

        # What a step may need is compiled now, not while the arm moves.
        compile_rows(robot, choice, stops=True, sticking=sticking, contacts=self._contacts)
        robot.compile('inverse_mass_matrix')
        robot.compile('external_force')

    @property
    def at_stops(self) -> list[str]:
        """Return the names of the joints at a stop."""
        at_stop = (self.q <= self.lower) | (self.q >= self.upper)
        return [self.joint_names[k] for k in np.flatnonzero(at_stop)]

    @property
    def measured(self) -> tuple[Array, Array]:
        """Return positions and rates at the sensors, (n,) each, rad or m, and s."""
        return self._q[self._sensors], self._rates[self._sensors]

    def commanded(self, actuated: Collection[str] = ()) -> list[int]:
        """
        Return the joints, by index, whose actuators take commands.

        `actuated` names them in a robot with drives, whose springs leave fewer actuators
        than independent speeds.
        """
        joints = commanded_joints(self.robot, self.robot.speed_names)
        if actuated and self.robot.drives:
            joints = tuple(sorted(map(self.robot.joint_names.index, actuated)))
        return [k for k in joints if k < len(self.joint_names)]  # modes, motors have none

    def step_warning(self) -> str | None:
        """Return a warning if the step is too long at this configuration, else None."""
        return step_warning(self.robot, self._q, float(self._constants[0]),
                            self._integrator)

    def use_parameters(self) -> None:
        """Use gravity and payload from the robot's parameters in further steps."""
        self.energy.close()
        self.energy.restart(self._state)
        self._constants[1:] = self.robot.parameters.block

    def reset(self, q: Array | None) -> None:
        """
        Put the arm at rest at q, (n,), without torque and wrenches.

        The springs of elastic joints hold the links there. With closed loops the
        independent joints are at q. None is `Robot.feasible_configuration`.
        """
        # At rest, with bristles and springs of drives relaxed.
        self._rates[:] = 0.0
        deflections_of(self.robot, self._state)[:] = 0.0
        self.effort[:] = 0.0
        if q is None:
            self._q[:] = self.robot.feasible_configuration()
        else:
            self._q[:] = self._closed(q)
        # Beams bend under the weight, and springs of drives carry it.
        if self._bending is not None:
            self._q[:] = self._bent()
        self._q[:] = settle_drives(self.robot, self._q)
        require_open(self.robot, self._contacts, self._q[None])
        self.wrenches.clear()
        self.energy.restart(self._state)

    def _bent(self) -> Array:
        """Return the configuration with the beams' deflection under the weight."""
        assert self._bending is not None
        relaxed = with_motors_at_links(self.robot.model, self._q)
        modes = set(self.robot.model.modal_coordinates)
        others = [k for k in range(self.robot.n_q) if k not in modes]
        return self._bending.configuration(relaxed[others])

    def _closed(self, q: Array) -> Array:
        """Return the closed configuration whose independent joints are at q."""
        robot = self.robot
        whole = np.append(q, np.zeros(robot.n_q - len(q)))  # straight beams
        whole = with_motors_at_links(robot.model, whole)
        return robot.closed_configuration(whole, fixed=robot.speed_names)

    def step(self, torque: Array) -> None:
        """
        Advance by one step.

        Parameters
        ----------
        torque : (n,) array
            Commanded torque, N m or N.

        Raises
        ------
        InputError
            The motion diverged (non-finite state), or the loops are near a singular
            configuration; the state is unchanged.

        """
        # 1. The efforts of the motors, within their limits.
        np.clip(torque, -self.limit, self.limit, out=self.effort)
        if (self.effort != torque).any():
            self.clamped += 1
        # 2. The generalized force: motors, terms that the arm adds itself, wrenches.
        # Modes of beams have no motors; of elastic joints only the motors have torques.
        if self._constrained:
            self._joint_torques[self._actuators] = self.effort
            self._total[0] = self.robot.generalized_force(self._joint_torques, self._q)
        else:
            self._total[0] = 0.0
            self._total[0, self._actuators] = self.effort
        if self._added is not None:
            self._total[0] += self._compensation(self._added)
        if self.wrenches:
            self._total[0] += self._external()
        # 3. One integration step; its last number is positive where the loops were
        # closed.
        if self._in_rows:
            self._next[:] = self._rows.step_end(self._source, self._state.copy())
            if not np.isfinite(self._next).all():
                raise InputError('the motion diverged: not finite; expected torques of a '
                                 'motion in a physical range')
        else:
            self._advance()
        if self._constrained and not self._next[-1] > 0.0:
            raise InputError('closed loops: near a singular configuration at '
                             f'{described(self.robot.mechanism, self._q)}; expected a '
                             'motion away from it')
        # 4. A joint beyond its limits: the step is repeated with the forces of the
        # stops.
        n = len(self.q)
        if self._in_rows:
            self._accept_rows()
        elif (self._next[:n] < self.lower).any() or (self._next[:n] > self.upper).any():
            self._apply_stops()
        else:
            self._state[:] = self._next
            self.energy.add(self._total[0], self._state)

    def _compensation(self, weights: Array) -> Array:
        """Return the generalized force of the terms that the arm adds itself, (n,)."""
        terms = self.robot.torque_terms(self._q, speeds_in(self.robot, self._state), self._at_rest)
        added = np.where(self._driven, weights @ terms, 0.0)
        for link, motor in self._moved:
            added[motor] += added[link]
            added[link] = 0.0
        return added

    def _external(self) -> Array:
        """Return the generalized force of the wrenches at the present configuration."""
        rows = [(self.frames.row(frame), wrench)
                for frame, wrench in self.wrenches.items()]
        world = self.frames.in_world(self._q, rows)
        return self.robot.external_force(self._q, wrench=world)

    def _accept_rows(self) -> None:
        """Accept a step of rows, in which joints and contacts may have hit."""
        self._state[:] = self._next
        at_stop = self._rows.rows(self.robot).sides(self._state) != 0.0
        self.stop_contacts += int(at_stop.any())
        if self._rows.changed:  # an impact takes energy, friction has a kink
            self.energy.close()
            self.energy.restart(self._state)
        else:
            self.energy.add(self._total[0], self._state)

    @property
    def stuck(self) -> list[str]:
        """Return the names of the joints that friction holds; none with the smooth law."""
        if not self._in_rows:
            return []
        held = self._sample().sticking[0][:len(self.joint_names)]
        return [name for name, sticks in zip(self.joint_names, held) if sticks]

    @property
    def touching(self) -> list[str]:
        """Return the names of the contacts that touch."""
        names = self._rows.contact_names
        if not names:
            return []
        return [name for name, mode in zip(names, self._sample().contact_modes[0]) if mode]

    def _sample(self) -> MotionSamples:
        """Return forces and modes of the rows at the present state."""
        return motion_at(self.robot, self._state[None], self._total, np.zeros(1), self._rows)

    def _apply_stops(self) -> None:
        """Advance by a step with the forces and the impulses of the stops."""
        self.energy.add(self._total[0], self._next)
        self.energy.close()
        self._state[:] = self._rows.step_end(self._source, self._state.copy())
        self.energy.restart(self._state)
        self.stop_contacts += 1


class EnergyCheck:
    """
    Checks the energy balance of the simulated arm at the end of each block of steps.

    Parameters
    ----------
    robot : Robot
    step : float
        s.
    integrator : str
        One of `mechanics.integrators.INTEGRATORS`.
    friction : RowSteps, optional
        Exact friction in place of the smooth law.

    Attributes
    ----------
    warning : str
        The warning of the first block with an energy error; empty if there is none.

    """

    def __init__(self, robot: Robot, step: float, integrator: str,
                 friction: RowSteps | None = None) -> None:
        self._arguments = robot, step
        self._integrator = integrator
        self._friction = friction
        self._states = np.zeros((1, BLOCK + 1, len(state_names(robot))))
        self._torques = np.zeros((1, BLOCK, robot.n))
        self.warning = ''
        self.restart(self._states[0, 0])

    def restart(self, state: Array) -> None:
        """Begin a block at a state; the balance does not include earlier motion."""
        self._states[0, 0] = state
        self._count = 0
        self._balance = EnergyBalance(*self._arguments, self._states[:, 0],
                                      self._integrator, friction=self._friction)

    def add(self, torque: Array, state: Array) -> None:
        """Add a step: the torques held during it, and the state after it."""
        k = self._count
        self._torques[0, k] = torque
        self._states[0, k + 1] = state
        self._count = k + 1
        if self._count == BLOCK:
            self.close()

    def close(self) -> None:
        """Check the steps of the block, and begin the next one where they ended."""
        k = self._count
        if not k:
            return
        balance = self._balance
        balance.update(self._states[:, :k + 1].copy(), 0, self._torques[:, :k])
        self.warning = self.warning or balance.warning() or ''
        self.restart(self._states[0, k].copy())


def _chosen_integrator(robot: Robot, integrator: str | None, q: Array, step: float,
                       sticking: bool) -> tuple[str, str]:
    """
    Return the integrator, by the step without a stated one, and why it was chosen.

    The reason is empty where the explicit one is stable or an integrator is stated.
    """
    if integrator is not None:
        return integrator, ''
    smooth = without_coulomb(robot) if sticking else robot
    chosen, words = stable_integrator(smooth, q[None], step, None, 0.0)
    return chosen, words or ''
