"""A figure drawn for white paper, turned for a dark ground."""

from __future__ import annotations

import colorsys
from typing import TYPE_CHECKING, Final

from matplotlib.artist import Artist
from matplotlib.collections import Collection
from matplotlib.colors import ListedColormap, to_rgba, to_rgba_array
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text

if TYPE_CHECKING:
    from matplotlib.typing import ColorType

SCALE: Final = 64  # colours from which a map of colours is a scale, which stays
GROUND: Final = 0.09  # lightness of what was white
VIVID: Final = 0.35  # saturation from which a colour keeps its lightness, unless it is too dark or too light to be seen


def darken(figure: Figure) -> None:
    """Turn all that is drawn: white becomes nearly black and black nearly white, colours stay themselves."""
    for artist in figure.findobj(include_self=True):
        _turn(artist)


def _turn(artist: Artist) -> None:
    match artist:
        case Text():
            artist.set_color(_turned(artist.get_color()))
            if (box := artist.get_bbox_patch()) is not None:
                _turn(box)
        case Line2D():
            face, edge = artist.get_markerfacecolor(), artist.get_markeredgecolor()  # by default the line's colour
            artist.set_color(_turned(artist.get_color()))
            artist.set_markerfacecolor(_turned(face))
            artist.set_markeredgecolor(_turned(edge))
        case Patch():
            face, edge = artist.get_facecolor(), artist.get_edgecolor()
            artist.set_facecolor(_turned(face))
            artist.set_edgecolor(_turned(edge))
        case AxesImage() if isinstance(colours := artist.get_cmap(), ListedColormap) and colours.N < SCALE:
            artist.set_cmap(ListedColormap([_turned(colours(place)) for place in range(colours.N)]))
        case Collection() if artist.get_array() is None:
            faces, edges = artist.get_facecolor(), artist.get_edgecolor()
            artist.set_facecolor([_turned(one) for one in to_rgba_array(faces)])
            artist.set_edgecolor([_turned(one) for one in to_rgba_array(edges)])


def _turned(colour: ColorType) -> ColorType:
    """A colour for a dark ground: without much colour with its lightness turned, else light enough."""
    if isinstance(colour, str) and colour == "none":
        return "none"
    red, green, blue, alpha = to_rgba(colour)
    hue, light, saturation = colorsys.rgb_to_hls(red, green, blue)
    if saturation < VIVID or not 0.1 < light < 0.85:
        light = GROUND + (1.0 - GROUND) * (1.0 - light) * 0.95
    else:
        light = max(light, 0.5)
    return (*colorsys.hls_to_rgb(hue, light, saturation), alpha)
