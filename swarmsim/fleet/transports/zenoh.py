"""The transport of IP networks: eclipse-zenoh, every robot connected to every other, and no broker."""

from __future__ import annotations

import json
import socket
import threading
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.fleet.addresses import LOOPBACK, Address, Interface
from swarmsim.fleet.keyring import key_of, read_keys, user
from swarmsim.fleet.mailbox import AIR, CONTROL, BoxedLink, Mailbox
from swarmsim.fleet.transport import WORLD, LinkError

if TYPE_CHECKING:
    import zenoh

_WHO: Final = "transport zenoh"  # in messages
_LARGEST: Final = 2**24
_FRAMING: Final = 16 + 52 + 38  # bytes: zenoh's own, TCP and IP with timestamps, Ethernet with its gap
_SAYS: Final = ["put", "liveliness_token"]  # what zenoh calls speaking and being there
_HEARS: Final = ["declare_subscriber", "liveliness_query", "declare_liveliness_subscriber"]
_FLUSH: Final = 1.0  # s, in which telegrams that wait still get out on closing


class Zenoh(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Frames by eclipse-zenoh over TCP, from each to each; `WORLD` listens at the address, HOST:PORT.

    A robot joins there, hears of all others and connects to them; when the world has gone they stay connected. Frames
    to a robot that takes none are dropped; telegrams to it wait in a thread of their channel. With `keys`, all goes
    through the world instead, which lets a robot in by its number and its key alone, to speak on the air as itself and
    on channels whose names end in its number. Nothing is encrypted.
    """

    interface: str = LOOPBACK  # name or number of the interface to listen on
    swarm: Annotated[str, Meta(pattern=r"^[\w-]+$")] = "swarm"  # swarms of different names share a network unheard
    keys: str = ""  # a file of keys, from `swarmsim radio keys`: who has none stays out, and nobody speaks for another
    patience: Annotated[float, Meta(gt=0.0, le=3600.0)] = 5.0  # s, in which the host has to answer
    mtu: Annotated[int, Meta(ge=1, le=_LARGEST)] = 65_535  # bytes of the longest frame
    rate: Annotated[float, Meta(gt=0.0)] = 1e8  # bit/s, for the airtime that is told

    def open(self, address: str, robot: int) -> BoxedLink:
        """Join the swarm. Raises InputError for an address that is none, is taken, or does not answer."""
        place, interface = Address.of(address, _WHO), Interface.of(self.interface, _WHO)
        interface.check_reaches(place, _WHO)
        return _Session(self, robot, _opened(self, place, interface, robot)).link()

    def airtime(self, length: int) -> float:
        """The time of a frame and its framing at the rate, in s."""
        return 8.0 * (length + _FRAMING) / self.rate


def _opened(keys: Zenoh, place: Address, interface: Interface, robot: int) -> zenoh.Session:
    try:
        import zenoh  # an extra
    except ImportError as problem:
        raise InputError(
            "transport zenoh: needs eclipse-zenoh; install it with: pip install eclipse-zenoh"
        ) from problem
    config = zenoh.Config()
    for key, value in (_meshed(keys, place, interface, robot) | (_guarded(keys, robot) if keys.keys else {})).items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as problem:
        raise InputError(f"transport zenoh: {_why(place, robot, keys.patience)}") from problem


def _meshed(keys: Zenoh, place: Address, interface: Interface, robot: int) -> dict[str, object]:
    """The configuration of a session that is connected to every other."""
    return {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "listen/endpoints": [f"tcp/{place if robot == WORLD else f'{interface.number}:0'}"],
        "listen/timeout_ms": 0,
        "listen/exit_on_failure": True,
        "connect/endpoints": [] if robot == WORLD else [f"tcp/{place}"],
        "connect/timeout_ms": int(1000 * keys.patience),
        "connect/exit_on_failure": True,
    }


def _guarded(keys: Zenoh, robot: int) -> dict[str, object]:
    """What changes in it if there are keys: a robot logs in at the world, which says who may say what.

    Only who is connected to learns the other's name, so a mesh could not do that. Raises InputError.
    """
    known, swarm = read_keys(keys.keys, "zenoh"), keys.swarm
    own = key_of(robot, known, keys.keys, "zenoh")
    if robot != WORLD:
        logs_in = {"transport/auth/usrpwd/user": user(robot), "transport/auth/usrpwd/password": own.hex()}
        return {"mode": "client", "listen/endpoints": [], **logs_in}
    robots = [user(one) for one in known if one != WORLD]
    rules = [_rule("hear", "ingress", _HEARS, f"{swarm}/**"), _rule("tell", "egress", _HEARS + _SAYS, f"{swarm}/**")]
    policies, subjects = [{"rules": ["hear", "tell"], "subjects": robots}], []
    for one in (number for number in known if number != WORLD):
        own_places = f"{swarm}/air/{one}", f"{swarm}/here/{one}", f"{swarm}/control/**/{one}"
        rules.append(_rule(f"as {user(one)}", "ingress", _SAYS, *own_places))
        subjects.append({"id": user(one), "usernames": [user(one)]})
        policies.append({"rules": [f"as {user(one)}"], "subjects": [user(one)]})
    access = {"default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}
    return {
        "mode": "router",
        "transport/auth/usrpwd/dictionary_file": str(Path(keys.keys).resolve()),
        "access_control": {"enabled": True, **access},
    }


def _rule(name: str, flow: str, messages: list[str], *places: str) -> dict[str, object]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": list(places)}


def _why(place: Address, robot: int, patience: float) -> str:
    """Why a session could not be opened."""
    if robot == WORLD:
        return f"cannot listen at {place}: the port is taken, or the host is not this machine; expected a free one"
    try:
        with socket.create_connection((place.host, place.port), timeout=1.0):
            return f"{place} answers, but does not let robot {robot} in; expected a world over zenoh, and the same keys"
    except OSError:
        return f"nobody answers at {place} within {patience:g} s; expected a world that has been started there"


class _Session:
    """A zenoh session of one robot: its topics are keys, and a token says that it is there."""

    def __init__(self, keys: Zenoh, robot: int, session: zenoh.Session) -> None:
        import zenoh

        self._keys, self._robot, self._session, self._zenoh = keys, robot, session, zenoh
        self._there: set[int] = set()
        self._lock = threading.Lock()

    def link(self) -> BoxedLink:
        """The link on the air; the robot is there for others once it can hear them."""
        box, name = Mailbox(AIR), self._keys.swarm
        held = [self._subscriber(f"{name}/air/*", box)]
        publisher = self._publisher(f"{name}/air/{self._robot}", self._zenoh.CongestionControl.DROP)
        held.append(self._session.liveliness().declare_subscriber(f"{name}/here/*", self._changed, history=True))
        held.append(self._session.liveliness().declare_token(f"{name}/here/{self._robot}"))

        def leave() -> None:
            held.clear()  # zenoh drops what nobody holds
            self._session.close()

        return BoxedLink(
            "zenoh", self._keys.mtu, box, publisher.put, self._keys.airtime, self._others, self._channel, leave
        )

    def _channel(self, name: str) -> BoxedLink:
        box, key = Mailbox(CONTROL, f"transport zenoh: channel {name}"), f"{self._keys.swarm}/control/{name}"
        outbox = _Outbox(self._publisher(key, self._zenoh.CongestionControl.BLOCK), name)
        held = [self._subscriber(key, box)]

        def leave() -> None:
            outbox.close()
            held.clear()

        return BoxedLink("zenoh", _LARGEST, box, outbox.put, self._keys.airtime, self._others, self._channel, leave)

    def _subscriber(self, key: str, box: Mailbox) -> object:
        def take(sample: zenoh.Sample) -> None:
            box.put(sample.payload.to_bytes())

        return self._session.declare_subscriber(key, take, allowed_origin=self._zenoh.Locality.REMOTE)

    def _publisher(self, key: str, congestion: zenoh.CongestionControl) -> zenoh.Publisher:
        return self._session.declare_publisher(
            key,
            congestion_control=congestion,
            express=True,
            allowed_destination=self._zenoh.Locality.REMOTE,
            # A lane of its own for the air: frames would wait for a telegram that blocks theirs.
            priority=self._zenoh.Priority.INTERACTIVE_HIGH
            if congestion == self._zenoh.CongestionControl.DROP
            else None,
        )

    def _changed(self, sample: zenoh.Sample) -> None:
        number = str(sample.key_expr).rpartition("/")[2]
        if not number.removeprefix("-").isdecimal():
            return
        with self._lock:
            if sample.kind == self._zenoh.SampleKind.PUT:
                self._there.add(int(number))
            else:
                self._there.discard(int(number))

    def _others(self) -> set[int]:
        with self._lock:
            return self._there - {self._robot}


class _Outbox:
    """Telegrams on their way to a channel, from a thread of their own: who takes none holds up nobody else."""

    def __init__(self, publisher: zenoh.Publisher, name: str) -> None:
        self._publisher, self._name = publisher, name
        self._changed = threading.Condition()
        self._waiting = deque[bytes]()
        self._taken = 0  # bytes that wait
        self._ends = False
        self._thread: threading.Thread | None = None

    def put(self, telegram: bytes) -> None:
        """Send it after those before. Raises LinkError if more than CONTROL bytes wait already."""
        with self._changed:
            if self._taken > CONTROL:
                raise LinkError(f"transport zenoh: channel {self._name}: {self._taken} bytes wait for who takes none")
            self._taken += len(telegram)
            self._waiting.append(bytes(telegram))
            self._changed.notify()
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, daemon=True, name=f"channel {self._name}")
                self._thread.start()

    def close(self) -> None:
        """End once all is sent, or after _FLUSH s."""
        with self._changed:
            self._ends = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(_FLUSH)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: bool(self._waiting) or self._ends)
                if not self._waiting:
                    return
                telegram = self._waiting.popleft()
                self._taken -= len(telegram)
            try:
                self._publisher.put(telegram)
            except Exception:  # zenoh's own kind: the session has ended meanwhile
                return
