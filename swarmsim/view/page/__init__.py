"""A run as one page that anybody's browser replays: no server, no network."""
