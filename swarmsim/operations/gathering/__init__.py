"""Samples of a field that go to those who compute it, instead of a computation that is shared."""
