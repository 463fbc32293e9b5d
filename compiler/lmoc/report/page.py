"""A page of its own: no scripts, nothing loaded from elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from itertools import islice

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.4rem; } math[display=block] { font-size: 1.25rem; margin: .6rem 0; text-align: left; }
table { border-collapse: collapse; margin-top: 1.5rem; }
td, th { padding: .2rem .8rem .2rem 0; text-align: left; border-bottom: 1px solid #ddd; }
code { font-size: .9em; color: #555; }
""".strip()


_MOST_NAMES = 12  # of a list


def named_lists(title: str, names: Mapping[str, Iterable[str]]) -> str:
    """A title and lists of names with a label each, for a notebook; what is empty is left out."""
    rows = []
    for label, listed in names.items():
        listed = list(islice(listed, _MOST_NAMES + 1))
        shown = [f"<code>{escape(name)}</code>" for name in listed[:_MOST_NAMES]]
        if listed:
            rows.append(f"<tr><th>{label}</th><td>{', '.join(shown)}{' …' * (len(listed) > _MOST_NAMES)}</td></tr>")
    return f"<p><b>{escape(title)}</b></p><table>{''.join(rows)}</table>"


def page(title: str, body: str) -> str:
    """A complete HTML page around a body."""
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f"<style>\n{_STYLE}\n</style>\n</head>\n<body>\n<h1>{escape(title)}</h1>\n{body}\n</body>\n</html>"
    )
