"""Scenarios of any parts with any valid keys, held to oracles that share no code with the package; and spoilt ones."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from generated.mutants import mutant
from generated.scenarios import scenario
from generated.trials import survives, tried, tried_all

from swarmsim.core.scenario import registry
from swarmsim.core.seams import SEAMS

FEW, SCENARIOS, BATCH = 75, 300, 25
MANY, LARGE_BATCH = 10_000, 500


@pytest.mark.parametrize("first", range(0, FEW, BATCH))
def test_any_scenario_keeps_to_walls_letters_and_counts(first: int, tmp_path: Path) -> None:
    tried_all(range(first, first + BATCH), tmp_path)


@pytest.mark.thorough
@pytest.mark.parametrize("first", range(FEW, SCENARIOS, BATCH))
def test_any_of_some_hundred_scenarios_keeps_to_walls_letters_and_counts(first: int, tmp_path: Path) -> None:
    tried_all(range(first, first + BATCH), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(SCENARIOS, SCENARIOS + MANY, LARGE_BATCH))
def test_any_of_ten_thousand_scenarios_keeps_to_walls_letters_and_counts(first: int, tmp_path: Path) -> None:
    print(first, dict(tried_all(range(first, first + LARGE_BATCH), tmp_path)))


@pytest.mark.parametrize("first", range(0, SCENARIOS, 75))
def test_a_damaged_scenario_is_read_or_refused_in_a_sentence_that_names_file_and_key(
    first: int, tmp_path: Path
) -> None:
    told = [survives(mutant(scenario(number), 0), scenario(number), tmp_path) for number in range(first, first + 75)]
    assert sum(map(bool, told)) > 37


@pytest.mark.slow
@pytest.mark.parametrize("salt", range(1, 21))
def test_twenty_damages_of_each_scenario_are_read_or_refused_in_a_sentence(salt: int, tmp_path: Path) -> None:
    for number in range(SCENARIOS):
        survives(mutant(scenario(number), salt), scenario(number), tmp_path)


#: A key that names places in the walls of one plan.
PLACED = {"advection-diffusion": {"vents"}}


def test_every_part_of_every_seam_takes_part_and_every_key_of_it() -> None:
    drawn: defaultdict[tuple[str, str], set[str]] = defaultdict(set)
    for number in range(4000):
        for seam, table in tables_of(scenario(number).table):
            drawn[seam, table.get("use", SEAMS[seam].default)] |= table.keys()
    for seam in SEAMS.keys() - {"layer", "figure", "transport", "adapter"}:  # which change nothing in a run
        for use, kind in registry.known(seam).items():
            if use == "conjugate-gradients":
                continue  # always refused, with the reason
            assert (seam, use) in drawn, f"no scenario has the {seam} {use}"
            lacking = set(kind.__struct_fields__) - drawn[seam, use] - PLACED.get(use, set())
            assert not lacking, f"no scenario says {sorted(lacking)} of the {seam} {use}"


def tables_of(table: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The tables of parts in a scenario, each with its seam."""
    world, mind, robots = table["world"], table["mind"], table["robots"]
    if "generate" in world:
        yield "generator", world["generate"]
    for seam in ("physics", "sensor", "field", "localisation", "motion", "kinematics", "task"):
        if seam in table:
            yield seam, table[seam]
    for group in robots if isinstance(robots, list) else []:
        yield from ((seam, group[seam]) for seam in ("sensor", "kinematics") if seam in group)
        yield from (group.get("mind") or {}).items()
    yield from (("computation", mind["computation"]), ("strategy", mind["strategy"]))
    if "drive" in mind["strategy"]:
        yield "strategy", mind["strategy"]["drive"]
    if "sharing" in mind["computation"]:
        yield "sharing", mind["computation"]["sharing"]
    yield "topology", table["network"]["topology"]
    channel = table["network"]["channel"]
    while channel:
        yield "channel", channel
        channel = channel.get("over")
    yield from (("fault", fault) for fault in table.get("faults", []))
    yield from (("sensor", sensor) for sensor in table.get("sensors", []))
    yield from (("probe", probe) for probe in table.get("probes", []))
    yield from (("actuator", actuator) for actuator in table.get("actuators", []))
    yield from (("job", job) for job in table.get("jobs", []))
    for solved in (table.get("field", {}), *table.get("jobs", [])):
        yield from ((seam, solved[seam]) for seam in ("model", "method") if seam in solved)


def test_a_failure_tells_a_scenario_file_that_shows_it_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(self: Any, moment: Any) -> None:
        raise AssertionError

    monkeypatch.setattr("generated.letters.Ledger.check", fails)
    whole = scenario(7)
    with pytest.raises(AssertionError) as caught:
        tried(whole, tmp_path)
    assert whole.text in caught.value.__notes__[0]
    assert scenario(7) == whole
