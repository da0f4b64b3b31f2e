"""How robots share a job in pieces, and go on when some of them fall silent."""
