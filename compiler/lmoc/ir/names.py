"""From the names a user writes to variables of the flat model, and what to say when there is none."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import overload

import numpy as np

from lmoc.ir.flat import Block, FlatDAE, Kind
from lmoc.messages.diagnostics import most_like
from lmoc.support.quoted import split, subscripts, with_subscripts, without_subscripts


class UnknownNameError(KeyError):
    """There is no variable of that name; the message says which name may have been meant."""

    def __init__(self, name: str, hint: str = ""):
        self.name = name
        self.hint = hint
        super().__init__(f"there is no variable '{name}'" + (f"; {hint}" if hint else ""))

    def __str__(self) -> str:  # KeyError shows the repr of its argument
        return str(self.args[0])


class Names(Sequence[str]):
    """Dotted names of variables, made on demand; `in` and `len` cost nothing."""

    def __init__(self, flat: FlatDAE, variables: np.ndarray):
        self._flat = flat
        self._variables = variables

    def __len__(self) -> int:
        return len(self._variables)

    @overload
    def __getitem__(self, i: int) -> str: ...

    @overload
    def __getitem__(self, i: slice) -> list[str]: ...

    def __getitem__(self, i: int | slice) -> str | list[str]:
        if isinstance(i, slice):
            return [self._flat.variable_name(int(v)) for v in self._variables[i]]
        return self._flat.variable_name(int(self._variables[i]))

    def __iter__(self) -> Iterator[str]:
        return (self._flat.variable_name(int(v)) for v in self._variables)

    def __contains__(self, name: object) -> bool:
        found = self._flat.find(name) if isinstance(name, str) else None
        return found is not None and len(found) == 1 and bool((self._variables == found[0]).any())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    def __repr__(self) -> str:
        return repr(list(self)) if len(self) <= 60 else f"<{len(self)} names: {self[0]} … {self[-1]}>"


def inputs_of(flat: FlatDAE) -> list[str]:
    """Return the names of the top-level inputs."""
    return list(Names(flat, np.flatnonzero(flat.kind == Kind.INPUT)))


def outputs_of(flat: FlatDAE) -> list[str]:
    """Return the names of the top-level outputs."""
    return list(Names(flat, np.flatnonzero(flat.per_variable(lambda b: b.output, bool))))


def names_of(given: str | Sequence[str] | None) -> tuple[str, ...] | None:
    """Return names as a tuple, where one may stand alone."""
    return (given,) if isinstance(given, str) else None if given is None else tuple(given)


def hint_for(flat: FlatDAE, name: str, among: Callable[[Block], bool] = lambda block: True) -> str:
    """Suggest names for one that the model does not have."""
    blocks = {_base(b): b for b in flat.blocks if b.size and among(b)}
    plain = without_subscripts(str(name)).strip()
    same = blocks.get(plain)
    if same is not None:
        return f"the indices of {same.pattern} run from 1 to {' and '.join(map(str, same.dims))}" if same.dims else ""
    return hint_among({base: b.pattern for base, b in blocks.items()}, str(name))


def hint_among(known: Mapping[str, str], name: str) -> str:
    """Suggest names for one that is not among the given ones.

    Parameters
    ----------
    known : {name without subscripts: how to show it}
    """
    plain = without_subscripts(name).strip()
    inside = [shown for base, shown in known.items() if base.startswith(plain + ".")]
    inside.sort(key=lambda shown: len(split(shown)))
    if inside:
        return f"'{name}' is a part; it has {_listed(inside)}"
    ends = {base: shown for base, shown in known.items() if base.endswith("." + plain)}
    if ends:
        least = min(len(split(base)) for base in ends)  # body.q rather than body.flange.q
        shown = [shown for base, shown in ends.items() if len(split(base)) == least]
        return f"did you mean {_listed(shown, ' or ')}?"
    close = most_like(plain, known)
    return f"did you mean '{known[close]}'?" if close else ""


def _base(block: Block) -> str:
    return ".".join(name for name, _ in block.path)


def _listed(names: list[str], last: str = ", ", most: int = 4) -> str:
    text = last.join(names[:most])
    return text + (" …" if len(names) > most else "")


def summarised(names: list[str], most: int = 12) -> list[str]:
    """Names with the members of an array put together: ``m[1].q, m[2].q, m[3].q`` → ``m[1:3].q``.

    Members need not stand side by side, but their single differing index counts up by one.
    """
    families: dict[str, list[list[str]]] = {}  # by the name without indices: runs of consecutive members
    for name in names:
        runs = families.setdefault(without_subscripts(name, "[]"), [])
        if runs and _follows(runs[-1][-1], name):
            runs[-1].append(name)
        else:
            runs.append([name])
    result: list[str] = []
    for run in (run for runs in families.values() for run in runs):
        result += run if len(run) < 3 else [_span_name(run[0], run[-1])]
    return result if len(result) <= most else [*result[: most - 1], f"… ({len(names)} in all)"]


def _follows(first: str, second: str) -> bool:
    differ = [(x, y) for x, y in zip(_indices(first), _indices(second), strict=True) if x != y]
    return len(differ) == 1 and int(differ[0][1]) == int(differ[0][0]) + 1


def _indices(name: str) -> list[str]:
    return [i for found in subscripts(name) for i in found]


def _span_name(first: str, last: str) -> str:
    merged = iter(x if x == y else f"{x}:{y}" for x, y in zip(_indices(first), _indices(last), strict=True))
    return with_subscripts(first, merged)


def patterns(flat: FlatDAE, variables: np.ndarray, orders: np.ndarray | None = None, most: int = 12) -> list[str]:
    """Names of jets with the members of arrays put together, without making the name of each.

    Parameters
    ----------
    variables : (n,) indices in the flat model
    orders : (n,) order of the derivative of each, 0 where not given
    most : entries after which the rest is only counted
    """
    variables = np.asarray(variables, int)
    orders = np.zeros(len(variables), int) if orders is None else np.asarray(orders, int)
    key = flat.block_of[variables] * 64 + orders
    _, first = np.unique(key, return_index=True)
    result: list[str] = []
    for position in np.sort(first).tolist():
        own = variables[key == key[position]]
        name = block_pattern(flat, own)
        names = summarised([flat.variable_name(int(v)) for v in own], most) if name is None else [name]
        order = int(orders[position])
        result += ["der(" * order + n + ")" * order for n in names]
    return result if len(result) <= most else [*result[: most - 1], f"… ({len(variables)} in all)"]


def block_pattern(flat: FlatDAE, variables: np.ndarray) -> str | None:
    """``m[2:10000].q`` for variables of one array that fill a range of its indices; None for others."""
    block = flat.block_at(int(variables[0]))
    places = variables - block.offset
    if places.min() < 0 or places.max() >= block.size:
        return None
    if not block.dims:
        return block.name(0)
    indices = np.unravel_index(places, block.dims)
    spans = [(int(i.min()) + 1, int(i.max()) + 1) for i in indices]
    if np.prod([high - low + 1 for low, high in spans]) != len(variables):
        return None
    texts = iter(f"{low}:{high}" if low != high else str(low) for low, high in spans)
    names = []
    for name, dims in block.path:
        own = ",".join(next(texts) for _ in dims)
        names.append(f"{name}[{own}]" if own else name)
    return ".".join(names)
