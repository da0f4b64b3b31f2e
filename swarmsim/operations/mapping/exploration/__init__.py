"""Where mapping robots go."""
