"""Parameters of the node: their table, their checks, their changes."""
