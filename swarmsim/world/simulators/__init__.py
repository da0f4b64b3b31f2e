"""Worlds of other simulators."""
