"""The world a swarm lives in: walls, free space, spawn areas and the truth about every cell."""
