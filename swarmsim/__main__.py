"""`python -m swarmsim` is the command `swarmsim`."""

import sys
from pathlib import Path

if __name__ == "__main__":
    # `-m` puts the current folder first, and the command does not: both have to find the same modules.
    if not sys.flags.safe_path and sys.path[0] in ("", str(Path.cwd())):
        del sys.path[0]

    from swarmsim.cli import main

    main()
