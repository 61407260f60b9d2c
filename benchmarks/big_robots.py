"""Compile times of robots whose straight-line code exceeds the instruction cache."""

from collections.abc import Callable
from dataclasses import replace
from importlib import metadata
import os
from pathlib import Path
import sys
import tempfile
import time
import warnings

from kane_dynamics import Body, Frame, Inertial, Joint, load_urdf, Model, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.model.model import WORLD
import numpy as np

MOST_SECONDS = 3.0  # for a kernel, from nothing


def human_hand() -> Model:
    """Return the shipped hand, 22 axes."""
    return load_urdf(resource_path('urdf', 'human_hand.urdf'))


def humanoid() -> Model:
    """Return Talos on a fixed base, 32 axes."""
    files = []
    for file in metadata.files('example-robot-data') or ():
        if file.name == 'talos_reduced.urdf':
            files.append(file)
    return load_urdf(Path(str(files[0].locate())))


def two_hands() -> Model:
    """Return two human hands on arms of two axes on a trunk of two: a 50-axis tree."""
    hand = human_hand()
    bodies: list[Body] = []

    def add(name: str, parent: int, axis: str, at: tuple[float, float, float]) -> int:
        """Add a rod 0.3 m long, 2 kg."""
        inertial = Inertial(2.0, np.array([0.15, 0.0, 0.0]),
                            np.diag([0.002, 0.016, 0.016]))
        joint = Joint(f'{name}_joint', 'revolute', np.eye(3)['xyz'.index(axis)],
                      translation=np.array(at), coordinate=len(bodies))
        bodies.append(Body(name, parent, joint, inertial))
        return len(bodies) - 1
    trunk = add('chest', add('waist', WORLD, 'z', (0.0, 0.0, 1.0)), 'y', (0.0, 0.0, 0.1))
    for side, y in (('left', 0.2), ('right', -0.2)):
        elbow = add(f'{side}_forearm', add(f'{side}_arm', trunk, 'y', (0.0, y, 0.3)),
                    'z',
                    (0.3, 0.0, 0.0))
        first = len(bodies)
        for body in hand.bodies:
            wrist = body.parent == WORLD
            joint = replace(
                body.joint, name=f'{side}_{body.joint.name}', coordinate=len(bodies),
                translation=[0.3, 0.0, 0.0] if wrist else body.joint.translation)
            bodies.append(Body(f'{side}_{body.name}', elbow if wrist
                               else first + body.parent, joint, body.inertial))
    return Model('two_hands', tuple(bodies), tuple(body.joint.name for body in bodies),
                 (Frame('tip', len(bodies) - 1),))


def chain(axes: int) -> Model:
    """Return a chain of revolute joints with random axes, offsets and inertias."""
    rng = np.random.default_rng(7)
    bodies = []
    for k in range(axes):
        direction = rng.normal(size=3)
        points = 0.1 * rng.normal(size=(8, 3))
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        mass = rng.uniform(0.5, 2.0)
        second = mass * points.T @ points / len(points)
        joint = Joint(f'joint_{k}', 'revolute', direction / np.linalg.norm(direction),
                      rotation=turned * np.linalg.det(turned),
                      translation=rng.uniform(-0.2, 0.2, 3), coordinate=k)
        bodies.append(Body(f'link_{k}', k - 1 if k else WORLD, joint, Inertial(
            mass, rng.uniform(-0.1, 0.1, 3), np.trace(second) * np.eye(3) - second)))
    return Model(f'chain_{axes}', tuple(bodies),
                 tuple(body.joint.name for body in bodies),
                 (Frame('tip', axes - 1),))


BIG: dict[str, Callable[[], Model]] = {
    'human_hand': human_hand, 'talos_reduced': humanoid, 'two_hands': two_hands}


def compile_seconds(model: Model) -> dict[str, float]:
    """Return the seconds to trace and compile each kernel of a robot, uncached."""
    robot = Robot(model)
    seconds = {}
    with tempfile.TemporaryDirectory() as empty:
        former_folder = os.environ.get('KANE_DYNAMICS_CACHE')
        os.environ['KANE_DYNAMICS_CACHE'] = empty
        try:
            for name in robot.kernels.names:
                start = time.perf_counter()
                robot.compile(name)
                seconds[name] = time.perf_counter() - start
        finally:
            os.environ.pop('KANE_DYNAMICS_CACHE')
            if former_folder is not None:
                os.environ['KANE_DYNAMICS_CACHE'] = former_folder
    return seconds


def measure() -> dict[str, dict[str, float]]:
    """Return the seconds of every kernel of every big robot."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        return {name: compile_seconds(make()) for name, make in BIG.items()}


def main() -> int:
    """Print the slowest kernels of each robot; return 1 where one takes too long."""
    worst = 0.0
    for robot, seconds in measure().items():
        slowest = sorted(seconds, key=lambda name: -seconds[name])[:3]
        print(f'{robot}: '
              + ', '.join(f'{name} {seconds[name]:.2f} s' for name in slowest))
        worst = max(worst, *seconds.values())
    print(f'slowest kernel {worst:.2f} s; gate {MOST_SECONDS:g} s: '
          f'{"met" if worst <= MOST_SECONDS else "NOT met"}')
    return int(worst > MOST_SECONDS)


if __name__ == '__main__':
    sys.exit(main())
