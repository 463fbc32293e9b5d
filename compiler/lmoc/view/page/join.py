"""The files of a page: JavaScript modules are joined into one script, since a file on a disk cannot import others."""

from __future__ import annotations

import re
from base64 import b64encode
from functools import cache
from importlib.resources import files
from zlib import compress

_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([\w.]+)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(async |)function|class|const)", re.MULTILINE)
_NAME = re.compile(r"^(?:async )?(?:function\*?|class|const|let) +(\{[^}]*\}|[\w$]+)", re.MULTILINE)


@cache
def asset(name: str) -> str:
    """Return the text of a file."""
    return (files("lmoc.view.page") / "assets" / name).read_text(encoding="utf-8")


@cache
def engine() -> str:
    """Return the engine in WebAssembly, packed."""
    return packed((files("lmoc.view.page") / "assets" / "engine.wasm").read_bytes())


def packed(data: bytes) -> str:
    """Return bytes as base64 of what zlib makes of them; `inflate.js` reads it."""
    return b64encode(compress(data, 9)).decode()


@cache
def worker() -> str:
    """Return the script of a page's worker, with its engine in it."""
    return f'{joined("worker.js")}\nserve("{engine()}");\n'


@cache
def joined(name: str) -> str:
    """Return a module with all that it imports before it, without imports and exports.

    Raises
    ------
    ValueError
        Two modules have a name in common at their top, or an import renames.
    """
    parts: dict[str, str] = {}
    _collect(name, parts)
    owner: dict[str, str] = {}
    for module, text in parts.items():
        for found in _NAME.finditer(text):
            for own in re.findall(r"[\w$]+", found[1]):
                if own in owner:
                    raise ValueError(f"{own} is a name of {owner[own]} and of {module}")
                owner[own] = module
    return "\n".join(f"// {module}\n{text}" for module, text in parts.items())


def _collect(name: str, parts: dict[str, str]) -> None:
    text = asset(name)
    for names, other in _IMPORT.findall(text):
        if " as " in names:
            raise ValueError(f"{name} renames what it imports from {other}")
        if other not in parts:
            _collect(other, parts)
    parts[name] = _EXPORT.sub("", _IMPORT.sub("", text))
