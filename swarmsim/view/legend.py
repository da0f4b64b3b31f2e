"""What the signs in a picture mean."""

from __future__ import annotations

import numpy as np
import pygame

from swarmsim.view.scene import Scene
from swarmsim.view.style import Style
from swarmsim.view.symbols import Pen
from swarmsim.view.theme import colour_of

Sign = tuple[str, str]  # its kind and what it means


def signs(scene: Scene, look: Style, enlarged: float) -> list[Sign]:
    """Every sign in the pictures of a scene; robots are drawn `enlarged` so many times."""
    rows, columns = scene.tile
    size = f", up to {enlarged:.2g} x its size" if enlarged > 1.0 else ""
    every = [
        ("robot", f"robot{size}"),
        ("tile", f"the {rows} x {columns} cells it senses"),
        ("beams", "its beams"),
        ("aim", "its way ahead and goal"),
        ("mutual", "link: each hears the other"),
        ("one way", "link: the arrow's end hears"),
        ("lost", "message lost"),
        ("waiting", "message under way"),
        ("heading", "the heading it estimates"),
        ("belief", "where a robot believes to be"),
        ("fault", "robot with a fault"),
        ("joined", "robot that joined late"),
        ("dead", "dead robot"),
        ("removed", "where a robot was removed"),
        ("person", "person"),
        ("box", "box that was not there before"),
        ("field", "the field, as robots estimate it"),
        ("known", f"floor that 1 to {scene.robots} robots know"),
        ("own", f"floor that robot {look.focus} knows"),
        ("others", "floor that others know"),
        ("seen", "occupied, in some map" if look.focus is None else "occupied, in its map"),
        ("mark", "event"),
    ]
    layers, own = look.layers, look.focus is not None
    rare = {kind: kind in scene.signs for kind in ("fault", "joined", "dead", "removed", "box")}
    rare |= dict.fromkeys(("mutual", "one way"), "links" in layers)
    rare |= {kind: "links" in layers and kind in scene.signs for kind in ("lost", "waiting")}
    rare |= {"tile": "tiles" in layers and scene.tile[0] > 0, "beams": "beams" in layers and bool(look.chosen)}
    rare |= {"aim": "ways" in layers and scene.walks, "mark": bool(scene.marks), "heading": scene.has_headings}
    rare |= {"field": scene.has_field, "belief": scene.has_beliefs}
    rare |= {"person": scene.has_people and "people" in layers, "seen": scene.has_maps}
    rare |= {"known": scene.has_maps and not own} | dict.fromkeys(("own", "others"), scene.has_maps and own)
    return [(kind, text) for kind, text in every if rare.get(kind, True)]


def draw_sign(surface: pygame.Surface, pen: Pen, kind: str, at: tuple[int, int], unit: float) -> None:
    """Draw one sign of the legend around a place, `unit` times its usual size."""
    (x, y), colour, theme = at, colour_of(0), pen.theme

    def box(left: float, top: float, width: float, height: float) -> pygame.Rect:
        return pygame.Rect(*(round(side) for side in (x + left * unit, y + top * unit, width * unit, height * unit)))

    ends, broad = ((x - 10 * unit, y), (x + 10 * unit, y)), max(1, round(2 * unit))
    match kind:
        case "robot":
            pen.robot(surface, at, 0.5, 6 * unit, colour)
        case "tile":
            pen.tile(surface, box(-7, -6, 14, 12), colour)
        case "beams":
            fan = [(x + 9 * unit, y + side * unit) for side in (-6, 0, 6)]
            pen.beams(surface, (x - 9 * unit, y), fan, theme.mark)
        case "aim":
            bend = (x - 3 * unit, y + 4 * unit)
            pen.way(surface, [(x - 10 * unit, y + 4 * unit), bend, (x + 5 * unit, y)], colour, broad)
            pen.goal(surface, (x + 6 * unit, y), 4 * unit, colour)
        case "mutual":
            pen.link(surface, *ends, broad)
        case "one way" | "lost" | "waiting":
            pen.link(surface, *ends, broad, 0.0, {"one way": "heard", "lost": "lost"}.get(kind, "under way"))
        case "heading":
            pen.heading(surface, (x - 6 * unit, y), 0.5, 16 * unit, broad)
            pen.robot(surface, (x - 6 * unit, y), 0.5, 3.5 * unit, colour)
        case "fault" | "joined":
            (pen.fault if kind == "fault" else pen.joined)(surface, at, 3.5 * unit)
            pen.robot(surface, at, 0.5, 3.5 * unit, colour)
        case "belief":
            pen.robot(surface, ends[0], 0.5, 3.5 * unit, colour)
            pen.belief(surface, ends[0], ends[1], 5 * unit, colour, broad)
        case "removed":
            pen.removed(surface, at, 6 * unit)
        case "dead":
            pen.dead(surface, at, 6 * unit)
        case "person":
            pen.person(surface, at, 6 * unit)
        case "box":
            pen.box(surface, box(-7, -5, 14, 10), broad)
        case "mark":
            surface.fill(theme.mark, box(-1, -7, 2, 14))
        case "field" | "known":
            for step in range(7):
                shade = (theme.heat if kind == "field" else theme.known)(np.array(step / 6.0)).tolist()
                surface.fill(shade, box(-10 + 20 * step / 7, -5, 20 / 7 + 1, 10))
        case _:
            dim = tuple((a + b) // 2 for a, b in zip(theme.unexplored, theme.few, strict=True))
            surface.fill({"own": theme.all, "others": dim}.get(kind, theme.seen), box(-7, -5, 14, 10))
