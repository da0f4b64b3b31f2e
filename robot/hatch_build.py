"""Takes what both distributions say from the other one's pyproject.toml: versions, extras, and the names of parts."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface


class Shared(MetadataHookInterface):
    """The requirements and entry points of `swarmsim-lab`, as far as a robot needs them."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Fill in what pyproject.toml calls dynamic."""
        root = Path(self.root)
        whole = tomllib.loads((root.parent / "pyproject.toml").read_text())["project"]
        build = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["hatch"]["build"]
        placed = build["targets"]["wheel"]["force-include"].values()
        rooms = [place.removesuffix(".py").replace("/", ".") for place in placed]
        required = {re.split(r"\W", one, maxsplit=1)[0]: one for one in whole["dependencies"]}
        metadata["license"], metadata["requires-python"] = whole["license"], whole["requires-python"]
        metadata["dependencies"] = [required[name] for name in self.config["needs"]]
        extras = {name: whole["optional-dependencies"][name] for name in self.config["extras"]}
        metadata["optional-dependencies"] = {**extras, "minds": [required[name] for name in self.config["minds"]]}
        metadata["entry-points"] = {
            group: {name: place for name, place in parts.items() if place.rpartition(".")[0].startswith(tuple(rooms))}
            for group, parts in whole["entry-points"].items()
            if group.removeprefix("swarmsim.") in self.config["seams"]
        }
