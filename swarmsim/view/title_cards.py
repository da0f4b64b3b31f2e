"""The first and last cards of a film: the scenario, and the result."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pygame

from swarmsim.view.lettering import Lettering
from swarmsim.view.panel import clock
from swarmsim.view.theme import Theme
from swarmsim.view.wording import fault_line, worded_value

if TYPE_CHECKING:
    from swarmsim.recording.reader import Recording
    from swarmsim.view.scene import Scene

FAULTS = 4  # named on the first card


def first_lines(recording: Recording, scene: Scene) -> list[str]:
    """The scenario in a few lines: title, swarm, network, faults."""
    scenario = recording.scenario
    robots = f"{scenario.robots.count} robot{'s' if scenario.robots.count != 1 else ''}"
    where = f" in {scene.world}" if scene.world else ""
    channel = "" if scenario.network.channel.declares("perfect", False) else f", channel {scene.channel}"
    lines = [scenario.title, f"{robots}{where}, seed {scenario.seed}", f"network: {scene.topology}{channel}"]
    faults = [fault_line(fault) for fault in scenario.faults]
    lines += [f"fault: {text}" for text in faults[:FAULTS]]
    return [*lines, *([f"and {len(faults) - FAULTS} more"] if len(faults) > FAULTS else [])]


def last_lines(recording: Recording, scene: Scene) -> list[str]:
    """The result: status, the task's measure, robots and messages."""
    summary, curve = recording.summary(), recording.curve
    name, value = curve.label.partition(", ")[0], worded_value(curve, summary["measures"][curve.name])
    lost = sum(summary["lost"].values())
    return [
        f"{summary['status']} after {recording.iterations} iterations",
        f"{name} {value} in {clock(recording.iterations * scene.period)}",
        f"{summary['alive']} of {summary['robots']} robots alive",
        f"{summary['messages']:,} messages heard" + (f", {lost:,} lost" if lost else ""),
    ]


def draw_card(surface: pygame.Surface, lines: list[str], theme: Theme, letters: Lettering) -> None:
    """Write lines on a card in the middle of a dimmed picture, the first one largest."""
    width, height = surface.get_size()
    unit = min(width / 1280, height / 720)
    veil = pygame.Surface((width, height), pygame.SRCALPHA, 32)
    veil.fill((*theme.background, 225))
    surface.blit(veil, (0, 0))
    room = round(0.86 * width)
    sizes = [max(18, round(46 * unit)), *[max(13, round(26 * unit))] * (len(lines) - 1)]
    inks = [theme.text, *[theme.muted] * (len(lines) - 1)]
    sizes[0] = letters.size(lines[0], sizes[0], sizes[-1], room)
    drawn = [letters.fitted(text, size, ink, room) for text, size, ink in zip(lines, sizes, inks, strict=True)]
    gap = round(12 * unit)
    top = (height - sum(line.get_height() + gap for line in drawn)) // 2
    for line in drawn:
        surface.blit(line, ((width - line.get_width()) // 2, top))
        top += line.get_height() + gap
