"""Robot learning: scenarios as PettingZoo and Gymnasium environments, on the same engine as every run."""

try:
    import gymnasium  # noqa: F401
    import pettingzoo  # noqa: F401
except ImportError as problem:
    raise ImportError(
        "swarmsim.learning needs pettingzoo and gymnasium; install them with: pip install 'swarmsim-lab[learn]'"
    ) from problem

from swarmsim.learning.environment import SwarmEnv
from swarmsim.learning.learned import ACTIONS, REWARDS
from swarmsim.learning.single import RobotEnv
from swarmsim.learning.vector import WorldsEnv, vector_env

__all__ = ["ACTIONS", "REWARDS", "RobotEnv", "SwarmEnv", "WorldsEnv", "vector_env"]
