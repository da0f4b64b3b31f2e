"""The scenarios, studies, papers and worlds that come with swarmsim, in a checkout or an installed package."""

from __future__ import annotations

import html
import os
import re
import shutil
import tomllib
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Final, Literal, get_args

from swarmsim.core.errors import InputError, unwritten


class NotShippedError(InputError):
    """swarmsim is installed without its scenarios and worlds."""


def root() -> Path:
    """The folder that holds `scenarios`, `papers` and `worlds`. Raises NotShippedError if they are not installed."""
    package = Path(__file__).parents[2]
    for folder in (package.parent, package):  # a checkout, or an installed package
        if (folder / "scenarios" / "basilica.toml").is_file():
            return folder
    raise NotShippedError(f"{package}: the folder scenarios is missing; install swarmsim again")


Kind = Literal["scenarios", "studies", "papers", "worlds"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
#: The folder of each kind, whose names begin there, and the files in it.
_PLACES: Final[dict[Kind, tuple[str, str]]] = {
    "scenarios": ("scenarios", "**/*.toml"),
    "studies": ("scenarios/studies", "**/*.toml"),
    "papers": ("papers", "*/paper.toml"),
    "worlds": ("worlds", "*.svg"),
}


def examples(kind: Kind = "scenarios") -> dict[str, str]:
    """The title of everything of a kind that ships, by its name, as in `faults/blind`: `swarmsim examples`.

    Raises InputError if it is not installed.
    """
    titled = {name: _title(path) for name, path in _files(kind).items()}
    return dict(sorted(titled.items(), key=lambda pair: (pair[0].count("/"), pair[0])))


def _files(kind: Kind) -> dict[str, Path]:
    """The files of a kind that ship, by name; a paper's is its `paper.toml`."""
    folder, files = _PLACES[kind]
    home = root() / folder
    apart = {"studies", "benchmarks"} if kind == "scenarios" else set()
    paths = [path for path in home.glob(files) if not apart & {*path.relative_to(home).parts}]
    return {
        (path.parent if kind == "papers" else path.with_suffix("")).relative_to(home).as_posix(): path for path in paths
    }


def _named(name: str, kinds: Iterable[Kind]) -> Path | None:
    """The file of this name, the first of these kinds."""
    first = name.partition("/")[0]
    files = [_files(one) for one in kinds]
    more = [{f"{one}/{rest}": path for rest, path in _files(one).items()} for one in KINDS if one == first]
    return next((one[name] for one in (*files, *more) if name in one), None)


def example(name: str) -> Path:
    """The file of something that ships, for `run` and others: `swarmsim examples run`.

    Scenarios come first, then studies, papers and worlds, unless the name begins with another kind: `papers/kit2018`.
    Raises InputError for a name that is none.
    """
    if path := _named(name, KINDS):
        return path
    alike = [one for kind in KINDS for one in _files(kind) if one.rpartition("/")[2] == name.rpartition("/")[2]]
    hint = f"did you mean {alike[0]!r}?" if alike else "list them with: swarmsim examples"
    raise InputError(f"{name}: no such example; {hint}")


def kind_of(path: Path) -> Kind:
    """What a file that ships is."""
    return next(kind for kind in reversed(KINDS) if path in _files(kind).values())


def found(given: str | Path, kind: Kind = "scenarios", folder: Path | None = None) -> Path:
    """The file that a path or, where there is none, the name of something that ships means: `basilica`.

    Paths resolve from `folder`. A name without folder and suffix is first one of its `kind`. What is neither is given
    back as a path, for its reader to refuse. Raises InputError for the path in swarmsim's repository of something that
    ships, which is told its name.
    """
    path = Path(given) if folder is None else folder / given
    if os.path.isfile(path) or Path(given).is_absolute() or (kind == "worlds" and os.path.isdir(path)):  # noqa: PTH112, PTH113 - the input may be no path at all
        return path
    name = Path(given).as_posix()
    try:
        if named := _named(name, (kind, *KINDS)):
            return named
        called = [known for one in KINDS for known, place in _files(one).items() if place == root() / name]
        if called and folder is None:
            raise InputError(f"{given}: no such file here; what comes with swarmsim is called {called[0]!r}")
        if name in {"scenarios", *(f"scenarios/{one.partition('/')[0]}" for one in _files("scenarios") if "/" in one)}:
            return root() / name  # a whole folder
        close = get_close_matches(name, [known for one in KINDS for known in _files(one)], 1)
    except NotShippedError:
        return path
    if close and not path.suffix and not os.path.isdir(path):  # noqa: PTH112 - as above
        raise InputError(f"{given}: no such file; did you mean {close[0]!r}, which comes with swarmsim?")
    return path


def copy(name: str, folder: str | Path) -> list[Path]:
    """Copy something that ships with all files that it names, and return the copies: `swarmsim examples copy`.

    They are put into folders as here, and run there; what was asked for comes first. Raises InputError for an unknown
    name and for files that exist already.
    """
    path, home, done = example(name), root(), list[Path]()
    for one in [path, *(path.parent.iterdir() if kind_of(path) == "papers" else ())]:
        _copied(one, home, Path(folder), done)
    return done


def _copied(path: Path, home: Path, folder: Path, done: list[Path]) -> list[Path]:
    place = folder / path.relative_to(home)
    if place in done:
        return done
    if place.exists() and place.read_bytes() != path.read_bytes():
        raise InputError(f"{place}: exists already, and is another file; expected a folder without it")
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, place)
    except OSError as problem:
        raise unwritten(place, problem, "a place for files") from problem
    done.append(place)
    if path.suffix == ".toml":
        for text in re.findall(r'"([^"\n]+\.\w+)"', path.read_text(encoding="utf-8")):
            other = (path.parent / text).resolve()
            if other.is_file() and other.is_relative_to(home.resolve()):
                _copied(home / other.relative_to(home.resolve()), home, folder, done)
    return done


def _title(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".svg":
        named = re.search("<title>(.*?)</title>", text)
        return html.unescape(named[1]) if named else path.stem
    table = tomllib.loads(text)
    if "cite" in table:
        return f"{table['cite']}: {table['title']}"
    if isinstance(groups := table.get("robots"), list):
        table["robots"] = {"count": sum(group["count"] for group in groups)}

    def value(match: re.Match[str]) -> str:
        found: object = table
        for key in match[1].split("."):
            found = found[key] if isinstance(found, dict) and key in found else match[0]
        return str(found)

    return re.sub(r"\{([\w.]+)\}", value, str(table.get("title", path.stem)))
