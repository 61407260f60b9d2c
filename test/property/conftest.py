"""Hypothesis, the same on every machine and every run."""

from hypothesis import HealthCheck, settings

settings.register_profile('deterministic', derandomize=True, deadline=None, max_examples=60,
                          database=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('deterministic')
