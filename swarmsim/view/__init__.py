"""Pictures and films of a run, made from its recording alone and without a display."""

import os

# On its first import pygame prints a greeting to standard output, which is for the program's own output.
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
