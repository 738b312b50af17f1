"""``python -m fvi_cli`` does what the command ``fvi`` does."""

from fvi_cli.cli import main

if __name__ == "__main__":
    main()
