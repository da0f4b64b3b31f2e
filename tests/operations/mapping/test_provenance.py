"""Age and origin of what robots know, against a dictionary for each robot that follows every message."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import called, made

from swarmsim.core.state import UNKNOWN, Moment
from swarmsim.operations.mapping.measures.provenance import MapProvenance


class Followed:
    """The same, slowly: for each robot a dictionary from cells to when, by whom, and over how many links."""

    def __init__(self, robots: int, shape: tuple[int, int]) -> None:
        self.maps: list[dict[tuple[int, int], tuple[int, int, int]]] = [{} for _ in range(robots)]
        self.shape = shape

    def sample(self, moment: Moment) -> None:
        before = [dict(one) for one in self.maps]
        now, accepted = moment.state.iteration + 1, moment.knowledge.accepted
        items = accepted.content
        hops = getattr(items, "hops", np.ones(len(accepted), int))
        for m in range(len(accepted)):
            i, sender = int(accepted.receivers[m]), int(accepted.senders[m])
            if items.sources[m] < 0:
                for cell in self.cells(items.values[m], items.origins[m]):
                    if cell not in self.maps[i] and cell in before[sender]:
                        when, by, links = before[sender][cell]
                        self.maps[i][cell] = (when, by, links + 1)
        for i in np.flatnonzero(moment.state.alive).tolist():
            for cell in self.cells(moment.readings.tiles.values[i], moment.readings.tiles.origins[i]):
                self.maps[i][cell] = (now, i, 0)
        for m in range(len(accepted)):
            if items.sources[m] >= 0:
                reading = (int(items.sensed[m]) + 1, int(items.sources[m]), int(hops[m]))
                for cell in self.cells(items.values[m], items.origins[m]):
                    known = self.maps[int(accepted.receivers[m])].get(cell, (0, -1, 0))
                    if (known[0], -known[2]) < (reading[0], -reading[2]):
                        self.maps[int(accepted.receivers[m])][cell] = reading

    def cells(self, tile: np.ndarray, corner: np.ndarray) -> list[tuple[int, int]]:
        places = np.argwhere(tile != UNKNOWN) + corner
        return [tuple(p) for p in places.tolist() if 0 <= p[0] < self.shape[0] and 0 <= p[1] < self.shape[1]]


@pytest.mark.parametrize(
    "share",
    [
        '{use="current-tile"}',
        '{use="relay", hops=3}',
        '{use="gossip"}',
        '{use="gossip", goals=true}',
        '{use="map"}',
        '{use="tile-and-goal"}',
    ],
)
def test_every_reading_is_followed_to_every_map(share: str) -> None:
    run = made(
        f"mind.computation.sharing={share}", "robots.count=6", 'network.topology={use="knn", k=2}',
        'faults=[{use="crash", at=9, count=1}]', "stop.iterations=40", 'stop.when_done="continue"',
    )  # fmt: skip
    lattice = run.context.lattice
    probe, followed = MapProvenance(6, lattice), Followed(6, lattice.shape)
    run.simulation.run([probe, followed])
    for robot, wanted in enumerate(followed.maps):
        found = {
            cell: (int(probe.origins.sensed[robot][cell]), int(probe.origins.by[robot][cell]),
                   int(probe.origins.hops[robot][cell]))
            for cell in map(tuple, np.argwhere(probe.origins.sensed[robot] > 0).tolist())
        }  # fmt: skip
        assert found == wanted
        assert probe.origins.cells[robot] == len(wanted)
        assert probe.origins.total[robot] == sum(when for when, _, _ in wanted.values())
        assert probe.origins.links[robot] == sum(links for _, _, links in wanted.values())
        assert probe.origins.heard[robot] == sum(by != robot for _, by, _ in wanted.values())
        ages = probe.age(robot)
        assert np.nanmean(ages) == pytest.approx(np.mean([40 - when for when, _, _ in wanted.values()]))
    told = probe.summary()
    assert told["information_hops"] == pytest.approx(probe.origins.links.sum() / probe.origins.cells.sum())
    assert 0.0 < told["information_heard"] < 1.0
    assert np.isnan(probe.ages[-1]).sum() == 1  # the dead know nothing of age
    assert told["information_age_end"] == pytest.approx(np.nanmean(probe.ages[-1]))


def test_alone_everything_is_ones_own() -> None:
    run = made('network.topology={use="none"}', "stop.iterations=20")
    probe = MapProvenance(3, run.context.lattice)
    run.simulation.run([probe])
    assert probe.summary()["information_hops"] == 0.0
    assert probe.summary()["information_heard"] == 0.0


def test_it_is_a_measure_of_studies_where_the_task_asks_for_it() -> None:
    names = {"information_age", "information_age_end", "information_hops", "information_heard"}
    for asked in ("true", "false"):
        run = made(f"task.provenance={asked}", "stop.iterations=5")
        summaries = run.simulation.parts.task.summaries()
        run.simulation.run(summaries)
        found = {name for one in summaries for name in one.summary()}
        assert (names <= found) is (asked == "true")


def test_it_is_drawn_from_a_recording(room: Path, tmp_path: Path) -> None:
    done = called("figure", "provenance", room, "--robot", 1, "--at", 30, "--out", tmp_path / "figure")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "figure.png").stat().st_size > 20_000
    assert called("figure", "provenance", room, "--robot", 7).returncode == 2
