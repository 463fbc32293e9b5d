"""From text to tokens."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections import namedtuple
from collections.abc import Sequence
from functools import cache

from lmoc.messages.diagnostics import Diagnostic
from lmoc.messages.source import Source, Span
from lmoc.syntax.parts import Part
from lmoc.syntax.tables import END_OF_TEXT, Tables, load


class Tokens(namedtuple("Tokens", "symbols texts starts ends")):
    """The tokens of a text, as parallel lists; the last one is the end of the text."""

    __slots__ = ()

    def splice(self, at: int, removed: int, inserted: tuple[str, ...], name: str = "") -> None:
        """Replace tokens from `at` on by others, an identifier among them being called `name`.

        One that replaces another takes its place, others have no width and stand right after the token before.
        """
        stop = at + removed
        if removed != len(inserted):
            place = self.ends[at - 1] if at else self.starts[0]
            self.starts[at:stop] = self.ends[at:stop] = [place] * len(inserted)
        self.symbols[at:stop] = inserted
        self.texts[at:stop] = [name if symbol == "IDENT" else symbol for symbol in inserted]


# Signs of other languages, and of mathematics, for which there is one of our own.
_FOREIGN = {
    **{"!=": "<>", "~=": "<>", "≠": "<>", "≤": "<=", "≥": ">=", "&&": "and", "||": "or", "!": "not", "**": "^"},
    **{"−": "-", "–": "-", "·": "*", "×": "*", "⋅": "*", "÷": "/"},
}
_ALIKE = str.maketrans("АВЕКМНОРСТХЅІЈаеорсухіјѕΑΒΕΖΗΙΚΜΝΟΡΤΥΧο", "ABEKMHOPCTXSIJaeopcyxijsABEZHIKMNOPTYXo")  # noqa: RUF001
_MEANT = {
    **{"²": "write '^2'", "³": "write '^3'", "°": "angles are in rad: pi/180 times as much"},
    "?": "a choice is written 'if c then a else b'",
    "%": "the remainder is 'mod(a, b)'; a comment begins with '//'",
    "#": "a comment begins with '//'",
    "&": "write 'and'",
    "|": "write 'or'",
}
_QUOTES = str.maketrans("“”„‟«»", '""""""')
# A sign that begins a comment elsewhere, at the beginning of a line or after a statement.
_OTHER_COMMENT = re.compile(r"(?:^|;)[ \t]*([%#].*)", re.MULTILINE)
_WORD = r"\w+"
_OPEN_NAME = r"'[^\s;,()=]*"


@cache
def _scanner(tables: Tables) -> re.Pattern:
    operators = sorted((s for s in tables.literals if not s[0].isalpha()), key=len, reverse=True)
    # Patterns come first, those with a longer fixed beginning (`initial equation`) before the general names.
    order = sorted(tables.patterns, key=lambda item: item[0] in ("IDENT", "NUMBER"))
    groups = [
        *order,
        ("foreign", "|".join(map(re.escape, _FOREIGN))),
        ("open_comment", r"/\*"),
        ("operator", "|".join(map(re.escape, operators))),
        ("wrong", r"[\s\S]"),
    ]
    return re.compile("|".join(f"(?P<{symbol}>{pattern})" for symbol, pattern in groups))


def scan(
    source: Source, tables: Tables, part: Part | None = None, doubtful: bool = False
) -> tuple[Tokens, list[Diagnostic]]:
    """The tokens of a text or of a part of it, and what is wrong with its characters.

    Keywords and operators are their own symbols. What is wrong is read as what was probably meant, or left out.
    In a `doubtful` text, one whose tokens make no sense, a string over several lines may be one that is not closed.
    """
    said: list[Diagnostic] = []
    start, end = part or (0, len(source.text))
    text = source.text[:end]
    while True:
        tokens, irregular = _tokens(text, tables, start)
        foreign = _in_our_signs(source, text, [at for symbol, at in irregular if symbol == "wrong"])
        if foreign is not None:
            text, found = foreign
            said.append(found)
            continue
        open_end = _first_open(text, tokens, irregular, doubtful)
        if open_end is None:
            break
        said.append(_not_closed(source, open_end))
        text = _close(text, open_end) if text[open_end] == '"' else _without_comments(text, open_end)
    for symbol, offset in irregular:
        # A wrong name is used many times, a foreign sign out of habit: once is enough.
        said += [d for d in _mend(source, tokens, symbol, offset) if all(d.message != e.message for e in said)]
    return tokens, said + _stray_index_ends(source, tokens)


def _in_our_signs(source: Source, text: str, wrong: list[int]) -> tuple[str, Diagnostic] | None:
    """The text, as long as before, with quotes or a comment of another language as ours, and what to say of it."""
    quote = next((at for at in wrong if ord(text[at]) in _QUOTES), None)
    if quote is not None:
        place = Span(source, quote, quote + 1)
        hint = "a string is written in straight quotes: \"…\""
        return text.translate(_QUOTES), Diagnostic("E0106", f"'{text[quote]}' means nothing here", place, hint=hint)
    odd = {at for at in wrong if text[at] in "%#"}
    comments = [m.span(1) for m in _OTHER_COMMENT.finditer(text) if m.start(1) in odd] if odd else []
    if comments:  # one message for all: it is a habit
        start, end = comments[0]
        sign, place = text[start], Span(source, start, end)
        said = Diagnostic("E0106", f"'{sign}' begins no comment", place, hint="a comment begins with '//'")
        return _blank(text, comments), said
    return None


def _blank(text: str, places: Sequence[tuple[int, int]]) -> str:
    """The text with spaces at some places."""
    pieces, done = [], 0
    for start, end in places:
        pieces += [text[done:start], " " * (end - start)]
        done = end
    return "".join([*pieces, text[done:]])


def _stray_index_ends(source: Source, tokens: Tokens) -> list[Diagnostic]:
    """Complain about each ``end`` that is meant as the last index but stands in no brackets."""
    said: list[Diagnostic] = []
    if "INDEX_END" not in tokens.symbols:
        return said
    depth = 0
    before = ""
    for at, (symbol, start, end) in enumerate(zip(tuple(tokens.symbols), tokens.starts, tokens.ends, strict=True)):
        declared, before = before == "IDENT", symbol
        if symbol == "[":
            depth += 1
        elif symbol == "]":
            depth = max(0, depth - 1)
        elif symbol == "INDEX_END" and declared:  # a word after a type: `Real end = 3`
            tokens.symbols[at] = "IDENT"
            message, hint = "'end' is a word of the language and cannot be a name", "take another name"
            said.append(Diagnostic("E0110", message, Span(source, start, end), hint=hint))
        elif symbol == "INDEX_END" and not depth:
            hint = "as the last index it belongs inside the brackets of an array: 'x[end]'"
            said.append(Diagnostic("E0101", "'end' is not allowed here", Span(source, start, end), hint=hint))
    return said


def left_open(text: str, part: Part) -> int | None:
    """Return where a comment or a string of a part begins that only what follows can end; None if there is none."""
    _, irregular = _tokens(text[: part.end], load(), part.start)
    return next((at for symbol, at in irregular if _opens(text, symbol, at)), None)


def certain_tokens(text: str, part: Part) -> tuple[Tokens, bool]:
    """Return the tokens of a part up to the first piece that is none, and whether that is wrong whatever follows."""
    tokens, irregular = _tokens(text[: part.end], load(), part.start)
    if not irregular:
        return tokens, False
    symbol, at = irregular[0]
    count = bisect_left(tokens.starts, at)
    end = (END_OF_TEXT,), ("",), (at,), (at,)
    return Tokens(*(own[:count] + list(e) for own, e in zip(tokens, end))), not _opens(text, symbol, at)


def _opens(text: str, symbol: str, at: int) -> bool:
    return symbol == "open_comment" or text[at] == '"'


def comments(source: Source) -> list[Span]:
    """The places of all comments, in their order, also of those inside of tokens like ``initial equation``."""
    patterns = dict(load().patterns)
    scanner = re.compile("|".join(f"(?P<{symbol}>{patterns[symbol]})" for symbol in ("COMMENT", "STRING", "IDENT")))
    found = scanner.finditer(source.text)
    return [Span(source, match.start(), match.end()) for match in found if match.lastgroup == "COMMENT"]


def _tokens(text: str, tables: Tables, start: int) -> tuple[Tokens, list[tuple[str, int]]]:
    """The tokens of a text from a character on, and kind and offset of each piece that is none."""
    tokens = Tokens([], [], [], [])
    irregular: list[tuple[str, int]] = []
    add_symbol, add_text = tokens.symbols.append, tokens.texts.append
    add_start, add_end = tokens.starts.append, tokens.ends.append
    ignored, literals = tables.ignored, tables.literals
    for match in _scanner(tables).finditer(text, start):
        symbol = match.lastgroup
        if symbol in ignored:
            continue
        value = match.group()
        if symbol == "IDENT" or symbol == "operator":
            if value in literals:
                symbol = value
        elif symbol in ("foreign", "open_comment", "wrong"):
            irregular.append((symbol, match.start()))
            if symbol == "open_comment":
                break  # whatever follows is the comment
            if symbol != "foreign":
                continue
            symbol = _FOREIGN[value]
        add_symbol(symbol)
        add_text(value)
        add_start(match.start())
        add_end(match.end())
    add_symbol(END_OF_TEXT)
    add_text("")
    add_start(len(text))
    add_end(len(text))
    return tokens, irregular


def _first_open(text: str, tokens: Tokens, irregular: list[tuple[str, int]], doubtful: bool) -> int | None:
    """Return where the first unclosed string or comment begins, None if there is none.

    Where a closing quote is missing, the next opening one closes the string, and a letter follows it at once.
    """
    certain = next((at for symbol, at in irregular if _opens(text, symbol, at)), None)
    if certain is not None or doubtful:
        for symbol, start, end in zip(tokens.symbols, tokens.starts, tokens.ends, strict=True):
            if symbol == "STRING" and text[end : end + 1].isalnum() and "\n" in text[start:end]:
                return start
    return certain


def _not_closed(source: Source, start: int) -> Diagnostic:
    line_end = source.text.find("\n", start)
    place = Span(source, start, len(source.text) if line_end < 0 else line_end)
    if source.text[start] == '"':
        return Diagnostic("E0104", "this string is not closed", place, expected="a '\"' at its end")
    return Diagnostic("E0105", "this comment is not closed", place, expected="'*/' at its end")


def _without_comments(text: str, start: int) -> str:
    """The text, as long as before, with the comment at `start` and those after it ended on their lines."""
    return text[:start] + re.sub(r"/\*[^\n]*", lambda comment: " " * len(comment[0]), text[start:])


def _close(text: str, start: int) -> str:
    """The text, as long as before, with the string that begins at `start` ended on its line."""
    line_end = text.find("\n", start)
    line = text[start : len(text) if line_end < 0 else line_end]
    kept = line.rstrip(" \t\r;),")
    closed = f'{kept[:-1]}"' if len(kept) > 1 else " "
    line = closed.replace("\\", " ") + line[len(kept) :]
    return text[:start] + line + text[start + len(line) :]


def _mend(source: Source, tokens: Tokens, symbol: str, offset: int) -> list[Diagnostic]:
    """Explain a piece that is no token, and put a name among the tokens where it was meant as one."""
    text = source.text
    if symbol == "foreign":
        sign = next(sign for sign in sorted(_FOREIGN, key=len, reverse=True) if text.startswith(sign, offset))
        place = Span(source, offset, offset + len(sign))
        return [Diagnostic("E0106", f"'{sign}' is not a sign of lmo", place, hint=f"write '{_FOREIGN[sign]}'")]
    if text[offset] == "'":
        end = offset + len(re.match(_OPEN_NAME, text[offset:])[0])
        _put_name(source, tokens, offset, end)
        prime = offset > 0 and (text[offset - 1].isalnum() or text[offset - 1] == "_")
        hint = "the derivative of x by time is written 'der(x)'" if prime else ""
        place = Span(source, offset, end)
        return [Diagnostic("E0104", "this quoted name is not closed", place, expected='a "\'"', hint=hint)]
    if not text[offset].isalpha():
        sign = text[offset]
        shown = f"'{sign}'" if sign.isprintable() else f"the character U+{ord(sign):04X}"
        place = Span(source, offset, offset + 1)
        return [Diagnostic("E0106", f"{shown} means nothing here", place, hint=_MEANT.get(sign, ""))]
    start, end = _put_name(source, tokens, offset, offset + len(re.match(_WORD, text[offset:])[0]))
    if start < offset and not text[offset - 1].isascii():
        return []  # said at its first wrong letter
    word = text[start:end]
    place = Span(source, start, end)
    latin = word.translate(_ALIKE)
    hint = f"a name in quotes can have it: \"'{word}'\""
    if latin.isascii():
        hint = f"some of its letters only look like Latin ones: in these it is '{latin}'"
    return [Diagnostic("E0106", f"'{text[offset]}' is not allowed in the name '{word}'", place, hint=hint)]


def _put_name(source: Source, tokens: Tokens, start: int, end: int) -> tuple[int, int]:
    """Make one name of the tokens that touch a range, whose extent is given back."""
    first = bisect_left(tokens.ends, start)
    last = bisect_right(tokens.starts, end - 1)
    if first < last and tokens.ends[first] == start and not tokens.texts[first][-1].isalnum():
        first += 1
    if first < last:
        start, end = min(start, tokens.starts[first]), max(end, tokens.ends[last - 1])
    tokens.symbols[first:last] = ["IDENT"]
    tokens.texts[first:last] = [source.text[start:end]]
    tokens.starts[first:last] = [start]
    tokens.ends[first:last] = [end]
    return start, end
