"""JavaScript outside a browser: node runs what a page runs."""

import json
import shutil
import subprocess

import pytest

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed: the JavaScript of pages is not run")


def run_script(text: str) -> object:
    """What a script prints last, as JSON."""
    done = subprocess.run([NODE, "--input-type=module", "-"], input=text, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])
