"""Estimate the payload of an arm from a recording."""

from dataclasses import dataclass

from kane_dynamics._util.checks import number
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.payload.payload_equations import PayloadEquations
from kane_dynamics.identification.payload.payload_rows import PayloadRows
from kane_dynamics.identification.payload.recorded_motion import recorded_joints, recorded_motion
from kane_dynamics.identification.physical_consistency import physical, prior_metric
from kane_dynamics.identification.recordings.recording import check_recording, Recording
from kane_dynamics.identification.regression import rms
from kane_dynamics.identification.solvers import on_one_processor
from kane_dynamics.mechanics.recursive.regressor import ENTRIES, pseudo_inertia_of
from kane_dynamics.model.model import Inertial, Model
from kane_dynamics.robot.robot import Robot
import numpy as np

# A ball of 1 kg around the frame: the initial guess of the search, and a weak prior.
START = Inertial(1.0, np.zeros(3), 0.01 * np.eye(3))
BELIEF = 1e-3
TOLD = 0.5  # of the belief's deviation of the mass: more is no finding but the belief
# Deviation of friction and offset that the model does not know, fraction of the effort
# limit.
DOUBT = 0.1
ROUNDING = 1e-12  # of the largest information
SCALE = 0.05  # standard deviation of the scale of all torques
PRESENT = 2.0  # deviations of the mass, of a payload that is there
ROWS = 20  # each half has as many as there are parameters, or more


@dataclass(frozen=True, eq=False)
class Payload:
    """
    An estimated payload.

    Attributes
    ----------
    inertial : Inertial
        In the axes of the payload's frame; physical.
    mass_deviation : float
        Standard deviation of the mass, kg. All deviations count the correlation of
        residuals, and what the model's friction and the torque's zero may be wrong by:
        `payload_equations`; and the scale of the torques.
    com_deviation : (3,) array
        Standard deviation of the center of mass, m; infinite without a clear mass.
    inertia_deviation : (3, 3) array
        Of the inertia about it, kg m^2.
    residual : (n,) array
        RMS of the torque that it leaves unexplained, N m or N.
    held_out : (n,) array
        RMS of what a payload fitted to the first half of the rows leaves of the second
        half.
    condition : float
        Condition number of the weighted equations, columns scaled to unit length;
        infinite if the motion does not tell all ten parameters.

    """

    inertial: Inertial
    mass_deviation: float
    com_deviation: Array
    inertia_deviation: Array
    residual: Array
    held_out: Array
    condition: float

    @property
    def is_present(self) -> bool:
        """Return whether the mass is clearly more than its deviation."""
        return self.inertial.mass > PRESENT * self.mass_deviation


@on_one_processor
def identify_payload(model: Model | Robot, recording: Recording, frame: str, *,
                     torque_scale: float = SCALE) -> Payload:
    """
    Estimate the payload from the difference between measured and computed torques.

    Parameters
    ----------
    model : Model or Robot
        Of the arm alone, friction included. A robot has its own speeds and constraints.
    recording : Recording
        Of the arm with the payload. With constraints, of the joints of
        `Robot(actuated=)` in the order of `Robot.actuated_names`, or else of those whose
        rates are the independent speeds, in the order of `Robot.speed_names`: the others
        follow from the constraints. Noise of more actuators than independent speeds
        counts as proportional to their effort limits.
    frame : str
        In whose axes the payload is described.
    torque_scale : float
        Standard deviation of the scale of all torques, which no residual shows; a part of
        that of the mass.

    Raises
    ------
    InputError
        No such frame, the recording is not of the model's joints, it has too few rows,
        or its motion does not identify the mass. The constraints are not those of
        positions, or the actuators are not joints.
    ConstraintError
        The recorded positions do not close the loops.

    """
    if isinstance(model, Robot):
        robot = model
    else:
        check_recording(model, recording, ROWS)
        robot = Robot(model)
    names = recorded_joints(robot)
    check_recording(robot.model, recording, ROWS, names)
    rows = PayloadRows(robot, frame)
    q, u, udot, tau, t = recorded_motion(robot, names, recording)
    Y, rates, torque, _, acting = rows(q, u, udot, tau, t)
    # The belief keeps what the motion does not tell from looking certain.
    belief = BELIEF * prior_metric(START)
    effort = np.asarray(robot.limits.effort)[list(map(robot.joint_names.index, names))]
    largest = np.where(np.isfinite(effort), effort, np.abs(recording.tau).max(axis=0))
    uncertainty = np.maximum(DOUBT * largest, 1e-6)
    equations = PayloadEquations(rows.friction_speed, uncertainty, belief,
                                 shared=rows.shared)
    samples: list[Array] = [Y, rates, torque]
    if acting is not None:  # the noise of actuators that share a load: as their effort limits
        samples += [np.broadcast_to(uncertainty, torque.shape), acting]

    # After the first half of the rows the estimate is that which predicts the second
    # half.
    middle = len(torque) // 2
    for row in zip(*(sample[:middle] for sample in samples), strict=True):
        equations.add(equations.row(*row))
    of_first_half, _ = _solved(*equations.solve(), belief)
    for row in zip(*(sample[middle:] for sample in samples), strict=True):
        equations.add(equations.row(*row))
    x, covariance = _solved(*equations.solve(), belief)
    sigma = np.maximum(rms(torque - Y @ x), 1e-9)
    A = (Y / sigma[:, None]).reshape(-1, 10)
    mass, com = load_deviations(x, covariance)
    if mass > TOLD * np.sqrt(np.linalg.inv(belief)[0, 0]):
        raise InputError(f"recording: the mass at '{frame}' is not identifiable, its "
                         f'standard deviation is {mass:.3g} kg; expected configurations '
                         'or motions in which that mass causes joint torques')
    lengths = np.linalg.norm(A, axis=0)
    condition = float(np.linalg.cond(A / lengths)) if lengths.all() else np.inf
    # A wrong scale of all torques is a wrong mass, which no residual shows.
    scale = number(torque_scale, 'torque_scale', 'a number >= 0 and below 1',
                   lambda share: 0.0 <= share < 1.0)
    mass = float(np.hypot(mass, scale * x[0]))
    if x[0] <= PRESENT * mass:
        com = np.full(3, np.inf)
    return Payload(Inertial.from_pseudo_inertia(pseudo_inertia_of(x)), mass, com,
                   _inertia_deviation(x, covariance), sigma,
                   rms(torque[middle:] - Y[middle:] @ of_first_half), condition)


def _solved(information: Array, weighted: Array, belief: Array) -> tuple[Array, Array]:
    """Return the physical parameters, (10,), that fit best, and their covariance."""
    values, V = in_beliefs(information, belief)
    # Equations R x = z with R^T R = information, in the directions that the rows know.
    root = np.sqrt(values)
    z = V.T @ weighted / np.where(root > 0.0, root, np.inf)
    x = physical(root[:, None] * (V.T @ belief), z, [START], np.zeros(0), BELIEF)
    return x, (V / (1.0 + values)) @ V.T


def in_beliefs(information: Array, belief: Array) -> tuple[Array, Array]:
    """
    Return the information, (10,), in directions V, (10, 10), in units of the belief.

    V^T belief V = 1 and V^T information V = diag(values). Where the information is
    rounding of that in other directions, it is 0: there the belief alone counts.
    """
    # In z = L^T x, with belief = L L^T, the belief is the identity.
    inverse = np.linalg.inv(np.linalg.cholesky(belief))
    values, axes = np.linalg.eigh(inverse @ information @ inverse.T)
    known = values > ROUNDING * values[-1]
    return np.where(known, values, 0.0), inverse.T @ axes


def with_belief(information: Array, weighted: Array, belief: Array,
                start: Array) -> tuple[Array, Array]:
    """Return parameters, believed to be near a start, after rows, and their covariance."""
    values, V = in_beliefs(information, belief)
    covariance = (V / (1.0 + values)) @ V.T

    # The rows move the parameters by a share of the way to their own solution.
    known = values > 0.0
    V = V[:, known]
    values = values[known]
    way = V.T @ weighted / values - V.T @ (belief @ start)
    return start + V @ (values / (1.0 + values) * way), covariance


def load_deviations(x: Array, covariance: Array) -> tuple[float, Array]:
    """Return standard deviations of mass and center of mass, linearized."""
    slope = np.column_stack([-x[1:4] / x[0]**2, np.eye(3) / x[0]])
    return (float(np.sqrt(covariance[0, 0])),
            np.sqrt(np.diag(slope @ covariance[:4, :4] @ slope.T)))


def _inertia_deviation(x: Array, covariance: Array) -> Array:
    """Return standard deviations of the inertia about the center of mass, (3, 3), linearized."""
    # The inertia about the center of mass is I - (h.h 1 - h h^T) / m: its derivatives
    # with respect to the mass, the first moment h = m c, and the entries of I.
    mass = x[0]
    # I_c = I - m (c^2 1 - c c^T) with c = h / m, differentiated by mass, by h, and by
    # the entries of I.
    h = x[1:4]
    one = np.eye(3)
    slopes = [(h @ h * one - np.outer(h, h)) / mass**2]
    for axis in one:
        slopes.append((np.outer(axis, h) + np.outer(h,
                                                    axis) - 2.0 * (axis @ h) * one) / mass)
    for r, s in ENTRIES:
        unit = np.zeros((3, 3))
        unit[r, s] = unit[s, r] = 1.0
        slopes.append(unit)
    J = np.array(slopes)
    return np.asarray(np.sqrt(np.einsum('irs,ij,jrs->rs', J, covariance, J)))
