"""Trust: frames with a tag that only those who know a secret can make, over any other transport."""

from __future__ import annotations

import hmac
from collections import Counter
from collections.abc import Mapping
from typing import Annotated, Final, final

from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.messages import HEADER
from swarmsim.core.scenario.part import Part
from swarmsim.fleet.emergency import Halt
from swarmsim.fleet.keyring import TAG, key_of, read_keys, tag
from swarmsim.fleet.transport import WORLD, Heard, RobotLink, Transport, check_length

_PURPOSE: Final = b"swarmsim frames"
_MOST: Final = 64  # frames of a robot in an iteration that are told apart; more count as replayed


class Signed(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A tag of 8 bytes after each frame, keyed BLAKE2b (RFC 7693); what is forged or said again is not heard.

    Each robot signs with its own key. All keys are in one file that every robot has, so a robot that is taken over can
    sign for any other; orders of the emergency stop are signed with the world's. The sender's number and the iteration
    stand in the frame, where codecs put them. Channels are not signed.
    """

    over: Part[Transport] = Part("transport")  # what carries the frames
    keys: str  # the file of keys, from `swarmsim radio keys`
    window: Annotated[int, Meta(ge=1, le=10**6)] = 64  # iterations that a frame may be late
    header: Annotated[int, Meta(ge=0, le=255)] = 0  # bytes before the sender's number: 1 if robots merge maps

    def open(self, address: str, robot: int) -> SignedLink:
        """Join by the transport beneath. Raises InputError, also for a file without one's own key."""
        keys = read_keys(self.keys, "signed")
        key_of(robot, keys, self.keys, "signed")
        transport = self.over.build(None, "over")
        return SignedLink(transport.open(address, robot), robot, keys, self.window, self.header)


class _Window:
    """What was heard of one robot lately: tags by iteration, as a tag stands for its frame."""

    def __init__(self) -> None:
        self.newest = -1
        self._tags: dict[int, set[bytes]] = {}

    def admits(self, iteration: int, tag: bytes, oldest: int) -> bool:
        """Whether this frame is not known and not too old; it is known from now on."""
        if iteration < oldest or tag in self._tags.get(iteration, ()):
            return False
        for old in [one for one in self._tags if one < oldest]:
            del self._tags[old]
        tags = self._tags.setdefault(iteration, set())
        if len(tags) >= _MOST:
            return False
        tags.add(tag)
        self.newest = max(self.newest, iteration)
        return True


@final
class SignedLink:
    """A link whose frames are signed, and which counts what it does not let through.

    Reasons: `forged` (nobody's key fits), `wrong key` (another robot's key fits), `replayed` (heard before, or older
    than the window), `too long`, `too short`, `unknown` (no robot of this number has a key).
    """

    def __init__(self, link: RobotLink, robot: int, keys: Mapping[int, bytes], window: int, header: int) -> None:
        self._link, self._robot, self._keys, self._within, self._header = link, robot, keys, window, header
        self._windows: dict[int, _Window] = {}
        self._now = 0  # the latest iteration of one's own
        self._refused = Counter[str]()
        self.mtu = link.mtu - TAG
        if self.mtu < header + HEADER.size:
            raise InputError(
                f"transport signed: frames of {link.mtu} bytes leave {self.mtu} beside the tag; expected more"
            )

    @property
    def counts(self) -> Mapping[str, int]:
        return Counter(self._link.counts) + self._refused

    def say(self, frame: bytes) -> None:
        check_length(frame, self.mtu, "signed")
        sender, iteration = self._stamp(frame)
        if sender not in self._keys:
            raise InputError(
                f"transport signed: a frame names {sender} as its sender, who has no key; expected `header`, the bytes "
                "before the sender's number, and a key for each robot"
            )
        self._now = max(self._now, iteration)
        self._link.say(frame + tag(frame, self._keys[self._robot], _PURPOSE))

    def heard(self) -> list[Heard]:
        found = []
        for signed, strength in self._link.heard():
            frame = signed[:-TAG]
            if why := self._why_not(frame, signed[-TAG:]):
                self._refused[why] += 1
            else:
                found.append((frame, strength))
        return found

    def wait(self, seconds: float) -> bool:
        return self._link.wait(seconds)

    def airtime(self, length: int) -> float:
        return self._link.airtime(length + TAG)

    def present(self) -> set[int]:
        return self._link.present()

    def channel(self, name: str) -> RobotLink:
        return self._link.channel(name)

    def close(self) -> None:
        self._link.close()

    def _stamp(self, frame: bytes) -> tuple[int, int]:
        """The sender and iteration that a frame names; the world for an order. Raises InputError for one without."""
        if (order := Halt.read(frame)) is not None:
            return WORLD, order.when
        if len(frame) < self._header + HEADER.size:
            raise InputError(f"transport signed: a frame of {len(frame)} bytes names no sender and iteration")
        sender, iteration = HEADER.unpack_from(frame, self._header)
        return sender, iteration

    def _why_not(self, frame: bytes, signed: bytes) -> str:
        """Why a frame is not let through; empty if it is."""
        if len(frame) > self.mtu:
            return "too long"
        if len(frame) < self._header + HEADER.size:
            return "too short"
        sender, iteration = self._stamp(frame)
        if sender not in self._keys:
            return "unknown"
        if not hmac.compare_digest(signed, tag(frame, self._keys[sender], _PURPOSE)):
            others = any(hmac.compare_digest(signed, tag(frame, key, _PURPOSE)) for key in self._keys.values())
            return "wrong key" if others else "forged"
        window = self._windows.setdefault(sender, _Window())
        oldest = max(window.newest, self._now) - self._within
        return "" if window.admits(iteration, signed, oldest) else "replayed"
