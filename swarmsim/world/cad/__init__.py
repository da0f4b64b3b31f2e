"""Drawings of CAD programs."""
