"""Recursive O(n) algorithms (RNEA, CRBA and their kin): what is compiled."""
