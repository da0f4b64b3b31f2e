"""The swarm's world: walls, free space, spawn areas and the truth about every cell."""
