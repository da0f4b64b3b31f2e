"""How fast sweeps converge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from swarmsim.core.jobs import Values
from swarmsim.operations.methods.problem import Patch, Problem

Sweep = Callable[
    [Values, Values], Values
]  # from a right side (c, k) and the values (s, k) of the cells seen, to (c, k)

_POWERS: Final = 60


def bound(problem: Problem, patches: Sequence[Patch], sweeps: Sequence[Sweep], every: bool) -> float:
    """An upper bound of block Jacobi's spectral radius rho: the least of some quotients of Collatz and Wielandt.

    The matrix G of a sweep has no negative entry, so rho <= max_i (G x)_i / x_i for any x > 0; x = G^k 1 makes it
    close. If pieces solve their own cells exactly, only the cells that others read count, since G's other columns are
    empty; otherwise `every` one does.
    """
    fields = problem.equations.fields
    read = np.unique(np.concatenate([patch.seen if every else patch.seen[patch.others] for patch in patches]))
    if not len(read):
        return 0.0
    now, found = np.ones((problem.equations.operators[0].shape[0], fields)), np.ones(fields)
    for _ in range(_POWERS):
        after = np.zeros_like(now)
        for patch, sweep in zip(patches, sweeps, strict=True):
            after[patch.own] = sweep(np.zeros((len(patch.own), fields)), now[patch.seen])
        top = after[read].max(axis=0)
        if not top.all():  # cells without neighbours
            return 0.0
        found, now = np.minimum(found, (after[read] / now[read]).max(axis=0)), after / top
    return min(float(found.max()) * (1.0 + 1e-9), 1.0 - 1e-15)
