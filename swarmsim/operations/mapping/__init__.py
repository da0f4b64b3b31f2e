"""Collective mapping: a swarm maps a building together; measures of its maps."""
