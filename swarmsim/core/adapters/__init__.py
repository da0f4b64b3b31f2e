"""Simpler forms of parts: a class of one robot's mind, and plain functions of arrays."""
