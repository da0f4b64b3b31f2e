"""The usual names of layers in the drawings of building programs."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import Final

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import World
from swarmsim.world.plan import FLOOR_LAYER, LAYERS, SPAWN_LAYER, UNKNOWN_LAYER

_WORDS: Final = {  # that identify a layer, without accents
    "walls": (
        "wall walls wallex wallin wand wande waende mauer mauern mauerwerk trennwand mur murs cloison cloisons pared "
        "paredes tabique tabiques muro muros muri parete pareti parede muur muren wanden vagg vaggar sciana sciany "
        "structure glaz glazing window windows fenster fenetre fenetres ventana ventanas finestra finestre janela "
        "janelas stair stairs strs treppe treppen escalier escaliers escalera escaleras hral handrail railing"
    ),
    "pillars": (
        "cols column columns pillar pillars stutze stutzen stuetze stuetzen saule saulen poteau poteaux pilar pilares "
        "columna columnas colonna colonne pilastro pilastri kolom kolommen"
    ),
    "furniture": (
        "furn furniture mobiliar mobel moebel mobilier meuble meubles mueble muebles mobiliario mobilario arredo "
        "arredi meubilair casework shelf shelves regal regale couch sofa table tables tisch tische chair chairs stuhl "
        "stuhle bench benches desk desks bett betten bed beds"
    ),
}
_DOORS: Final = "door doors tur ture turen tuer tueren porte portes puerta puertas porta portas deur deuren"
_NOTES: Final = (  # annotations beside walls or above them
    "iden text texts anno annotation dims dim dimensions dimension tag tags note notes label labels patt grid head ovhd"
)
_LAYER_OF: Final = {word: layer for layer, words in _WORDS.items() for word in words.split()}
_ENDS_OF_WALLS: Final = ("wand", "wande", "waende", "wall", "walls")  # of compounds, as in Aussenwand


class Conventions:
    """Tells the layers of one drawing apart, by the scenario and by usual names."""

    def __init__(self, names: Iterable[str], world: World, file: str) -> None:
        """`names` are the file's layers; `*` and `?` in the scenario's names match any characters.

        Raises InputError for a layer that does not exist and for names that the drawing lacks.
        """
        self._given = dict(world.named)
        if world.floor:
            self._given[FLOOR_LAYER] = (*self._given.get(FLOOR_LAYER, ()), *world.floor)
        known = list(names)
        for layer, patterns in self._given.items():
            for missing in (one for one in patterns if not any(_matches(name, one) for name in known)):
                near = difflib.get_close_matches(missing.casefold(), map(str.casefold, known), n=1, cutoff=0.5)
                hint = next((f"did you mean {name!r}? " for name in known if [name.casefold()] == near), "")
                key = "world.floor" if missing in world.floor else f"world.layers.{layer}"
                raise InputError(
                    f"{file}: {key}: no layer is called {missing!r}; {hint}it has {', '.join(known[:12]) or 'none'}"
                )

    def layer_of(self, name: str) -> str:
        """The floor plan's layer for one of the file's layers; empty if neither scenario nor name says."""
        given = next((layer for layer in LAYERS if any(_matches(name, p) for p in self._given.get(layer, ()))), "")
        if given:
            return given
        words = _words(name)
        usual = next((layer for word in words if (layer := _LAYER_OF.get(word) or _compound(word))), "")
        if words in (["spawn"], ["unknown"]):
            usual = SPAWN_LAYER if words == ["spawn"] else UNKNOWN_LAYER
        if usual in self._given or _is_note(words):
            return ""
        return usual

    def draws_doors(self, name: str) -> bool:
        """Whether a layer holds the symbols of doors."""
        words = _words(name)
        return not self.layer_of(name) and not _is_note(words) and any(word in _DOORS.split() for word in words)


def _compound(word: str) -> str:
    return "walls" if word.endswith(_ENDS_OF_WALLS) else ""


def _is_note(words: list[str]) -> bool:
    return any(word in _NOTES.split() for word in words)


def _matches(name: str, pattern: str) -> bool:
    return fnmatchcase(name.casefold(), pattern.casefold())


def _words(name: str) -> list[str]:
    """The words of a layer's name, without accents, digits, and the name of the file that it was bound from."""
    own = re.split(r"[|]|\$\d+\$", name)[-1]
    plain = unicodedata.normalize("NFKD", own.casefold().replace("ß", "ss"))
    return re.findall(r"[^\W\d_]+", "".join(c for c in plain if not unicodedata.combining(c)))
