"""Words before a declaration: which there are, in which order they stand, and what they can stand before."""

from __future__ import annotations

from lmoc.syntax.equations import EquationActions
from lmoc.syntax.expressions import Word

# Prefixes in the order in which they stand.
_ORDER = (
    "redeclare each final inner outer replaceable encapsulated partial pure "
    "expandable flow stream discrete parameter constant input output"
).split()
EXCLUSIVE = ({"parameter", "constant", "discrete"}, {"input", "output"}, {"flow", "stream"})
OF_CLASSES = {"encapsulated", "partial", "expandable", "pure"}  # "pure" says what every function of lmo is
OF_COMPONENTS = {"flow", "stream", "discrete", "parameter", "constant", "input", "output"}
_UNSUPPORTED = {
    "stream": "'stream' variables describe flowing media, lmo has none",
    "operator": "operator records and functions are not part of lmo",
    "impure": "a function of lmo has no effects besides its results",
}


class PrefixActions(EquationActions):
    """Actions of the grammar's rules for prefixes."""

    def prefix(self, v: list, start: int, end: int) -> Word:
        return Word(v[0], start, end)

    argument_prefix = prefix

    def prefixes(self, v: list, start: int, end: int) -> dict[str, Word]:
        found: dict[str, Word] = {}
        for prefix in v:
            self._check_prefix(prefix, found)
            found[prefix.text] = prefix
        return found

    argument_prefixes = prefixes

    def _check_prefix(self, prefix: Word, before: dict[str, Word]) -> None:
        text, place = prefix.text, self.span(prefix.start, prefix.end)
        if text in _UNSUPPORTED:
            self.report.error("E0116", _UNSUPPORTED[text], place)
            return
        if text in before:
            self.report.error("E0113", f"'{text}' occurs here twice", place)
            return
        for group in EXCLUSIVE:
            for other in group & before.keys() - {text}:
                if text in group:
                    self.report.error("E0113", f"'{other}' and '{text}' exclude each other", place)
                    return
        later = [other for other in before if other in _ORDER and _ORDER.index(other) > _ORDER.index(text)]
        if later:
            hint = f"write '{text} {later[0]}'"
            self.report.error("E0113", f"'{text}' belongs before '{later[0]}'", place, hint=hint)

    def _refuse(self, prefixes: dict[str, Word], wrong: set[str], what: str) -> None:
        for text, prefix in prefixes.items():
            if text in wrong:
                self.report.error("E0113", f"{what} cannot be '{text}'", self.span(prefix.start, prefix.end))
