"""The scenarios and worlds that come with swarmsim, in a checkout or an installed package."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path

from swarmsim.core.errors import InputError, unwritten


def root() -> Path:
    """The folder that holds `scenarios` and `worlds`. Raises InputError if they are not installed."""
    package = Path(__file__).parents[2]
    for folder in (package.parent, package):  # a checkout, or an installed package
        if (folder / "scenarios" / "basilica.toml").is_file():
            return folder
    raise InputError(f"{package}: the folder scenarios is missing; install swarmsim again")


def examples() -> dict[str, str]:
    """The title of every shipped scenario, by its name, as in `basilica` and `faults/blind`: `swarmsim examples`.

    Raises InputError if they are not installed.
    """
    home = root() / "scenarios"
    paths = sorted(
        path for path in home.rglob("*.toml") if not {"studies", "benchmarks"} & {*path.relative_to(home).parts}
    )
    titled = {path.relative_to(home).with_suffix("").as_posix(): _title(path) for path in paths}
    return dict(sorted(titled.items(), key=lambda pair: (pair[0].count("/"), pair[0])))


def example(name: str) -> Path:
    """The file of a shipped scenario, for `run`: `swarmsim examples run`.

    Raises InputError for a name not in `examples`.
    """
    known = examples()
    if name not in known:
        close = [one for one in known if one.rpartition("/")[2] == name.rpartition("/")[2]]
        hint = f"did you mean {close[0]!r}?" if close else "list them with: swarmsim examples"
        raise InputError(f"{name}: no such example; {hint}")
    return root() / "scenarios" / f"{name}.toml"


def copy(name: str, folder: str | Path) -> list[Path]:
    """Copy a shipped scenario with all files that it names, and return the copies: `swarmsim examples copy`.

    They are put into `scenarios` and `worlds` of the folder, as here, and run there; the scenario comes first. Raises
    InputError for an unknown name and for files that exist already.
    """
    return _copied(example(name), root(), Path(folder), [])


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
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    if isinstance(groups := table["robots"], list):
        table["robots"] = {"count": sum(group["count"] for group in groups)}

    def value(match: re.Match[str]) -> str:
        found: object = table
        for key in match[1].split("."):
            found = found[key] if isinstance(found, dict) and key in found else match[0]
        return str(found)

    return re.sub(r"\{([\w.]+)\}", value, str(table.get("title", path.stem)))
