"""A run as one page that any browser replays: no server, no network."""
