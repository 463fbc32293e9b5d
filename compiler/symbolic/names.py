"""Short names: what a person would call ``mass1.q`` on paper, as long as nothing else is called so."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping

_INDEX = re.compile(r"(?:\[(\d+)\]|(\d+))$")


def base_of(name: str) -> tuple[str, int]:
    """``der(der(m.q))`` → (``m.q``, 2)."""
    order = 0
    while name.startswith("der(") and name.endswith(")"):
        name, order = name[4:-1], order + 1
    return name, order


def short_names(names: Iterable[str], given: Mapping[str, str] | None = None) -> dict[str, str]:
    """Shortest unambiguous form of each dotted name.

    A name in `given` is called as given there (the user's own name for the same thing: ``output q1 = wheel.q``).
    For the others:

    The last component (``q``); else with the number of its part (``mass1.q`` → ``q1``, ``m[3].q`` → ``q3``); else
    with the part's name (``q_left``), or its connector's (``tau_a``); else the whole name. All names with the same
    last component take the same form.
    """
    full = list(dict.fromkeys(names))
    given = {name: short for name, short in (given or {}).items() if name in full and short not in full}
    families: dict[str, list[str]] = {}
    for name in full:
        families.setdefault(_last(name), []).append(name)
    result = {name: name for name in full if "." not in name and "[" not in name} | given
    taken = set(result.values())
    for family in families.values():
        rest = [name for name in family if name not in result]
        for form in _FORMS:
            candidates = [form(name) for name in rest]
            clash = len(set(candidates)) < len(candidates) or any(c is None or c in taken for c in candidates)
            if not clash or form is _whole:
                result.update(zip(rest, candidates, strict=True))
                taken.update(candidates)
                break
    return {name: result[name] for name in full}


def _last(name: str) -> str:
    return name.rpartition(".")[2]


def _numbered(name: str) -> str | None:
    parent, _, last = name.rpartition(".")
    found = _INDEX.search(parent if parent else last)
    if not found:
        return None
    number = found.group(1) or found.group(2)
    return (last if parent else last[: found.start()]) + number if not last[-1].isdigit() else None


def _with_first(name: str) -> str | None:
    parts = name.split(".")
    return f"{parts[-1]}_{parts[0]}" if len(parts) > 2 and "[" not in parts[-1] + parts[0] else None


def _with_part(name: str) -> str | None:
    parts = name.split(".")
    return f"{parts[-1]}_{parts[-2]}" if len(parts) > 1 and "[" not in parts[-1] + parts[-2] else None


def _whole(name: str) -> str:
    return name


_FORMS: tuple[Callable[[str], str | None], ...] = (_last, _numbered, _with_first, _with_part, _whole)
