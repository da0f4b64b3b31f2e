"""Pictures and films of a run, made from its recording alone and without a display."""

import os

# pygame greets on standard output when it is first imported, where a program's own output belongs.
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
