"""Where compiled kernels are kept when neither the package's folder nor the home can be written."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

#: Permissions do not bind root, so numba is told that its two places cannot be written; that the system says so, as in
#: a container, is the same OSError from the same call.
CODE = """
import sys, tempfile
from numba.core import caching
real = caching._CacheLocator.ensure_cache_path
def refusing(self):
    if not self.get_cache_path().startswith(tempfile.gettempdir()):
        raise OSError(30, "Read-only file system")
    real(self)
caching._CacheLocator.ensure_cache_path = refusing
from swarmsim.cli import main
if __name__ == "__main__":
    main()
"""


def called(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    (folder / "main.py").write_text(CODE)
    (folder / "tmp").mkdir(exist_ok=True)
    environment = {**os.environ, "TMPDIR": str(folder / "tmp")}
    environment.pop("NUMBA_CACHE_DIR", None)
    return subprocess.run(
        [sys.executable, "main.py", *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.skipif(os.name != "posix", reason="users have numbers")
def test_kernels_are_kept_in_a_temporary_folder_where_no_other_can_be_written(tmp_path: Path) -> None:
    done = called(tmp_path, "world", "check", "nowhere.svg")
    assert "no such file" in done.stderr
    (kept,) = (tmp_path / "tmp").glob("swarmsim-kernels-*")
    assert kept.stat().st_mode & 0o077 == 0
    code = "import tempfile; from swarmsim.kernels.compiling import _own_folder; print(_own_folder())"
    environment = {**os.environ, "TMPDIR": str(tmp_path / "tmp")}
    kept.chmod(0o777)  # anybody could have put code in it
    found = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()
    assert Path(found) != kept
    assert Path(found).stat().st_mode & 0o077 == 0


@pytest.mark.slow
def test_a_read_only_install_runs_with_one_notice(tmp_path: Path) -> None:
    first = called(tmp_path, "examples", "run", "room", "--out", "first")
    assert first.returncode == 0, first.stderr
    assert first.stdout.count("notice: compiled kernels are kept in") == 1
    assert "Traceback" not in first.stderr
    second = called(tmp_path, "examples", "run", "room", "--out", "second")
    assert second.returncode == 0
    assert "compiled kernels" not in second.stdout
    assert "which is temporary" in called(tmp_path, "doctor").stdout.replace("\n", " ")


def test_a_machine_is_new_until_a_kernel_is_kept(tmp_path: Path) -> None:
    code = "from swarmsim.kernels import compiling; print(compiling.is_new())"

    def is_new() -> str:
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        return run.stdout.strip()

    assert is_new() == "True"
    one = "from swarmsim.kernels.checks import counts_hold; print(counts_hold._cache.cache_path)"
    folder = Path(
        subprocess.run(
            [sys.executable, "-c", one], env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}, capture_output=True,
            text=True, check=True,
        ).stdout.strip()
    )  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "kernel.nbi").touch()
    assert is_new() == "False"
