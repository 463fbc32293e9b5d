"""One self-contained page: no network, no server."""

from __future__ import annotations

import json
import re
from functools import cached_property
from html import escape
from pathlib import Path

from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.report.files import check_target
from lmoc.report.result import Result
from lmoc.report.summary import counted, energy_text, stages, times_text
from lmoc.support.records import dataclass
from lmoc.support.replacing import replace_file
from lmoc.view.page.contents import Contents, contents
from lmoc.view.page.join import asset, joined, packed, worker

UPLOT = "1.6.32"


@dataclass(frozen=True)
class Page:
    """A page in which a run moves; shown in notebooks, written by `save`.

    Attributes
    ----------
    run : what it shows
    version : of the program, for the page's head
    """

    run: Result
    version: str

    @cached_property
    def contents(self) -> Contents:
        """What is in the page: data, equations, and what is missing."""
        run = self.run
        return contents(run.fine if run.trajectory.kept is None else run, run.flat.name)

    @cached_property
    def html(self) -> str:
        """The text of the page."""
        run, found = self.run, self.contents
        title = run.flat.name
        missing = (f'<p class="warning">{escape(sentence)}</p>' for sentence in dict.fromkeys(found.missing))
        return _filled(asset("page.html"), {
            "version": self.version,
            "title": escape(title),
            "subtitle": escape(run.flat.description),
            "missing": "".join(missing),
            "equations": found.equations,
            "terms": found.terms,
            "system": system_html(run, found.data["script"].get("rtol")),
            "style": asset(f"uplot-{UPLOT}.min.css") + asset("page.css"),
            "uplot": asset(f"uplot-{UPLOT}.min.js"),
            "uplot-version": UPLOT,
            "licence": escape(asset("uplot-LICENSE.txt")),
            "data": packed(json_text(found).encode()),
            "script": joined("main.js"),
            "worker": packed(worker().encode()),
        })  # fmt: skip

    def save(self, path: str | Path) -> Path:
        """Write the page.

        Raises
        ------
        ModelError
            E0623, E0624: it cannot be written.
        """
        path = Path(path)
        check_target(path, (".html", ".htm"))
        try:
            replace_file(path, lambda target: target.write_text(self.html, encoding="utf-8"))
        except OSError as error:
            reason = error.strerror or error
            raise ModelError([Diagnostic("E0623", f"'{path}' cannot be written: {reason}")]) from None
        return path

    def _repr_html_(self) -> str:
        """Return a frame with the page in it, for notebooks."""
        style = "width:100%;height:760px;border:1px solid #ddd"
        return f'<iframe srcdoc="{escape(self.html)}" style="{style}" title="{escape(self.run.flat.name)}"></iframe>'

    def __repr__(self) -> str:
        return f"<Page of {self.run!r}>"


def _filled(template: str, values: dict[str, str]) -> str:
    """Put values into a template at once: what looks like a place within a value stays as it is."""
    return re.sub(r"\{\{([\w-]+)\}\}", lambda found: values[found[1]], template)


def json_text(found: Contents) -> str:
    """Return the data of a page as JSON."""
    return json.dumps(found.data, allow_nan=False, ensure_ascii=False, separators=(",", ":"))


def system_html(run: Result, own: float | None) -> str:
    """Return what was solved and what it cost, as a table.

    Parameters
    ----------
    own : relative tolerance of the simulation in the page; None where it has none
    """
    stats, states = run.stats, run.states
    named = ", ".join(f"<code>{escape(name)}</code>" for name in states[:12]) + (" …" if len(states) > 12 else "")
    counts = [f"{stats[key]} {key}" for key in ("steps", "evaluations") if key in stats]
    rows = {
        "states": named or "none",
        "reduction": escape(" → ".join(counted(n, stage) for stage, n in stages(run.reduced.counts))),
        "solver": escape(f"{stats.get('solver', '')} ({stats.get('reason', '')}), rtol {stats.get('rtol', 0):g}"),
        "cost": escape("; ".join(filter(None, [", ".join(counts), times_text(run.timings)]))),
        "energy": escape(energy_text(run)),
    }
    if own is not None:
        rows["in this page"] = f"DOP853, and Radau IIA where stability limits its steps, rtol {own:g}"
    warnings = [d.message for d in run.notes if d.severity == "warning"]
    body = "".join(f'<tr><th scope="row">{name}</th><td>{text}</td></tr>' for name, text in rows.items())
    said = "".join(f'<p class="warning">{escape(text)}.</p>' for text in warnings)
    return f'<table aria-label="States, reduction, cost">{body}</table>{said}'
