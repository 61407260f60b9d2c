"""Feedback of the torques of gears, which gives the motors another inertia."""

from __future__ import annotations

from kane_dynamics._util.checks import finite_row, instance, number, per_joint
from kane_dynamics._util.typing import Array, Vector
from kane_dynamics.control.elastic_feedforward import joints_with_actuators
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import joint_positions
from kane_dynamics.mechanics.elastic_joints import damping_torque, spring_torque
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike


class JointTorqueFeedback:
    """
    Feedback of the gears' torques, which gives the motors another inertia.

    tau_m = tau_J + (B / B_d) (torque - tau_J)

    With it the motor moves under `torque` as one of inertia B_d, with its friction times
    B_d / B: lighter motors with less friction (C. Ott, A. Albu-Schaeffer,
    A. Kugi, G. Hirzinger, On the passivity-based impedance control of flexible joint
    robots, IEEE Trans. Robotics 24, 2008). Each motor has a law of its own, so that every
    kind of mechanism has it.

    Parameters
    ----------
    robot : Robot
        With elastic joints, all or some.
    inertia : float or (n,) array_like
        B_d, joint-side, kg m^2, positive, one or one for each of `joint_names`; those of
        rigid joints do not matter.

    Attributes
    ----------
    joint_names : tuple of n str
        Joints with actuators: of a tree all; under constraints those with drives, and the
        rigid ones of the robot's `actuated`.

    Raises
    ------
    InputError
        The robot has no elastic joints, or a drive with `full_coupling`; or an inertia is
        not positive.

    """

    def __init__(self, robot: Robot, *, inertia: ArrayLike) -> None:
        """Check the inertias and compile the torques of the gears."""
        instance(robot, Robot, 'robot')
        if not robot.drives:
            raise InputError('robot: with rigid joints; expected one with elastic '
                             'joints, from with_drives')
        for name, drive, _, _ in robot.drives:
            if drive.full_coupling:
                raise InputError(f"joint '{name}': a drive with full_coupling; expected "
                                 "Spong's reduced model")
        self.robot = robot
        self.joint_names = joints_with_actuators(robot)
        self.inertia = per_joint(inertia, 'inertia', self.joint_names)
        # The inertia divides the torque: it must not vanish.
        for name, value in zip(self.joint_names, self.inertia):
            if value == 0.0:
                raise InputError(f"inertia: 0 of joint '{name}'; expected a positive "
                                 'number')

        # By drive: its place among the joints with actuators, its link and its motor.
        self._drives = [self.joint_names.index(elastic.name) for elastic in robot.drives]
        self._links = [elastic.link for elastic in robot.drives]
        self._motors = [elastic.motor for elastic in robot.drives]
        # The joints that the actuators move: motors, and rigid joints themselves.
        names = robot.joint_names
        self._moved = list(map(names.index, self.joint_names))
        for k, motor in zip(self._drives, self._motors):
            self._moved[k] = motor
        count = len(self._drives)
        self._gear_torques = robot.compiled(self._traced, name='gear_torques',
                                            deflections=(count,), rates=(count,),
                                            shape=(count,))

    def torque(self, q: ArrayLike, u: ArrayLike, torque: ArrayLike, *,
               t: float = 0.0) -> Array:
        """
        Return tau, (n,), for torques of `joint_names` in a state; rigid joints keep theirs.

        Parameters
        ----------
        q, u : (n_q,) and (n,) array_like
            State of links and motors.
        torque : array_like
            Of the joints with actuators, N m or N.
        t : float
            Time, s, on which constraints may depend.

        """
        robot = self.robot
        t = number(t, 't', 'a finite number, s', np.isfinite)
        q = finite_row(q, 'q', robot.coordinate_names)
        u = finite_row(u, 'u', robot.speed_names, part='speed')
        torque = finite_row(torque, 'torque', self.joint_names)
        positions = joint_positions(robot.model, q)
        rates = robot.joint_rates(q, u, t=t)
        gear_torques = self._gear_torques(
            (positions[self._motors] - positions[self._links]).astype(np.float64),
            rates[self._motors] - rates[self._links])
        shaped = torque.copy()
        for k, elastic, gear_torque in zip(self._drives, robot.drives, gear_torques):
            share = elastic.drive.rotor_inertia / self.inertia[k]
            shaped[k] = gear_torque + share * (torque[k] - gear_torque)
        torques = np.zeros(robot.model.n)
        torques[self._moved] = shaped
        return np.asarray(robot.generalized_force(torques, q, t=t))

    def _traced(self, deflections: Vector, rates: Vector) -> Vector:
        """Return the torques of the gears, (k,), over any scalar."""
        torques = []
        for elastic, deflection, rate in zip(self.robot.drives, deflections, rates):
            torque = spring_torque(elastic.drive, deflection)
            if self.robot.friction:
                torque = torque + damping_torque(elastic.drive, rate)
            torques.append(torque)
        return np.array(torques)
