"""Endings of files that are maps in pixels."""

from __future__ import annotations

from typing import Final

PICTURES: Final = (".pgm", ".png", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff", ".gif", ".pbm", ".ppm")
MAPS: Final = (".yaml", ".yml", *PICTURES)
