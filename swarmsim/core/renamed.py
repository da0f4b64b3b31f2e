"""Old names and their new ones, so that messages can tell the new name."""

from __future__ import annotations

from collections.abc import Container, Iterable
from typing import Any, Final

#: Methods and attributes of parts and minds.
OF_PARTS: Final = {
    "adopt": "copy_from",
    "forget": "reset",
    "knows": "knowledge_type",
    "reads": "requires_knowledge",
    "says": "message_fields",
    "shows": "recorded",
    "taken": "accepted",
}

#: Attributes of `Me`.
OF_MINDS: Final = {"knows": "knowledge", "reads": "readings"}

#: Modules, and what was imported from them.
OF_MODULES: Final = {
    "swarmsim.core.code": "swarmsim.core.scenario.identity",
    "swarmsim.core.forms": "swarmsim.core.adapters.forms",
    "swarmsim.core.minds": "swarmsim.core.adapters.minds",
    "swarmsim.core.part": "swarmsim.core.scenario.part",
    "swarmsim.core.registry": "swarmsim.core.scenario.registry",
    "swarmsim.core.setting": "swarmsim.core.context",
    "swarmsim.faults.disguise": "swarmsim.faults.delegate",
    "swarmsim.operations.mapping.choosing": "swarmsim.operations.mapping.exploration.rules",
    "swarmsim.operations.mapping.coverage": "swarmsim.operations.mapping.measures.coverage",
    "swarmsim.operations.mapping.exploring": "swarmsim.operations.mapping.exploration.strategy",
    "swarmsim.operations.mapping.frontier": "swarmsim.operations.mapping.exploration.nearest",
    "swarmsim.operations.mapping.gossip": "swarmsim.operations.mapping.sharing.gossip",
    "swarmsim.operations.mapping.message": "swarmsim.operations.mapping.sharing.codecs",
    "swarmsim.operations.mapping.relaying": "swarmsim.operations.mapping.sharing.relaying",
    "swarmsim.operations.placement.gathering": "swarmsim.operations.placement.rendezvous",
    "swarmsim.world.generated": "swarmsim.world.made.generated",
    "swarmsim.world.masonry": "swarmsim.world.made.wall_grid",
}
OF_IMPORTS: Final = {
    "Calendar": "Schedule",
    "Channel": "NetworkChannel",
    "Columns": "MessageBatch",
    "Happening": "EventSource",
    "Lasting": "StatelessEffect",
    "Now": "Tick",
    "Options": "Candidates",
    "PostOffice": "MessageBuffer",
    "Said": "Broadcast",
    "Setting": "BuildContext",
    "Site": "WorldContext",
    "WrappedComputation": "ComputationDelegate",
}

#: Keys of scenarios.
OF_KEYS: Final = {
    "choose": ("target",),
    "keep": ("min_alive",),
    "lasts": ("duration",),
    "share": ("fraction", "sharing"),  # of faults, of mapping
}


def key_now(old: str, known: Container[str]) -> str | None:
    """The new name of a key once called `old`, if known."""
    return next((new for new in OF_KEYS.get(old, ()) if new in known), None)


def in_new_words(scenario: dict[str, Any]) -> dict[str, Any]:
    """The table of a recorded scenario with today's names of its keys."""
    computation, stop = scenario["mind"]["computation"], scenario["stop"]
    if computation["use"] == "occupancy-grid" and "share" in computation:
        computation["sharing"] = computation.pop("share")
    if stop["when_done"] == "go-on":
        stop["when_done"] = "continue"
    old = {key: now[0] for key, now in OF_KEYS.items()}
    faults = [{old.get(key, key): value for key, value in fault.items()} for fault in scenario["faults"]]
    return {**scenario, "faults": faults}


def hint(names: Iterable[str], now: dict[str, str]) -> str:
    """Tells the new names of the old ones among these; empty without any."""
    return "".join(f"; {name!r} is called {now[name]!r} now" for name in names if name in now)


def hint_of(problem: BaseException) -> str:
    """The same for the name that an exception could not find."""
    if isinstance(problem, ModuleNotFoundError):
        return hint([problem.name or ""], OF_MODULES)
    if isinstance(problem, ImportError):
        return hint([name for name in OF_IMPORTS if f"cannot import name {name!r}" in str(problem)], OF_IMPORTS)
    return ""
