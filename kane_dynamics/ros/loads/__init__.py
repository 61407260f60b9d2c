"""Loads on the arm: gravity, payload and measured wrenches."""
