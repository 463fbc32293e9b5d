"""Units of measurement as vectors of exponents of the SI base units (Modelica specification, chapter 19).

A unit string is ``numerator/denominator`` of factors joined by dots, each a symbol with an optional prefix and an
exponent: ``N.m/rad``, ``kg.m2``, ``m/s2``, ``1/s``, ``(kg.m)/s2``. ``km`` and ``m`` are of one dimension, but different
units: nothing is converted, so the factor is kept and compared.
"""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

from lmoc.messages.diagnostics import nearest
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from fractions import Fraction

BASE = ("m", "kg", "s", "A", "K", "mol", "cd")
NONE = (0,) * len(BASE)


@dataclass(frozen=True)
class Unit:
    """A product of powers of the base units, times a factor.

    The scales of temperature that do not begin at 0 K have an `offset`, in K. A difference of two such temperatures,
    and whatever they are multiplied with, is in K.
    """

    exponents: tuple[int | Fraction, ...] = NONE  # whole ones as int: almost all are, and they are far faster
    factor: float = 1.0
    offset: float = 0.0

    def __mul__(self, other: Unit) -> Unit:
        return Unit(tuple(a + b for a, b in zip(self.exponents, other.exponents)), self.factor * other.factor)

    def __truediv__(self, other: Unit) -> Unit:
        return Unit(tuple(a - b for a, b in zip(self.exponents, other.exponents)), self.factor / other.factor)

    def __pow__(self, power: int | Fraction) -> Unit:
        return Unit(tuple(_plain(a * power) for a in self.exponents), self.factor ** float(power))

    def same_as(self, other: Unit) -> bool:
        """Equal dimensions and zero points, and factors up to rounding."""
        return self.offset == other.offset and self.same_step(other)

    def same_step(self, other: Unit) -> bool:
        """Whether differences are in the same unit."""
        return self.exponents == other.exponents and abs(self.factor / other.factor - 1) < 1e-9

    def __str__(self) -> str:
        return unit_text(self)


def _plain(exponent: int | Fraction) -> int | Fraction:
    return exponent.numerator if exponent.denominator == 1 else exponent


ONE_UNIT = Unit()
SECOND = Unit(tuple(int(name == "s") for name in BASE))


def _of(text: str) -> tuple[int | Fraction, ...]:
    powers = dict.fromkeys(BASE, 0)
    for symbol, exponent in re.findall(r"([A-Za-z]+)(-?\d+)?", text):
        powers[symbol] += int(exponent or 1)
    return tuple(powers[name] for name in BASE)


# symbol: (base units, factor); those that take prefixes first
_PREFIXED = {
    "m": ("m", 1.0), "g": ("kg", 1e-3), "s": ("s", 1.0), "A": ("A", 1.0), "K": ("K", 1.0), "mol": ("mol", 1.0),
    "cd": ("cd", 1.0), "rad": ("", 1.0), "sr": ("", 1.0), "Hz": ("s-1", 1.0), "N": ("kg m s-2", 1.0),
    "Pa": ("kg m-1 s-2", 1.0), "J": ("kg m2 s-2", 1.0), "W": ("kg m2 s-3", 1.0), "C": ("A s", 1.0),
    "V": ("kg m2 s-3 A-1", 1.0), "F": ("kg-1 m-2 s4 A2", 1.0), "Ohm": ("kg m2 s-3 A-2", 1.0),
    "S": ("kg-1 m-2 s3 A2", 1.0), "Wb": ("kg m2 s-2 A-1", 1.0), "T": ("kg s-2 A-1", 1.0), "H": ("kg m2 s-2 A-2", 1.0),
    "lm": ("cd", 1.0), "lx": ("cd m-2", 1.0), "Bq": ("s-1", 1.0), "Gy": ("m2 s-2", 1.0), "Sv": ("m2 s-2", 1.0),
    "kat": ("mol s-1", 1.0), "eV": ("kg m2 s-2", 1.602176634e-19), "l": ("m3", 1e-3), "L": ("m3", 1e-3),
    "bar": ("kg m-1 s-2", 1e5), "t": ("kg", 1e3),
}  # fmt: skip
_PLAIN = {
    "degC": ("K", 1.0), "degF": ("K", 5 / 9), "degRk": ("K", 5 / 9), "deg": ("", 0.017453292519943295),
    "rev": ("", 6.283185307179586), "min": ("s", 60.0), "h": ("s", 3600.0), "d": ("s", 86400.0),
    "rpm": ("s-1", 0.10471975511965977), "%": ("", 0.01), "dB": ("", 0.11512925464970229),
}  # fmt: skip
_FROM_ZERO = {"degC": 273.15, "degF": 459.67 * 5 / 9}  # K at which a scale begins
_PREFIX = {
    "Y": 1e24, "Z": 1e21, "E": 1e18, "P": 1e15, "T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "da": 1e1,
    "d": 1e-1, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9, "p": 1e-12, "f": 1e-15, "a": 1e-18,
}  # fmt: skip
# what people write instead of a symbol
_WRITTEN_OUT = {
    **dict.fromkeys(("meter", "metre", "meters", "metres"), "m"), **dict.fromkeys(("second", "seconds", "sec"), "s"),
    **dict.fromkeys(("kilogram", "kilograms", "kilo", "kgs"), "kg"), **dict.fromkeys(("gram", "grams"), "g"),
    **dict.fromkeys(("newton", "newtons"), "N"), **dict.fromkeys(("joule", "joules"), "J"),
    **dict.fromkeys(("watt", "watts"), "W"), **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("degree", "degrees"), "deg"), **dict.fromkeys(("hertz", "herz"), "Hz"),
    **dict.fromkeys(("minute", "minutes"), "min"), **dict.fromkeys(("hour", "hours"), "h"),
    **{"pascal": "Pa", "volt": "V", "volts": "V", "ampere": "A", "amp": "A", "amps": "A", "kelvin": "K", "ohm": "Ohm"},
    **{"farad": "F", "henry": "H", "tesla": "T", "liter": "l", "litre": "l"},
    **{"millimeter": "mm", "millimetre": "mm", "centimeter": "cm", "kilometer": "km", "celsius": "degC"},
}  # fmt: skip
SYMBOLS = tuple(_PREFIXED) + tuple(_PLAIN)
_FACTOR = re.compile(r"([A-Za-z%]+)(?:\^?([+-]?\d+(?:/\d+)?|\([+-]?\d+/\d+\)))?")


class UnitError(ValueError):
    """A unit string that means nothing; `hint` may know better."""

    def __init__(self, message: str, hint: str = ""):
        super().__init__(message)
        self.hint = hint


@cache
def parse_unit(text: str) -> Unit | None:
    """The unit that a string means; None for the empty string: unknown.

    Raises
    ------
    UnitError
    """
    text = text.strip()
    if not text:
        return None
    if text in _FROM_ZERO:
        base, factor = _PLAIN[text]
        return Unit(_of(base), factor, _FROM_ZERO[text])
    numerator, *denominators = _split(text)
    if len(denominators) > 1:
        raise UnitError(f"'{text}' divides more than once", "write one '/' and brackets after it: m/(s.K)")
    result = _product(numerator, text)
    return result / _product(denominators[0], text) if denominators else result


def _split(text: str) -> list[str]:
    """At the slashes that are outside of brackets."""
    parts, depth = [""], 0
    for char in text:
        depth += (char == "(") - (char == ")")
        if char == "/" and depth == 0:
            parts.append("")
        else:
            parts[-1] += char
    if depth:
        raise UnitError(f"brackets do not match in '{text}'")
    return parts


def _product(text: str, whole: str) -> Unit:
    text = text.strip()
    if text.startswith("(") and text.endswith(")"):
        text = text[1:-1]
    result = ONE_UNIT
    for factor in text.split("."):
        if factor.strip() == "1":
            continue
        match = _FACTOR.fullmatch(factor.strip())
        if match is None:
            hint = "factors are joined by dots: N.m" if re.search(r"[*· ]", whole) else ""
            raise UnitError(f"'{factor}' is no unit in '{whole}'", hint)
        symbol, exponent = match.groups()
        power = _exponent((exponent or "1").strip("()"))
        result = result * _symbol(symbol) ** power
    return result


def _exponent(text: str) -> int | Fraction:
    if "/" not in text:
        return int(text)
    from fractions import Fraction  # brings decimal with it, which few models need

    return _plain(Fraction(text))


def _symbol(symbol: str) -> Unit:
    if symbol in _PREFIXED or symbol in _PLAIN:
        base, factor = _PREFIXED.get(symbol) or _PLAIN[symbol]
        return Unit(_of(base), factor)
    for length in (2, 1):
        prefix, rest = symbol[:length], symbol[length:]
        if prefix in _PREFIX and rest in _PREFIXED:
            base, factor = _PREFIXED[rest]
            return Unit(_of(base), factor * _PREFIX[prefix])
    raise UnitError(f"there is no unit '{symbol}'", _suggestion(symbol))


def _suggestion(symbol: str) -> str:
    same = next((s for s in SYMBOLS if s.lower() == symbol.lower()), None)
    same = same or _WRITTEN_OUT.get(symbol.lower())
    if same:
        return f"did you mean '{same}'?"
    for k in range(1, len(symbol)):  # Nm, Nms
        if symbol[:k] in SYMBOLS and symbol[k:] in SYMBOLS:
            return f"did you mean '{symbol[:k]}.{symbol[k:]}'?"
    return nearest(symbol, SYMBOLS)


_NAMED = {_of(_PREFIXED[s][0]): s for s in ("N", "J", "W", "Pa", "V", "C")}


def unit_text(unit: Unit) -> str:
    """A unit as people write it: ``kg.m/s2`` or ``N``."""
    if unit.offset:
        return next(name for name, offset in _FROM_ZERO.items() if offset == unit.offset)
    if unit.exponents in _NAMED:
        text = _NAMED[unit.exponents]
    else:
        powers = dict(zip(BASE, unit.exponents))
        order = ("kg", "m", "s", "A", "K", "mol", "cd")
        up = [_power(n, powers[n]) for n in order if powers[n] > 0]
        down = [_power(n, -powers[n]) for n in order if powers[n] < 0]
        text = ".".join(up) or "1"
        if down:
            text += "/" + (down[0] if len(down) == 1 else f"({'.'.join(down)})")
    return text if abs(unit.factor - 1) < 1e-12 else f"{unit.factor:g} {text}"


def _power(name: str, exponent: int | Fraction) -> str:
    return name if exponent == 1 else f"{name}{exponent}" if exponent.denominator == 1 else f"{name}({exponent})"
