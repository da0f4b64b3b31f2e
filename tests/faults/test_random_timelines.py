"""Any few faults of any kinds at once, at random: nothing breaks, nobody is in a wall, and all counts add up."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from conftest import ROOT
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from test_fault_contract import RADIUS, Watch, deepest

from swarmsim.core import registry
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import Table, decode, load
from swarmsim.engine.build import Run, build

ITERATIONS = 30
OUT = {"removed", "crashed", "late", "battery empty"}  # events after which a robot is dead ...
BACK = {"returned", "repaired", "joined"}  # ... and after which it is alive

iterations = st.integers(1, 12)
metres = st.floats(-0.5, 0.5).map(lambda x: round(x, 3))
shares = st.floats(0.05, 0.95).map(lambda x: round(x, 2))


def some(*, needed: dict | None = None, **keys: st.SearchStrategy) -> st.SearchStrategy[Table]:
    """Tables with all `needed` keys and any of the others."""
    return st.fixed_dictionaries(needed or {}, optional=keys)


def merged(*tables: st.SearchStrategy[Table]) -> st.SearchStrategy[Table]:
    return st.tuples(*tables).map(lambda each: {key: value for table in each for key, value in table.items()})


@st.composite
def boxes(draw: st.DrawFn, most: float = 1.0) -> list[float]:
    """Boxes in the room: left, lower, right, upper in m."""
    left, low = draw(st.floats(0.2, 4.0)), draw(st.floats(0.2, 2.9))
    width, height = draw(st.floats(0.05, most)), draw(st.floats(0.05, most))
    return [round(edge, 2) for edge in (left, low, min(left + width, 4.9), min(low + height, 3.7))]


WHEN = (
    some(needed={"at": st.integers(0, 25)}, every=st.integers(1, 10), lasts=iterations),
    st.tuples(st.integers(0, 25), iterations).map(lambda pair: {"between": [pair[0], sum(pair)]}),
    some(needed={"progress": shares}, lasts=iterations),
    some(needed={"rate": st.sampled_from([0.05, 0.2, 1.0])}, lasts=iterations),
)
LIFE = some(
    needed={"life": some(needed={"mean": st.sampled_from([3.0, 12.0])}, shape=st.sampled_from([0.5, 3.0]))},
    lasts=iterations,
)
DUTY = some(duty=st.tuples(iterations, iterations).map(list))
OF_ALL = merged(st.one_of(WHEN), DUTY)
TIMED = merged(st.one_of(*WHEN, LIFE), DUTY)


def whom(robots: int) -> st.SearchStrategy[Table]:
    """Keys that say which robots, and how many."""
    ids = st.lists(st.integers(0, robots - 1), min_size=1, max_size=robots, unique=True)
    which = st.one_of(
        st.just({}),
        st.fixed_dictionaries({"robots": ids}),
        st.fixed_dictionaries({"region": boxes(4.0)}),
        st.just({"choose": "hub"}),
        st.fixed_dictionaries(
            {"choose": st.sampled_from(["nearest", "farthest"]), "point": st.sampled_from([[1.0, 1.0], [4.0, 3.0]])}
        ),
    )
    many = st.one_of(
        st.just({}), st.fixed_dictionaries({"count": st.integers(1, robots)}), st.fixed_dictionaries({"share": shares})
    )
    return merged(which, many, some(keep=st.integers(0, robots - 1)))


def failing(use: str, **failures: st.SearchStrategy[Table]) -> st.SearchStrategy[Table]:
    """Tables of a kind with several failures, each with keys of its own; `_` stands for a hyphen."""
    each = [merged(st.just({"use": use, "failure": name.replace("_", "-")}), keys) for name, keys in failures.items()]
    return st.one_of(each)


NOTHING = st.just({})
MEMORY = some(map=st.sampled_from(["kept", "lost"]))
CONSTANT = some(needed={"dx": st.sampled_from([-0.4, 0.02, 0.15])}, dy=metres, dyaw=metres)
OF_ROBOTS = {
    "remove": merged(st.just({"use": "remove"}), MEMORY),
    "crash": merged(st.just({"use": "crash"}), MEMORY),
    "push": merged(st.just({"use": "push"}), some(needed={"velocity": st.lists(metres, min_size=2, max_size=2)})),
    "motor": failing(
        "motor",
        off=some(wheel=st.sampled_from(["left", "right"])),
        slow=some(wheel=st.sampled_from(["left", "right"]), factor=st.sampled_from([0.0, 0.3, 2.0])),
        stuck=some(wheel=st.sampled_from(["left", "right"]), speed=st.sampled_from([-0.15, 0.05])),
    ),
    "sensor": failing(
        "sensor",
        off=NOTHING,
        stuck=some(needed={"value": st.sampled_from(["free", "occupied"])}),
        garbage=NOTHING,
        range=some(needed={"range": st.sampled_from([0.1, 0.3])}),
        offset=some(needed={"offset": st.lists(st.integers(-30, 30), min_size=2, max_size=2)}),
        beams=some(needed={"beams": st.lists(st.integers(0, 5), min_size=1, max_size=6)}),
    ),
    "radio": failing(
        "radio",
        transmit=NOTHING,
        receive=NOTHING,
        off=NOTHING,
        loss=some(needed={"loss": shares}),
        delay=some(needed={"delay": st.integers(1, 6)}),
    ),
    "localisation": failing(
        "localisation",
        bias=CONSTANT,
        drift=merged(CONSTANT, some(sigma=shares, sigma_yaw=shares)),
        kidnap=NOTHING,
    ),
    "mind": failing("mind", frozen=NOTHING, random_walk=some(reach=st.sampled_from([0.2, 3.0])), reboot=NOTHING),
    "byzantine": failing(
        "byzantine",
        inverted=NOTHING,
        free=NOTHING,
        occupied=NOTHING,
        origin=some(needed={"offset": st.lists(st.integers(-40, 40), min_size=2, max_size=2)}),
        replay=some(needed={"age": st.integers(1, 9)}),
        spoof=some(id=st.integers(0, 2)),
    ),
}
COSTS = some(
    needed={
        "capacity": st.sampled_from([5.0, 20.0]),
        "per_metre": st.sampled_from([0.0, 4.0]),
        "per_byte": st.sampled_from([0.0, 0.01]),
        "idle": st.sampled_from([0.1, 1.0]),
    },
    spread=shares,
    empty=st.sampled_from(["crash", "remove"]),
)
SCHEDULE = st.one_of(
    some(needed={"at": st.integers(0, 25)}, lasts=iterations), some(needed={"progress": shares}, lasts=iterations)
)


def alone(robots: int) -> dict[str, st.SearchStrategy[Table]]:
    """Kinds that strike no robots by the keys of `whom`, by what to call them here."""
    groups = st.permutations(range(robots)).map(lambda ids: [[*ids[: robots // 2]]])
    late = some(needed={"at": st.integers(1, 25)}, map=st.sampled_from(["empty", "copied"]))
    return {
        "join": merged(st.just({"use": "join"}), late, some(count=st.integers(1, robots - 1))),
        "battery": merged(st.just({"use": "battery"}), COSTS),
        "door": merged(st.just({"use": "door"}), SCHEDULE, some(needed={"box": boxes()})),
        "furniture": merged(st.just({"use": "furniture"}), SCHEDULE, some(needed={"box": boxes()}, to=boxes())),
        "rubble": merged(
            st.just({"use": "rubble", "region": [0.3, 0.3, 4.8, 3.6]}),
            SCHEDULE,
            some(every=iterations, count=st.integers(1, 4)),
        ),
        "people": merged(st.just({"use": "people"}), some(count=st.integers(1, 3), speed=st.sampled_from([0.3, 1.5]))),
        "radio jam": merged(st.just({"use": "radio", "failure": "jam"}), OF_ALL, some(needed={"area": boxes(4.0)})),
        "radio partition": merged(
            st.just({"use": "radio", "failure": "partition"}),
            OF_ALL,
            st.one_of(st.just({"x": 2.0}), st.just({"y": 2.0}), st.fixed_dictionaries({"groups": groups})),
        ),
    }


CHANNELS = st.one_of(
    st.just({"use": "perfect"}),
    st.just({"use": "bernoulli", "loss": 0.3}),
    st.just({"use": "latency", "delay": 2}),
    st.just({"use": "latency", "delay": 1.5, "law": "geometric", "over": {"use": "bernoulli", "loss": 0.2}}),
    st.just({"use": "bandwidth", "bytes_per_second": 60.0, "queue": 3}),
)


@st.composite
def scenarios(draw: st.DrawFn) -> Table:
    """Scenario tables of a small swarm in the room with one to four faults."""
    robots = draw(st.sampled_from([3, 5]))
    timed = {kind: merged(fault, TIMED, whom(robots)) for kind, fault in OF_ROBOTS.items()}
    kinds = {**timed, **alone(robots)}
    number = draw(st.sampled_from([2, 3, 4, 1]))
    chosen = draw(st.lists(st.sampled_from(sorted(kinds)), min_size=number, max_size=number))
    # Nobody may be dead before the latecomers are late, so they come first, and once.
    chosen = ["join"] * ("join" in chosen) + [kind for kind in chosen if kind != "join"]
    return {
        "title": "Random faults",
        "world": str(ROOT / "worlds" / "room.svg"),
        "seed": draw(st.integers(0, 2**32)),
        "robots": {"count": robots, "spawn": "room"},
        "network": {
            "topology": {"use": "knn", "k": draw(st.integers(1, 2))},
            "channel": draw(CHANNELS),
        },
        "mind": {"computation": {"share": {"use": draw(st.sampled_from(["current-tile", "relay", "map"]))}}},
        "stop": {"iterations": ITERATIONS, "when_done": "go-on"},
        "faults": [draw(kinds[kind]) for kind in chosen],
    }


def check(run: Run, deep: float = 0.05, tight: float = 1.9) -> None:
    """Run it to its end, and see that what has to hold under any faults does.

    No body may reach deeper into a wall than `deep` radii, nor two be nearer than `tight` radii.
    """
    watch = Watch(run)
    run.simulation.run([watch])
    assert len(watch.moments) == run.scenario.stop.iterations
    assert deepest(watch) <= deep * RADIUS
    assert tightest(watch) >= tight * RADIUS
    alive_as_told(watch)
    messages_add_up(watch, run.scenario.network.channel["use"], run.scenario.faults)
    forgets = run.scenario.mind.computation.get("decay", 0.0) > 0.0
    if "coverage" in watch.moments[0].measured.values and keeps_what_it_knows(run.scenario.faults) and not forgets:
        unions = [moment.measured.values["coverage"] for moment in watch.moments]
        assert (np.diff(unions) >= 0).all()
        assert (np.diff([moment.measured.robots["covered"] for moment in watch.moments], axis=0) >= 0).all()
        assert run.simulation.parts.building.domain.sum() == run.domain.sum()


def keeps_what_it_knows(faults: tuple[Table, ...]) -> bool:
    """Whether no fault empties a map or changes the building."""
    changes = {fault["use"] for fault in faults} & {"door", "furniture", "rubble"}
    return not changes and not any(fault.get("map") == "lost" or fault.get("failure") == "reboot" for fault in faults)


def tightest(watch: Watch) -> float:
    """The least distance in m between the centres of two bodies that are in the world."""
    least = np.inf
    for moment, solid in zip(watch.moments, watch.solid, strict=True):
        centres = moment.state.pose[solid, :2]
        apart = np.hypot(*(centres[:, None] - centres).transpose(2, 0, 1))
        least = min(least, apart[~np.eye(len(centres), dtype=bool)].min(initial=np.inf))
    return float(least)


def alive_as_told(watch: Watch) -> None:
    """The live are those whom no event has taken out and none brought back since."""
    out: set[int] = set()
    robots, events = watch.moments[0].state.robots, watch.events
    for t, moment in enumerate(watch.moments):
        for event in (event for event in events if event.iteration == t):
            if event.kind in OUT:
                out.add(event.robot)
            elif event.kind in BACK:
                out.remove(event.robot)
        assert set(np.flatnonzero(~moment.state.alive).tolist()) == out
        assert int(moment.state.alive.sum()) == robots - len(out)
        assert not np.isin(moment.links, list(out)).any()


def messages_add_up(watch: Watch, channel: str, faults: tuple[Table, ...]) -> None:
    """Each message said is heard or lost once, no sooner than it was said, or still under way."""
    under_way: Counter[tuple[int, ...]] = Counter()
    said = done = 0
    at_once = channel in ("perfect", "bernoulli") and not any(fault.get("failure") == "delay" for fault in faults)
    for t, moment in enumerate(watch.moments):
        new = [(*link, t) for link in moment.links.tolist()]
        assert len(set(new)) == len(new)
        under_way.update(new)
        assert moment.state.alive[moment.delivery.heard[:, 0]].all()
        letters = [moment.delivery.heard, *(lost for _, lost in moment.delivery.lost)]
        ended = [tuple(letter) for letter in np.concatenate(letters)[:, :3].tolist()]
        under_way.subtract(ended)
        said, done = said + len(new), done + len(ended)
        assert min(under_way.values(), default=0) >= 0, "a message that nobody said, or that ended twice"
        under_way = +under_way
        assert said == done + under_way.total()
        assert min((sent for _, _, sent in under_way), default=t) >= moment.delivery.oldest
        assert not (at_once and under_way)


def reported(table: Table, judge: Callable[[Run], None]) -> None:
    """Judge a run of the scenario; whatever is raised gets a scenario file that reproduces it as a note."""
    try:
        run = build(decode(table, "random"), "random")
    except InputError:
        assume(False)
    try:
        judge(run)
    except Exception as problem:
        problem.add_note(f"Save this as a scenario file to see it again:\n\n{tomli_w.dumps(table)}")
        raise


QUICK = settings(derandomize=True, deadline=None, max_examples=40)
THOROUGH = settings(
    derandomize=True, deadline=None, max_examples=500, suppress_health_check=[HealthCheck.too_slow], print_blob=False
)


@QUICK
@given(scenarios())
def test_whatever_goes_wrong_bodies_messages_maps_and_counts_stay_sound(table: Table) -> None:
    reported(table, check)


@pytest.mark.slow
@THOROUGH
@given(scenarios())
def test_500_times_whatever_goes_wrong_all_stays_sound(table: Table) -> None:
    reported(table, check)


def test_every_kind_of_fault_takes_part() -> None:
    assert {kind.split()[0] for kind in (*OF_ROBOTS, *alone(3))} == set(registry.known("fault"))


@settings(QUICK, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scenarios())
def test_a_failing_case_tells_a_scenario_file_that_reproduces_it(tmp_path: Path, table: Table) -> None:
    scenario = decode(table, "random")

    def fails(run: Run) -> None:
        raise ArithmeticError

    with pytest.raises(ArithmeticError) as caught:
        reported(table, fails)
    text = caught.value.__notes__[0].partition("\n\n")[2]
    path = tmp_path / "again.toml"
    path.write_text(text)
    assert load(path) == scenario
    assert decode(tomllib.loads(text), "again") == scenario
