"""The verbs of radios: what messages take on the air, and keys that let robots trust them."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.cli.options import AllowCode, Overrides

if TYPE_CHECKING:
    from swarmsim.api.radios import OnRadio

app = typer.Typer(
    help="Messages on the air: their time on radios that exist, and keys.\n\nExample: swarmsim radio airtime basilica",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command()
def airtime(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (TOML).")],
    iterations: Annotated[int, typer.Option(min=1, help="Simulate so many iterations of each kind of sharing.")] = 200,
    set_: Overrides = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
    allow_code: AllowCode = False,
) -> None:
    """Print the bytes of a scenario's messages, and their time on LoRa, BLE, 802.15.4 and ESP-NOW.

    Example: swarmsim radio airtime basilica
    """
    from swarmsim.api.radios import radio_airtime
    from swarmsim.cli.tables import print_table

    found = radio_airtime(scenario, iterations=iterations, overrides=set_, allow_code=allow_code)
    if as_json:
        print(json.dumps([asdict(one) for one in found], indent=2))
        return
    radios = list(dict.fromkeys(one.radio for one in found))
    limits = {one.radio: one.mtu for one in found}
    rows = [
        [name, str(of[0].median), str(of[0].longest), *map(_time, of)]
        for name in dict.fromkeys(one.sharing for one in found)
        for of in [[one for one in found if one.sharing == name]]
    ]
    head = ("what is told", "bytes", "longest", *(f"{name}, <= {limits[name]} B" for name in radios))
    print_table("ms on the air for a message of median length; - if the longest fits into no frame", head, rows)


def _time(one: OnRadio) -> str:
    return "-" if one.longest > one.mtu else f"{1000.0 * one.airtime:.3g}"


@app.command()
def keys(
    robots: Annotated[int, typer.Argument(min=1, max=65_536, help="How many robots there are.")],
    out: Annotated[Path, typer.Option(help="New file; readable by you alone.")],
) -> None:
    """Write a secret for each robot and the world, for the transports `signed` and `zenoh`.

    Example: swarmsim radio keys 15 --out swarm.keys
    """
    from swarmsim.fleet.keyring import write_keys

    print(write_keys(robots, out))
