"""Pursuit: robots of one group chase those of another."""
