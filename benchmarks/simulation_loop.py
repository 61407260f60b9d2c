"""
Runge-Kutta at 1 ms under constant torque: simulate, Pinocchio's C++ and MuJoCo.

`simulate` without the check of its energy balance is raced too: the share of the check.
"""

from functools import partial
import sys
from unittest.mock import patch
import warnings

from interleaved_timing import interleaved, Timing
from kane_dynamics import Robot, simulate
from kane_dynamics._util.resources import resource_path
from kane_dynamics.model.model import Model
from kane_dynamics.simulation.energy_balance import EnergyBalance
import mujoco
from native_loop import ARMS, cpp_races, Race, race
import numpy as np
from pinocchio_native import builds, Pinocchio, Unavailable

STEP = 1e-3
STEPS = 10_000
UNCHECKED = 'simulate without the energy balance'
# rad, m or s: one method, three implementations
CHECKED_STEPS = 100
TOLERANCE = 1e-8


def mujoco_model(name: str, model: Model) -> mujoco.MjModel:
    """Return MuJoCo's model of a shipped arm: same joints, no contacts, no friction."""
    spec = mujoco.MjSpec.from_file(str(resource_path('urdf', f'{name}.urdf')))
    locked = [joint for joint in spec.joints if joint.name not in model.joint_names]
    # The equalities tie the gripper's fingers.
    for element in [*spec.equalities, *locked]:
        spec.delete(element)
    plant = spec.compile()
    plant.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    plant.opt.timestep = STEP
    plant.opt.gravity[:] = model.gravity
    off = mujoco.mjtDisableBit
    plant.opt.disableflags |= (off.mjDSBL_CONTACT | off.mjDSBL_LIMIT
                               | off.mjDSBL_FRICTIONLOSS | off.mjDSBL_CONSTRAINT)
    plant.dof_damping[:] = 0.0
    plant.dof_armature[:] = 0.0
    assert [plant.joint(k).name for k in range(plant.njnt)] == list(model.joint_names)
    return plant


def simulation_races(name: str, model: Model) -> list[Race]:
    """Time ten seconds of simulated time, with both peers."""
    robot = Robot(model, friction=False)
    rng = np.random.default_rng(0)
    n = robot.n
    q0, u0 = rng.uniform(-1.0, 1.0, (2, n))
    tau = robot.gravity_force(q0)
    plant = mujoco_model(name, model)
    data = mujoco.MjData(plant)

    def ours(steps: int = STEPS) -> np.ndarray:
        result = simulate(robot, q0, u0, steps * STEP, step=STEP, torque=tau,
                          sample=steps * STEP)
        return np.concatenate([result.q[-1], result.u[-1]])

    def of_mujoco(steps: int = STEPS) -> np.ndarray:
        data.qpos[:] = q0
        data.qvel[:] = u0
        data.qfrc_applied[:] = tau
        mujoco.mj_step(plant, data, nstep=steps)
        return np.concatenate([data.qpos, data.qvel])

    def unchecked(steps: int = STEPS) -> np.ndarray:
        with patch.object(EnergyBalance, 'look'):
            return ours(steps)

    contenders = {'ours': ours, 'MuJoCo': of_mujoco, UNCHECKED: unchecked}

    def of_pinocchio(peer: Pinocchio, steps: int = STEPS) -> np.ndarray:
        state = np.concatenate([q0, u0])
        peer.simulate(steps, STEP, tau, state)
        return state
    theirs = []
    try:
        peers = builds(robot)
    except Unavailable as error:
        print(f'simulation in Pinocchio C++ left out: {error}')
        peers = {}
    for compiler, peer in peers.items():
        if peer.columns != list(range(n)):
            raise AssertionError(f'{name}: the joints have another order in Pinocchio')
        theirs.append(f'{compiler}: RK4')
        contenders[theirs[-1]] = partial(of_pinocchio, peer)
    expected = ours(CHECKED_STEPS)
    for contender, call in contenders.items():
        error = np.abs(call(CHECKED_STEPS) - expected).max()
        if not error < TOLERANCE:
            raise AssertionError(
                f'{name}: after {CHECKED_STEPS} steps {contender} is {error:.2g} off')
    timing = interleaved(contenders)
    what = 'RK4 simulation, a step'
    lines = [race(robot, what, contender, timing, STEPS, (contender,))
             for contender in ('MuJoCo', UNCHECKED)]
    if theirs:
        seconds = {name: timing.seconds[name] for name in ('ours', *theirs)}
        lines += cpp_races(robot, what, Timing(seconds), STEPS)
    return lines


def races() -> list[Race]:
    """Return the races of all arms."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        return [r for name, make in ARMS.items() for r in simulation_races(name, make())]


def main() -> int:
    """Print the races."""
    print(*races(), sep='\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
