"""Scenario number i, for any i: a small building, a few robots, and any parts of all seams with any valid keys."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import shapely
import tomli_w
from generated.buildings import place
from generated.keys import OMITTED, Own, drawn
from generated.timelines import Timelines

from swarmsim.core.scenario import registry
from swarmsim.core.scenario.platforms import PLATFORMS

Table = dict[str, Any]

#: By computation: the strategies and tasks that read what it gives. Any goes with ANY_STRATEGY and ANY_TASK besides.
TOGETHER: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "occupancy-grid": (
        (
            "nearest-frontier", "random-frontier", "largest-frontier", "utility-frontier", "coordinated-frontier",
            "min-pos", "assigned-frontier", "potential-field", "market", "reserved-frontier", "dispersed-frontier",
            "shared-frontier", "oracle-frontier",
        ),
        ("coverage",),
    ),
    "positions": (("rendezvous", "disperse", "lloyd", "perimeter", "formation"), ()),
    "heading-consensus": (("self-propelled",), ("alignment",)),
    "average-consensus": ((), ("agreement",)),
    "field-estimate": (("most-uncertain",), ("field-error",)),
    "reactive": (("wander",), ()),
    "locate-source": (("most-disputed",), ("source-found",)),
}  # fmt: skip
ANY_STRATEGY = ("stand", "wander", "random-waypoint")
ANY_TASK = ("gathered", "spacing", "locational-cost", "guarded", "formation-error", "travelled")
TOLD_GOALS = (
    "market",
    "reserved-frontier",
    "dispersed-frontier",
    "oracle-frontier",
)  # that need to hear where others go
LAYERED = 0.5  # how often a channel lies over another
FIRST_LARGE, EVERY_LARGE = 300, 40  # from which scenario on, and how often, there are many robots for long


@dataclass(frozen=True)
class Scenario:
    """One scenario, as a person would have written it."""

    number: int
    table: Table
    files: dict[str, bytes]  # that it reads, by name
    solid: shapely.Geometry | None  # what is solid in a building that we have drawn; None: a generator's

    @property
    def text(self) -> str:
        """The scenario file."""
        return tomli_w.dumps(self.table)

    def written(self, folder: Path) -> Path:
        """The scenario file in a folder, which also has the files that it reads."""
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        path = folder / "scenario.toml"
        path.write_text(self.text)
        return path

    def __str__(self) -> str:
        beside = "".join(f"\n\n{name}:\n{content.decode()}" for name, content in self.files.items())
        return f"scenario {self.number}; save this as a scenario file to see it again:\n\n{self.text}{beside}"


def scenario(number: int) -> Scenario:
    """The scenario of a number, always the same one."""
    return _Draw(number).scenario()


BESIDE = ("neighbours", "ground", "bump")  # sensors that robots have besides their beams


class _Draw:
    """Draws one scenario, part by part."""

    def __init__(self, number: int) -> None:
        self._number, self._dice = number, Random(number)
        self._large = number >= FIRST_LARGE and number % EVERY_LARGE == 0
        self._place = place(self._dice, self._large)
        self._count = self._dice.randint(8, 20) if self._large else self._dice.choice((1, 2, 3, 3, 4, 5))

    def scenario(self) -> Scenario:
        """All of it."""
        dice = self._dice
        computation = dice.choice(("occupancy-grid", *sorted(TOGETHER)))
        strategies, tasks = TOGETHER[computation]
        strategy = dice.choice((*strategies, *strategies, *ANY_STRATEGY))
        task = dice.choice((*tasks, *tasks, *ANY_TASK))
        maps, ranges = computation == "occupancy-grid", strategy == "wander"
        robots, sensor = self._robots(maps or ranges, ranges)
        table: Table = {
            "title": f"Scenario {self._number}",
            "world": self._place.world,
            "seed": dice.randint(0, 2**32),
            "robots": robots,
            "network": {"topology": self._topology(), "channel": self._channel()},
            "mind": {
                "computation": self._computation(computation, strategy), "strategy": self._part("strategy", strategy),
            },
            "task": self._part("task", task),
            "motion": self._any("motion"),
            "stop": {
                "iterations": 150 if self._large else dice.randint(4, 14),
                "when_done": dice.choice(("stop", "continue")),
            },
        }  # fmt: skip
        if sensor:
            table["sensor"] = sensor
        if dice.random() < 0.2:
            table["period"] = dice.choice((0.25, 0.5, 1.5))
        if dice.random() < 0.5:
            table["localisation"] = self._any("localisation")
        if dice.random() < 0.3:
            table["physics"] = self._any("physics")
        if "field-estimate" in computation or "field-error" in task or dice.random() < 0.1:
            table["field"] = self._any("field")
        if "locate-source" in computation:
            table["field"] = self._smell()
        if dice.random() < 0.55:
            tiles = sensor.get("use", "ir-ring") == "ir-ring" and not isinstance(robots, list)
            group = ""
            if not isinstance(robots, list) and dice.random() < 0.3:
                group, table["robots"] = "everybody", [{**robots, "name": "everybody"}]
            timelines = Timelines(
                dice, self._count, self._place.width, self._place.height, maps=maps, tiles=tiles, group=group
            )  # fmt: skip
            bodies = table.get("physics", {}).get("use", "pymunk") == "pymunk"
            table["faults"] = timelines.some(sorted(registry.known("fault")), bodies)
        if dice.random() < 0.3:
            uses = dice.sample(sorted(registry.known("probe").keys() - {"sources"}), dice.randint(1, 2))
            table["probes"] = [{"use": use, "name": f"of_{use}", "every": dice.randint(1, 4)} for use in uses]
        if not isinstance(robots, list) and dice.random() < 0.3:
            table.setdefault("sensor", {"use": "ir-ring"})
            table["sensors"] = [self._part("sensor", use) for use in dice.sample(BESIDE, dice.randint(1, 2))]
            for one in table["sensors"] if dice.random() < 0.5 else []:
                name = f"{one['name']}_{one['use']}" if "name" in one else one["use"]
                fails: Table = {"failure": "noisy", "sigma": 0.1} if one["use"] == "neighbours" else {"failure": "off"}
                fault = {"use": "sensor", "at": dice.randint(0, 5), "min_alive": 0, "channels": [name], **fails}
                table["faults"] = [*table.get("faults", []), fault]
            if dice.random() < 0.2:
                table["sensors"].append({**self._ring(ranges=False), "name": "rear"})
        if not isinstance(robots, list) and dice.random() < 0.3:
            self._lights(table)
        elif not isinstance(robots, list) and self._count > 1 and dice.random() < 0.1:
            table |= self._pursuit(robots)
        self._wheels(table)
        if dice.random() < 0.2:
            job = self._any("job")
            table["jobs"] = [job]
            if job["use"] == "gather" and "field" not in table:
                table["field"] = self._any("field")
            if dice.random() < 0.5:
                tasks = {"solve": "computed", "locate-source": "source-found"}
                table["task"] = self._part("task", tasks.get(job["use"], "settled"))
            if job["use"] == "locate-source":
                table["field"] = self._smell()
                table.setdefault("probes", []).append({"use": "sources", "name": "truth", "every": 2})
                job["name"] = "beside"  # the mind may be one too
            if dice.random() < 0.5:
                self._processors(table)
            if dice.random() < 0.5:
                table["network"]["rounds"] = dice.randint(2, 4)
            if dice.random() < 0.3:
                others = {"solve", "stigmergy", "storage", "percolation"} - {job["use"]}
                table["jobs"].append(self._part("job", dice.choice(sorted(others))))
        if dice.random() < 0.2:
            table["network"]["charged"] = "sent"
        return Scenario(self._number, table, self._place.files, self._place.solid)

    def _smell(self) -> Table:
        """A field with a source, wherever it is."""
        own = {"model": lambda: {"use": "diffusion"}, "method": lambda: OMITTED, "refine": lambda: self._maybe(2)}
        return self._part("field", "model", hidden=lambda: [{"strength": 0.02, "begin": 1.0}], **own)

    def _pursuit(self, robots: Table) -> Table:
        """Two groups with minds of their own, in the place of what robots are, sense, do and suffer."""
        pursuers, keys = self._dice.randint(1, self._count - 1), {"spawn": robots["spawn"]} if "spawn" in robots else {}
        groups: list[Table] = [
            {
                "name": name, "count": count, **keys,
                "mind": {"computation": self._part("computation", one), "strategy": self._part("strategy", two)},
            }
            for name, count, one, two in (
                ("pursuers", pursuers, "chase", "pursue"), ("evaders", self._count - pursuers, "flight", "evade")
            )
        ]  # fmt: skip
        fault = {"use": "remove", "at": self._dice.randint(1, 5), "group": self._dice.choice(("pursuers", "evaders"))}
        return {
            "robots": groups, "sensor": {"use": "ir-ring"}, "task": self._part("task", "caught"),
            "sensors": [{"use": "neighbours", "reach": 3.0, "groups": True}],
            "faults": [fault] if self._dice.random() < 0.5 else [], "probes": [],
        }  # fmt: skip

    def _processors(self, table: Table) -> None:
        """Processors that most often take long, and at times a fault of them."""
        dice, robots = self._dice, table["robots"]
        groups = robots if isinstance(robots, list) else [robots]
        for group in groups:
            energy, memory = self._maybe(1e-9), self._maybe(1e8)
            own = {"rate": dice.choice((1e3, 1e5, 1e9)), "energy": energy, "memory": memory}
            given = {"use": "pi-zero-2"} if dice.random() < 0.2 else own
            group["processor"] = {key: value for key, value in given.items() if value is not OMITTED}
        if dice.random() < 0.7:
            name = groups[0].get("name", "")
            size = self._place.width, self._place.height
            timelines = Timelines(dice, self._count, *size, maps=False, tiles=False, group=name)
            table["faults"] = [*table.get("faults", []), timelines.one("processor")]

    def _lights(self, table: Table) -> None:
        """Lights on the robots, which see those of others and most often tell something by them."""
        dice, mind = self._dice, table["mind"]
        led = self._part("actuator", "led")
        light = f"{led['name']}_led" if "name" in led else "led"
        table["actuators"] = [led]
        table.setdefault("sensor", {"use": "ir-ring"})
        sensors = table.setdefault("sensors", [])
        near = next((one for one in sensors if one["use"] == "neighbours" and "name" not in one), None)
        if near is None:
            near = self._part("sensor", "neighbours", name=lambda: OMITTED)
            sensors.append(near)
        near["sees"] = [light]
        if dice.random() < 0.8:
            drive, colour = mind["strategy"], [dice.randint(0, 255) for _ in range(3)]
            mind["strategy"] = self._part(
                "strategy", "mimic", drive=lambda: drive, light=lambda: light, first=lambda: self._maybe([0]),
                colour=lambda: self._maybe(colour),
            )  # fmt: skip
        if dice.random() < 0.5:
            table["task"] = self._part("task", "lit", light=lambda: light)

    def _wheels(self, table: Table) -> None:
        """Give robots other wheels than two, unless they are particles or a fault is of one of two wheels."""
        dice, faults = self._dice, table.get("faults", [])
        stuck = any("wheel" in one or one.get("failure") == "stuck" for one in faults if one["use"] == "motor")
        if stuck or table.get("physics", {}).get("use", "pymunk") != "pymunk" or dice.random() > 0.3:
            return
        table["kinematics"] = self._any("kinematics")
        for group in table["robots"] if isinstance(table["robots"], list) else []:
            if dice.random() < 0.5:
                group["kinematics"] = self._any("kinematics")

    def _any(self, seam: str) -> Table:
        return self._part(seam, self._dice.choice(sorted(registry.known(seam))))

    def _part(self, seam: str, use: str, **own: Any) -> Table:
        """The table of a part."""
        return {"use": use, **drawn(self._dice, registry.find(seam, use), {**self._own(use), **own})}

    def _point(self) -> list[float]:
        width, height = self._place.width, self._place.height
        return [round(self._dice.uniform(0.3, width - 0.3), 3), round(self._dice.uniform(0.3, height - 0.3), 3)]

    def _maybe(self, value: Any, often: float = 0.4) -> Any:
        return value if self._dice.random() < often else OMITTED

    def _own(self, use: str) -> Own:
        """How to draw the keys of a part that their types alone do not tell."""
        dice, count = self._dice, self._count
        degree = {"k": lambda: dice.randint(0, min(count - 1, 4))}
        corners = {"corners": lambda: [[0.6, 0.6], [1.8, 0.6], [1.8, 1.6], [0.6, 1.6]]}
        offsets = {"places": lambda: [[0.4 * i, 0.1 * i * i] for i in range(count)]}
        pace = {"speed": lambda: self._maybe(round(dice.uniform(0.02, 0.1), 3))}
        called = {"name": lambda: self._maybe(f"my_{use}")}
        noise = {"noise": lambda: self._maybe(0.05)}
        asked: dict[str, Own] = {
            **dict.fromkeys(("knn", "farthest-k", "k-random"), degree),
            "small-world": {"k": lambda: dice.randint(0, count - 1), "p": lambda: round(dice.random(), 2)},
            "random": {"p": lambda: round(dice.random(), 2)},
            "star": {"hub": lambda: dice.randrange(count)},
            "radius": {"radius": lambda: round(dice.uniform(0.3, 2.0), 2)},
            "line-of-sight": {"radius": lambda: self._maybe(round(dice.uniform(0.3, 2.0), 2))},
            "edges": {"links": self._edges},
            "bernoulli": {"loss": lambda: round(dice.random(), 2)},
            "gilbert-elliott": {
                "loss": lambda: round(dice.uniform(0.0, 0.6), 2), "burst": lambda: dice.choice((2.0, 4.0)),
            },
            "range": {"metres": lambda: round(dice.uniform(0.3, 2.0), 2)},
            "bandwidth": {
                "bytes_per_second": lambda: dice.choice((10.0, 60.0, 600.0)),
                "queue": lambda: self._maybe(dice.randint(0, 6)),
                "expiry": lambda: self._maybe(dice.randint(0, 4)),
            },
            "contention": {
                "radio": lambda: OMITTED, "bytes_per_second": lambda: dice.choice((300.0, 3000.0)),
                "overhead": lambda: self._maybe(12.0), "duty": lambda: self._maybe(0.05),
                "access": lambda: self._maybe(dice.choice(("slotted", "csma"))), "reach": lambda: self._maybe(2.0),
            },
            "tdma": {"bytes": lambda: self._maybe(dice.choice((20.0, 200.0)))},
            "path-loss": {
                "power": lambda: self._maybe(round(dice.uniform(-30.0, 15.0), 1)),
                "sensitivity": lambda: self._maybe(-85.0),
            },
            "average-consensus": {
                "weights": lambda: OMITTED,
                "values": lambda: self._maybe([round(dice.uniform(-5, 5), 2) for _ in range(count)]),
                "gain": lambda: OMITTED,
            },
            "heading-consensus": {
                "leaders": lambda: self._maybe([dice.randrange(count)]),
                "dt": lambda: self._maybe(0.5),
                "at": lambda: self._maybe(dice.randint(0, 5)),
                "frequency": lambda: self._maybe(0.05),
                "turn": lambda: self._maybe(1.0),
            },
            "field-estimate": {"spacing": lambda: 1.0, "half_life": lambda: self._maybe(8.0)},
            "neighbours": {**called, "most": lambda: self._maybe(dice.randint(1, 4)), "sees": lambda: OMITTED},
            "led": called,
            "ground": {
                **called, "error": lambda: self._maybe(0.05),
                "floors": lambda: [{"use": "formula", "formula": one} for one in ("x", "y * y")[: dice.randint(1, 2)]],
                "steps": lambda: self._maybe([0.5, 1.5]),
            },
            "bump": called,
            "formula": {**noise, "formula": lambda: dice.choice(("sin(x) + y / 2", "exp(-hypot(x, y))", "x * t"))},
            "picture": {
                **noise, "low": lambda: self._maybe(-1.0),
                "values": lambda: [[round(dice.random(), 2) for _ in range(3)] for _ in range(2)],
            },
            "sources": {
                **noise, "base": lambda: self._maybe(0.3),
                "sources": lambda: [
                    {"x": self._point()[0], "y": self._point()[1], "width": 0.8, "velocity": [0.05, -0.02]}
                ]
            },
            "model": {
                **noise, "model": self._equation,
                "method": lambda: {"use": "explicit"} if self._explicit else self._maybe({"use": "block-jacobi"}),
                "dt": lambda: self._maybe(dice.choice((0.25, 2.0))),
                "sources": lambda: self._maybe(self._emitters(), 0.2), "hidden": lambda: OMITTED,
                "refine": lambda: OMITTED if self._explicit else self._maybe(2),
                "start": lambda: self._maybe({"use": "formula", "formula": "exp(-hypot(x, y))"}),
            },
            "solve": {
                "fence": self._fence, "model": self._equation, "method": self._method, "dt": lambda: 0.5,
                "duration": lambda: dice.choice((1.0, 2.0)), "sources": lambda: self._maybe(self._emitters(), 0.2),
                "budget": lambda: self._maybe(1_000_000),
                "migrate": lambda: OMITTED if self._clocked else self._maybe(0.5),
                "pieces": lambda: self._maybe(dice.randint(1, 6)), "name": lambda: self._maybe("heat"),
            },
            "stigmergy": {**called, "budget": lambda: self._maybe(100)},
            "locate-source": {
                "name": lambda: self._maybe("smell"), "dt": lambda: 0.5,
                "model": lambda: {"use": "diffusion", "diffusivity": 0.02},
                "pulse": lambda: 1.0, "duration": lambda: dice.choice((4.0, 20.0)), "spacing": lambda: 2.0,
                "budget": lambda: self._maybe(100),
            },
            "storage": {
                **called, "copies": lambda: dice.randint(0, min(count - 1, 2)),
                "capacity": lambda: self._maybe(1000), "budget": lambda: self._maybe(2000),
            },
            "percolation": {
                **called, "rate": lambda: self._maybe(1e5), "budget": lambda: self._maybe(100),
                "lattices": lambda: dice.randint(1, 3),
            },
            "gather": {
                **called, "model": lambda: {"use": "diffusion", "decay": 0.01}, "base": lambda: dice.randrange(count),
                "servers": lambda: dice.randint(1, count), "budget": lambda: self._maybe(1_000_000),
                "every": lambda: dice.randint(1, 4), "levels": lambda: dice.randint(1, 4),
            },
            **dict.fromkeys(("diffusion", "gray-scott"), self._walls()),
            "source-found": {"ahead": lambda: self._maybe([5.0])},
            "buoy": {
                "current": lambda: self._maybe([0.03, -0.02]), "eddies": lambda: self._maybe(0.02),
                "eddy_size": lambda: self._maybe(2.0),
            },
            "advection-diffusion": {
                "walls": lambda: "open", "value": lambda: self._maybe(0.1), "vents": lambda: OMITTED,
                "decay": lambda: self._maybe(0.01),
                "velocity": lambda: [round(dice.uniform(-0.1, 0.1), 3) for _ in "xy"],
            },
            "formation": {**offsets, **pace, "march": lambda: self._maybe([0.02, 0.0])},
            "formation-error": offsets,
            "perimeter": {**corners, **pace},
            "guarded": corners,
            "travelled": {"distance": lambda: round(dice.uniform(0.1, 2.0), 2)},
            "alignment": {"frequency": lambda: self._maybe(0.05)},
            "gathered": {"within": lambda: self._maybe(round(dice.uniform(0.5, 2.0), 2))},
            "rendezvous": {
                **pace, "apart": lambda: self._maybe(0.3),
                "range": lambda: self._maybe(round(dice.uniform(0.5, 2.0), 2)),
            },
            **dict.fromkeys(("disperse", "lloyd", "self-propelled", "wander"), pace),
            "chase": {"of": lambda: self._maybe("evaders")},
            "pursue": pace,
            "flight": {"of": lambda: self._maybe("pursuers")},
            "evade": {**pace, "of": lambda: self._maybe("pursuers")},
            "caught": {"pursuers": lambda: self._maybe("pursuers"), "evaders": lambda: self._maybe("evaders")},
            "pymunk": {
                "substep": lambda: self._maybe(dice.choice((1 / 128, 1 / 32))),
                "parting": lambda: 0.2 if count % 2 else OMITTED,
            },
            "particles": {"substeps": lambda: self._maybe(dice.randint(1, 20))},
        }  # fmt: skip
        bounded = dice.random() < 0.3  # such robots do not patrol
        exploring = {
            "search": lambda: dice.randint(3, 200) if bounded else OMITTED,
            "idle": lambda: "stand" if bounded else self._maybe("patrol"),
            "patience": lambda: self._maybe(dice.randint(1, 9)),
            "grain": lambda: self._maybe(dice.randint(3, 9)),
            "near": lambda: self._maybe(round(dice.uniform(1.0, 12.0), 2)),
            "heeds": lambda: self._maybe(dice.randint(1, 3)),
        } | ({"revenue": lambda: self._maybe(3.0)} if use == "shared-frontier" else {})
        found = registry.known("strategy").get(use)
        return asked.get(use, {key: exploring[key] for key in exploring if found and key in found.__struct_fields__})

    def _equation(self) -> Table:
        """A model that implicit methods with steps of any length can solve."""
        self._draught = self._dice.random() < 0.2
        self._explicit = not self._draught and self._dice.random() < 0.3
        if self._explicit:  # within the limits of its steps
            return self._dice.choice(
                (
                    {"use": "wave", "speed": 0.05, "damping": 0.1, "walls": "fixed", "value": 0.1},
                    {"use": "diffusion", "diffusivity": 0.005, "decay": 0.01},
                )
            )
        use = "advection-diffusion" if self._draught else self._dice.choice(("diffusion", "gray-scott"))
        return self._part("model", use)

    def _walls(self) -> Own:
        """What happens at walls, and rates that steps of 2 s bear."""
        dice, fixed = self._dice, self._dice.random() < 0.3
        return {
            "walls": lambda: "fixed" if fixed else "no-flux", "value": lambda: 0.2 if fixed else OMITTED,
            "rate": lambda: round(dice.uniform(0.05, 0.2), 3),
        }  # fmt: skip

    def _fence(self) -> str:
        self._clocked = self._dice.random() < 0.3
        return "clock" if self._clocked else "data"

    def _method(self) -> Table:
        if self._explicit:
            return {"use": "explicit", "level": self._dice.randint(1, 2)}
        use = self._dice.choice(
            ("block-jacobi", "schwarz") if self._draught else ("block-jacobi", "chebyshev", "schwarz")
        )
        overlap = 0 if self._clocked else self._dice.randint(0, 3)
        return self._part("method", use, sweeps=lambda: self._dice.randint(2, 5), overlap=lambda: overlap)

    def _emitters(self) -> list[Table]:
        x, y = self._point()
        return [{"x": x, "y": y, "strength": 0.05, "begin": 1.0, "end": 6.0, "velocity": [0.02, 0.0]}]

    def _edges(self) -> list[list[int]]:
        pairs = [[i, j] for i in range(self._count) for j in range(self._count) if i != j]
        return self._dice.sample(pairs, self._dice.randint(0, min(len(pairs), 8)))

    def _topology(self) -> Table:
        return self._any("topology")

    def _channel(self) -> Table:
        """A channel, or several, one over another."""
        use = self._dice.choice(sorted(registry.known("channel")))
        table = self._part("channel", use)
        if use == "latency":
            law = self._dice.choice(("fixed", "geometric"))
            delay = float(self._dice.randint(0, 3)) if law == "fixed" else round(self._dice.uniform(0.0, 2.0), 2)
            table |= {"law": law, "delay": delay}
        if use == "contention" and self._dice.random() < 0.5:
            table = {**table, "radio": self._dice.choice(("BLE", "802.15.4", "ESP-NOW"))}
            table = {key: value for key, value in table.items() if key not in ("bytes_per_second", "overhead")}
        if use != "perfect" and self._dice.random() < LAYERED:
            table["over"] = self._channel()
        return table

    def _computation(self, use: str, strategy: str) -> Table:
        table = self._part("computation", use)
        if use != "occupancy-grid":
            if use == "average-consensus" and self._dice.random() < 0.5:
                table |= {"weights": "constant", "gain": 0.2}
            return table
        dice = self._dice
        for key, low, high in (
            ("hit", 0.7, 0.95),
            ("miss", 0.3, 0.45),
            ("lowest", 0.05, 0.25),
            ("highest", 0.955, 0.99),
        ):
            table.pop(key, None)
            if dice.random() < 0.3:
                table[key] = round(dice.uniform(low, high), 3)
        table["decay"] = dice.choice((0.0, 0.0, 0.0, 0.05))
        table.pop("quorum", None)
        if table.get("trust") == "quorum":
            if self._count < 3:
                table["trust"] = "own"
            elif dice.random() < 0.5:
                table["quorum"] = 2
        share = "tile-and-goal" if strategy in TOLD_GOALS else dice.choice(sorted(registry.known("sharing")))
        table["sharing"] = self._part("sharing", share)
        return table

    def _robots(self, sees: bool, ranges: bool) -> tuple[Any, Table]:
        """The robots and their sensor; of a mixed swarm both in one."""
        dice, narrow = (
            self._dice,
            [use for use in PLATFORMS if use not in ("turtlebot3-burger", "thymio", "khepera-iv")],
        )
        keys = {"mass": 0.3, "traction": 0.5, "acceleration": 0.8, "speed": 0.12, "wheel_base": 0.09, "radius": 0.05}
        own = {key: value for key, value in keys.items() if dice.random() < 0.1}
        if self._count > 2 and not ranges and dice.random() < 0.2:  # mixed swarms have no ranges
            first = dice.randint(1, self._count - 1)
            groups: list[Table] = [
                {"count": count, "use": dice.choice(narrow), **({"sensor": self._ring(ranges)} if sees else {})}
                for count in (first, self._count - first)
            ]
            return groups, {}
        robots: Table = {"count": self._count, **own}
        if dice.random() < 0.3:
            robots["use"] = dice.choice(narrow)
        if not sees and dice.random() < 0.4:
            return robots, {"use": "none"}
        sensor = self._ring(ranges)
        return robots, sensor if sees or dice.random() < 0.7 else {}

    def _ring(self, ranges: bool) -> Table:
        """A ring of beams, ideal or not."""
        dice = self._dice
        bearings = sorted(dice.sample(range(-170, 180, 10), dice.randint(6, 20)))
        round_about: Table = dice.choice(({}, {"beams": dice.randint(120, 200)}, {"bearings": bearings}))
        reach = round(dice.uniform(0.5, 1.4), 3)
        errors: Table = {}
        if dice.random() < 0.4:
            some = {
                "blind": 0.06, "cone": dice.choice((4.0, 20.0)), "error": 0.01, "error_share": 0.03,
                "error_square": 0.02, "drop_out": 0.1, "outliers": 0.05, "step": 0.01,
            }  # fmt: skip
            errors = {key: value for key, value in some.items() if dice.random() < 0.35}
            if "beams" not in round_about and dice.random() < 0.3:
                errors["preset"] = dice.choice(("sharp-gp2y0a21", "gternal", "ebot"))
        rest = {
            "reach": reach, "frame": dice.choice(("map", "robot")),
            "robots": dice.choice(("ignored", "occlude", "occupied")),
            "tile": [dice.randint(4, 8), dice.randint(4, 8)],
        }  # fmt: skip
        some_of_it = {key: value for key, value in rest.items() if dice.random() < 0.5}
        seen = {"ranges": True} if ranges or dice.random() < 0.5 else {}
        return {"use": "ir-ring", **round_about, **errors, **some_of_it, **seen}
