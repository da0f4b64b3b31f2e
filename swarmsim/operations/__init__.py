"""Collective operations: local computations, control strategies, and the tasks that measure them."""
