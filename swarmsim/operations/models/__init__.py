"""Equations of the environment: what changes in a building, and how fast."""
