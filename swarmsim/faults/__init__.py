"""Faults: wrappers that make a part misbehave, with whom, when, how long and how much."""
