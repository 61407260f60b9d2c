"""The cost of chosen speeds and constraints against the plain arm; simulation speed."""

from collections.abc import Callable
from copy import copy
from functools import partial
from importlib import import_module
from pathlib import Path
import sys
import time

from interleaved_timing import interleaved, Timing, TURNS
from kane_dynamics import (absolute_rates, Closure, Coupling, disc, FlexibleLink,
                           knife_edge, LoopTracker, Model, ModelBuilder, momenta,
                           point_mass, PointVelocity, Robot, rod, Rolling, simulate)
from kane_dynamics.loop_tracking.loop_tracker import tracking_kernel
from kane_dynamics.robot.kernel_set import KernelSet
from kane_dynamics.simulation.step_kernels import state_layout, state_names
from kane_dynamics.simulation.torque_input import torque_input
from native_loop import kernel_loop, Race, shipped_arm, STATES
import numpy as np

PLAIN = 'the plain arm'
CLOCK = 'the clock'
NEAR = {'four-bar': (0.8, 0.0, -1.5), 'rolling disc': (0.0, 0.0, 0.0, 0.3, 0.2, 0.1)}


def choices(model: Model) -> dict[str, dict[str, object]]:
    """Return the keyword arguments of each contender's Robot."""
    tip = model.frames[-1].name
    first, second = model.joint_names[1:3]
    return {
        'absolute rates': {'speeds': absolute_rates},
        'momenta': {'speeds': momenta},
        'a knife edge at the tip': {'constraints': [knife_edge(tip, (0, 1, 0))]},
        'the tip on a plane': {'constraints': [PointVelocity(tip, (0, 0, 1))]},
        'a coupling': {'constraints': [Coupling(second, {first: -1.0})]},
    }


def costs(name: str) -> list[Race]:
    """Compare forward dynamics with speeds or constraints to that of the plain arm."""
    model = shipped_arm(name)
    robots = {
        PLAIN: Robot(model),
        **{what: Robot(model, **choice) for what, choice in choices(model).items()}}
    rng = np.random.default_rng(0)
    loops = {}
    q = rng.uniform(-1.0, 1.0, (STATES, model.n))
    for what, robot in robots.items():
        u, tau = rng.uniform(-1.0, 1.0, (2, STATES, robot.n))
        loops[what] = kernel_loop(robot.kernels.kernel('forward_dynamics'),
                                  {'q': q, 'u': u, 'tau': tau})
    timing = interleaved(loops)
    return [Race(name, robot.n, f'forward dynamics under {what}', PLAIN,
                 timing.undisturbed(what) / STATES, timing.undisturbed(PLAIN) / STATES,
                 timing.ratio(PLAIN, what))
            for what, robot in robots.items() if what != PLAIN]


def unwatched(robot: Robot) -> Robot:
    """
    Return a constrained robot whose kernels and steps leave out what is watched.

    Steps close the loops as before: that is no watch.
    """
    unwatched_robot = Robot(robot.model, constraints=robot.mechanism.constraints,
                            independent=robot.speed_names)
    equations = copy(unwatched_robot.equations)
    equations.watched = False
    kernels = KernelSet(equations, None, unwatched_robot.parameters.block)
    # Robots refuse assignments.
    vars(unwatched_robot).update(equations=equations, kernels=kernels)
    return unwatched_robot


def watch_costs() -> list[Race]:
    """Race steps and forward dynamics (native loop, calls), watched and unwatched."""
    model = shipped_arm('ur10e')
    robots = {'four-bar': four_bar(), 'rolling disc': rolling_disc(),
              **{what: Robot(model, **choice) for what, choice in choices(model).items()
                 if 'constraints' in choice}}
    rng = np.random.default_rng(0)
    result = []
    for name, robot in robots.items():
        q = robot.closed_configuration(NEAR[name] if name in NEAR else
                                       rng.uniform(-1.0, 1.0, robot.n_q))
        u = rng.uniform(-0.1, 0.1, robot.n)
        loops: dict[str, Callable[[], object]] = {}
        for what, one in (('watched', robot), ('not', unwatched(robot))):
            source = torque_input(one, 1e-5, STATES, None, None, 'rk4')
            buffer = np.ones((1, STATES + 1, len(state_names(one))))
            buffer[0, 0, :robot.n_q] = q
            buffer[0, 0, state_layout(robot).v] = robot.joint_rates(q, u)
            loops[f'step {what}'] = partial(source.advance, buffer, 0)
            loops[f'dynamics {what}'] = kernel_loop(
                one.kernels.kernel('forward_dynamics'),
                {'q': np.tile(q, (STATES, 1)), 'u': np.tile(u, (STATES, 1)),
                 'tau': np.tile(u, (STATES, 1))})
            loops[f'calls {what}'] = partial(call_each, one, q, u)
        timing = interleaved(loops, TURNS, time.process_time)
        result += [Race(name, robot.n, f'{what} with the watch of constraints',
                        'without it', timing.undisturbed(f'{what} watched') / STATES,
                        timing.undisturbed(f'{what} not') / STATES,
                        timing.ratio(f'{what} not', f'{what} watched'))
                   for what in ('step', 'dynamics', 'calls')]
    return result


def closures() -> list[Race]:
    """
    Compare inverse dynamics of the palletizer with closed loops to that of its tree.

    The states are 2 ms apart; each is closed from the one before.
    """
    sys.path.append(str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))
    palletizer = import_module('palletizer')
    robot = palletizer.palletizer()
    tree = palletizer.palletizer_tree()
    turns = 0.002 * np.arange(STATES + 1)
    measured = np.stack([0.4 * np.sin(turns), 0.2 + 0.3 * np.sin(turns),
                         0.3 * np.cos(turns), turns % 1.0], axis=1)
    rates = np.gradient(measured, 0.002, axis=0)
    tracker = LoopTracker(robot, palletizer.DRIVEN)
    closed = []
    watched = []
    for at, u in zip(measured, rates):
        watched.append(tracker.accepted)
        tracker.update(at, u)
        closed.append(tracker.q.copy())
    q = np.array(closed[1:])
    u = rates[1:]
    last, T = (np.array(x[1:]) for x in zip(*watched))
    contenders = {
        'closure': kernel_loop(tracking_kernel(robot, tracker.places), {
            'q': last, 'T': T, 'measured': measured[1:], 'rates': u, 'seen': q,
            'weights': np.ones_like(q)}),
        'dynamics': kernel_loop(robot.kernels.kernel('inverse_dynamics'),
                                {'q': q, 'u': u, 'udot': 0.0 * u}),
        'tree': kernel_loop(tree.kernels.kernel('inverse_dynamics'), {
            'q': q, 'u': robot.joint_rates(q, u),
            'udot': robot.joint_accelerations(q, u, 0.0 * u)})}

    def both() -> None:
        contenders['closure']()
        contenders['dynamics']()
    timing = interleaved({'both': both, 'tree': contenders['tree']}, TURNS)
    return [
        Race('palletizer', robot.n, 'inverse dynamics from measured joints', 'its tree',
             timing.undisturbed('both') / STATES, timing.undisturbed('tree') / STATES,
             timing.ratio('tree', 'both'))]


def call_each(robot: Robot, q: np.ndarray, u: np.ndarray) -> None:
    """Call forward dynamics from Python once for each of `STATES`."""
    call = robot.forward_dynamics
    for _ in range(STATES):
        call(q, u, u)


def four_bar() -> Robot:
    """Return a crank-rocker, its loop cut at the rocker's end."""
    b = ModelBuilder('four-bar')
    carrier = 'world'
    joint = (0.0, 0.0, 0.0)
    for name, length in (('crank', 0.3), ('coupler', 0.9), ('rocker', 0.7)):
        b.body(name, carrier, axis=(0, -1, 0), at=joint,
               inertial=rod(2.0 * length, (0, 0, 0), (length, 0, 0)))
        carrier = name
        joint = (length, 0.0, 0.0)
    b.frame('end', 'rocker', at=joint)
    b.frame('ground', 'world', at=(1, 0, 0))
    return Robot(b.model(),
                 constraints=[Closure('end', 'ground', 'revolute', axis=(0, 1, 0))],
                 independent=['crank'])


def rolling_disc() -> Robot:
    """Return a thin disc that rolls on a plane."""
    b = ModelBuilder('rolling disc')
    b.body('disc', kind='floating', turns='zxy', at=(0, 0, 0.5),
           inertial=disc(1.0, 0.5, axis=(0, 1, 0)))
    return Robot(b.model(), constraints=[Rolling('disc', 0.5, axis=(0, 1, 0))])


def flexible_arm(modes: tuple[int, int], **joint: object) -> Robot:
    """Return an arm of two beams with a load at its tip."""
    b = ModelBuilder(f'flexible arm, {sum(modes)} modes a link')
    for name, on in (('upper', 'world'), ('fore', 'upper/tip')):
        b.beam(name, on, FlexibleLink(1.0, 1.0, 400.0, modes), armature=0.05, **joint)
        joint = {'axis': (0, -1, 0)} if joint else {}
    b.load('fore/tip', point_mass(0.5))
    return Robot(b.model())


def real_time(name: str, robot: Robot, q: np.ndarray, u: np.ndarray, step: float,
              integrator: str = 'rk4') -> Race:
    """Compare the time to simulate a second to a second."""
    simulated = 10_000 * step

    def run() -> None:
        simulate(robot, q, u, simulated, step=step, sample=simulated,
                 integrator=integrator)
    run()
    seconds = []
    for _ in range(25):
        start = time.perf_counter()
        run()
        seconds.append((time.perf_counter() - start) / simulated)
    timing = Timing({'ours': np.array(seconds), CLOCK: np.ones(len(seconds))})
    how = '' if integrator == 'rk4' else f', {integrator}'
    return Race(name, robot.n, f'a second simulated at {1e3 * step:g} ms{how}', CLOCK,
                timing.undisturbed('ours'), 1.0, timing.ratio(CLOCK, 'ours'))


def clocked() -> list[Race]:
    """Compare the simulation of mechanisms to real time."""
    loop = four_bar()
    result = [real_time('four-bar', loop, loop.closed_configuration((0.8, 0.0, -1.5),
                                                                    fixed=['crank']),
                        np.array([5.0]), 1e-3)]
    for name, robot in (('planar flexible arm', flexible_arm((3, 0))),
                        ('spatial flexible arm', flexible_arm((2, 1), axis=(0, -1, 0)))):
        q, u = np.zeros((2, robot.n))
        q[robot.joint_names.index('fore')] = 0.5
        u[robot.joint_names.index('upper')] = 1.0
        result.append(real_time(name, robot, q, u, 1e-4))
        result.append(real_time(name, robot, q, u, 1e-3, 'implicit'))
    return result


def races() -> list[Race]:
    """Return all races."""
    return [*costs('ur10e'), *costs('fr3'), *watch_costs(), *closures(), *clocked()]


def main() -> int:
    """Print the races."""
    print(*races(), sep='\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
