"""The drives of the simulated arm: which coordinates motors move, and springs that hold."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.elastic_joints import spring_torque
from kane_dynamics.model.drive import Drive
from kane_dynamics.model.elastic_model import with_motors_at_links
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np

HALVINGS = 80  # of an interval: more than a double has binary digits


def actuator_coordinates(robot: Robot) -> list[int]:
    """Return the coordinate that the actuator of each coordinate moves: itself, or a motor."""
    model = robot.model
    coordinates = list(range(robot.n_q))
    for elastic in model.drives:
        coordinates[_place(model, elastic.link)] = _place(model, elastic.motor)
    return coordinates


def _place(model: Model, speed: int) -> int:
    """Return the index in q of a joint of one degree of freedom, by its index in u."""
    place = model.places[speed]
    assert place is not None  # ball joints have no drives
    return place


def settle_drives(robot: Robot, q: Array) -> Array:
    """Return the configuration, (n_q,), whose springs hold the links of q at rest."""
    model = robot.model
    settled = with_motors_at_links(model, q)
    if not model.drives:
        return settled
    # The torque of each gear at rest determines how far its spring gives.
    torques = _gear_torques(robot, settled)
    for elastic, torque in zip(model.drives, torques, strict=True):
        motor = _place(model, elastic.motor)
        settled[motor] += _holding_deflection(elastic.drive, float(torque))
    return settled


def _gear_torques(robot: Robot, q: Array) -> Array:
    """
    Return the torques of the gears at rest, one a drive, N m or N; no spring is deflected.

    Of closed loops whose actuators are redundant, those with the least sum of squares.
    """
    rest = np.zeros(robot.n)
    needed = robot.inverse_dynamics(q, rest, rest)
    links = [_place(robot.model, elastic.link) for elastic in robot.drives]
    # The generalized force of a unit torque at each joint that has an actuator.
    forces = []
    for place in (*links, *_rigid_actuators(robot, links)):
        unit = np.zeros(robot.n_q)
        unit[place] = 1.0
        forces.append(robot.generalized_force(unit, q))
    torques = np.linalg.lstsq(np.array(forces).T, needed, rcond=None)[0]
    return np.asarray(torques[:len(links)])


def _rigid_actuators(robot: Robot, links: Sequence[int]) -> list[int]:
    """Return the coordinates of rigid joints with actuators: those that are independent."""
    motors = {elastic.drive.motor for elastic in robot.drives}
    places = []
    for name in robot.speed_names:
        place = robot.coordinate_names.index(name)
        if name not in motors and place not in links:
            places.append(place)
    return places


def _holding_deflection(drive: Drive, torque: float) -> float:
    """
    Return the deflection at which a drive's spring has a torque, rad or m.

    It is 0 for no torque, also within a dead zone.
    """
    load = abs(torque)
    if load == 0.0:
        return 0.0
    # The torque never falls with the deflection: bracket the load, then bisect.
    high = 1e-6
    while spring_torque(drive, high) < load:
        high *= 2.0
    low = 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if spring_torque(drive, middle) < load:
            low = middle
        else:
            high = middle
    return float(np.copysign(high, torque))
