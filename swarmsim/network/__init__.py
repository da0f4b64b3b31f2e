"""Who hears whom, and what of it arrives."""
