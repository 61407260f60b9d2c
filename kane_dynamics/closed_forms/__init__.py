"""Equations of motion of small mechanisms on paper (extra `equations`)."""

from kane_dynamics.closed_forms.derivation import Derivation, derivation

__all__ = ['Derivation', 'derivation']
