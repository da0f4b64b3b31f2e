"""Opens HDF5 files, also those whose writer was killed."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, BinaryIO

import h5py


def open_for_reading(path: Path) -> h5py.File:
    """The file at `path`, also if its writer was killed.

    HDF5 marks a file that is being written and opens a marked one only by waiting for its writer. Where no
    writer is left, the mark is taken off while the file is read.
    """
    with path.open("rb") as file:
        superblock = bytearray(file.read(48))
    if len(superblock) < 48 or superblock[8] != 3 or superblock[11] == 0:
        return h5py.File(path, "r")
    superblock[11] = 0
    superblock[28:36] = path.stat().st_size.to_bytes(8, "little")  # the end of the file
    superblock[44:48] = lookup3(superblock[:44]).to_bytes(4, "little")
    return h5py.File(_Begun(bytes(superblock), path.open("rb")), "r")


class _Begun(io.RawIOBase):
    """A file whose first bytes are others."""

    def __init__(self, begin: bytes, file: BinaryIO) -> None:
        self._begin, self._file = begin, file

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def readinto(self, buffer: Any) -> int:
        at = self._file.tell()
        read = self._file.readinto(buffer)  # type: ignore[attr-defined]
        mine = self._begin[at : at + read]
        memoryview(buffer).cast("B")[: len(mine)] = mine
        return int(read)

    def close(self) -> None:
        self._file.close()
        super().close()


def lookup3(data: bytes | bytearray) -> int:
    """Jenkins' lookup3 hash, HDF5's checksum of metadata; of whole 32-bit words, for which it is shortest."""
    words = [int.from_bytes(data[at : at + 4], "little") for at in range(0, len(data), 4)]
    a = b = c = 0xDEADBEEF + len(data)

    def turned(x: int, bits: int) -> int:
        x &= 0xFFFFFFFF
        return x << bits | x >> (32 - bits)

    while len(words) > 3:
        a, b, c, words = a + words[0], b + words[1], c + words[2], words[3:]
        for bits in (4, 6, 8, 16, 19, 4):
            a, b, c = b, c + b, (a - c) ^ turned(c, bits)
    a, b, c = (x + word for x, word in zip((a, b, c), [*words, 0, 0], strict=False))
    for bits in (14, 11, 25, 16, 4, 14, 24):
        a, b, c = b, (c ^ b) - turned(b, bits), a
    return b & 0xFFFFFFFF
