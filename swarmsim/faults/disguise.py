"""A computation around another one, which does all but what a fault changes."""

from __future__ import annotations

from abc import ABC
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.messages import Codec, Columns, Inbox, Said
from swarmsim.core.parts import AnyComputation
from swarmsim.core.state import Knowledge, Senses


class WrappedComputation(ABC):
    """Passes everything on."""

    def __init__(self, inner: AnyComputation) -> None:
        self._inner = inner

    @property
    def knows(self) -> type[Knowledge]:
        """What the computation inside gives."""
        return self._inner.knows

    @property
    def codec(self) -> Codec[Any]:
        """That of the computation inside."""
        return self._inner.codec

    @property
    def maps(self) -> Any:
        """The maps of robots that map; None if they do not."""
        return getattr(self._inner, "maps", None)

    def say(self, senses: Senses) -> Said[Columns]:
        """What the computation inside says."""
        return self._inner.say(senses)

    def hear(self, senses: Senses, inbox: Inbox[Columns]) -> Knowledge:
        """What the computation inside knows."""
        return self._inner.hear(senses, inbox)

    def forget(self, robots: NDArray[np.int64]) -> None:
        """Pass it on."""
        self._inner.forget(robots)

    def adopt(self, robots: NDArray[np.int64], source: int) -> None:
        """Pass it on."""
        self._inner.adopt(robots, source)
