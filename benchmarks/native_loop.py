"""Every quantity in a native loop: our kernels and Pinocchio's C++, interleaved."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
import gc
import sys
import warnings

from big_robots import BIG, chain
from interleaved_timing import interleaved, Timing
from kane_dynamics import load_urdf, Model, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loops import repeat
import numpy as np
from pinocchio_native import builds, Pinocchio, Unavailable

CPP = 'Pinocchio C++'
STATES = 1024  # that fit the cache, so that the arithmetic is what is timed
TOLERANCE = 1e-9  # relative to the largest entry: both must agree before they are timed
# Quantities that both have, with the faster of Pinocchio's conventions.
RIVALS = {
    'inverse_dynamics': ('inverse_dynamics',),
    'bias_force': ('bias_force',),
    'gravity_force': ('gravity_force',),
    'forward_dynamics': ('forward_dynamics', 'forward_dynamics/world'),
    'mass_matrix': ('mass_matrix', 'mass_matrix/world'),
    'inverse_mass_matrix': ('inverse_mass_matrix',),
    'coriolis_matrix': ('coriolis_matrix',),
    'inverse_dynamics_derivatives': ('inverse_dynamics_derivatives',),
    'forward_dynamics_derivatives': ('forward_dynamics_derivatives',),
    'regressor': ('regressor',),
}


@dataclass(frozen=True)
class Race:
    """
    One line of the report.

    Attributes
    ----------
    robot, axes, what, peer : str, int, str, str
        Robot, its degrees of freedom, the quantity, and the peer.
    ours, theirs : float
        Seconds of one call, state or step.
    ratio : (float, float, float)
        theirs / ours, from interleaved runs; then the 10th and 90th percentile.

    """

    robot: str
    axes: int
    what: str
    peer: str
    ours: float
    theirs: float
    ratio: tuple[float, float, float]

    def __str__(self) -> str:
        """Return one line."""
        middle, low, high = self.ratio
        return (f'{self.robot} ({self.axes}) {self.what}: {1e9 * self.ours:.0f} ns, '
                f'{self.peer} {1e9 * self.theirs:.0f} ns, {middle:.1f} ({low:.1f} to '
                f'{high:.1f})')


def race(robot: Robot, what: str, peer: str, timing: Timing, calls: int,
         rivals: tuple[str, ...]) -> Race:
    """Return a line of the report; against the fastest of the peer's alternatives."""
    rival = min(rivals, key=timing.undisturbed)
    return Race(robot.model.name, robot.n, what, peer,
                timing.undisturbed('ours') / calls,
                timing.undisturbed(rival) / calls, timing.ratio(rival, 'ours'))


def cpp_races(robot: Robot, what: str, timing: Timing, calls: int) -> list[Race]:
    """
    Return lines against Pinocchio's C++: the fastest, then that of each compiler.

    Contenders are 'ours' and '<compiler>: <algorithm>', of which the fastest counts.
    """
    theirs = tuple(name for name in timing.seconds if name != 'ours')
    lines = [race(robot, what, CPP, timing, calls, theirs)]
    for compiler in dict.fromkeys(name.partition(': ')[0] for name in theirs):
        rivals = tuple(name for name in theirs if name.startswith(f'{compiler}: '))
        lines.append(race(robot, what, f'{CPP}, {compiler}', timing, calls, rivals))
    return lines


def shipped_arm(name: str) -> Model:
    """Return a shipped arm without its gripper's joints."""
    path = resource_path('urdf', f'{name}.urdf')
    joints = [n for n in load_urdf(path).joint_names if 'finger' not in n]
    return load_urdf(path, joints=joints)


ARMS: dict[str, Callable[[], Model]] = {
    'ur10e': partial(shipped_arm, 'ur10e'),
    'fr3': partial(shipped_arm, 'fr3'),
}
NOT_LARGE = ('gravity_force',)
# Without the zeros of real robots' frames.
CHAINS = (partial(chain, 32), partial(chain, 50), partial(chain, 200))
# Quantities of a chain that compile in seconds.
OF_LONGEST = ('forward_dynamics', 'mass_matrix', 'inverse_mass_matrix')
LONGEST = 100  # axes from which only these are compared


def random_states(robot: Robot, count: int) -> np.ndarray:
    """Return q, u and udot (or tau), (3, count, n)."""
    rng = np.random.default_rng(0)
    return rng.uniform(-2.0, 2.0, (3, count, robot.n))


def check(robot: Robot, peer: Pinocchio, what: str, states: np.ndarray) -> None:
    """Raise unless both give the same numbers at a few states."""
    kernel = robot.kernels.kernel(what)
    arguments = {'q': 0, 'u': 1, 'udot': 2, 'tau': 2}
    for i in range(5):
        ours = np.asarray(
            kernel(*(states[arguments[a.name], i] for a in kernel.arguments)))
        theirs = peer.answer(what, *states[:, i])
        for axis, order in _axes(robot, peer, what):
            ours = np.take(ours, order, axis=axis)
        if what == 'coriolis_matrix':  # not unique; its product with u is
            u = peer.permuted(states[1, i])
            ours = ours @ u
            theirs = theirs.reshape(robot.n, robot.n) @ u
        tolerance = TOLERANCE
        if what in ('forward_dynamics', 'forward_dynamics_derivatives',
                    'inverse_mass_matrix'):
            # Of the peer's matrix: ours would have to be compiled, which takes long for
            # chains.
            M = peer.answer('mass_matrix', *states[:, i])
            condition = np.linalg.cond(M.reshape(robot.n, robot.n))
            tolerance = max(tolerance, 100.0 * np.finfo(float).eps * condition)
        error = np.abs(ours.ravel() - theirs).max() / np.abs(theirs).max()
        if not error < tolerance:
            raise AssertionError(
                f'{robot.model.name}: {what} differs by {error:.2g} of its size '
                f'from Pinocchio; at most {tolerance:.2g}')


def _axes(robot: Robot, peer: Pinocchio, what: str) -> list[tuple[int, list[int]]]:
    """Return the axes of our result whose joints must be put in the peer's order."""
    if what == 'regressor':
        blocks = []
        for i in peer.order:
            for k in range(10):
                blocks.append(10 * i + k)
        return [(0, peer.columns), (1, blocks)]
    shape = robot.kernels.kernel(what).shape
    return [(axis, peer.columns) for axis, size in enumerate(shape)
            if len(shape) < 3 or axis > 0]


def our_loop(robot: Robot, what: str, states: np.ndarray) -> Callable[[], None]:
    """Return a call that runs a kernel natively over all states, each over the last."""
    return kernel_loop(robot.kernels.kernel(what),
                       dict(zip(('q', 'u', 'udot'), states)) | {'tau': states[2]})


def kernel_loop(kernel: Kernel, rows: Mapping[str, np.ndarray]) -> Callable[[], None]:
    """Return a call that runs a kernel natively over `STATES` rows of its arguments."""
    blocks = [rows[argument.name] for argument in kernel.arguments]
    strides = [block.strides[0] for block in blocks] + [0, 0]
    result = np.empty(kernel.shape)
    pointers = [block.ctypes.data for block in (*blocks, kernel.parameters, result)]
    owned = (blocks, result)  # the closure keeps the memory alive

    def run() -> None:
        repeat(kernel.address, pointers, strides, len(owned[0][0]))
    return run


def kernel_races(robot: Robot, quantities: tuple[str, ...]) -> list[Race]:
    """Time every quantity that is one kernel of this robot."""
    states = random_states(robot, STATES)
    peers = builds(robot)
    races = []
    for peer in peers.values():
        peer.keep(*states)
    for what in quantities:
        if what not in robot.kernels.names:
            continue
        contenders = {'ours': our_loop(robot, what, states)}
        for compiler, peer in peers.items():
            check(robot, peer, what, states)
            for name in RIVALS[what]:
                contenders[f'{compiler}: {name}'] = partial(peer.run, name)
        races += cpp_races(robot, f'native loop: {what}', interleaved(contenders),
                           STATES)
    return races


def races() -> list[Race]:
    """Return all races; Unavailable says why there are none."""
    results = []
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        for make in (*ARMS.values(), *BIG.values(), *CHAINS):
            model = make()
            robot = Robot(model, friction=False)  # which Pinocchio does not know
            large = robot.n > 9
            rows = []
            for what in RIVALS:
                if not (large and what in NOT_LARGE):
                    rows.append(what)
            quantities = tuple(rows)
            results += kernel_races(robot,
                                    OF_LONGEST if robot.n > LONGEST else quantities)
            gc.collect()
    return results


def main() -> int:
    """Print the races."""
    try:
        print(*races(), sep='\n')
    except Unavailable as error:
        print(f'native loop left out: {error}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
