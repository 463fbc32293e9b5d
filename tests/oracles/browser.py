"""A real browser: Chromium, driven by its own chromedriver over the W3C WebDriver protocol."""

import atexit
import base64
import json
import re
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import NamedTuple
from urllib.request import Request, urlopen

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")
needs_browser = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None, reason="Chromium with chromedriver is not installed: pages are not opened"
)

CODES = {"Tab": 9, "Enter": 13, " ": 32, "ArrowUp": 38, "ArrowDown": 40, ".": 190}  # of keys
_FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--host-resolver-rules=MAP * ~NOTFOUND")
_WAIT = 60_000  # ms for a script


class Seen(NamedTuple):
    """What a page has done."""

    answer: object  # of the script
    console: list[str]
    picture: bytes  # a screenshot, PNG


class Browser:
    """One window, for all tests of a process."""

    def __init__(self) -> None:
        call = [DRIVER, "--port=0"]
        self.driver = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        port = next(found[1] for line in self.driver.stdout if (found := re.search(r"on port (\d+)\.", line)))
        self.base = f"http://127.0.0.1:{port}/session"
        options = {"binary": CHROMIUM, "args": list(_FLAGS)}
        capabilities = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
        made = self.send("", {"capabilities": {"alwaysMatch": capabilities}})
        self.base += f"/{made['sessionId']}"
        self.send("/timeouts", {"script": _WAIT})

    def send(self, path: str, body: dict | None = None, method: str = "POST"):
        data = None if body is None else json.dumps(body).encode()
        request = Request(self.base + path, data, {"Content-Type": "application/json"}, method=method)
        with urlopen(request, timeout=90) as answer:
            return json.loads(answer.read())["value"]

    def command(self, name: str, **parameters):
        """A command of Chromium's own protocol."""
        return self.send("/goog/cdp/execute", {"cmd": name, "params": parameters})

    def close(self) -> None:
        try:
            self.send("", method="DELETE")
        finally:
            self.driver.terminate()


@cache
def browser() -> Browser:
    made = Browser()
    atexit.register(made.close)
    return made


def open_page(html: str, script: str, size: tuple[int, int] = (1200, 900), dark: bool = False) -> Seen:
    """Open a page, run the body of an async function in it, and return what that returns.

    Parameters
    ----------
    script : JavaScript that may await and returns something for JSON; `frames(n)` waits for n frames, `idle()` for the
        end of simulations
    size : px, of the page
    """
    own = browser()
    own.command("Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False)
    theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    own.command("Emulation.setEmulatedMedia", features=[theme])
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        page.write_text(html, encoding="utf-8")
        own.send("/url", {"url": page.as_uri()})
        answer = in_page(f"await idle(); {script}")
        console = [entry["message"] for entry in own.send("/se/log", {"type": "browser"})]
        picture = base64.b64decode(own.send("/screenshot", method="GET"))
    return Seen(answer, console, picture)


def in_page(script: str) -> object:
    """Run the body of an async function, as of `open_page`, in the page that is open, and return what that returns."""
    answer = browser().send("/execute/async", {"script": f"""
    const done = arguments[0];
    const frames = async (n) => {{ for (let k = 0; k < n; k++) await new Promise(requestAnimationFrame); }};
    const busy = () => document.body.hasAttribute("data-busy");
    const idle = async () => {{ do await frames(2); while (busy()); await frames(1); }};
    (async () => {{ {script} }})().then((a) => done({{ a }}), (e) => done({{ e: String(e.stack ?? e) }}));
    """, "args": []})  # fmt: skip
    assert "e" not in answer, answer["e"]
    return answer.get("a")


def press(key: str, times: int = 1) -> None:
    """Press a key as a hand does, and let it go."""
    text = {"Enter": "\r"}.get(key, key if len(key) == 1 else "")
    for _ in range(times):
        for kind in ("keyDown", "keyUp"):
            given = {"text": text} if text and kind == "keyDown" else {}
            browser().command("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=CODES[key], **given)


def controls() -> dict[tuple[str, str], str]:
    """Return {(role, name): description} of what a screen reader lets one act on in the page that is open."""
    found = {}
    for node in browser().command("Accessibility.getFullAXTree")["nodes"]:
        told = {p["name"]: p["value"].get("value") for p in node.get("properties", ())}
        if not node.get("ignored") and told.get("focusable") and node["role"]["value"] != "RootWebArea":
            name, text = (node.get(key, {}).get("value", "") for key in ("name", "description"))
            found[node["role"]["value"], name] = text
    return found
