"""Consensus: robots that come to agree on a heading, or on the average of what each has measured."""
