"""Hypothesis strategies: random mechanisms as compiled robots, and states of them."""

from functools import lru_cache

from hypothesis import strategies as st
from kane_dynamics import Robot
from mechanisms import random_model
import numpy as np

# Whole and half numbers among the states: zeros and coinciding axes are where branches
# hide.
NUMBERS = st.one_of(st.floats(-3.0, 3.0, allow_subnormal=False),
                    st.integers(-4, 4).map(lambda k: 0.5 * k),
                    st.integers(-4, 4).map(lambda k: 0.25 * np.pi * k))


@lru_cache(maxsize=64)
def made(passive, seed, n, prismatic, branching, mimics, axes):
    """Return a random robot that may be pushed at its last frame; kernels are kept."""
    model = random_model(seed, n, prismatic=prismatic, branching=branching,
                         mimics=mimics, axes=axes, passive=passive)
    return Robot(model, wrench_frames=(model.frames[-1].name,))


@st.composite
def robots(draw, *, passive=True, most=6):
    """Draw a robot: chains and trees, revolute, prismatic and mimic joints."""
    return made(passive, draw(st.integers(0, 9999)), draw(st.integers(1, most)),
                draw(st.sampled_from([0.0, 0.3, 1.0])),
                draw(st.sampled_from([0.0, 0.3, 0.8])),
                draw(st.integers(0, 2)), draw(st.sampled_from(['any', 'principal'])))


def vectors(n):
    """Draw (n,) numbers of ordinary size."""
    return st.lists(NUMBERS, min_size=n, max_size=n).map(np.array)


@st.composite
def robots_and_states(draw, count=3, **options):
    """Draw a robot and `count` vectors: q, u, udot ..."""
    robot = draw(robots(**options))
    return (robot, *[draw(vectors(robot.n)) for _ in range(count)])
