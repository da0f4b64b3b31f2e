"""Sources: robots find out where a field comes from, and predict it."""
