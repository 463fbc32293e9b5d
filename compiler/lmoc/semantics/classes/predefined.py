"""The predefined types (Modelica specification, 4.8), and what other languages call them."""

from __future__ import annotations

from lmoc.support.records import dataclass

ENUMERATIONS = {
    "StateSelect": ("never", "avoid", "default", "prefer", "always"),
    "AssertionLevel": ("error", "warning"),
}


@dataclass(frozen=True)
class Builtin:
    """A predefined type: Real, Integer, Boolean, String, or an enumeration."""

    name: str
    literals: tuple[str, ...] = ()


BUILTINS: dict[str, Builtin] = {name: Builtin(name) for name in ("Real", "Integer", "Boolean", "String")}
BUILTINS |= {name: Builtin(name, literals) for name, literals in ENUMERATIONS.items()}

# what other languages call the predefined types
FOREIGN_TYPES = {"int": "Integer", "bool": "Boolean", "str": "String", "string": "String"}
FOREIGN_TYPES |= dict.fromkeys(("float", "double", "real", "number", "var", "let"), "Real")
