"""The command: `lmoc`, or `python -m lmoc`."""

import sys


def main() -> int:
    """Run the command; Ctrl-C ends it quietly even while its own files are being imported."""
    try:
        from lmoc.cli.main import main as command

        return command()
    except KeyboardInterrupt:
        print("failed: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
