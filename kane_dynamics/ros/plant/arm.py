"""The simulated arm: its equations of motion, its stops, its motors, and what pushes on it."""

from kane_dynamics.model import Array
from kane_dynamics.robot import Robot
from kane_dynamics.ros.plant.stops import pushed_back
from kane_dynamics.ros.wrenches import WrenchFrames
from kane_dynamics.stepping import step_kernel
import numpy as np


class SimulatedArm:
    """
    One arm that moves by compiled Runge-Kutta steps under torques held for each of them.

    The native step works on memory that stays where it is. The stops stand at the position
    limits; speed limits are the business of whoever controls the arm and bind nothing here.

    Parameters
    ----------
    robot : Robot
        The arm's own: its parameters are used as `use_parameters` finds them.
    step : float
        s.

    Attributes
    ----------
    q, u : (n,) arrays
        The state, rad or m, and s; they stay where they are.
    effort : (n,) array
        What the motors gave in the last step, N m or N.
    limit : (n,) array
        The most that they give.
    wrenches : dict
        Of frame name to (6,), force then moment at the frame's origin in the frame's axes, N and
        N m, of the environment on the arm; held until changed. Of the robot's wrench frames.
    blows : int
        Steps in which a stop was hit or leant on.
    clamped : int
        Steps in which a motor was asked for more than its limit.

    """

    def __init__(self, robot: Robot, step: float) -> None:
        """Compile everything that a step may need."""
        n = robot.n
        self.robot = robot
        self._state, self._next, self._total = np.zeros(2 * n), np.zeros(2 * n), np.zeros((1, n))
        self.q, self.u = self._state[:n], self._state[n:]
        self.effort = np.zeros(n)
        self.limit = robot.limits.effort.copy()
        self.wrenches: dict[str, Array] = {}
        self.blows = self.clamped = 0
        self._lower, self._upper = robot.limits.lower, robot.limits.upper
        kernel = step_kernel(robot, feedback=False)
        self._constants = kernel.parameters
        self._constants[0] = step
        self.use_parameters()
        self._advance = kernel.bind([self._state, self._total], self._next, 'Step.')
        inverse_mass = robot.kernels.quantity('inverse_mass_matrix')
        self._inverse_mass = inverse_mass.bind([self.q], np.zeros(inverse_mass.shape), 'M^-1.')
        self.frames = WrenchFrames(robot)
        robot.compile('external_force')

    @property
    def at_stops(self) -> list[str]:
        """Names of the joints that stand at a stop."""
        there = (self.q <= self._lower) | (self.q >= self._upper)
        return [self.robot.joint_names[k] for k in np.flatnonzero(there)]

    def use_parameters(self) -> None:
        """Step from now on with gravity and payload as the robot's parameters are."""
        self._constants[1:] = self.robot.parameters.block

    def put(self, q: Array) -> None:
        """Put the arm at rest at a position, with no torque and nothing that pushes."""
        self.q[:], self.u[:], self.effort[:] = q, 0.0, 0.0
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
        self._total[0] = self.effort
        if self.wrenches:
            self._total[0] += self._external()
        self._advance()
        self._state[:] = self._next
        if (self.q < self._lower).any() or (self.q > self._upper).any():
            self._stop()

    def _external(self) -> Array:
        """Return what the wrenches do along each joint, (n,), at the present position."""
        world = self.frames.in_world(self.q, ((self.frames.row(frame), wrench)
                                              for frame, wrench in self.wrenches.items()))
        return self.robot.external_force(self.q, wrench=world)

    def _stop(self) -> None:
        """
        Push back the joints that went past a stop, and take away their speed into it.

        Both through the mass matrix: a joint that is merely put back would have carried the
        others along in a fall that never was.
        """
        q, W = self.q, self._inverse_mass()
        nearer = np.where(self._upper - q < q - self._lower, self._upper, self._lower)
        side = np.where(nearer == self._upper, 1.0, -1.0) * np.isfinite(nearer)
        past = np.where(np.isfinite(nearer), q - nearer, 0.0)
        q += pushed_back(past, side, W) - past
        np.clip(q, self._lower, self._upper, out=q)
        side = np.where(q >= self._upper, 1.0, np.where(q <= self._lower, -1.0, 0.0))
        self.u[:] = pushed_back(self.u, side, W)
        self.blows += 1
