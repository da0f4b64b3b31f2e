"""Shell completions: keys and parts for --set, faults for --fault, shipped examples."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import msgspec


def set_keys(incomplete: str) -> list[str]:
    """Keys of scenarios with `=`, and the parts for a key: network.topology={use="knn"}."""
    return [text for text in _settings() if text.startswith(incomplete)]


def fault_words(incomplete: str) -> list[str]:
    """Kinds of faults, then their failures, then keys with `=`, each after the words typed so far."""
    import typing

    import msgspec

    from swarmsim.core.scenario import registry

    *before, last = incomplete.split(" ")
    kinds = registry.known("fault")
    if not before:
        return [kind for kind in kinds if kind.startswith(last)]
    kind = kinds.get(before[0])
    if kind is None:
        return []
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind)}
    words: list[str] = []
    if "failure" in fields and len(before) == 1:
        words = list(typing.get_args(fields["failure"].type))
    given = {word.partition("=")[0] for word in before}
    words += [f"{key}=" for key in fields if key not in given | {"failure"}]
    return [" ".join([*before, word]) for word in words if word.startswith(last)]


def example_names(incomplete: str) -> list[str]:
    """The names of what ships."""
    from swarmsim.core.scenario import shipped

    names = dict.fromkeys(name for kind in shipped.KINDS for name in shipped.examples(kind))
    return [name for name in names if name.startswith(incomplete)]


def _settings() -> Iterator[str]:
    import msgspec

    from swarmsim.core.scenario import registry
    from swarmsim.core.scenario.file import Scenario
    from swarmsim.core.seams import SEAMS

    places = {seam.at: seam for seam in SEAMS.values()}

    def keys(kind: type[msgspec.Struct], place: str) -> Iterator[str]:
        for field in msgspec.structs.fields(kind):
            path = f"{place}{field.encode_name}"
            inner = field.type
            if path in places and not places[path].many:
                for name, part in registry.known(places[path].name).items():
                    yield f'{path}={{use="{name}"}}'
                    yield from keys(part, f"{path}.")
            elif isinstance(inner, type) and issubclass(inner, msgspec.Struct):
                yield from keys(inner, f"{path}.")
            elif path not in places:
                yield f"{path}="

    return iter(dict.fromkeys(keys(Scenario, "")))
