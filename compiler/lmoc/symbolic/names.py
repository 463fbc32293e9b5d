"""Short names: what a person would call ``mass1.q`` on paper, as long as nothing else is called so."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping

from lmoc.support.quoted import last, parent, split, subscripts, without_subscripts

_NUMBER = re.compile(r"\d+$")


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
    last component take the same form where one suits all.
    """
    full = list(dict.fromkeys(names))
    given = {name: short for name, short in (given or {}).items() if name in full and short not in full}
    given = {name: short for name, short in given.items() if _whole_array_given(name, full, given)}
    families: dict[str, list[str]] = {}
    for name in full:
        families.setdefault(_last(name), []).append(name)
    result = {name: name for name in full if "." not in name and "[" not in name} | given
    taken = set(result.values())
    for family in families.values():
        rest = [name for name in family if name not in result]
        found = _uniform(rest, taken) or _one_by_one(rest, taken)
        result.update(found)
        taken.update(found.values())
    return {name: result[name] for name in full}


def _uniform(names: list[str], taken: set[str]) -> dict[str, str] | None:
    """The first short form that suits all of them."""
    for form in _FORMS[:-1]:
        candidates = [form(name) for name in names]
        if len(set(candidates)) == len(candidates) and not any(c is None or c in taken for c in candidates):
            return dict(zip(names, candidates, strict=True))
    return None


def _one_by_one(names: list[str], taken: set[str]) -> dict[str, str]:
    """For each the first form that no other could claim."""
    claims = Counter(form(name) for form in _FORMS for name in names)
    result = {}
    for name in names:
        free = [form(name) for form in _FORMS if claims[form(name)] == 1 and form(name) not in taken]
        result[name] = next((candidate for candidate in free if candidate is not None), name)
    return result


def _whole_array_given(name: str, full: list[str], given: Mapping[str, str]) -> bool:
    """One member of an array keeps the form of the others (q1, q2, …) unless all have names of their own."""
    pattern = without_subscripts(name)
    return not subscripts(name) or all(other in given for other in full if without_subscripts(other) == pattern)


def _last(name: str) -> str:
    return without_subscripts(last(name))


def _numbered(name: str) -> str | None:
    """With the indices of the arrays on its path, else with the number that its part's name ends in."""
    indices = [i for found in subscripts(name) for i in found]
    own = _last(name)
    if indices:  # lever[3].l1 → l1_3
        return own + "_" * own[-1].isdigit() + "_".join(indices)
    found = _NUMBER.search(parent(name))
    return own + found[0] if found and not own[-1].isdigit() else None


def _with_first(name: str) -> str | None:
    parts = split(name)
    return f"{parts[-1]}_{parts[0]}" if len(parts) > 2 and not subscripts(parts[-1] + parts[0]) else None


def _with_part(name: str) -> str | None:
    parts = split(name)
    return f"{parts[-1]}_{parts[-2]}" if len(parts) > 1 and not subscripts(parts[-1] + parts[-2]) else None


def _whole(name: str) -> str:
    return name


_FORMS: tuple[Callable[[str], str | None], ...] = (_last, _numbered, _with_first, _with_part, _whole)


def without_dots(names: Iterable[str]) -> list[str]:
    """Return names for libraries that keep dots for themselves: ``_`` in their place, more where two become alike."""
    made: dict[str, None] = {}
    for name in names:
        plain = name.replace(".", "_")
        while plain in made:
            plain += "_"
        made[plain] = None
    return list(made)
