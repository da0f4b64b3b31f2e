"""The roles of indoor maps' features: tags of OpenStreetMap, categories of IMDF, types of wrld3d."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Final

from swarmsim.world.plan import DOORS_LAYER, FLOOR_LAYER

OPEN: Final = "open"  #: floor without walls towards other such floor, like a corridor's parts
ROOM: Final = "room"  #: floor if no walls are drawn, else a name for the space between them
NO_FLOOR: Final = "no floor"  #: stairs, lifts, and rooms that are not for the public
OUTLINE: Final = "outline"  #: a building's outline: floor where walls are drawn on it
IGNORED: Final = "ignored"  #: a whole level or building
FLOORS: Final = (FLOOR_LAYER, OPEN, ROOM, OUTLINE)  #: floor as a whole, not a line
PLACES: Final = (FLOOR_LAYER, OPEN, ROOM, "walls")  #: they make a file an indoor map

_OSM: Final = {
    "room": FLOOR_LAYER, "area": OPEN, "corridor": OPEN, "wall": "walls", "column": "pillars", "pillar": "pillars",
    "door": DOORS_LAYER, "level": IGNORED, "yes": IGNORED,
}  # fmt: skip
_PARTS: Final = {"room": FLOOR_LAYER, "corridor": OPEN, "hall": OPEN, "wall": "walls", "verticalpassage": NO_FLOOR}
_WRLD3D: Final = {
    "wall": "walls", "window": "walls", "door": DOORS_LAYER, "room": ROOM, "outline": OUTLINE,
    "building_outline": OUTLINE,
    **dict.fromkeys(("stairs", "elevator", "escalator", "inaccessible_space", "floor_opening"), NO_FLOOR),
}  # fmt: skip
_IMDF: Final = {"opening": DOORS_LAYER, "fixture": "furniture", "kiosk": "furniture"}
# https://register.apple.com/resources/imdf/Categories/#unit
_UNITS: Final = {
    **dict.fromkeys(("walkway", "walkway.island", "unenclosedarea"), OPEN),
    **dict.fromkeys(("brick", "column", "concrete", "drywall", "glass", "structure", "wood"), "walls"),
    **dict.fromkeys(
        ("elevator", "escalator", "stairs", "steps", "movingwalkway", "nonpublic", "opentobelow", "vegetation"),
        NO_FLOOR,
    ),
}
_KINDS: Final = (  # properties that may give a feature's role, the most telling first
    "category", "feature_type", "room", "highway", "buildingpart", "indoor", "type", "building", "amenity", "layer",
)  # fmt: skip
_CLIMBING: Final = ("stairs", "elevator", "steps", "escalator")  # values of `room` and `highway`


def texts(properties: Mapping[str, object], keys: Iterable[str]) -> dict[str, str]:
    """The properties with these keys that are texts."""
    return {key: value for key in keys if isinstance(value := properties.get(key), str)}


def role_of(properties: Mapping[str, object]) -> str:
    """The floor plan's layer of an indoor feature, one of the roles above, or empty."""
    kind = properties.get("feature_type")
    if isinstance(kind, str):
        category = str(properties.get("category") or "").casefold()
        return _UNITS.get(category, FLOOR_LAYER) if kind == "unit" else _IMDF.get(kind, IGNORED)
    part = properties.get("buildingpart")
    if isinstance(part, str) and part in _PARTS:  # OpenStreetMap's form before `indoor=room`
        return _PARTS[part]
    kind = properties.get("indoor")
    if isinstance(kind, str) and kind != "no":
        climbs = any(properties.get(key) in _CLIMBING for key in ("room", "highway"))
        if climbs or properties.get("stairs", "no") != "no":
            return NO_FLOOR
        if kind in _OSM and not ("door" in properties and kind == "yes"):
            return _OSM[kind]
    if "door" in properties or "entrance" in properties:
        return DOORS_LAYER
    kind = properties.get("type")
    return _WRLD3D.get(kind, "") if isinstance(kind, str) else ""


def kind_of(properties: Mapping[str, object]) -> str:
    """A feature's name in the file."""
    return next(iter(texts(properties, _KINDS).values()), "other")


def width_of(properties: Mapping[str, object]) -> float | None:
    """The property `width` in m, in OpenStreetMap's forms: 0.9, 0.9 m or 90 cm; None if there is none."""
    value = properties.get("width")
    if isinstance(value, int | float) and not isinstance(value, bool):
        width = float(value)
    elif isinstance(value, str) and (found := re.fullmatch(r"\s*(\d{1,5}(?:[.,]\d+)?)\s*(m|cm)?\s*", value)):
        width = float(found[1].replace(",", ".")) * (0.01 if found[2] == "cm" else 1.0)
    else:
        return None
    return width if 0.0 < width <= 100.0 else None
