"""Tables as text: cells in lines, as spreadsheets, instruments and other programs write them.

The separator (semicolon, tab, comma, blanks), the encoding and the line ends follow from the file itself. Cells may
stand within quotation marks (RFC 4180). A line of comment begins with # or %; the last one before the numbers may name
the columns, as `numpy.savetxt` writes it. A first line ``sep=;`` is one for Excel.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator

from lmoc.messages.source import Source, Span
from lmoc.support.records import dataclass

_SEPARATORS = ";\t,"  # the first that the line of the columns' names has; else blanks
_NAMES = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
_COMMENT = re.compile(r"\s*[#%]\s*")
_FOR_EXCEL = re.compile(r"\ufeff?\s*sep=.\s*")
_NUMBER = re.compile(r"\s*[-+]?[.,]?\d")
_QUOTED = re.compile(r'"(?:[^"]|"")*"')
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF32_LE, "utf-32-le"), (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"),
)  # fmt: skip


class NotText(ValueError):
    """Bytes that are no text in an encoding which spreadsheets write."""


def decoded(data: bytes) -> str:
    """Return the text of a file with line feeds as line ends.

    Without a byte order mark it is UTF-8, or else the encoding of Western Windows, of which no two bytes that a number
    is written with mean anything else.

    Raises
    ------
    NotText
    """
    mark, encoding = next((m for m in _MARKS if data.startswith(m[0])), (b"", ""))
    if not mark and b"\0" in data:
        raise NotText("it is not text")
    for name in [encoding] if encoding else ["utf-8", "cp1252"]:
        try:
            text = data[len(mark) :].decode(name)
        except UnicodeDecodeError:
            continue
        return text.replace("\r\n", "\n").replace("\r", "\n")
    raise NotText("it is not text in a known encoding")


@dataclass(frozen=True)
class Sheet:
    """The cells of a table.

    Attributes
    ----------
    header : the names of the columns
    rows : the lines below that have anything in them
    separator : between the cells; a blank stands for any number of them
    """

    header: list[Span]
    rows: list[list[Span]]
    separator: str

    @property
    def separated_by(self) -> str:
        """What separates the columns, in words."""
        return _NAMES[self.separator]

    def stray_separator(self, row: list[Span]) -> str:
        """The name of a separator that a line has although the header has not; empty where there is none."""
        if self.separator == " ":
            return ""
        text = _QUOTED.sub("", row[0].to(row[-1]).text)
        stronger = _SEPARATORS[: _SEPARATORS.index(self.separator)]
        return next((_NAMES[mark] for mark in stronger if mark in text), "")


def sheet(source: Source) -> Sheet | None:
    """Return the cells of a text; None where it has no line."""
    separator = _separator(source.text)
    comments: list[list[Span]] = []
    lines: list[list[Span]] = []
    for row in _records(source, separator):
        text = row[0].text
        if _FOR_EXCEL.fullmatch(row[0].to(row[-1]).text) and not lines:
            continue
        comment = _COMMENT.match(text)
        if comment is None:
            lines.append(row)
        elif not lines:
            first = Span(source, row[0].start + comment.end(), row[0].end)
            comments.append([first, *row[1:]] if first.text.strip() or separator != " " else row[1:])
    if comments and comments[-1] and (not lines or _NUMBER.match(content(lines[0][0]))):
        lines.insert(0, comments[-1])
    if not lines:
        return None
    header = _with_units(lines[0]) if separator == " " else lines[0]
    return Sheet(header, lines[1:], separator)


def _with_units(names: list[Span]) -> list[Span]:
    """Names that blanks separate; a unit in brackets belongs to the name before it."""
    found: list[Span] = []
    for name in names:
        if found and name.text[0] in "[(":
            found[-1] = found[-1].to(name)
        else:
            found.append(name)
    return found


def _separator(text: str) -> str:
    """That of the line of names, outside of quotation marks: the first that is no comment, or one before numbers."""
    comment = ""
    for line in _QUOTED.sub('""', text[:100_000]).split("\n"):
        if not line.strip() or _FOR_EXCEL.fullmatch(line):
            continue
        if _COMMENT.match(line):
            comment = line
            continue
        named = comment if comment and _NUMBER.match(line) else line
        break
    else:
        named = comment
    return next((mark for mark in _SEPARATORS if mark in named), " ")


def _records(source: Source, separator: str) -> Iterator[list[Span]]:
    """The cells of all lines that have anything in them; a cell in quotation marks may go on in the next line."""
    row: list[Span] = []
    for match in _cells(separator).finditer(source.text):
        row.append(Span(source, match.start(1), match.end(1)))
        if match[2] in ("\n", ""):
            cells = [cell for cell in row if cell.start < cell.end] if separator == " " else row
            if any(cell.text.strip() for cell in cells):
                yield cells
            row = []


def _cells(separator: str) -> re.Pattern:
    """A cell and what ends it: a separator, a line feed, or nothing at the end of the text."""
    blanks, end = (" *", separator) if separator == "\t" else ("[ \t]*", separator)
    if separator == " ":
        return re.compile(r'[ \t]*("(?:[^"]|"")*"(?=[ \t\n]|\Z)|[^ \t\n]*)((?:[ \t]+(?=[^ \t\n])|[ \t]*\n|[ \t]*\Z))')
    return re.compile(rf'{blanks}("(?:[^"]|"")*"|[^{end}\n]*?){blanks}({end}|\n|\Z)')


def content(cell: Span) -> str:
    """Return the text of a cell without the quotation marks around it."""
    text = cell.text.strip()
    quoted = len(text) > 1 and text[0] == text[-1] == '"'
    return text[1:-1].replace('""', '"').strip() if quoted else text
