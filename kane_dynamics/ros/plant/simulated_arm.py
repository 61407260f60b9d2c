"""The simulated arm: its equations of motion, its stops, its motors, and what pushes on it."""

from kane_dynamics._util.typing import Array
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.plant.joint_stops import pushed_back
from kane_dynamics.ros.torque_path.wrench_input import WrenchFrames
from kane_dynamics.simulation.step_kernels import step_kernel
from kane_dynamics.simulation.step_size import step_warning
import numpy as np


def joint_count(robot: Robot) -> int:
    """Return how many coordinates are joints'; those of beams' modes come after them."""
    return robot.n - len(robot.model.modal_coordinates)


class SimulatedArm:
    """
    One arm that moves by compiled integration steps under torques held for each of them.

    Its motors, sensors and stops are those of the joints, which come first among the coordinates;
    beams' modes move with them, and nothing acts on them or tells of them.

    The native step works on memory that stays where it is. The stops stand at the position
    limits; speed limits are the business of whoever controls the arm and bind nothing here.

    Parameters
    ----------
    robot : Robot
        The arm's own: its parameters are used as `use_parameters` finds them.
    step : float
        s.
    integrator : str
        One of `stepping.INTEGRATORS`.

    Attributes
    ----------
    joint_names : tuple of str
        Of the n joints.
    q, u : (n,) arrays
        Their state, rad or m, and s; they stay where they are.
    effort : (n,) array
        What the motors gave in the last step, N m or N.
    limit : (n,) array
        The most that they give.
    lower, upper : (n,) arrays
        Where the stops are.
    wrenches : dict
        Of frame name to (6,), force then moment at the frame's origin in the frame's axes, N and
        N m, of the environment on the arm; held until changed. Of the robot's wrench frames.
    blows : int
        Steps in which a stop was hit or leant on.
    clamped : int
        Steps in which a motor was asked for more than its limit.

    """

    def __init__(self, robot: Robot, step: float, integrator: str = 'rk4') -> None:
        """Compile everything that a step may need."""
        self._integrator = integrator
        whole = robot.n
        n = joint_count(robot)
        self.robot, self.joint_names = robot, robot.joint_names[:n]
        self._bending = QuasiStatic(robot) if n < whole else None
        self._state, self._next = np.zeros((2, 2 * whole))
        self._total = np.zeros((1, whole))
        self._q, self._u = np.split(self._state, 2)
        self.q, self.u = self._q[:n], self._u[:n]
        self.effort = np.zeros(n)
        self.limit = robot.limits.effort[:n].copy()
        self.wrenches: dict[str, Array] = {}
        self.blows = self.clamped = 0
        self.lower, self.upper = robot.limits.lower[:n], robot.limits.upper[:n]
        self._lower, self._upper = robot.limits.lower, robot.limits.upper
        kernel = step_kernel(robot, False, integrator)
        self._constants = kernel.parameters
        self._constants[0] = step
        self.use_parameters()
        self._advance = kernel.bind([self._state, self._total], self._next, 'Step.')
        inverse_mass = robot.kernels.quantity('inverse_mass_matrix')
        self._inverse_mass = inverse_mass.bind([self._q], np.zeros(inverse_mass.shape), 'M^-1.')
        self.frames = WrenchFrames(robot)
        robot.compile('external_force')

    @property
    def at_stops(self) -> list[str]:
        """Names of the joints that stand at a stop."""
        there = (self.q <= self.lower) | (self.q >= self.upper)
        return [self.joint_names[k] for k in np.flatnonzero(there)]

    @property
    def doubt(self) -> str | None:
        """Return what to say of a step that is too long for the arm where it is, else None."""
        return step_warning(self.robot, self._q, float(self._constants[0]),
                            self._integrator)

    def use_parameters(self) -> None:
        """Step from now on with gravity and payload as the robot's parameters are."""
        self._constants[1:] = self.robot.parameters.block

    def put(self, q: Array) -> None:
        """Put the arm at rest at a position, with no torque and nothing that pushes."""
        self.q[:], self._u[:], self.effort[:] = q, 0.0, 0.0
        if self._bending is not None:
            self._q[len(self.q):] = self._bending.modes(q, self.u, self.u)
        self.wrenches.clear()

    def step(self, torque: Array) -> None:
        """
        Advance by one step.

        Parameters
        ----------
        torque : (n,) array
            What the motors are asked for, N m or N.

        Raises
        ------
        InputError
            The motion would leave the finite numbers; the state stays as it was.

        """
        np.clip(torque, -self.limit, self.limit, out=self.effort)
        if (self.effort != torque).any():
            self.clamped += 1
        self._total[0, :len(self.effort)] = self.effort
        self._total[0, len(self.effort):] = 0.0
        if self.wrenches:
            self._total[0] += self._external()
        self._advance()
        self._state[:] = self._next
        if (self.q < self.lower).any() or (self.q > self.upper).any():
            self._stop()

    def _external(self) -> Array:
        """Return what the wrenches do along each coordinate at the present position."""
        world = self.frames.in_world(self._q, ((self.frames.row(frame), wrench)
                                               for frame, wrench in self.wrenches.items()))
        return self.robot.external_force(self._q, wrench=world)

    def _stop(self) -> None:
        """
        Push back the joints that went past a stop, and take away their speed into it.

        Both through the mass matrix: a joint that is merely put back would have carried the
        others along in a fall that never was.
        """
        q, W = self._q, self._inverse_mass()
        nearer = np.where(self._upper - q < q - self._lower, self._upper, self._lower)
        side = np.where(nearer == self._upper, 1.0, -1.0) * np.isfinite(nearer)
        past = np.where(np.isfinite(nearer), q - nearer, 0.0)
        q += pushed_back(past, side, W) - past
        np.clip(q, self._lower, self._upper, out=q)
        side = np.where(q >= self._upper, 1.0, np.where(q <= self._lower, -1.0, 0.0))
        self._u[:] = pushed_back(self._u, side, W)
        self.blows += 1
