"""Equations of motion of small mechanisms on paper (extra `equations`)."""

from kane_dynamics.closed_forms.derivation import Derivation, derivation
from kane_dynamics.closed_forms.linear_form import linear_form, LinearForm

__all__ = ['Derivation', 'derivation', 'LinearForm', 'linear_form']
