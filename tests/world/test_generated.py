"""Buildings that are made: whole, different for every seed, and such that swarms can finish them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import ndimage

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import decode
from swarmsim.engine.build import build
from swarmsim.engine.inspection import inspect
from swarmsim.world.source import floor_plan, read_world

KINDS = ("rooms", "office", "maze", "cave", "obstacles")


def scenario(kind: str, seed: int, **keys: object):
    world = {"generate": {"use": kind, **keys}, "seed": seed}
    table = {"world": world, "robots": {"count": 4}, "network": {"topology": {"use": "full"}}}
    return decode(table, "made.toml")


@pytest.mark.parametrize("kind", KINDS)
def test_all_of_it_can_be_mapped_whatever_the_seed(kind: str) -> None:
    texts = set()
    for seed in range(12):
        made = scenario(kind, seed)
        run = build(made, "made.toml")
        assert run.explorable.sum() > 500
        texts.add(run.world)
        assert read_world(made.world, made.grid.cell) == run.world
    assert len(texts) == 12


@pytest.mark.parametrize("kind", KINDS)
def test_a_swarm_finishes_it(kind: str) -> None:
    sizes = {} if kind == "cave" else {"width": 6.15, "height": 6.15}
    simulation = build(scenario(kind, 5, **sizes), "made.toml").simulation
    assert simulation.run()


def test_sizes_are_those_asked_for() -> None:
    made = scenario("rooms", 3, width=9.0, height=6.0, door=0.9)
    plan = floor_plan(read_world(made.world, 0.15), made.world)
    assert plan.page == pytest.approx((0.0, 0.0, 9.0, 6.0))
    assert plan.walls.bounds == pytest.approx((0.0, 0.0, 9.0, 6.0))
    found = inspect(made, read_world(made.world, 0.15), "made.toml", 1.2)
    assert found.problem is None
    assert len(found.rooms) > 3
    assert [door.width for door in found.doors] == pytest.approx([0.9] * len(found.doors), abs=0.01)
    assert len(found.doors) >= len(found.rooms) - 1


def test_obstacles_fill_the_share_that_was_asked_for_and_leave_the_start_free() -> None:
    for seed in range(8):
        run = build(scenario("obstacles", seed, width=6.3, height=6.3, block=0.3, filled=0.3), "made.toml")
        low, left = (round((0.15 - at) / 0.15) for at in (run.arena.lattice.y0, run.arena.lattice.x0))
        inside = run.arena.occupied[low : low + 40, left : left + 40]
        squares = inside.reshape(20, 2, 20, 2).all(axis=(1, 3))
        assert (squares == inside.reshape(20, 2, 20, 2).any(axis=(1, 3))).all()  # whole squares alone
        assert not squares[:2, :2].any()
        assert 0.29 <= squares.mean() <= 0.37  # at most a tenth of what is free is filled besides
        assert (run.context.start[:, :2] < 0.15 + 0.6).all()
        assert ndimage.label(~squares)[1] == 1  # all floor hangs together
        assert run.reachable.any()


def test_a_maze_without_loops_is_a_tree() -> None:
    made = scenario("maze", 8, loops=0.0)
    run = build(made, "made.toml")
    free = ~run.arena.occupied
    passages = json.loads(run.world)["bbox"][2] / 0.75
    assert passages == pytest.approx(12.2, abs=0.1)
    # A tree of squares of 4 x 4 cells, joined by openings of 1 x 4: an opening less than there are squares.
    inside = int(run.explorable[free].sum())
    squares = 12 * 8
    assert inside == squares * 16 + (squares - 1) * 4


@pytest.mark.parametrize(
    ("kind", "keys", "message"),
    [
        ("rooms", {"door": 2.1}, "door: 2.1 m does not fit"),
        ("rooms", {"wall": 0.01}, "wall: 0.01 m is less than a cell"),
        ("rooms", {"width": 0.6}, "width: nothing but walls fits in"),
        ("office", {"height": 2.0}, "height: 2 m has no room"),
        ("maze", {"width": 1.0}, "width: fewer than two passages"),
        ("cave", {"filled": 0.6, "width": 1.5, "height": 1.5}, "filled: rock alone is left"),
        ("rooms", {"width": 1e9}, r"world\.generate\.width: expected `float` <= 1000"),
        ("obstacles", {"filled": 0.5}, "filled: 0.5 of all squares cut the hall into pieces"),
        ("obstacles", {"width": 0.9}, "width: fewer than two squares"),
        ("castle", {}, r"world\.generate\.use: no generator is called 'castle'"),
    ],
)
def test_what_cannot_be_made_is_refused(kind: str, keys: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build(scenario(kind, 1, **keys), "made.toml")


@pytest.mark.parametrize("pockets", ["ignore", "refuse"])
def test_doors_pockets_and_seats_are_found(pockets: str) -> None:
    made = decode(
        {
            "world": {"file": "tests/worlds/hand-written.svg", "pockets": pockets},
            "robots": {"count": 2, "radius": 0.2},
            "network": {"topology": {"use": "none"}},
        },
        "x.toml",
    )
    text = (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 6"><g id="walls"><path fill-rule="evenodd" '
        'd="M0 0H9V6H0ZM.3 .3V5.7H8.7V.3ZM4.2 .3H4.5V2.4H4.2ZM4.2 3H4.5V5.7H4.2ZM7.5 4.5H8.7V4.65H7.65V5.7H7.5Z"/>'
        "</g></svg>"
    )
    found = inspect(made, text, "x.toml", 1.5)
    assert [(round(door.width, 2), np.round(door.place, 1).tolist()) for door in found.doors] == [(0.6, [4.3, 3.2])]
    if pockets == "refuse":
        assert found.problem is not None
        assert "has no way to spawn area" in found.problem
    else:
        assert found.problem is None
        assert any("1 pocket of 1.10 m2 at (8.18 m, 0.82 m) cannot be entered" in notice for notice in found.notices)
    assert found.pockets[0].cells > 20
