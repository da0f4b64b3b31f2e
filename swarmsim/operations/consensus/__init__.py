"""Consensus: robots that agree on a heading, or on the average of their measurements."""
