"""The transport that is most like a radio: broadcast datagrams on one interface, and no library."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time
from collections.abc import Mapping
from typing import Annotated, Final

from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.fleet.addresses import LOOPBACK, Address, Interface
from swarmsim.fleet.keyring import key_of, read_keys
from swarmsim.fleet.mailbox import AIR, BoxedLink, Mailbox
from swarmsim.fleet.switch import LARGEST, Switch
from swarmsim.fleet.transport import WORLD
from swarmsim.fleet.transports.beacons import GONE, HERE, LONGEST, Beacons

_WHO: Final = "transport udp"  # in messages
_LOOK: Final = 0.1  # s between two looks at what waits to be sent
_BEACONS: Final = 6  # in the time of silence after which a robot counts as gone; more would take a large swarm's time
_AT_ONCE: Final = 1024  # datagrams that are read from one socket before others have their turn
_FRAMING: Final = 28 + 8 + 28  # bytes: UDP and IP, LLC, and the header and checksum of IEEE 802.11
_PREAMBLE: Final = 192e-6  # s, the long preamble of IEEE 802.11b, which goes before broadcasts


class Udp(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Frames as broadcast datagrams: all on the interface hear them, and what is lost is lost.

    The address is HOST:PORT. Frames go to PORT, beacons that say who is there to PORT + 1, and channels by TCP to the
    world's process, which listens at the address; robots without a world need no host there. Needs Linux.
    """

    interface: str = LOOPBACK  # name or number of the interface to speak and listen on
    keys: str = ""  # a file of keys, from `swarmsim radio keys`, that signs beacons; frames are signed by `signed`
    patience: Annotated[float, Meta(gt=0.0, le=3600.0)] = 5.0  # s, in which the host has to answer
    silence: Annotated[float, Meta(gt=0.1, le=3600.0)] = 3.0  # s without a beacon, after which a robot counts as gone
    mtu: Annotated[int, Meta(ge=1, le=65_507)] = 1472  # bytes of the longest frame: what one Ethernet frame holds
    rate: Annotated[float, Meta(gt=0.0)] = 1e6  # bit/s, of broadcasts on Wi-Fi, for the airtime that is told

    def open(self, address: str, robot: int) -> BoxedLink:
        """Join all on the interface. Raises InputError for an address that is none or is taken."""
        place, interface = Address.of(address, _WHO), Interface.of(self.interface, _WHO)
        interface.check_reaches(place, _WHO)
        return _Station(self, place, interface, robot).link()

    def secrets(self, robot: int) -> Mapping[int, bytes]:
        """The keys of all, by number; none without a file. Raises InputError for a file without the robot's own."""
        if not self.keys:
            return {}
        found = read_keys(self.keys, "udp")
        key_of(robot, found, self.keys, "udp")
        return found

    def airtime(self, length: int) -> float:
        """The time of a broadcast on Wi-Fi at the rate, in s."""
        return _PREAMBLE + 8.0 * (length + _FRAMING) / self.rate


class _Station:
    """The sockets of one link, and the thread that listens to them."""

    def __init__(self, keys: Udp, place: Address, interface: Interface, robot: int) -> None:
        self._keys, self._place, self._interface, self._robot = keys, place, interface, robot
        self._box = Mailbox(AIR)
        secrets = keys.secrets(robot)
        self._ends = threading.Event()
        places = (interface.broadcast, place.port), (interface.broadcast, place.port + 1), (interface.number, 0)
        with contextlib.ExitStack() as opened:
            listening = opened.enter_context(_listening(place)) if robot == WORLD else None
            self._air, self._beacons, self._voice = (opened.enter_context(_bound(one)) for one in places)
            opened.pop_all()  # all are there, and stay open
        self._me = self._voice.getsockname()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._air, selectors.EVENT_READ, self._take_frames)
        self._selector.register(self._beacons, selectors.EVENT_READ, self._take_beacons)
        self._switch = Switch(place, listening, self._selector)
        self._box.counts = self._switch.counts
        self._known = Beacons(robot, keys.silence, secrets, self._switch.counts)
        self._thread = threading.Thread(target=self._run, daemon=True, name=f"udp {robot}")
        self._thread.start()

    def link(self) -> BoxedLink:
        """The link on the air."""
        keys = self._keys
        return BoxedLink("udp", keys.mtu, self._box, self._say, keys.airtime, self._others, self._channel, self._leave)

    def _channel(self, name: str) -> BoxedLink:
        box = self._switch.open(name, self._keys.patience)
        return BoxedLink(
            "udp", LARGEST, box, lambda telegram: self._switch.say(name, bytes(telegram), box), self._keys.airtime,
            self._others, self._channel, lambda: self._switch.leave(name, box),
        )  # fmt: skip

    def _say(self, frame: bytes) -> None:
        self._send(frame, self._place.port)

    def _send(self, frame: bytes, port: int) -> None:
        try:
            self._voice.sendto(frame, (self._interface.broadcast, port))
        except OSError:  # as without a network, or while the system's buffer is full
            self._box.counts["unsent"] += 1

    def _run(self) -> None:
        due = 0.0
        while not self._ends.is_set():
            if time.monotonic() >= due:
                self._send(self._known.made(HERE), self._place.port + 1)
                due = time.monotonic() + self._keys.silence / _BEACONS
            for key, _ in self._selector.select(min(_LOOK, self._keys.silence / _BEACONS)):
                key.data()
            self._switch.flush()

    def _take_frames(self) -> None:
        for frame in self._received(self._air, self._keys.mtu):
            self._box.put(frame)

    def _take_beacons(self) -> None:
        for frame in self._received(self._beacons, LONGEST):
            self._known.take(frame)

    def _received(self, heard: socket.socket, most: int) -> list[bytes]:
        """What waits at a socket and is not our own; frames that are too long are counted."""
        found = list[bytes]()
        for _ in range(_AT_ONCE):
            try:
                frame, origin = heard.recvfrom(most + 1)
            except OSError:
                break
            if origin != self._me:
                if len(frame) > most:
                    self._box.counts["too long"] += 1
                else:
                    found.append(frame)
        return found

    def _others(self) -> set[int]:
        return self._known.present

    def _leave(self) -> None:
        self._ends.set()
        self._thread.join()
        self._send(self._known.made(GONE), self._place.port + 1)
        self._switch.close()
        self._selector.close()
        for one in (self._air, self._beacons, self._voice):
            one.close()


def _bound(to: tuple[str, int]) -> socket.socket:
    """A socket for datagrams at an address, which other links on this machine share. Raises InputError."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setblocking(False)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    try:
        made.bind(to)
    except OSError as problem:
        made.close()
        raise InputError(f"transport udp: {to[0]}:{to[1]} is taken; expected a free port") from problem
    return made


def _listening(place: Address) -> socket.socket:
    """A socket that accepts the connections of channels. Raises InputError."""
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((place.host, place.port))
    except OSError as problem:
        made.close()
        raise InputError(
            f"transport udp: cannot listen at {place}: the port is taken, or the host is not this machine; expected a "
            "free one"
        ) from problem
    made.listen(64)
    return made
