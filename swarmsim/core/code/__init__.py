"""The code behind a run, by content."""
