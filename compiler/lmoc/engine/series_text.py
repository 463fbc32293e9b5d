"""The recurrences of a series as C: one order, instruction by instruction, for as many runs as there are lanes."""

from __future__ import annotations

import ctypes
from collections.abc import Collection, Iterator

import numpy as np

from lmoc.engine.accelerator import Accelerator, compiled, headers
from lmoc.lower.series_code import PRODUCTS, RECURRENCES

_LONGEST = 2_000  # instructions of a text: each of them may be a loop
_INSTRUCTION, _PRODUCT = 60.0, 250.0  # operations of about a nanosecond of all orders together
# Of the work after which a tape is compiled: half a second. The compiler takes 0.2 s for a quarter car and a double
# pendulum, 0.7 s for Pleiades, and what it makes half the time of what is interpreted.
_SHARE = 1 / 6
_TEXT = {
    "copy": "{out} = {a};",
    "neg": "{out} = -{a};",
    "add": "{out} = {a} + {b};",
    "sub": "{out} = {a} - {b};",
    "scale": "{out} = {number} * {a};",
    "scale_more": "{out} += {number} * {a};",
    "late": "{out} += {A}[0] * {b};",
    "ratio": "{out} = {a} / {number};",
    "convolve": "convolve(k, {A}, {B}, &{out});",
    "square": "square(k, {A}, &{out});",
    "quotient": "{{ const lmoc_real top = {a}; quotient(k, &top, {B}, {OUT}); }}",
    "power": "power(k, {A}, &{number}, {OUT});",
    "chain": "chain(k, {A}, {B}, &{out});",
    "chain_more": "chain_more(k, {A}, {B}, &{out});",
    "of_time": "{out} = lmoc_of_time(k, {A}, {B});",
    "open": "y->open(y, {0}, k);",
    "solve": "y->solve(y, {0}, k);",
}
# Products as functions: a loop for each of them in one text takes the compiler seconds.
_PRODUCTS = """
#define PRODUCT(name, value) \\
  LMOC_WIDEST static void name(int64_t k, const lmoc_real *a, const lmoc_real *b, lmoc_real *out) { value; }
PRODUCT(convolve, *out = lmoc_convolve(k, a, b))
PRODUCT(chain, *out = lmoc_chain(k, a, b))
PRODUCT(chain_more, *out += lmoc_chain(k, a, b))
PRODUCT(quotient, out[k] = (*a - lmoc_rest(k, b, out)) / b[0])
PRODUCT(power, out[k] = lmoc_power(k, a, *b, out))
LMOC_WIDEST static void square(int64_t k, const lmoc_real *a, lmoc_real *out) { *out = lmoc_square(k, a); }
"""


def _instructions(code: np.ndarray) -> Iterator[tuple[str, list[int]]]:
    """Yield the operations with what follows them."""
    at, numbers = 0, code.tolist()
    while numbers[at]:
        name = RECURRENCES[numbers[at]]
        end = at + 4 + (2 * numbers[at + 2] if name == "total" else 0)
        yield name, numbers[at + 1 : end]
        at = end


def series_text(code: np.ndarray, lanes: int, passing: Collection[int] = ()) -> str:
    """Return the text of ``void lmoc_order(series, k)``, which does what the instructions of a series say.

    Parameters
    ----------
    passing : series that nobody reads at another order: their coefficients are variables, and fill no cache
    """
    lines = [_line(name, rest, passing) for name, rest in _instructions(code)]
    declared = [f"  lmoc_real v{series};" for series in sorted(passing)]
    return "\n".join([
        f"#define LMOC_OF_LANES {lanes}",
        headers("lane", "lu", "tape", "tables", "engine", "series", "recurrence"),
        # clang has rows of four where an engine that gcc has built has rows of eight
        f"#if LMOC_LANES != {lanes}",
        "#error another compiler has built the engine",
        "#endif",
        _PRODUCTS,
        "#define S(i) (s + (int64_t)(i)*LMOC_LENGTH)",
        "#define W(place) LMOC_ROW(w, place)",
        "LMOC_WIDEST void lmoc_order(const lmoc_series *y, int64_t k) {",
        "  lmoc_real *const s = (lmoc_real *)y->s;",
        "  double *const w = y->w;",
        *declared,
        *lines,
        "}\n",
    ])  # fmt: skip


def _line(name: str, rest: list[int], passing: Collection[int]) -> str:
    def now(series: int) -> str:
        return f"v{series}" if series in passing else f"S({series})[k]"

    out, a, b = rest[:3]
    if name == "total":
        terms = [f"W({number}) * {now(own)}" for own, number in zip(rest[3::2], rest[4::2], strict=True)]
        return f"  {now(out)} = (lmoc_real){{0}} + {' + '.join(terms)};"
    series = {"out": now(out), "a": now(a) if a >= 0 else "(lmoc_real){0}", "b": now(b)}
    return "  " + _TEXT[name].format(a, **series, A=f"S({a})", B=f"S({b})", OUT=f"S({out})", number=f"W({b})")


def cost_of_series(code: np.ndarray) -> float:
    """Return about how many operations all orders of a series have."""
    names = [name for name, _ in _instructions(code)]
    return _INSTRUCTION * len(names) + _PRODUCT * sum(name in PRODUCTS for name in names)


class SeriesAccelerator(Accelerator):
    """Compiles the instructions of a series beside their use."""

    def __init__(self, code: np.ndarray, lanes: int, passing: Collection[int]) -> None:
        super().__init__(cost_of_series(code), _SHARE)
        self._code, self._count = code, sum(1 for _ in _instructions(code))
        self._lanes, self._passing = lanes, passing

    def _make(self) -> ctypes.CDLL | None:
        return None if self._count > _LONGEST else compiled(lambda: series_text(self._code, self._lanes, self._passing))
