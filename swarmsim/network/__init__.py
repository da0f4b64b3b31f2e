"""Which robots hear which others, and which messages arrive."""
