"""Where links meet: an address of a host, and the interface of this machine on which they listen."""

from __future__ import annotations

import ipaddress
import socket
import struct
from dataclasses import dataclass
from typing import Final, Self

from swarmsim.core.errors import InputError

LOOPBACK: Final = "127.0.0.1"
_LOCAL: Final = "127.255.255.255"  # all on the loopback interface
_ADDRESS, _BROADCAST = 0x8915, 0x8919  # SIOCGIFADDR, SIOCGIFBRDADDR of Linux


@dataclass(frozen=True, slots=True)
class Address:
    """An address: that of the world's process, or where one would be."""

    host: str  # a number such as 192.168.1.20
    port: int

    @classmethod
    def of(cls, text: str, who: str) -> Self:
        """The place that HOST:PORT stands for. Raises InputError for text that is none, and for unknown names."""
        host, _, port = text.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65_535:
            raise InputError(
                f"{who}: {text!r} is no address; expected HOST:PORT with a port from 1 to 65534, such as "
                f"{LOOPBACK}:7447"
            )
        try:
            found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM)
        except (OSError, UnicodeError) as problem:
            raise InputError(f"{who}: no host is called {host!r}; expected its name or number") from problem
        return cls(str(found[0][4][0]), int(port))

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class Interface:
    """An interface of this machine."""

    name: str
    number: str  # its own address
    broadcast: str  # the address of all who are on it

    @classmethod
    def of(cls, called: str, who: str) -> Self:
        """The interface with this name or number. Raises InputError for an unknown one.

        Names and all but the loopback's number are known on Linux alone.
        """
        if called == LOOPBACK:
            return cls("lo", LOOPBACK, _LOCAL)
        known = {name: found for _, name in socket.if_nameindex() if (found := _numbers(name)) is not None}
        for name, (number, broadcast) in known.items():
            if called in (name, number):
                return cls(name, number, broadcast)
        listed = ", ".join(f"{name} ({number})" for name, (number, _) in known.items())
        raise InputError(f"{who}: interface: no {called!r} with an address here; expected one of {listed}")

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine is on it."""
        return ipaddress.ip_address(self.number).is_loopback

    def check_reaches(self, place: Address, who: str) -> None:
        """Raise InputError for a place beyond loopback, if links listen on loopback alone."""
        if self.is_loopback and not ipaddress.ip_address(place.host).is_loopback:
            raise InputError(
                f"{who}: {place} is beyond this machine, and links listen on {self.name} alone; expected "
                "`interface`, the name or number of the interface to listen on"
            )


def _numbers(name: str) -> tuple[str, str] | None:
    """An interface's own address and that of all on it; None without one."""
    try:
        import fcntl  # which Windows lacks
    except ImportError:
        return None
    asked = struct.pack("256s", name.encode()[:15])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        try:
            own = socket.inet_ntoa(fcntl.ioctl(any_socket, _ADDRESS, asked)[20:24])
            everyone = socket.inet_ntoa(fcntl.ioctl(any_socket, _BROADCAST, asked)[20:24])
        except OSError:
            return None
    return own, _LOCAL if ipaddress.ip_address(own).is_loopback else everyone
