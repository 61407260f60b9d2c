"""What chosen speeds and constraints cost, beside the plain arm; a closed loop in real time."""

import sys
import time

from interleaved import interleaved, Timing
from kane_dynamics import (absolute_rates, Closure, Coupling, knife_edge, Model, ModelBuilder,
                           momenta, PointVelocity, Robot, rod, simulate)
from native_loop import kernel_loop, Race, shipped_arm, STATES
import numpy as np

PLAIN, CLOCK = 'the plain arm', 'the clock'
STEP, SIMULATED = 1e-3, 10.0  # s


def choices(model: Model) -> dict[str, dict[str, object]]:
    """Return what each contender's Robot is given besides the model."""
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
    """Race forward dynamics of a re-speeded or constrained arm against the plain arm's."""
    model = shipped_arm(name)
    robots = {PLAIN: Robot(model),
              **{what: Robot(model, **given) for what, given in choices(model).items()}}
    rng, loops = np.random.default_rng(0), {}
    q = rng.uniform(-1.0, 1.0, (STATES, model.n))
    for what, robot in robots.items():
        u, tau = rng.uniform(-1.0, 1.0, (2, STATES, robot.n))
        loops[what] = kernel_loop(robot.kernels.quantity('forward_dynamics'),
                                  {'q': q, 'u': u, 'tau': tau})
    timing = interleaved(loops)
    return [Race(name, robot.n, f'forward dynamics under {what}', PLAIN,
                 timing.median(what) / STATES, timing.median(PLAIN) / STATES,
                 timing.ratio(PLAIN, what))
            for what, robot in robots.items() if what != PLAIN]


def four_bar() -> Robot:
    """Return a crank-rocker, its loop cut at the rocker's end."""
    b = ModelBuilder('four-bar')
    carrier, joint = 'world', (0.0, 0.0, 0.0)
    for name, length in (('crank', 0.3), ('coupler', 0.9), ('rocker', 0.7)):
        b.body(name, carrier, axis=(0, -1, 0), at=joint,
               matter=rod(2.0 * length, (0, 0, 0), (length, 0, 0)))
        carrier, joint = name, (length, 0.0, 0.0)
    b.frame('end', 'rocker', at=joint)
    b.frame('ground', 'world', at=(1, 0, 0))
    return Robot(b.model(), constraints=[Closure('end', 'ground', 'revolute', axis=(0, 1, 0))],
                 independent=['crank'])


def real_time() -> Race:
    """Race a simulated second of the loop against a second."""
    robot = four_bar()
    q = robot.closed_posture((0.8, 0.0, -1.5), fixed=['crank'])

    def run() -> None:
        simulate(robot, q, [5.0], SIMULATED, step=STEP, sample=SIMULATED)
    run()
    seconds = []
    for _ in range(25):
        start = time.perf_counter()
        run()
        seconds.append((time.perf_counter() - start) / SIMULATED)
    timing = Timing({'ours': np.array(seconds), CLOCK: np.ones(len(seconds))})
    return Race('four-bar', robot.n, 'a second simulated at 1 ms', CLOCK, timing.median('ours'),
                1.0, timing.ratio(CLOCK, 'ours'))


def races() -> list[Race]:
    """Return all races."""
    return [*costs('ur10e'), *costs('fr3'), real_time()]


def main() -> int:
    """Print the races."""
    print(*races(), sep='\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
