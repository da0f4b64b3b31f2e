"""Indoor maps: features with tags, venues, levels."""
