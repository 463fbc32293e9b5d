"""The command: `lmoc`, or `python -m lmoc`."""

import gc
import os
import sys

# A start makes some hundred thousand objects, of which next to none is garbage: with the usual threshold of 700 the
# collector looks at them again and again, a tenth of a short run.
gc.set_threshold(100_000)

# The matrices of a scene are small: a second thread of the BLAS gains nothing, and where other work wants the same
# processors the threads wait for each other. 36 least-squares problems of 156 rows took 0.09 s with one thread and
# 4 to 7 s with two on two busy processors. It must be said before numpy is imported; what a user has said remains.
if "OMP_NUM_THREADS" not in os.environ:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> int:
    """Run the command; Ctrl-C ends it quietly even while its own files are being imported."""
    try:
        from lmoc.cli import interruption

        interruption.keep()
        from lmoc.cli.main import main as command

        return command()
    except KeyboardInterrupt:
        print("failed: interrupted", file=sys.stderr)
        return 130
    finally:
        gc.freeze()  # the interpreter's last collections would look at everything that is freed next anyway


if __name__ == "__main__":
    sys.exit(main())
