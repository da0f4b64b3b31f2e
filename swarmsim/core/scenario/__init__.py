"""Scenario files: tables become typed values, and parts are found by name."""
