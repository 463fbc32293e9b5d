"""The standard layout of a text: a tree printed back, with its comments.

What was parsed from the result equals the tree that was printed, except for the places of its nodes. Comments
keep their order and stay with what they precede or, at the end of a line, with what precedes them.
Single blank lines between statements stay.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from lmoc.messages.source import Span
from lmoc.syntax import text as show
from lmoc.syntax import tree
from lmoc.syntax.lexer import comments
from lmoc.syntax.lines import broken

_INDENT = "  "
_SECTIONS = (
    ("initial_equations", "initial equation"),
    ("equations", "equation"),
    ("initial_statements", "initial algorithm"),
    ("statements", "algorithm"),
)


def format(file: tree.File) -> str:
    """A file in the standard layout.

    Parameters
    ----------
    file : tree.File
        As parsed without errors: what was not understood would be lost.
    """
    return joined([written(file)])


def written(file: tree.File) -> tuple[list[str], bool]:
    """Return the lines of a file in the standard layout, and whether a blank line stands behind them."""
    page = _Page(file.span)
    if file.within:
        page.line(f"within {'.'.join(file.within)};")
    for definition in file.classes:
        page.begin(definition.span)
        _class(page, definition)
    page.comments_before(len(page.text))
    return page.lines, bool(page.lines and page.lines[-1]) and page.blank_line_before(len(page.text))


def joined(parts: Iterable[tuple[list[str], bool]]) -> str:
    """Return the text of what has been written of some parts of a text, one behind the other."""
    lines: list[str] = []
    apart = False
    for own, open_end in parts:
        lines += [""] * (apart and bool(own)) + own
        apart = open_end if own else apart
    return "\n".join(lines) + "\n" if lines else ""


class _Page:
    """The lines written so far, and the comments of the text not yet among them."""

    def __init__(self, span: Span):
        self.text = span.source.text
        self.waiting = comments(span.source)
        self.lines: list[str] = []
        self.depth = 0
        self.reached = 0  # how far the original text is written

    def line(self, text: str) -> None:
        """Write a line at the current depth, broken where it is too long."""
        self.lines += broken(_INDENT * self.depth + text)

    def begin(self, span: Span) -> None:
        """Before what was written at a place: the comments up to there, and a blank line if there was one."""
        self.comments_before(span.start)
        self._blank_line(span.start)
        self.reached = max(self.reached, span.start)

    def end(self, position: int) -> None:
        """After what ends at a position: the comments inside it and on the rest of its line."""
        line_end = self.text.find("\n", position)
        stop = len(self.text) if line_end < 0 else line_end
        while self.waiting and self.waiting[0].start < stop:
            comment = self.waiting[0]
            between = self.text[max(position, self.reached) : comment.start]
            if comment.start >= position and not re.fullmatch(r"[\s;,)]*(loop|then)?\s*", between):
                break  # something else stands between
            self.waiting.pop(0)
            self.reached = max(self.reached, comment.end)
            if self.lines and "//" not in _without_strings(self.lines[-1]):
                self.lines[-1] += f"  {comment.text.rstrip()}"
            else:
                self.line(comment.text.rstrip())
        self.reached = max(self.reached, position)

    def comments_before(self, position: int) -> None:
        """Write the comments up to a position, each on a line of its own."""
        while self.waiting and self.waiting[0].start < position:
            comment = self.waiting.pop(0)
            self._blank_line(comment.start)
            self.lines.append(_INDENT * self.depth + comment.text.rstrip())
            self.reached = comment.end

    def _blank_line(self, position: int) -> None:
        if self.lines and self.lines[-1] and self.blank_line_before(position):
            self.lines.append("")

    def blank_line_before(self, position: int) -> bool:
        """Return whether there was one between what is written and a position."""
        return re.search(r"\n[ \t\r]*\n", self.text[self.reached : position]) is not None


def _without_strings(line: str) -> str:
    return re.sub(r'"(?:[^"\\]|\\.)*"', '""', line)


# ------------------------------------------------------------------ classes


def _class(page: _Page, c: tree.Class) -> None:
    if c.short is not None or c.literals is not None:
        page.line(f"{show.short_class(c)};")
        page.end(c.span.end)
        return
    page.line(f"{show.prefixes(c)}{c.kind} {c.name}{show.description(c.description)}")
    page.end(c.name_span.end)
    page.depth += 1
    _elements(page, c.elements)
    for field, word in _SECTIONS:
        items = getattr(c, field)
        whole = [items] if items else []
        for section in c.algorithms(field.startswith("initial")) if field.endswith("statements") else whole:
            page.depth -= 1
            page.line(word)
            page.depth += 1
            _items(page, section)
    if c.external is not None:
        page.depth -= 1
        page.line(f"external{show.external(c.external)};")
        page.depth += 1
    if c.annotation is not None:
        page.begin(c.annotation.span)
        page.line(f"annotation{show.modification(c.annotation)};")
        page.end(c.annotation.span.end)
    page.comments_before(c.span.end)
    page.depth -= 1
    page.line(f"end {c.name}{_closing(c)};")
    page.end(c.span.end)


def _closing(c: tree.Class) -> str:
    """Return the text after the name that follows ``end``."""
    if c.constrained_by is None:
        return ""
    return f" constrainedby {show.expression(c.constrained_by)}{show.modification(c.constraint)}"


def _elements(page: _Page, elements: Iterable[tree.Element]) -> None:
    protected = False
    for group in _groups(elements):
        first = group[0]
        if getattr(first, "protected", protected) != protected:
            protected = not protected
            page.depth -= 1
            page.line("protected" if protected else "public")
            page.depth += 1
        page.begin(first.span)
        if isinstance(first, tree.Class):
            _class(page, first)
            continue
        page.line(f"{_element(group)};")
        page.end(first.span.end)


def _groups(elements: Iterable[tree.Element]) -> Iterable[list]:
    """The elements, those declared together in one list."""
    group: list = []
    for element in elements:
        if group and isinstance(element, tree.Component) and element.span is group[0].span:
            group.append(element)
            continue
        if group:
            yield group
        group = [element]
    if group:
        yield group


def _element(group: list) -> str:
    first = group[0]
    if isinstance(first, tree.Component):
        return show.component(*group)
    described = show.description(first.description, first.annotation)
    if isinstance(first, tree.Extends):
        return f"extends {show.expression(first.base)}{show.modification(first.modification)}{described}"
    path = ".".join(first.path)
    if first.alias:
        path = f"{first.alias} = {path}"
    elif first.wildcard:
        path += ".*"
    elif first.names:
        path += f".{{{', '.join(first.names)}}}"
    return f"import {path}{described}"


# -------------------------------------------------- equations and statements


def _items(page: _Page, items: Iterable[tree.Equation | tree.Statement]) -> None:
    for item in items:
        page.begin(item.span)
        if type(item) in _COMPOUND:
            _COMPOUND[type(item)](page, item)
        else:
            page.line(f"{_simple(item)};")
        page.end(item.span.end)


def _simple(item: tree.Equation | tree.Statement) -> str:
    """An equation or statement of one line."""
    described = show.description(item.description, item.annotation)
    match item:
        case tree.Equality():
            return f"{show.simple(item.left)} = {show.expression(item.right)}{described}"
        case tree.Assignment():
            return f"{show.simple(item.target)} := {show.expression(item.value)}{described}"
        case tree.Connect():
            return f"connect({show.expression(item.left)}, {show.expression(item.right)}){described}"
        case tree.CallEquation() | tree.CallStatement():
            return f"{show.expression(item.call)}{described}"
        case tree.Return():
            return f"return{described}"
        case tree.Break():
            return f"break{described}"
    raise TypeError(f"no layout for {type(item).__name__}")


def _body(page: _Page, items: Iterable[tree.Equation | tree.Statement]) -> None:
    page.depth += 1
    _items(page, items)
    page.depth -= 1


def _close(page: _Page, item: tree.Equation | tree.Statement, word: str) -> None:
    page.depth += 1
    page.comments_before(item.span.end)
    page.depth -= 1
    page.line(f"end {word}{show.description(item.description, item.annotation)};")


def _loop(page: _Page, item: tree.For | tree.ForStatement) -> None:
    page.line(f"for {show.indices(item.indices)} loop")
    page.end(item.indices[-1].span.end)
    _body(page, item.body)
    _close(page, item, "for")


def _while(page: _Page, item: tree.WhileStatement) -> None:
    page.line(f"while {show.expression(item.condition)} loop")
    page.end(item.condition.span.end)
    _body(page, item.body)
    _close(page, item, "while")


def _branches(page: _Page, item: tree.IfEquation | tree.IfStatement | tree.When | tree.WhenStatement) -> None:
    word = "when" if isinstance(item, (tree.When, tree.WhenStatement)) else "if"
    for number, (condition, body) in enumerate(item.branches):
        page.comments_before(condition.span.start)
        page.line(f"{'else' * (number > 0)}{word} {show.expression(condition)} then")
        page.end(condition.span.end)
        _body(page, body)
    otherwise = getattr(item, "otherwise", ())
    if otherwise:
        page.line("else")
        _body(page, otherwise)
    _close(page, item, word)


_COMPOUND = {
    tree.For: _loop,
    tree.ForStatement: _loop,
    tree.WhileStatement: _while,
    tree.IfEquation: _branches,
    tree.IfStatement: _branches,
    tree.When: _branches,
    tree.WhenStatement: _branches,
}
