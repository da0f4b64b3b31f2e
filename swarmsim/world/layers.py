"""The layer of a drawing's element, by its id, label or class."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence

from swarmsim.core.errors import InputError
from swarmsim.world.elements import Element
from swarmsim.world.plan import FLOOR_LAYER, LAYERS, SOLID_LAYERS

_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_ESCAPED = re.compile(r"_x([0-9a-f]{2,4})_", re.IGNORECASE)  # Illustrator's escape for characters not allowed in ids
_COPY = re.compile(r"([ _-]copy)?([ _-]\d+_?)*$")  # what programs append to the names of copies


class LayerNames:
    """Tells the layers of one drawing apart."""

    def __init__(self, root: Element, given: Mapping[str, Sequence[str]], name: str) -> None:
        """`given` holds names, or `#id` and `.class`, that replace a layer's own name.

        Raises InputError for a layer that does not exist and for names that the drawing lacks.
        """
        self._given = {layer: tuple(names) for layer, names in given.items()}
        elements = [element for element in root.tree() if element is not root]
        found = {layer: [e for e in elements if self._is(e, layer)] for layer in LAYERS}
        self._layers = {element: layer for layer in reversed(LAYERS) for element in found[layer]}
        for layer, names in self._given.items():
            for missing in (one for one in names if not any(_answers(e, one) for e in elements)):
                groups = dict.fromkeys(own for e in elements if e.tag == "g" for own in names_of(e))
                near = difflib.get_close_matches(normal(missing), map(normal, groups), n=1, cutoff=0.5)
                hint = next((f"did you mean {one!r}? " for one in groups if [normal(one)] == near), "")
                known = ", ".join(list(groups)[:12]) or "no group with a name"
                raise InputError(
                    f"{name}: world.layers.{layer}: nothing in the drawing is called {missing!r}; {hint}it has {known}"
                )
        self._found = {layer: any(e.tag != "svg" for e in one) for layer, one in found.items()}
        #: Whether the drawing itself says what is solid; otherwise all of it is.
        self.says_solid = any(self._found[layer] for layer in SOLID_LAYERS)
        self._near = [
            (own, layer)
            for element in elements
            if element.tag == "g"
            for own in names_of(element)
            for layer in difflib.get_close_matches(normal(own), SOLID_LAYERS, n=1, cutoff=0.75)
        ]

    def layer_of(self, element: Element) -> str:
        """The layer of an element, or an empty string."""
        return self._layers.get(element, "")

    def has(self, layer: str) -> bool:
        """Whether the drawing has a layer of that name, shown or hidden."""
        return self._found[layer]

    def misspelt(self) -> str | None:
        """The likely error if no layer is solid, but a group has nearly such a name."""
        if self.says_solid or not self._near:
            return None
        own, layer = self._near[0]
        return (
            f"no layer `{layer}`, but a group {own!r}; call it {layer}, or say in the scenario [world.layers] "
            f'{layer} = ["{own}"]'
        )

    def _is(self, element: Element, layer: str) -> bool:
        if layer in self._given:
            return any(_answers(element, name) for name in self._given[layer])
        if layer == FLOOR_LAYER:
            return False
        return any(normal(own) == layer for own in names_of(element))


def names_of(element: Element) -> list[str]:
    """The id, labels and classes of an element, as written."""
    attributes = element.attributes
    labels = [attributes[key] for key in ("id", _LABEL, "data-name") if attributes.get(key, "").strip()]
    return labels + attributes.get("class", "").split()


def normal(name: str) -> str:
    """A name without programs' additions: case, blanks around it, escapes, the numbers of copies."""
    plain = _ESCAPED.sub(lambda match: chr(int(match[1], 16)), name).strip().casefold()
    return _COPY.sub("", plain).strip(" _")


def _answers(element: Element, name: str) -> bool:
    """Whether an element is called `name`, `#id` or `.class`."""
    if name.startswith("#"):
        return element.attributes.get("id") == name[1:]
    if name.startswith("."):
        return name[1:] in element.attributes.get("class", "").split()
    return any(own == name or normal(own) == normal(name) for own in names_of(element))
