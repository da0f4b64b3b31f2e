"""Radios that robots can have: how long a frame takes and may be, and who may send when, as published."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

Access = Literal["aloha", "slotted", "csma"]
LICENSED: Final = 0.01  # of an hour on the air, between 868.0 and 868.6 MHz (ETSI EN 300 220-2, table B.1)


@dataclass(frozen=True, slots=True)
class RadioKind:
    """A radio as robots would use it: broadcasts without answers."""

    mtu: int  # bytes of a codec that fit into one of its frames
    airtime: Callable[[int], float]  # s on the air for so many of them
    source: str
    access: Access = "aloha"  # how it finds its turn
    turnaround: float = 0.0  # s from listening to sending
    duty: float = 1.0  # share of an hour that it may be on the air

    def airtime_of(self, message: int) -> float:
        """The time in s for a message of so many bytes, in as many frames as it needs."""
        whole, rest = divmod(message, self.mtu)
        return whole * self.airtime(self.mtu) + (self.airtime(rest) if rest or not whole else 0.0)


def lora(spreading: int, length: int, bandwidth: float = 125e3) -> float:
    """The time on air of a LoRa frame with a payload of `length` bytes, in s.

    8 symbols of preamble, explicit header, checksum, coding rate 4/5; low data rate optimisation where a symbol takes
    more than 16 ms (Semtech, SX1276 datasheet, revision 7, section 4.1.1.7).
    """
    symbol = 2.0**spreading / bandwidth
    slow = symbol > 16e-3
    bits = 8 * length - 4 * spreading + 28 + 16
    symbols = 8 + max(math.ceil(bits / (4 * (spreading - 2 * slow))), 0) * 5
    return (8 + 4.25 + symbols) * symbol


def advertisement(length: int) -> float:
    """The time of a BLE advertisement with `length` bytes of a maker's data, on all three of its channels, in s.

    On each a preamble of 1 byte, an access address of 4, a header of 2, the sender's 6, a data header of 4 and a
    checksum of 3, at 1 Mbit/s (Bluetooth Core 5.4, volume 6, part B, section 2).
    """
    return 3 * 8e-6 * (1 + 4 + 2 + 6 + 4 + length + 3)


def extended_advertisement(length: int) -> float:
    """The time of an extended BLE advertisement, in s: 17 bytes on three channels, which point to one with the data.

    That has 24 bytes besides the maker's data (Bluetooth Core 5.4, volume 6, part B, section 2.3.4).
    """
    return 8e-6 * (3 * 17 + 1 + 4 + 2 + 1 + 1 + 6 + 2 + 4 + length + 3)


def ieee_802_15_4(length: int) -> float:
    """The time of an IEEE 802.15.4 broadcast at 250 kbit/s, in s.

    6 bytes for synchronisation and length, 9 of MAC header with short addresses, 2 of checksum (IEEE 802.15.4-2020,
    sections 7.2 and 12.1).
    """
    return 32e-6 * (6 + 9 + length + 2)


def esp_now(length: int) -> float:
    """The time of an ESP-NOW broadcast at 1 Mbit/s, in s.

    A preamble of 192 us, then 24 bytes of MAC header, 8 of category, maker and random value, 7 of the maker's element,
    and 4 of checksum (Espressif, ESP-IDF programming guide, ESP-NOW).
    """
    return 192e-6 + 8e-6 * (24 + 8 + 7 + length + 4)


#: By name. LoRa's mtu is that of the chip; LoRaWAN allows 222 bytes at SF7 and 51 at SF12.
RADIOS: Final[Mapping[str, RadioKind]] = {
    "LoRa SF7": RadioKind(255, lambda length: lora(7, length), "Semtech SX1276", duty=LICENSED),
    "LoRa SF12": RadioKind(255, lambda length: lora(12, length), "Semtech SX1276", duty=LICENSED),
    "BLE": RadioKind(27, advertisement, "Bluetooth Core 5.4"),
    "BLE extended": RadioKind(241, extended_advertisement, "Bluetooth Core 5.4"),
    "802.15.4": RadioKind(116, ieee_802_15_4, "IEEE 802.15.4-2020", "csma", 192e-6),  # 12 symbols (section 11.3)
    "ESP-NOW": RadioKind(250, esp_now, "Espressif ESP-NOW", "csma", 10e-6),  # aSIFSTime (IEEE 802.11-2020, table 15-8)
}
