"""Robots that are processes of their own: how they hear one another, and what stands beside them."""
