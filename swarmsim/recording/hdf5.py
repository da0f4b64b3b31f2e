"""HDF5 files: growing ones, and those left open by a killed writer."""

from __future__ import annotations

import io
import os
import re
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Final

import h5py
from h5py import h5f, h5i

from swarmsim.core.errors import StorageError, unwritten

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

if sys.platform == "linux":
    import fcntl

BEYOND: Final = 1 << 62  # the byte that a writer locks, beyond any file's end


class Growing:
    """A new file that a run appends to, readable by others while it grows.

    While it is open its writer holds a lock, by which `being_written` recognises a killed writer.
    """

    def __init__(self, path: Path) -> None:
        """Make the file. Raises FileExistsError, InputError for a wrong place, and StorageError for a full disk."""
        self.path = Path(path)
        try:
            #: The file, which the same process may read while it grows.
            self.file = h5py.File(path, "x", libver="latest")
        except FileExistsError:
            raise
        except OSError as problem:
            raise unwritten(path, problem, "a new file in a folder that can be written") from problem
        #: Whether all writing has succeeded.
        self.whole = True
        self._readable = False  # whether its head and some data are on the disk
        self._lock = _locked(self.path)

    @contextmanager
    def writing(self, kept: str) -> Iterator[None]:
        """A context of writing to the file; if it fails, the file is abandoned as it is.

        Raises StorageError, which says what was `kept`.
        """
        begun = self.file.swmr_mode
        try:
            yield
        except (OSError, RuntimeError) as problem:  # h5py's words for HDF5's failures
            self._abandon()
            raise StorageError(f"{self.path}: cannot be written ({_reason(problem)}); {kept}") from problem
        self._readable = begun

    def close(self, kept: str) -> None:
        """Close the file, if it is open and whole. Raises StorageError, which says what was `kept`."""
        if self.whole and self.file:
            with self.writing(kept):
                self.file.close()
            self._unlock()

    def _abandon(self) -> None:
        """Never close the file, and write nothing more: HDF5 crashes when it closes data that it could not write.

        Every identifier gets an extra reference, so neither Python nor the end of the process closes it. What HDF5
        still holds is lost; the disk keeps what was flushed.
        """
        self.whole = False
        if self.file:
            for one in h5f.get_obj_ids(self.file.id, h5f.OBJ_ALL):
                h5i.inc_ref(one)
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.dup2(nowhere, self.file.id.get_vfd_handle())
            os.close(nowhere)
            if not self._readable:
                self.path.unlink(missing_ok=True)
        self._unlock()

    def _unlock(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None


def _reason(problem: BaseException) -> str:
    """Why HDF5 could not write, in the system's words if it gives them."""
    if isinstance(problem, OSError) and problem.errno:
        return os.strerror(problem.errno)
    told = re.search(r"error message = '([^']+)'", str(problem))
    return told[1] if told else str(problem).partition("\n")[0]


def _locked(path: Path) -> BinaryIO | None:
    """A lock on a file for the life of this process; None where the system has no such locks."""
    if sys.platform != "linux":
        return None
    file = path.open("rb")
    try:
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, _lock(fcntl.F_RDLCK))
    except OSError:
        file.close()
        return None
    return file


def being_written(path: Path) -> bool | None:
    """Whether the writer of a file that was not closed still lives; None where the system cannot tell.

    Raises OSError.
    """
    with path.open("rb") as file:
        superblock = file.read(12)
        if len(superblock) < 12 or superblock[8] != 3 or superblock[11] == 0:
            return False
        if sys.platform != "linux":
            return None
        try:
            found = fcntl.fcntl(file, fcntl.F_OFD_GETLK, _lock(fcntl.F_WRLCK))
        except OSError:  # a file system without locks
            return None
    return bool(struct.unpack(_LOCK, found)[0] != fcntl.F_UNLCK)


_LOCK: Final = "hhqqi4x"  # struct flock of 64-bit Linux: type, whence, start, length, process


def _lock(kind: int) -> bytes:
    return struct.pack(_LOCK, kind, os.SEEK_SET, BEYOND, 1, 0)


def open_for_reading(path: Path) -> h5py.File:
    """The file at `path`, also if its writer was killed.

    HDF5 marks a file under writing, and refuses to open it without its writer. If the writer is gone, the mark is
    removed for reading.
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
    """A file with its first bytes replaced."""

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

    def readinto(self, buffer: WriteableBuffer) -> int:
        at = self._file.tell()
        read = self._file.readinto(buffer)  # type: ignore[attr-defined]
        mine = self._begin[at : at + read]
        memoryview(buffer).cast("B")[: len(mine)] = mine
        return int(read)

    def close(self) -> None:
        self._file.close()
        super().close()


def lookup3(data: bytes | bytearray) -> int:
    """Jenkins' lookup3 hash, HDF5's checksum of metadata; only for whole 32-bit words."""
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


def to_the_end(work: Callable[[], None]) -> None:
    """Complete some work even if Ctrl-C or SIGTERM arrives meanwhile; the interruption is raised afterwards."""
    failures: list[BaseException] = []

    def done() -> None:
        try:
            work()
        except BaseException as problem:
            failures.append(problem)

    thread = threading.Thread(target=done)
    thread.start()
    interruption: KeyboardInterrupt | None = None
    while thread.is_alive():
        try:
            thread.join()
        except KeyboardInterrupt as asked:
            interruption = asked
    if failures:
        raise failures[0]
    if interruption is not None:
        raise interruption
