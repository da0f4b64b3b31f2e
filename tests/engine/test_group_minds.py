"""Groups of robots with minds of their own: one network, messages of several kinds, none of which is misread."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, moments_of
from numpy.testing import assert_allclose, assert_array_equal

from swarmsim import testing
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.groups import GroupKnowledge
from swarmsim.core.kinds import KindCodec, Mixed
from swarmsim.core.messages import HEADER
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load, minds_of
from swarmsim.engine.build import BuiltRun, build
from swarmsim.recording.reader import Recording
from swarmsim.recording.recorder import text_of

CODE = '''
from msgspec import Struct

from swarmsim.operations.placement.positions import PositionComputation


class Dog:
    """Says where it is; what it hears of dogs has that form, and of sheep another, of as many bytes."""

    message_fields = {"x": "f8", "y": "f8"}
    recorded = ("dogs", "sheep", "sum")
    dogs = sheep = sum = 0

    def __init__(self, speed: float = 0.05):
        self.speed = speed

    def say(self, me):
        return 1000.0 + me.id, -1.0

    def hear(self, me):
        sheep = me.others.get("sheep", ())
        self.dogs, self.sheep = len(me.heard), len(sheep)
        for one in me.heard:
            assert (one.x, one.y) == (1000.0 + one.sender, -1.0)
        for one in sheep:
            assert vars(one).keys() == {"sender", "age", "wool", "name"}
            assert (one.wool, one.name) == (7, one.sender)
        self.sum = sum(one.name for one in sheep)

    def step(self, me):
        return me.drive(self.speed, 0.1 * self.sheep)


class Sheep:
    """Says two whole numbers."""

    message_fields = {"wool": "i8", "name": "i8"}
    recorded = ("dogs",)
    dogs = 0

    def say(self, me):
        return 7, me.id

    def hear(self, me):
        assert all(one.wool == 7 for one in me.heard)
        assert all(one.x == 1000.0 + one.sender for one in me.others["dogs"])
        self.dogs = len(me.others["dogs"])

    def step(self, me):
        return me.drive(0.02 * self.dogs, me.random.uniform(-0.5, 0.5))


class Shining(Dog):
    def step(self, me):
        return me.drive(0.05).also(led=(me.id, 200, 0))


class Wrong(Sheep):
    def step(self, me):
        return me.drive(1.0 / (me.iteration - 3), 0.0)


class Crooked(Struct, frozen=True):
    def build(self, context):
        return Bent()


class Bent(PositionComputation):
    def say(self, senses):
        said = super().say(senses)
        return said if senses.iteration < 2 else (said,)
'''
DOGS = '{{name="dogs", count={}, mind={{use="./herd.py:Dog"}}}}'
SHEEP = '{{name="sheep", count={}, mind={{use="./herd.py:Sheep"}}}}'
BRED = '{{count={}, mind={{use="./herd.py:Dog"}}}}'  # as dogs are, without a name


@pytest.fixture
def herd(tmp_path: Path):
    """A run of these groups of robots."""
    (tmp_path / "herd.py").write_text(CODE)
    room = (ROOT / "scenarios" / "room.toml").read_text().replace("../worlds", str(ROOT / "worlds"))
    (tmp_path / "herd.toml").write_text(room)

    def made(*groups: str, keys: tuple[str, ...] = ()) -> BuiltRun:
        with registry.own_code(True):
            return build(load(tmp_path / "herd.toml", overrides(*groups, keys=keys)), "herd.toml")

    return made


def overrides(*groups: str, keys: tuple[str, ...] = ()) -> tuple[str, ...]:
    """A short run of groups of robots that all hear each other."""
    of = (f"robots=[{', '.join(groups)}]", 'task={use="spacing"}', 'network.topology={use="full"}')
    return *of, "stop.iterations=12", 'stop.when_done="continue"', *keys


def test_messages_of_as_many_bytes_and_other_fields_are_never_misread(herd) -> None:
    """The minds look at every message that they get."""
    run = herd(DOGS.format(2), SHEEP.format(3), keys=('network.channel={use="latency", delay=1.5, law="geometric"}',))
    moments = moments_of(run)
    heard = moments[-1].knowledge
    assert isinstance(heard, GroupKnowledge)
    assert max(one.knowledge.of_group("dogs").sheep.max() for one in moments) >= 3.0  # some come late
    content = moments[-1].inbox.content
    assert isinstance(content, Mixed)
    assert set(np.unique(content.kind)) == {0, 1}
    for moment in moments:
        inbox = moment.inbox
        assert_array_equal(inbox.content.kind, inbox.senders >= 2)
        assert_array_equal(inbox.content.of(1).name, inbox.senders[inbox.senders >= 2])
        assert_array_equal(inbox.content.of(0).x, 1000.0 + inbox.senders[inbox.senders < 2])


def test_a_byte_tells_kinds_apart_and_is_counted(herd) -> None:
    run = herd(DOGS.format(2), SHEEP.format(3))
    parts, perceived = run.simulation.parts, run.simulation.perceive()
    codec, said = parts.computation.codec, parts.computation.say(perceived.senses)
    assert isinstance(codec, KindCodec)
    assert said.sizes.tolist() == [HEADER.size + 16 + 1] * 5
    for robot in range(5):
        packed = codec.pack(robot, 4, said.of(robot))
        assert len(packed) == said.sizes[robot]
        assert packed[0] == (robot >= 2)
        sender, sent, back = codec.unpack(packed)
        assert (sender, sent, back.kind.tolist()) == (robot, 4, [int(robot >= 2)])
        for one, other in zip(back.arrays(), said.of(robot).arrays(), strict=True):
            assert_array_equal(one, other)
    with pytest.raises(ValueError, match=r"robot 0 says messages of the kind 0, not \[1\]"):
        codec.pack(0, 4, said.of(3))
    with pytest.raises(ValueError, match="a message of the kind 9; expected one of"):
        codec.unpack(bytes([9]) + packed[1:])


def test_who_takes_another_kinds_name_is_heard_by_nobody(herd) -> None:
    """A dog that passes itself off as a sheep says what no sheep says."""
    spoof = 'faults=[{use="byzantine", failure="spoof", at=0, robots=[0], id=3}]'
    run = herd(DOGS.format(2), SHEEP.format(3), keys=(spoof,))
    knowledge = moments_of(run)[-1].knowledge
    assert knowledge.of_group("dogs").dogs.tolist() == [1.0, 0.0]  # of the other dog, and of the liar
    assert knowledge.of_group("sheep").dogs.tolist() == [1.0, 1.0, 1.0]


def test_minds_keep_every_contract_alone_in_another_order_and_unheard(herd, tmp_path: Path) -> None:
    """Of three groups, two of which share a mind, one with a robot of its own and one that is struck by faults."""
    herd(DOGS.format(1), SHEEP.format(3), BRED.format(2))
    keys = (
        'faults=[{use="remove", at=4, robots=[5]}, {use="mind", failure="reboot", at=5, robots=[0, 2]}]',
        'network.channel={use="latency", delay=1.0, law="fixed"}',
    )
    given = overrides(DOGS.format(1), SHEEP.format(3), BRED.format(2), keys=keys)
    scenario = tmp_path / "herd.toml"
    for check in (
        testing.check_strictly, testing.check_one_robot, testing.check_permutation, testing.check_locality,
        testing.check_silence, testing.check_determinism,
    ):  # fmt: skip
        check(scenario, given, 12, allow_code=True)


def test_the_order_of_groups_is_that_of_numbers_and_groups_with_equal_minds_share_theirs(herd) -> None:
    run = herd(DOGS.format(1), SHEEP.format(3), BRED.format(2))
    assert [one.groups for one in minds_of(run.scenario)] == [(0, 2), (1,)]
    knowledge = moments_of(run)[-1].knowledge
    assert knowledge.of_group("dogs") is knowledge.of_group("2")
    assert knowledge.of_group("dogs").dogs.tolist() == [2.0, 2.0, 2.0]
    assert [type(knowledge.of(robot)).__name__ for robot in range(6)] == ["Dog", *["Sheep"] * 3, "Dog", "Dog"]
    with pytest.raises(InputError, match="no group of robots is called 'cats'; known: 2, dogs, sheep"):
        knowledge.of_group("cats")
    same = herd(DOGS.format(1), BRED.format(4))
    assert not isinstance(moments_of(same)[-1].knowledge, GroupKnowledge)


def test_a_dead_group_is_silent_and_the_others_go_on(herd) -> None:
    dead = 'faults=[{use="remove", at=5, robots=[0, 1], min_alive=0}]'
    run = herd(DOGS.format(2), SHEEP.format(3), keys=(dead,))
    moments = moments_of(run)
    assert [one.knowledge.of_group("sheep").dogs.tolist() for one in moments[4:6]] == [[2.0] * 3, [0.0] * 3]
    assert not moments[-1].state.alive[:2].any()
    assert len(moments) == 12


def test_a_fault_strikes_a_group_by_its_name(herd) -> None:
    """A mind that forgets is one of its group's again."""
    fault = 'faults=[{use="mind", failure="frozen", group="sheep", at=4}]'
    run = herd(DOGS.format(2), SHEEP.format(3), keys=(fault,))
    moments = moments_of(run)
    twists = np.array([one.intents.twists for one in moments])
    assert (twists[4:, 2:] == twists[3, 2:]).all()
    assert (twists[3, 2:] != twists[2, 2:]).any()
    reboot = 'faults=[{use="mind", failure="reboot", group="2", at=4}]'
    run = herd(DOGS.format(1), SHEEP.format(1), BRED.format(2), keys=(reboot,))
    knowledge = [one.knowledge for one in moments_of(run)]
    assert knowledge[3].of_group("dogs").dogs.tolist() == [2.0, 2.0, 2.0]
    assert knowledge[4].of_group("dogs").dogs.tolist() == [2.0, 0.0, 0.0]
    assert knowledge[4].of(2) is not knowledge[3].of(2)
    assert knowledge[4].of(0) is knowledge[3].of(0)


def test_what_groups_show_is_one_table_and_what_one_alone_shows_is_nan_for_others(herd, tmp_path: Path) -> None:
    run = herd(DOGS.format(2), SHEEP.format(1))
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    recording = Recording(tmp_path)
    assert recording["dogs"][-1].tolist() == [1.0, 1.0, 2.0]
    assert_array_equal(recording["sheep"][-1], [1.0, 1.0, np.nan])
    assert text_of(recording.scenario) == text_of(run.scenario)


def test_tables_of_other_forms_are_told_apart_by_the_group(herd) -> None:
    field = 'field={use="formula", formula="x"}'
    average, heading = (
        f'{{count=2, mind.computation={{use="{use}"}}}}' for use in ("average-consensus", "field-estimate")
    )
    run = herd(average, heading, keys=(field, 'mind.strategy={use="stand"}'))
    moment = moments_of(run)[-1]
    rows = moment.knowledge.record().rows
    assert rows["weights"].shape[0] == 4
    assert np.isnan(rows["weights"][:2]).all()
    own = [known.record().rows for known in moment.knowledge.known]
    for name, values in own[0].items():
        assert_allclose(rows[name][:2], values)


def test_maps_of_one_group_are_recorded_by_the_numbers_of_its_robots(herd) -> None:
    silent = '{count=2, mind={computation={use="positions"}, strategy={use="stand"}}}'
    run = herd(silent, "{count=2}")
    moments = moments_of(run)
    changes = np.concatenate([one.knowledge.record().lists["changes"] for one in moments])
    assert set(changes[:, 0]) == {2, 3}
    maps = moments[-1].knowledge.of_group("1")
    assert maps.observed[0].sum() == len(np.unique(changes[changes[:, 0] == 2, 1]))
    twice = herd('{count=2, mind.strategy={use="stand"}}', "{count=1}")
    assert set(moments_of(twice)[0].knowledge.record().lists["changes"][:, 0]) == {0, 1, 2}


@pytest.mark.parametrize("sharing", ["relay", "gossip", "merge"])
def test_a_group_that_maps_beside_another_keeps_every_contract(sharing: str) -> None:
    """Its maps are held against the tiles of its own robots, by their rows."""
    given = (
        'robots=[{count=1, mind={computation={use="positions"}, strategy={use="disperse"}}}, {count=3}]',
        'task={use="spacing", apart=9.0}', 'network.topology={use="full"}', f"mind.computation.sharing.use={sharing}",
    )  # fmt: skip
    for check in (testing.check_strictly, testing.check_one_robot, testing.check_permutation, testing.check_locality):
        check(ROOT / "scenarios" / "room.toml", given, 12)


def test_lights_of_a_group_that_does_not_use_them_are_dark(herd) -> None:
    shining = DOGS.format(2).replace("Dog", "Shining")
    run = herd(
        shining,
        "{count=2, mind={computation={use='reactive'}, strategy={use='stand'}}}",
        keys=('actuators=[{use="led"}]',),
    )
    moments = moments_of(run)
    assert moments[-1].intents.commands["led"].tolist() == [[0, 200, 0], [1, 200, 0], [0, 0, 0], [0, 0, 0]]


def test_what_breaks_its_contract_names_the_group(herd) -> None:
    wrong = SHEEP.format(2).replace("Sheep", "Wrong")
    with pytest.raises(PartError, match=r"strategy herd\.py:Wrong of group 'sheep', iteration 3: .*robot [12]"):
        herd(DOGS.format(1), wrong).simulation.run()
    crooked = DOGS.format(2).replace("mind", "mind.computation").replace("Dog", "Crooked")
    stands = 'mind.strategy={use="stand"}'
    with pytest.raises(PartError, match=r"computation herd\.py:Bent of group 'dogs', iteration 2: say: tuple"):
        herd(crooked, BRED.format(1), keys=(stands,)).simulation.run()


@pytest.mark.parametrize(
    ("groups", "keys", "words"),
    [
        ((DOGS.format(1), "{count=1}"), ('task={use="coverage"}',), r"'coverage' reads Maps, and groups of robots"),
        (
            (DOGS.format(1), '{count=1, mind.strategy={use="rendezvous"}}'), (),
            r"robots\[1\]\.mind\.strategy\.use: 'rendezvous' reads Positions, and 'occupancy-grid' gives Maps",
        ),
        (
            (DOGS.format(1), '{count=1, mind={use="./herd.py:Dog", speed="x"}}'), (),
            r"robots\[1\]\.mind\.computation\.speed: expected",
        ),
        (
            (DOGS.format(1), '{count=1, mind={use="./herd.py:Dog", strategy={use="stand"}}}'), (),
            r"robots\[1\]\.mind\.use sets both computation and strategy",
        ),
        (
            (DOGS.format(1), '{count=1, mind.strategy={use="wander"}}'), (),
            r"robots\[1\]\.mind\.strategy\.use: 'wander' needs 'ranges'",
        ),
        ((DOGS.format(1), SHEEP.format(1).replace('"sheep"', '"dogs"')), (), r"two groups have one name"),
        (
            (DOGS.format(1), SHEEP.format(1)), ('faults=[{use="byzantine", failure="inverted", at=1}]',),
            r"faults\[0\]\.failure: 'inverted' needs a computation .* groups with several minds does not",
        ),
        (
            (DOGS.format(1), SHEEP.format(1)), ('faults=[{use="mind", failure="random-walk", at=1}]',),
            r"faults\[0\]\.failure: 'random-walk' needs a computation .* groups with several minds does not",
        ),
        (
            (DOGS.format(1), SHEEP.format(1)), ('faults=[{use="byzantine", failure="replay", age=2, at=1}]',),
            r"faults\[0\]\.failure: 'replay' is for robots of one mind",
        ),
        (
            (DOGS.format(1), SHEEP.format(1)), ('faults=[{use="remove", group="cats", at=1}]',),
            r"faults\[0\]\.group: no group of robots is called 'cats'; known: dogs, sheep",
        ),
        (
            (DOGS.format(1), SHEEP.format(1)), ('faults=[{use="remove", group="dogs", robots=[0], at=1}]',),
            r"faults\[0\]\.group: `robots` says whom already",
        ),
    ],
)  # fmt: skip
def test_minds_of_groups_that_cannot_be_are_refused(herd, groups, keys, words: str) -> None:
    with pytest.raises(InputError, match=words):
        herd(*groups, keys=keys)


def test_a_group_finds_its_own_sensors_under_their_plain_names(herd) -> None:
    """Others have no such sensor, or one that reaches farther."""
    rings = [f"sensor={{ranges=true, reach={reach}}}" for reach in (0.6, 0.9)]
    wanders = [
        f'mind={{computation={{use="reactive"}}, strategy={{use="wander", bend={bend}}}}}' for bend in (0.1, 0.2)
    ]
    run = herd(*(f"{{count=2, {ring}, {mind}}}" for ring, mind in zip(rings, wanders, strict=True)), BRED.format(1))
    moments = moments_of(run)
    assert (moments[-1].intents.twists[:4, 0] > 0.0).all()
    assert "ranges.0" in moments[0].readings


def test_keys_of_a_group_are_set_by_its_number_or_its_name(herd, tmp_path: Path) -> None:
    herd(DOGS.format(1), SHEEP.format(1))
    with registry.own_code(True):
        given = overrides(DOGS.format(1), SHEEP.format(1), keys=("robots.dogs.mind.speed=0.09", "robots.1.count=4"))
        scenario = load(tmp_path / "herd.toml", given)
        assert [one.mind.strategy.table.get("speed") for one in minds_of(scenario)] == [0.09, None]
        assert minds_of(scenario)[0].mind.computation.table["speed"] == 0.09
        assert scenario.robots.count == 5
        with pytest.raises(InputError, match=r"robots: has no 'cats'; expected 0 to 1 or 'dogs' or 'sheep'"):
            load(tmp_path / "herd.toml", (*given, "robots.cats.count=2"))
