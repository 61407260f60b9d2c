"""Vectors, dual numbers and linear algebra over any scalar type."""
