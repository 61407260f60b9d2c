"""The rules of a control cycle: judged states, limits, refusals, stops, and who commands."""
