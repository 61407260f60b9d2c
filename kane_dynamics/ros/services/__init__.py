"""Services and the action of the node."""
