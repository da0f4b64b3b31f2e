"""Jobs whose messages are facts: keys with values, of which the newest wins, whatever order they arrive in."""
