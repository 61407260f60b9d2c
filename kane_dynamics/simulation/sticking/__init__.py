"""Exact Coulomb friction of `simulate`: joints that stick, and the times of transition."""
