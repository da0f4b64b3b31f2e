"""Runs that go on while somebody looks at them."""
