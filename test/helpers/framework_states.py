"""Robots of several kinds and their states, for functions for PyTorch, JAX, CasADi."""

from functools import cache

from kane_dynamics import Inertial, load_urdf, Prescribed, Robot
from kinds_of_mechanism import case
from linkages import four_bar_model, PIN
import numpy as np

QUANTITIES = [('tree', 'inverse_dynamics'), ('tree', 'forward_dynamics'),
              ('tree', 'mass_matrix'),
              ('tree', 'frame_pose:tool'), ('tree', 'kinetic_energy'),
              ('chosen speeds', 'inverse_dynamics'), ('closed loop', 'inverse_dynamics'),
              ('closed loop', 'forward_dynamics'), ('nonholonomic', 'inverse_dynamics'),
              ('time-dependent', 'inverse_dynamics'), ('flexible', 'inverse_dynamics')]


@cache
def arm():
    """Return two links with a payload and a frame that carries a wrench."""
    robot = Robot(load_urdf('urdf/two_link.urdf'),
                  wrench_frames=['tip'], payload_frame='tip')
    robot.parameters.payload = Inertial(0.7, (0.1, 0.02, -0.03), 0.01 * np.eye(3))
    return robot


@cache
def fr3():
    """Return seven axes."""
    return Robot(load_urdf('urdf/fr3.urdf', tip='fr3_link7'))


@cache
def driven(turntable=False):
    """Return a four-bar with a stated crank; only a turntable moves freely."""
    return Robot(four_bar_model(turntable), constraints=[
        PIN, Prescribed('crank', lambda t: 0.7 + 0.1 * np.sin(t))])


def states(kind, names, count=3):
    """Return arguments of the robot of a kind by name: states with closed loops."""
    mechanism = case(kind)
    rng = np.random.default_rng(3)
    n = mechanism.robot.n
    arguments = {'q': np.tile(mechanism.q, (count, 1)),
                 't': np.full(count, mechanism.time),
                 **{name: rng.normal(size=(count, n)) for name in ('u', 'udot', 'tau')},
                 'wrench': rng.normal(size=(count, 1, 6))}
    return {name: arguments[name] for name in names}


def value_and_gradients(kind, name, cotangent, given):
    """Return a quantity of the robot of a kind, and its gradients, by `Robot`."""
    robot = case(kind).robot
    quantity, _, frame = name.partition(':')
    loads = {key: given[key] for key in ('wrench', 't') if key in given}
    state = [x for key, x in given.items() if key not in loads]
    gradients = robot.vjp(name, cotangent, *state, by=tuple(given), **loads)
    value = getattr(robot, quantity)(*([frame] if frame else []), *state, **loads)
    return value, dict(zip(given, gradients))
