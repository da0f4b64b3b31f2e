"""Benchmarks: a frozen set of tasks, what others score on it, and how near that comes to the best possible."""
