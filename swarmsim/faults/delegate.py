"""Delegates to a wrapped computation; faults override single methods."""

from __future__ import annotations

from abc import ABC
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.messages import Broadcast, Codec, Inbox, MessageBatch
from swarmsim.core.parts import AnyComputation
from swarmsim.core.state import Knowledge, Senses


class ComputationDelegate(ABC):
    """Passes everything on."""

    def __init__(self, inner: AnyComputation) -> None:
        self._inner = inner

    @property
    def knowledge_type(self) -> type[Knowledge]:
        """The wrapped computation's knowledge type."""
        return self._inner.knowledge_type

    @property
    def codec(self) -> Codec[MessageBatch]:
        """The wrapped computation's codec."""
        return self._inner.codec

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - what the computation has
        """Other attributes of the wrapped computation."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._inner, name)

    def say(self, senses: Senses) -> Broadcast[MessageBatch]:
        """The wrapped computation's message."""
        return self._inner.say(senses)

    def hear(self, senses: Senses, inbox: Inbox[MessageBatch]) -> Knowledge:
        """The wrapped computation's knowledge."""
        return self._inner.hear(senses, inbox)

    def reset(self, robots: NDArray[np.int64]) -> None:
        self._inner.reset(robots)

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        self._inner.copy_from(robots, source)
