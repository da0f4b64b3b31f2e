"""pymunk's insides: a version whose insides differ is refused before a kernel calls them by address."""

from __future__ import annotations

import pytest
from conftest import ROOT, called
from pymunk import batch

from swarmsim.core.errors import InputError
from swarmsim.robots import batched


@pytest.fixture(autouse=True)
def anew() -> None:
    """Nothing is checked yet."""
    batched.check.cache_clear()


def test_the_installed_pymunk_passes() -> None:
    batched.check()


def refused() -> str:
    with pytest.raises(InputError) as told:
        batched.check()
    assert "install one that swarmsim knows: pip install 'pymunk>=7,<8'" in str(told.value)
    return str(told.value)


def test_a_function_of_another_type_or_none_at_all_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(batched.FUNCTIONS, "cpSpaceStep", "void(*)(struct cpSpace *, float)")
    assert "cpSpaceStep is declared in another way" in refused()
    monkeypatch.setitem(batched.FUNCTIONS, "cpSpaceLeap", batched.VISIT)
    assert "it lacks what the physics calls by address" in refused()


def test_a_struct_whose_fields_moved_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    moved = (("num", "int", 0), ("arr", "double *", 8), ("max", "int", 16))
    monkeypatch.setitem(batched.STRUCTS, "struct pmFloatArray", moved)
    assert "struct pmFloatArray is declared in another way" in refused()


@pytest.mark.parametrize(
    ("call", "told"),
    [("get_space_bodies", "reads bodies in another order"), ("set_space_bodies", "writes forces in another order")],
)
def test_batch_calls_that_do_something_else_are_refused(monkeypatch: pytest.MonkeyPatch, call: str, told: str) -> None:
    honest = getattr(batch, call)

    def fewer(space, fields, buffer):
        left = batch.BodyFields.ANGLE if call == "get_space_bodies" else batch.BodyFields.TORQUE
        honest(space, fields & ~left, buffer)

    monkeypatch.setattr(batch, call, fewer)
    assert told in refused()


def test_a_run_with_such_a_pymunk_ends_with_the_message(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setitem(batched.FUNCTIONS, "cpSpaceStep", "int")
    ended = called("run", ROOT / "scenarios" / "room.toml", cwd=tmp_path)
    assert ended.returncode == 2
    assert "cpSpaceStep is declared in another way" in ended.stderr
