"""Expectations of scenarios and studies, and what their runs say of them."""
