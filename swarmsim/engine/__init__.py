"""The engine: builds a scenario's parts and runs them, tick by tick."""
