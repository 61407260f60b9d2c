"""Random values of trials, determined by the sweep's seed and the index of the trial."""

from collections.abc import Iterator, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.sweep.description import Sweep
from kane_dynamics.sweep.trial import CONTROLLERS, PAYLOAD, PlantParameters
import numpy as np

Values = dict[str, Array]


def drawn(sweep: Sweep, rows: Sequence[int]) -> Values:
    """
    Return the values of trials as (N,) arrays by column name.

    Parameters
    ----------
    sweep : Sweep
        The sweep.
    rows : sequence of int
        Indices of the trials.

    """
    count = sum(value.random for value in sweep.values)
    uniform = np.zeros((len(rows), count))
    normal = np.zeros((len(rows), count))
    if count:
        for k, row in enumerate(rows):
            seed = np.random.SeedSequence(sweep.seed, spawn_key=(row,))
            generator = np.random.Generator(np.random.PCG64(seed))
            generator.random(out=uniform[k])
            generator.standard_normal(out=normal[k])
    draws: Iterator[tuple[Array, Array]] = zip(uniform.T, normal.T)
    no_draw = np.zeros(len(rows)), np.zeros(len(rows))
    # The index of a trial, written in the mixed base of the grids' lengths, has the
    # place in each grid as its digits.
    values, numbers = {}, np.asarray(rows)
    for value in sweep.values:
        draw = next(draws) if value.random else no_draw
        length = len(value.numbers) if value.kind == 'grid' else 1
        values[value.name] = value.taken(*draw, numbers % length)
        numbers = numbers // length
    return values


def of_joints(values: Values, name: str, joints: Sequence[str],
              default: float = 0.0) -> Array:
    """Return the values of all joints, given together or for each joint, (N, n)."""
    count = len(next(iter(values.values())))
    of_all = values.get(name, np.full(count, default))
    columns = [values.get(f'{name}.{joint}', of_all) for joint in joints]
    return np.stack(columns, axis=1)


def controllers(values: Values) -> list[str]:
    """Return the controller of each trial."""
    return [CONTROLLERS[int(place)] for place in values['controller'].tolist()]


def plant(values: Values, joints: Sequence[str],
          followed: Sequence[str]) -> PlantParameters:
    """Return the plant parameters of all trials for the kernels, with gains of `followed`."""
    friction = of_joints(values, 'friction', joints)
    payload = np.zeros((len(friction), PAYLOAD))
    known = np.zeros((len(friction), 1))
    if 'payload.mass' in values:
        mass, gyration = values['payload.mass'], values['payload.gyration']
        com = np.stack([values[f'payload.com_{axis}'] for axis in 'xyz'], axis=1)
        payload[:, 0] = mass
        payload[:, 1:4] = mass[:, None] * com
        # J = m k^2 1 about the center of mass is the second moment 1/2 m k^2 1.
        of_shape = 0.5 * (gyration**2)[:, None, None] * np.eye(3)
        second_moments = com[:, :, None] * com[:, None] + of_shape
        # The six distinct entries of the symmetric matrix.
        rows, columns = np.triu_indices(3)
        payload[:, 4:] = mass[:, None] * second_moments[:, rows, columns]
        known[:, 0] = values.get('known_payload', 0.0)
    return PlantParameters(payload, known, friction, of_joints(values, 'kp', followed),
                           of_joints(values, 'kd', followed))
