"""Batches of random mechanisms equal the results of single states."""

from hypothesis import given, strategies as st
from kane_dynamics.robot.kernel_set import QUANTITIES
import numpy as np
from strategies import robots, vectors


@given(robots(), st.data())
def test_a_batch_is_its_states_one_by_one(robot, data):
    count = data.draw(st.integers(1, 19))
    pool = np.array([data.draw(vectors(robot.n)) for _ in range(3)])
    inputs = np.random.default_rng(count).permuted(np.resize(pool, (3, count, robot.n)),
                                                   axis=2)
    for name in ('inverse_dynamics', 'forward_dynamics', 'mass_matrix', 'bias_force'):
        method = getattr(robot, name)
        arguments = inputs[:len(QUANTITIES[name].arguments)]
        single = np.array([method(*row.copy()) for row in arguments.transpose(1, 0, 2)])
        error = method(*arguments) - single
        size = np.abs(single)
        # An acceleration is as exact as the torque it asks for.
        if name == 'forward_dynamics':
            M = robot.mass_matrix(inputs[0])
            error = np.einsum('krs,ks->kr', M, error)
            size = np.abs(M).max(axis=2) * size
        axes = tuple(range(1, single.ndim))
        assert (np.abs(error).max(axis=axes)
                <= 1e-13 * (1e-3 + size.max(axis=axes))).all(), name
