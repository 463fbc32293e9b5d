"""`python -m lmoc` is the command `lmoc`."""

import sys

from lmoc.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
