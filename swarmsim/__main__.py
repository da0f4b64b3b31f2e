"""`python -m swarmsim` is the command `swarmsim`."""

import sys
from pathlib import Path


def main() -> None:
    """Run the command line, which can be interrupted even during its import."""
    try:
        from swarmsim.cli import main as run
    except KeyboardInterrupt:
        print("swarmsim: interrupted", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    # `-m` puts the current folder first, unlike the command: both must find the same modules.
    if not sys.flags.safe_path and sys.path[0] in ("", str(Path.cwd())):
        del sys.path[0]
    main()
