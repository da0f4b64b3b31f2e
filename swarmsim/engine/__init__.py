"""The engine: a scenario becomes parts, and the tick runs them."""
