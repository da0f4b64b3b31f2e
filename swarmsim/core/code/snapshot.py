"""The user's code as its files stand at one moment, and the modules made from it.

A part is named by its file or its module. Its imports are looked for beside that file first, as in a Python script,
whatever the name: with a `random.py` there, `import random` means that file, but only for the code beside it.
Then come installed modules. Only `swarmsim` is always this package, and a file that imports its own name means the
other module of that name. `from . import sibling` works too. `sys.path` is left alone: two folders that both have a
`helper.py` have two modules.
"""

from __future__ import annotations

import builtins
import hashlib
import importlib
import linecache
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import lru_cache
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import decode_source, spec_from_file_location
from pathlib import Path
from threading import RLock
from types import CodeType, ModuleType
from typing import Final
from weakref import WeakKeyDictionary

from swarmsim.core.code import statements
from swarmsim.core.code.distributions import home_of

PREFIX: Final = "swarmsim_own_"  # of the packages that stand for the user's folders
_PACKAGE: Final = "__init__.py"
_LOCK: Final = RLock()  # workers of Dask's may have several threads


@dataclass(frozen=True, slots=True)
class Files:
    """Texts of code that can be sent to and run in other processes."""

    base: str = ""  # the folder that relative paths are resolved from
    texts: tuple[tuple[str, bytes], ...] = ()  # by absolute path, sorted


class Snapshot:
    """The user's code at one moment; each file is read once, when code that may import it is first loaded."""

    def __init__(self, given: Files | None = None) -> None:
        """`given` texts replace files."""
        #: The folder that relative paths are resolved from.
        self.base = Path.cwd() if given is None else Path(given.base)
        self._texts = {} if given is None else {Path(file): text for file, text in given.texts}
        self._given = tuple(self._texts)
        self._folders: dict[str, Path] = {}  # by the package that stands for it
        self._named: dict[str, Path] = {}  # files whose names are no module names, by module
        self._homes: dict[tuple[str, str], str | None] = {}  # the package for a top-level name that a module imports
        self._entries: set[str] = set()
        self._builtins = {**vars(builtins), "__import__": self._import}
        #: Its modules by name, while another snapshot's are in `sys.modules`.
        self.modules: dict[str, ModuleType] = {}

    def load(self, place: str) -> ModuleType:
        """The module that `place`, the path of a .py file or a module's name, stands for.

        Raises what its code raises, and FileNotFoundError.
        """
        with _LOCK:
            _shelf().activate(self)
            name = self.name_of(place)
            if name is None:
                return importlib.import_module(place)
            self._entries.add(name)
            self._reached([name])  # all texts are read before any of them runs
            return importlib.import_module(name)

    def name_of(self, place: str) -> str | None:
        """The name of the module that `place` stands for; None for an installed one. Raises FileNotFoundError."""
        if not place.endswith(".py"):
            folder = self._folder_of(place.partition(".")[0])
            return None if folder is None else f"{self._package(folder)}.{place}"
        file = Path(os.path.normpath(self.base / place))
        if not self._has(file):
            raise FileNotFoundError(f"no file {place}")
        folder, names = file.parent, [] if file.name == _PACKAGE else [file.stem.replace(".", "_")]
        while self._has(folder / _PACKAGE) and folder.name.isidentifier():
            names.insert(0, folder.name)
            folder = folder.parent
        name = ".".join((self._package(folder), *names))
        if "." in file.stem:
            self._named[name] = file
        return name

    def makes(self, kind: type) -> None:
        """Note that a class comes from this snapshot."""
        _shelf().made[kind] = self

    def texts(self, places: Iterable[str]) -> dict[Path, bytes]:
        """The texts of all files that these places need, including those that code loaded by name."""
        named = [self.name_of(place) for place in places]
        found = self._reached(name for name in named if name is not None)
        if found:
            modules = _own_modules() if _shelf().active is self else self.modules
            origins = [module.__spec__.origin for module in modules.values() if module.__spec__ is not None]
            loaded = {Path(origin) for origin in origins if origin is not None} & self._texts.keys()
            found |= {file: self._texts[file] for file in loaded - self._reached(self._entries).keys()}
        return found

    def short(self, file: Path) -> str:
        """A file's path relative to the folder where its imports start."""
        homes = [folder for folder in self._folders.values() if file.is_relative_to(folder)]
        return file.relative_to(max(homes, key=lambda home: len(home.parts), default=file.parent)).as_posix()

    def is_current(self) -> bool:
        """Whether all files are still as they were read, and none has appeared."""
        if self.base != Path.cwd() or any(_content(file) != text for file, text in self._texts.items()):
            return False
        outside = [(importer, top) for (importer, top), home in self._homes.items() if home is None]
        return not any(self._is_beside(importer, top) for importer, top in outside)

    def spec(self, name: str) -> ModuleSpec | None:
        """How Python loads a user module; None without a file for it."""
        file, folder = self._file(name), self._place(name)
        if folder is None:
            return None
        if file is not None:
            inner = [str(folder)] if file.name == _PACKAGE else None
            loader = _Loader(name, file, self)
            return spec_from_file_location(name, file, loader=loader, submodule_search_locations=inner)
        if not folder.is_dir() and not any(text.is_relative_to(folder) for text in self._given):
            return None
        found = ModuleSpec(name, None, is_package=True)
        found.submodule_search_locations = [str(folder)]
        return found

    def text(self, file: Path) -> bytes:
        """The text of a file that is loaded."""
        return self._texts[file]

    def run(self, code: CodeType, module: ModuleType) -> None:
        """Run a module's code, with imports that find what is beside it."""
        module.__dict__["__builtins__"] = self._builtins
        exec(code, module.__dict__)

    def _import(
        self,
        name: str,
        globals: Mapping[str, object] | None = None,  # noqa: A002 - Python's own names
        locals: Mapping[str, object] | None = None,  # noqa: A002
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        """`import` for the user's code."""
        with _LOCK:
            _shelf().activate(self)
            top = name.partition(".")[0]
            home = None if level or globals is None else self._home(str(globals.get("__name__")), top)
            if home is None:
                return builtins.__import__(name, globals, locals, fromlist or (), level)
            found = builtins.__import__(f"{home}.{name}", globals, locals, fromlist or (), 0)
            return found if fromlist else sys.modules[f"{home}.{top}"]

    def _home(self, importer: str, top: str) -> str | None:
        """The user package of a name that `importer` imports; None if it is installed."""
        if (importer, top) not in self._homes:
            self._homes[importer, top] = self._found(importer, top)
        return self._homes[importer, top]

    def _found(self, importer: str, top: str) -> str | None:
        package = importer.partition(".")[0]
        if top == "swarmsim" or package not in self._folders:
            return None
        if self._is_beside(importer, top):
            return package
        folder = self._folder_of(top)
        if folder is not None:
            return None if importer == f"{self._package(folder)}.{top}" else self._package(folder)
        if top in sys.modules or home_of(top).installed:
            return None
        inner = importer.rpartition(".")[0]
        if self._file(f"{inner}.{top}") is not None:  # a script inside a package may import what is beside it
            return inner
        return package if (self._folders[package] / top).is_dir() else None

    def _is_beside(self, importer: str, top: str) -> bool:
        """Whether the folder where imports start has a file of this name, other than the importing one."""
        name = f"{importer.partition('.')[0]}.{top}"
        file = None if top == "swarmsim" else self._file(name)
        return file is not None and (importer != name or file.name == _PACKAGE)

    def _folder_of(self, top: str) -> Path | None:
        """The folder of a module that is not installed: of the given files, or where Python finds it."""
        home = home_of(top)
        if home.installed:
            return None
        for file in self._given:
            if file.name == f"{top}.py":
                return file.parent
            if file.name == _PACKAGE and file.parent.name == top:
                return file.parent.parent
        return home.folder

    def _package(self, folder: Path) -> str:
        """The name of the package that stands for a folder; the same in every process, as numba's caches need."""
        name = PREFIX + hashlib.blake2b(str(folder).encode(), digest_size=6).hexdigest()
        self._folders[name] = folder
        return name

    def _place(self, name: str) -> Path | None:
        """The path of a module's file or folder, without suffix; None for an unknown package."""
        package, *rest = name.split(".")
        return self._folders[package].joinpath(*rest) if package in self._folders else None

    def _file(self, name: str) -> Path | None:
        """The file of a user module, which is read; None for folders and missing files."""
        place = self._place(name)
        if name in self._named or place is None or "." not in name:
            return self._named.get(name)
        both = (place / _PACKAGE, place.with_name(f"{place.name}.py"))
        return next((file for file in both if self._has(file)), None)

    def _has(self, file: Path) -> bool:
        if file not in self._texts:
            found = _content(file)
            if found is None:
                return False
            self._texts[file] = found
        return True

    def _reached(self, names: Iterable[str]) -> dict[Path, bytes]:
        """The texts of these user modules, and of all that their import statements may load."""
        found: dict[Path, bytes] = {}
        waiting = list(names)
        while waiting:
            words = waiting.pop().split(".")
            for end in range(1, len(words) + 1):
                name = ".".join(words[:end])
                file = self._file(name)
                if file is not None and file not in found:
                    found[file] = self._texts[file]
                    waiting.extend(self._imported(name, file))
        return found

    def _imported(self, name: str, file: Path) -> Iterator[str]:
        """The user modules that a file's import statements name, anywhere in it."""
        package = name if file.name == _PACKAGE else name.rpartition(".")[0]
        for module in statements.imported(self._texts[file], package):
            home = None if module.startswith(PREFIX) else self._home(name, module.partition(".")[0])
            yield module if home is None else f"{home}.{module}"


class _Loader(SourceFileLoader):
    """Runs a file's text as a snapshot has it."""

    def __init__(self, name: str, file: Path, snapshot: Snapshot) -> None:
        super().__init__(name, str(file))
        self._file, self._snapshot = file, snapshot

    def get_source(self, fullname: str) -> str:
        return decode_source(self._snapshot.text(self._file))

    def get_code(self, fullname: str) -> CodeType:
        code: CodeType = compile(self._snapshot.text(self._file), self.path, "exec", dont_inherit=True)
        return code

    def exec_module(self, module: ModuleType) -> None:
        code, text = self.get_code(module.__name__), self.get_source(module.__name__)
        # Tracebacks show the lines that ran, even if the file has changed; an entry without a time is not read again.
        linecache.cache[self.path] = (len(text), None, text.splitlines(keepends=True), self.path)
        self._snapshot.run(code, module)


class _Finder:
    """Finds the modules of the active snapshot, and no others."""

    def __init__(self, shelf: _Shelf) -> None:
        self._shelf = shelf

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """How a module is loaded, or None."""
        return self._shelf.active.spec(name) if name.startswith(PREFIX) else None


class _Shelf:
    """The latest snapshot of this process, and the one whose modules are in `sys.modules`."""

    def __init__(self) -> None:
        self.latest = self.active = Snapshot()
        #: The snapshot that each part's class comes from.
        self.made: WeakKeyDictionary[type, Snapshot] = WeakKeyDictionary()
        sys.meta_path.insert(0, _Finder(self))

    def activate(self, snapshot: Snapshot) -> None:
        """Replace another snapshot's modules by this one's."""
        if self.active is not snapshot:
            self.active.modules = _own_modules()
            for name in self.active.modules:
                del sys.modules[name]
            sys.modules.update(snapshot.modules)
            self.active = snapshot


@lru_cache(maxsize=1)
def _shelf() -> _Shelf:
    return _Shelf()


def _own_modules() -> dict[str, ModuleType]:
    return {name: module for name, module in list(sys.modules.items()) if name.startswith(PREFIX)}


def _content(file: Path) -> bytes | None:
    try:
        return file.read_bytes()
    except (OSError, ValueError):
        return None


_GIVEN: ContextVar[Files | None] = ContextVar("given files", default=None)


@contextmanager
def given(files: Files) -> Iterator[None]:
    """Within this context, these texts are the user's code, whatever the files hold now."""
    token = _GIVEN.set(files)
    try:
        yield
    finally:
        _GIVEN.reset(token)


def present() -> Snapshot:
    """The user's code as it stands now or, in a context of `given`, as it was given."""
    files = _GIVEN.get()
    with _LOCK:
        if files is not None:
            return _of(files)
        shelf = _shelf()
        if not shelf.latest.is_current():
            shelf.latest = Snapshot()
        return shelf.latest


def home_of_class(kind: type) -> Snapshot:
    """The code behind a part's class."""
    return _shelf().made[kind]


@lru_cache(maxsize=8)
def _of(files: Files) -> Snapshot:
    return Snapshot(files)
