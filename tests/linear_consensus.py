"""The response of heading consensus to a leader that turns to and fro, by the linear equation.

`python tests/linear_consensus.py DIR` prints the responses over many networks and draws them into DIR.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from swarmsim.studies.peak import peak, sentences
from swarmsim.view import plots

DRIVES = {0.002: 1.0, 0.005: 1.0, 0.02: 0.5, 0.1: 0.5}  # Hz: s, the period
KS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 99)
NETWORKS = 400


def linear_response(hears: np.ndarray, frequency: float, period: float) -> float:
    """H^2 of robots 1, 2, ... to robot 0 by Eq. 1 without wrapping, once transients have died out.

    `hears` (n, n) are the weights 1 / k of those that each robot hears; z is one step of the drive, per second.
    """
    z = (np.exp(2j * np.pi * frequency * period) - 1.0) / period
    h = np.linalg.solve((z + 1.0) * np.eye(len(hears) - 1) - hears[1:, 1:], hears[1:, 0])
    return float((np.abs(h) ** 2).sum())


def linear_responses(
    ks: Sequence[int], frequency: float, period: float, robots: int = 100, networks: int = 300
) -> np.ndarray:
    """The linear H^2 (networks, k) of the k nearest among robots scattered evenly in an arena without edges."""
    found = np.empty((networks, len(ks)))
    for network, places in enumerate(np.random.default_rng(0).random((networks, robots, 2))):
        near = KDTree(places, boxsize=1.0).query(places, max(ks) + 1)[1][:, 1:]
        for column, k in enumerate(ks):
            hears = np.zeros((robots, robots))
            np.put_along_axis(hears, near[:, :k], 1.0 / k, axis=1)
            found[network, column] = linear_response(hears, frequency, period)
    return found


def main(folder: Path) -> None:
    """Print the means with standard errors and the best k, and draw the figure."""
    drawn = {}
    for frequency, period in DRIVES.items():
        table = linear_responses(KS, frequency, period, networks=NETWORKS)
        mean, error = table.mean(axis=0), table.std(axis=0, ddof=1) / np.sqrt(NETWORKS)
        cells = (f"{k}: {m:.3g} ± {e:.2g}" for k, m, e in zip(KS, mean, error, strict=True))
        print(f"{frequency} Hz, k: {', '.join(cells)}")
        print(*sentences([peak(f"{frequency} Hz", KS, table, "highest")], "H^2", "k", "highest"))
        ends = np.stack([mean - 1.96 * error, mean + 1.96 * error], axis=1)
        drawn[f"{frequency} Hz"] = plots.Steps(np.array(KS, float), mean, ends, np.zeros(len(KS)), [NETWORKS] * len(KS))
    for robots in (50, 200):
        table = linear_responses(KS[:6], 0.02, 0.5, robots, NETWORKS)
        print(*sentences([peak(f"0.02 Hz, {robots} robots", KS[:6], table, "highest")], "H^2", "k", "highest"))
    title = "Collective response of 100 robots, by the linear equation"
    print(
        *plots.save(
            plots.sweep(drawn, {}, "neighbours heard, k", title, "response, H^2"), folder / "consensus-response"
        )
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
