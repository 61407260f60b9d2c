"""Equations of motion of small mechanisms in closed form (extra `equations`)."""

from kane_dynamics.closed_forms.closed_form import closed_form, ClosedForm

__all__ = ['ClosedForm', 'closed_form']
