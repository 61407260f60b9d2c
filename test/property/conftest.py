"""Deterministic Hypothesis profile; `make test-slow` tries more examples."""

import os

from hypothesis import HealthCheck, settings

settings.register_profile('deterministic', derandomize=True, deadline=None,
                          max_examples=6,
                          database=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile('thorough', parent=settings.get_profile('deterministic'),
                          max_examples=200)
settings.load_profile(os.environ.get('HYPOTHESIS_PROFILE', 'deterministic'))
