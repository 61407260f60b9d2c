"""Shapes of links, as they are drawn and as they collide."""
