"""A page of its own: no scripts, nothing loaded from elsewhere."""

from __future__ import annotations

from html import escape

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.4rem; } math[display=block] { font-size: 1.25rem; margin: .6rem 0; text-align: left; }
table { border-collapse: collapse; margin-top: 1.5rem; }
td, th { padding: .2rem .8rem .2rem 0; text-align: left; border-bottom: 1px solid #ddd; }
code { font-size: .9em; color: #555; }
""".strip()


def page(title: str, body: str) -> str:
    """A complete HTML page around a body."""
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f"<style>\n{_STYLE}\n</style>\n</head>\n<body>\n<h1>{escape(title)}</h1>\n{body}\n</body>\n</html>"
    )
