"""Faults: wrappers that make a part misbehave; they say which robots are hit, when, how long and how much."""
