"""Recordings in the formats of third-party viewers."""
