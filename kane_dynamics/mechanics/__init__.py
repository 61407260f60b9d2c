"""The physics: pure functions over any scalar, from a Model."""
