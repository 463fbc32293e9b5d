"""The diagnostics of a text: those of `lmoc check`, for every model that could be meant.

Checking solves for the start of a scene and can take seconds; an editor has it done in a process of its own, which is
ended when it takes too long or when the text has changed in the meantime.
"""

from __future__ import annotations

from collections.abc import Sequence

from lmoc.editor.analysis import analyse, folders_around
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.messages.source import Source, Span
from lmoc.support.records import dataclass

MOST_MODELS = 20  # of one text that are checked


@dataclass(frozen=True)
class FileRange:
    """A range of characters of a file."""

    file: str
    start: int
    end: int


@dataclass(frozen=True)
class Finding:
    """A diagnostic without its source, so that it can pass between processes."""

    code: str
    severity: str
    message: str
    place: FileRange | None
    expected: str
    found: str
    hint: str
    labels: tuple[tuple[FileRange, str], ...]


@dataclass(frozen=True)
class Checked:
    """The outcome of a check.

    Attributes
    ----------
    counts : {model: (stage, count) …}, of models without errors
    """

    findings: tuple[Finding, ...]
    counts: tuple[tuple[str, tuple[tuple[str, int], ...]], ...]


def check(text: str, path: str) -> Checked:
    """Check every model of a text that `lmoc check` would take with ``--model`` or without.

    Parameters
    ----------
    path : of the file that the text belongs to
    """
    findings: dict[Finding, None] = {}
    counts = []
    for model in _models(text, path):
        said, counted = _check_one(text, path, model)
        findings.update(dict.fromkeys(map(_finding, said)))
        if counted is not None:
            counts.append(counted)
    return Checked(tuple(findings), tuple(counts))


def _models(text: str, path: str) -> Sequence[str | None]:
    """The models to check; None stands for the one that is meant where none is named."""
    from lmoc.semantics.classes.choose import choose_model
    from lmoc.semantics.mistakes.wrong import NoModel, SeveralModels, Wrong

    analysis = analyse(text, path)
    try:
        choose_model(analysis.root, [analysis.file], None)
    except SeveralModels as wrong:
        return wrong.names[:MOST_MODELS]
    except NoModel:
        if any(True for _ in analysis.classes()):
            return ()
    except Wrong:
        pass  # it will be said
    return (None,)


def _check_one(
    text: str, path: str, model: str | None
) -> tuple[Sequence[Diagnostic], tuple[str, tuple[tuple[str, int], ...]] | None]:
    from lmoc.compilation import compiled, scene_of

    try:
        dae = compiled(Source(path, text), scene_of(model, path=[str(f.path) for f in folders_around(text, path)]))
        said = dae.check()
        return said, (dae.name, tuple(dae.reduced.counts.items()))
    except ModelError as error:
        return error.diagnostics, None


def _finding(d: Diagnostic) -> Finding:
    labels = tuple((_place(label.span), label.text) for label in d.labels)
    return Finding(d.code, d.severity, d.message, d.span and _place(d.span), d.expected, d.found, d.hint, labels)


def _place(span: Span) -> FileRange:
    return FileRange(span.source.name, span.start, span.end)
