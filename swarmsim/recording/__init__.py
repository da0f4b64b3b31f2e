"""Recordings of runs: writing them and reading them back."""
