"""Physics-true 2D simulation of robot swarms whose network is the experiment."""

__version__ = "0.1.0"
