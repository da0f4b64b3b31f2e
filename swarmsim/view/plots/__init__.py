"""Figures of single runs and of many runs together, saved as the same bytes every time."""

from swarmsim.view.plots.asked import asked
from swarmsim.view.plots.building import building
from swarmsim.view.plots.chances import Chances, Way, chances, front
from swarmsim.view.plots.conditions import comparison, distributions
from swarmsim.view.plots.imported import imported
from swarmsim.view.plots.local_maps import local_maps
from swarmsim.view.plots.methods import Ratios, profiles, ratios
from swarmsim.view.plots.network import contact_times, degrees, network_course, who_heard_whom
from swarmsim.view.plots.over_time import curves, padded
from swarmsim.view.plots.provenance import provenance
from swarmsim.view.plots.rewiring import rewiring
from swarmsim.view.plots.sheet import address, save
from swarmsim.view.plots.style import COLOURS, FINEST, TIME, printing
from swarmsim.view.plots.trends import Steps, scaling, sweep

__all__ = [
    "COLOURS", "FINEST", "TIME", "Chances", "Ratios", "Steps", "Way", "address", "asked", "building", "chances",
    "comparison", "contact_times", "curves", "degrees", "distributions", "front", "imported", "local_maps",
    "network_course", "padded", "printing", "profiles", "provenance", "ratios", "rewiring", "save", "scaling", "sweep",
    "who_heard_whom",
]  # fmt: skip
