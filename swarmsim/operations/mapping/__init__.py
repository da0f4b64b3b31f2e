"""Collective mapping: a swarm that maps a building together, and what is measured of its maps."""
