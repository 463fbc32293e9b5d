"""The command: `lmoc`, or `python -m lmoc`."""

import gc
import sys

# A start makes some hundred thousand objects, of which next to none is garbage: with the usual threshold of 700 the
# collector looks at them again and again, a tenth of a short run.
gc.set_threshold(100_000)


def main() -> int:
    """Run the command; Ctrl-C ends it quietly even while its own files are being imported."""
    try:
        from lmoc.cli.main import main as command

        return command()
    except KeyboardInterrupt:
        print("failed: interrupted", file=sys.stderr)
        return 130
    finally:
        gc.freeze()  # the interpreter's last collections would look at everything that is freed next anyway


if __name__ == "__main__":
    sys.exit(main())
