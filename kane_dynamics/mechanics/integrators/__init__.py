"""
Integrators of the equations of motion.

`INTEGRATORS` has one entry per method; simulation, sweeps, the simulated robot and the
step sizes use them through `Integrator`. To add a method, write a class with these
members and add it here.
"""

from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.integrators.interface import Integrator, System
from kane_dynamics.mechanics.integrators.rosenbrock import Rosenbrock
from kane_dynamics.mechanics.integrators.runge_kutta import RungeKutta4

__all__ = ['INTEGRATORS', 'Integrator', 'System', 'integrator_of']

_METHODS: tuple[Integrator, ...] = (RungeKutta4(), Rosenbrock())
INTEGRATORS: dict[str, Integrator] = {method.name: method for method in _METHODS}


def integrator_of(name: str) -> Integrator:
    """Return the integrator with this name; raise InputError for an unknown one."""
    if not isinstance(name, str) or name not in INTEGRATORS:
        names = ', '.join(INTEGRATORS)
        raise InputError(f'integrator: {name!r}; expected one of {names}')
    return INTEGRATORS[name]
