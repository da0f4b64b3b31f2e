from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, made

from swarmsim.core.errors import InputError
from swarmsim.core.events import Ended
from swarmsim.core.scenario import registry
from swarmsim.core.state import Moment
from swarmsim.recording.digests import Digests


def digest(*overrides: str, scenario: str = "room") -> str:
    digests = Digests()
    made(*overrides, scenario=scenario).simulation.run([digests])
    return digests.total()


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others() -> None:
    first = digest("seed=5")
    assert digest("seed=5") == first
    assert digest("seed=6") != first


def test_another_process_gives_the_same_bytes() -> None:
    code = "from test_simulation import digest; print(digest('stop.iterations=60', scenario='basilica'))"
    command = [sys.executable, "-c", code]
    path = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "tests"), str(Path(__file__).parent)])}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=path)
    assert done.stdout.strip() == digest("stop.iterations=60", scenario="basilica")


def test_one_more_robot_moves_none_of_the_others_at_the_start() -> None:
    few = made("robots.count=10", scenario="basilica").simulation.state.pose
    many = made("robots.count=11", scenario="basilica").simulation.state.pose
    np.testing.assert_array_equal(many[:10], few)


@pytest.mark.parametrize("use", sorted(registry.known("topology")))
def test_every_topology_maps_the_room(use: str) -> None:
    needed = {
        "knn": "k=2", "k-random": "k=2", "farthest-k": "k=2", "small-world": "k=2, p=0.1", "random": "p=0.3",
        "radius": "radius=1.0", "edges": "links=[[0, 1], [1, 0]]",
    }  # fmt: skip
    table = ", ".join([f'use="{use}"', *([needed[use]] if use in needed else [])])
    simulation = made(f"network.topology={{{table}}}").simulation
    assert simulation.run()
    assert simulation.state.iteration < 500


def test_a_run_ends_at_its_limit_and_says_so() -> None:
    moments: list[Moment] = []

    class Keep:
        def sample(self, moment: Moment) -> None:
            moments.append(moment)

    simulation = made("stop.iterations=4").simulation
    assert not simulation.run([Keep()])
    assert simulation.state.iteration == len(moments) == 4
    assert [event for moment in moments for event in moment.events] == [Ended(3, False)]


def test_a_run_may_stop_at_less_than_everything() -> None:
    simulation = made("task.share=0.6").simulation
    whole = made().simulation
    assert simulation.run()
    assert whole.run()
    assert simulation.state.iteration < whole.state.iteration


def test_switches_of_the_model_change_the_run() -> None:
    plain = digest("seed=2")
    for change in (
        'mind.strategy.replan="every-iteration"',
        'mind.strategy.ties="row-order"',
        "mind.strategy.neighbours=4",
        "period=0.5",
        "robots.speed=0.1",
    ):
        assert digest("seed=2", change) != plain, change


def test_robots_that_stop_each_others_beams_map_less() -> None:
    cut = "stop.iterations=1"
    seen = made(cut, scenario="basilica").simulation
    hidden = made(cut, 'sensor.robots="occlude"', scenario="basilica").simulation
    seen.run()
    hidden.run()
    assert hidden.parts.computation.maps.observed.sum() < seen.parts.computation.maps.observed.sum()


def test_wide_robots_finish_a_world_that_lets_them_through() -> None:
    simulation = made("robots.radius=0.14", "robots.count=2", "network.topology.k=1").simulation
    assert simulation.run(), simulation.state


def test_a_room_too_full_of_robots_is_refused_with_the_number_it_holds() -> None:
    with pytest.raises(InputError, match=r"holds \d+ robots"):
        made("robots.count=5000", "network.topology.k=1")


def test_nobody_ever_starts_inside_another_robot_or_a_wall() -> None:
    run = made("robots.count=40", "robots.radius=0.1", scenario="basilica")
    pose = run.simulation.state.pose[:, :2]
    apart = np.hypot(*(pose[:, None] - pose[None]).transpose(2, 0, 1)) + 9.0 * np.eye(40)
    assert apart.min() >= 0.2 - 1e-9
    cells = run.arena.lattice.cells(pose)
    assert not run.arena.occupied[cells[:, 0], cells[:, 1]].any()


def test_a_body_may_end_in_a_room_that_only_cells_cannot_get_to(tmp_path: Path) -> None:
    (tmp_path / "rooms.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="4m" height="2m" viewBox="0 0 4 2"><path fill-rule="evenodd" '
        'd="M0,0H4V2H0Z M0.15,0.15H1.95V1.85H0.15Z M1.95,0.97H2.1V1.14H1.95Z M2.1,0.15H3.85V1.85H2.1Z"/>'
        '<rect class="spawn" id="room" x="0.3" y="0.3" width="1.2" height="1.2"/></svg>'
    )
    run = made(
        f'world={{file="{tmp_path / "rooms.svg"}", pockets="ignore"}}',
        "robots.count=2",
        "network.topology.k=1",
        "stop.iterations=2",
    )
    assert any("too coarse for the passage" in notice for notice in run.notices)
    bodies = run.simulation.parts.bodies
    bodies.crash(np.array([0]))
    bodies.place(np.array([0]), np.array([[3.0, 1.0, 0.0]]))
    run.simulate()
    assert run.astray() == []


def test_a_run_in_which_a_body_ends_in_or_beyond_a_wall_is_no_result() -> None:
    for place in ((0.05, 0.05), (-3.0, 1.0), (2.0, 3.85)):
        run = made("stop.iterations=3")
        assert run.astray() == []
        run.simulation.tick()
        bodies = run.simulation.parts.bodies
        bodies.crash(np.array([1]))
        bodies.place(np.array([1]), np.array([[*place, 0.0]]))
        with pytest.raises(InputError, match=r"physics\.substep: robot 1 ended in or beyond a wall"):
            run.simulate()
    assert made("stop.iterations=300").simulate()


def test_what_parts_find_out_of_each_other_while_they_run_names_the_scenario_file() -> None:
    run = made()
    step = run.simulation.parts.strategy.step

    def asking(senses, inbox, knowledge):
        assert senses.readings["ranges"] is not None
        return step(senses, inbox, knowledge)

    run.simulation.parts.strategy.step = asking
    with pytest.raises(InputError, match=r"room\.toml: these robots have no channel 'ranges'; they have tiles"):
        run.simulation.run()
