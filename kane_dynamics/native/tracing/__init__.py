"""Expressions and programs: a traced function as straight-line code."""
