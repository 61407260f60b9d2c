"""
Functions for PyTorch and JAX compared with robot dynamics written in these, interleaved.

4096 states of inverse dynamics of the FR3, seven axes, on the CPU: forward and backward
in PyTorch (peer: `adam.pytorch`, which has no inverse dynamics: its users compute M udot
+ h, as here), and in JAX under jit and vmap (peer: `frax`). What is not installed is
left out. Times are of the processor, of all threads; those of the wall clock are beside
them.
"""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
import statistics
import sys
import tempfile
import time
from typing import Any
import warnings

from gates import exit_status
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
import numpy as np

STATES = 4096
ROUNDS = 15
# Least ratio of a peer's time to ours.
TORCH_GATE = 20.0
JAX_GATE = 5.0
GRAVITY = 9.81
Function = Callable[..., Any]


def installed(*names: str) -> Any:
    """Return modules, the last one of them, or None if one is not installed."""
    library = None
    for name in names:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')
                library = import_module(name)
        except ImportError:
            print(f'LEFT OUT: {name} is not installed')
            return None
    return library


def joint_names(robot: Robot) -> list[str]:
    """Return the names of the axes."""
    return list(robot.joint_names)


def torch_functions(robot: Robot, urdf: str) -> dict[str, Function]:
    """Return functions of arrays: gradients of the sum of squared torques, by name."""
    torch = installed('torch')
    if torch is None:
        return {}

    def gradients(torques: Function) -> Function:
        def call(*arrays: Any) -> Any:
            arguments = [torch.from_numpy(x).requires_grad_() for x in arrays]
            torques(*arguments).square().sum().backward()
            return np.concatenate([x.grad.numpy() for x in arguments], axis=1)
        return call
    functions = {'kane_dynamics': gradients(robot.torch('inverse_dynamics'))}
    adam = installed('adam.pytorch')
    if adam is not None:
        peer = adam.KinDynComputationsBatch(
            urdf, joint_names(robot), torch.device('cpu'), torch.float64,
            gravity=torch.tensor([0, 0, -GRAVITY, 0, 0, 0]))
        base = torch.eye(4, dtype=torch.float64).expand(STATES, 4, 4)
        still = torch.zeros(STATES, 6, dtype=torch.float64)
        functions['adam'] = gradients(lambda q, u, udot: (
            peer.mass_matrix(base, q)[:, 6:, 6:] @ udot[:, :, None])[:, :, 0]
            + peer.bias_force(base, q, still, u)[:, 6:])
    return functions


def jax_functions(robot: Robot, urdf: str) -> dict[str, Function]:
    """Return functions of arrays: the torques, under jit and vmap, by name."""
    jax = installed('jax')
    if jax is None:
        return {}
    jax.config.update('jax_enable_x64', True)

    def batch(torques: Function) -> Function:
        compiled = jax.jit(jax.vmap(torques))
        return lambda *arrays: compiled(*arrays).block_until_ready()
    functions = {'kane_dynamics': batch(robot.jax('inverse_dynamics', compiled=True)),
                 'kane_dynamics, by Python': batch(
                     robot.jax('inverse_dynamics', compiled=False))}
    frax = installed('frax.core.robot')
    if frax is not None:
        peer = frax.Robot(urdf)
        up = np.array([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0])
        functions['frax'] = batch(lambda q, u, udot: peer.rnea(q, u, udot, up, None))
    return functions


def compared(title: str, functions: dict[str, Function], gate: float) -> bool:
    """Print relative times; return whether the fastest peer takes `gate` times ours."""
    if not functions:
        return True
    arrays = np.random.default_rng(0).normal(size=(3, STATES, 7))
    expected = functions['kane_dynamics'](*arrays)
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in functions}
    for name, function in functions.items():
        np.testing.assert_allclose(np.asarray(function(*arrays)), np.asarray(expected),
                                   rtol=1e-6, atol=1e-6 * np.abs(expected).max(),
                                   err_msg=name)
    for _ in range(ROUNDS):
        for name, function in functions.items():
            began = time.process_time(), time.perf_counter()
            function(*arrays)
            times[name].append(
                (time.process_time() - began[0], time.perf_counter() - began[1]))
    print(title)
    ours = times['kane_dynamics']
    good = True
    for name, durations in times.items():
        cpu, wall = (statistics.median(x[k] / y[k] for x, y in zip(durations, ours))
                     for k in (0, 1))
        ms = 1e3 * statistics.median(x[0] for x in durations)
        print(f'  {name:26}{cpu:8.1f} ({ms:.2f} ms); by the clock {wall:8.1f}')
        if not name.startswith('kane_dynamics') and cpu < gate:
            print(f'FAILED: {cpu:.1f} times as fast as {name}; expected {gate:g}')
            good = False
    if len([name for name in functions if not name.startswith('kane_dynamics')]) == 0:
        print('LEFT OUT: no peer; the gate is not checked')
    return good


def main() -> int:
    """Print the comparisons; return 1 if a gate does not hold."""
    text = Path(resource_path('urdf', 'fr3.urdf')).read_text(encoding='utf-8')
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'fr3.urdf')  # its fingers are fixed for all
        path.write_text(text.replace('type="prismatic"', 'type="fixed"'),
                        encoding='utf-8')
        robot = Robot(load_urdf(path), friction=False)
        good = [
            compared(f'{STATES} inverse dynamics of the FR3, forward and backward, '
                     'PyTorch: relative time', torch_functions(robot, str(path)),
                     TORCH_GATE),
            compared(f'{STATES} inverse dynamics of the FR3, JAX under jit and '
                     'vmap: relative time', jax_functions(robot, str(path)), JAX_GATE)]
    return exit_status(all(good))


if __name__ == '__main__':
    sys.exit(main())
