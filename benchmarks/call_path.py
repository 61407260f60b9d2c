"""
Count the modules and functions of kane_dynamics that one first call passes.

A first call traces and compiles what it needs, so it passes more code than any later
one: this is what a reader has to follow. Functions are counted once each, without
comprehensions and lambdas, which belong to the function around them. `--list` names them
by module. The exit status is 1 if a call passes more than `MOST` says.
"""

import argparse
from collections import defaultdict
from itertools import chain
import os
from pathlib import Path
import sys
import tempfile

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = str(ROOT / 'kane_dynamics')
# Modules and functions of each call at most.
MOST = {
    'forward_dynamics, tree': (23, 190),
    'forward_dynamics, loop': (33, 275),
    'simulate, tree': (41, 291),
    'simulate, four-bar': (52, 427),
    'time_optimal, UR10e': (40, 306),
    'node: configure, warm': (80, 450),
    'node: joint stiffness': (12, 40),
}


def functions_passed(call):
    """Return the names of functions that a call passes, by module."""
    passed = defaultdict(set)

    def count(frame, event, argument):
        code = frame.f_code
        is_named = not code.co_name.startswith('<')
        if event == 'call' and is_named and code.co_filename.startswith(PACKAGE):
            passed[code.co_filename[len(PACKAGE) + 1:]].add(code.co_qualname)

    sys.setprofile(count)
    try:
        call()
    finally:
        sys.setprofile(None)
    return passed


def first_calls():
    """Yield the name and the call of each case; every robot is new."""
    from four_bar import b as builder, pin, q as closed
    from kane_dynamics import load_urdf, Robot, simulate
    from kane_dynamics.feasibility import time_optimal
    from kane_dynamics.native.machine_code import compiling
    import numpy as np

    def tree():
        return Robot(load_urdf(str(ROOT / 'urdf' / 'ur10e.urdf')))

    def loop():
        return Robot(builder.model(), constraints=[pin], independent=['crank'])

    compiling.SLOW = 1e6  # no line of the log on a busy machine
    zeros = np.zeros(6)
    closed = np.array(closed)
    at_rest = np.zeros(1)
    waypoints = np.array([[0, -1, 1, 0, 0, 0], [0.5, -1.2, 0.8, 0.3, 0.2, 0.1],
                          [1, -0.8, 1.2, 0.1, 0.4, 0.3]])
    arm, linkage = tree(), loop()
    yield 'forward_dynamics, tree', lambda: arm.forward_dynamics(zeros, zeros, zeros)
    yield 'forward_dynamics, loop', lambda: linkage.forward_dynamics(
        closed, at_rest, at_rest)
    simulated_arm = tree()
    yield 'simulate, tree', lambda: simulate(simulated_arm, zeros, zeros, 0.1)
    yield 'simulate, four-bar', lambda: simulate(linkage, closed, at_rest, 0.1)
    yield 'time_optimal, UR10e', lambda: time_optimal(simulated_arm, waypoints)


def node_calls():
    """Yield two calls of a node in this process, whose kernels are on disk already."""
    try:
        import rclpy
    except ImportError:
        return
    from kane_dynamics.ros.dynamics_node.node import DynamicsNode
    from rclpy.parameter import Parameter
    parameters = (f'urdf:={ROOT}/urdf/two_link.urdf', 'arm_compensates:=none',
                  'mode:=joint_impedance')
    rclpy.init(args=['--ros-args', *[x for one in parameters for x in ('-p', one)]])
    node = DynamicsNode()
    node.trigger_configure()
    node.trigger_cleanup()
    yield 'node: configure, warm', node.trigger_configure
    node.trigger_activate()
    node.set_parameters([Parameter('joint_impedance.stiffness', value=80.0)])
    stiffer = Parameter('joint_impedance.stiffness', value=90.0)
    yield 'node: joint stiffness', lambda: node.set_parameters([stiffer])
    node.halt()
    rclpy.shutdown()


def main():
    """Print a line a call."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--list', action='store_true', help='name every function')
    arguments = parser.parse_args()
    sys.path[:0] = [str(ROOT), str(ROOT / 'examples')]
    exceeded = False
    for name, call in chain(first_calls(), node_calls()):
        # An empty cache on disk each: what an earlier call compiled must not shorten
        # this one.
        with tempfile.TemporaryDirectory() as cache:
            os.environ['KANE_DYNAMICS_CACHE'] = cache
            passed = functions_passed(call)
        total = sum(len(functions) for functions in passed.values())
        most_modules, most_functions = MOST[name]
        exceeded = exceeded or len(passed) > most_modules or total > most_functions
        print(f'{name:24s} {len(passed):3d} modules (at most {most_modules}) '
              f'{total:4d} functions (at most {most_functions})')
        if arguments.list:
            for module, functions in sorted(passed.items()):
                print(f'    {module} {len(functions)}: {" ".join(sorted(functions))}')
    sys.exit(int(exceeded))


if __name__ == '__main__':
    main()
