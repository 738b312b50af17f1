"""The entry point of ``python -m fvi_cli`` and of the command ``fvi``."""

from __future__ import annotations

import sys

INTERRUPTED = 130


def main() -> None:
    """Load the command line, which takes a moment, and run it."""
    try:
        from fvi_cli.cli.app import command_line
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    command_line()


if __name__ == "__main__":
    main()
