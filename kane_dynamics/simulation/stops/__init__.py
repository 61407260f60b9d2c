"""Joint stops in simulations."""
