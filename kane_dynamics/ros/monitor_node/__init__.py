"""The node that listens to an arm: payload estimate, and a watch over its model."""
