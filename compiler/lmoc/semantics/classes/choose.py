"""Choice of the model among those of the files, and the scopes in which its names are looked up."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from lmoc.messages.diagnostics import Diagnostic, Label, Report, nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import NoModel, SeveralModels, Wrong
from lmoc.sources.library import Packages
from lmoc.sources.packages import Folder, own_folders
from lmoc.support.quoted import split
from lmoc.syntax import tree

_SHOWN = 5  # so many models are marked where one must be chosen


def open_scopes(
    files: Sequence[tree.File], library: Sequence[tree.File], report: Report, folders: Sequence[Folder] = ()
) -> Scope:
    """The scope of the user's classes; that of the library's is around it, so that the user's names shadow them."""
    around = Scope(None, None, report, True)
    _fill(around, library)
    around.folders = (Packages(),) if library else ()
    root = Scope(None, around, report, False)
    root.folders = tuple(folders)
    _fill(root, files)
    return root


def mistakes_in(files: Sequence[tree.File]) -> list[Diagnostic]:
    """Return the syntax errors in the classes of the files."""
    return [d for definition in _with_inner(c for file in files for c in file.classes) for d in definition.mistakes]


def left_out(files: Sequence[tree.File], report: Report) -> Iterator[Diagnostic]:
    """Warn of classes that the grammar has refused, and that the model does not use."""
    for definition in _with_inner(c for file in files for c in file.classes):
        wrong = [d for d in definition.mistakes if d.severity == "error"]
        if wrong and wrong[0] not in report.diagnostics:
            message = f"'{definition.name}' has a mistake and is left out: {wrong[0].message}"
            yield Diagnostic("W0246", message, wrong[0].span, wrong[0].expected, wrong[0].found, wrong[0].hint)


def _with_inner(classes: Iterable[tree.Class]) -> Iterator[tree.Class]:
    for definition in classes:
        yield definition
        yield from _with_inner(e for e in definition.elements if isinstance(e, tree.Class))


def _fill(root: Scope, files: Sequence[tree.File]) -> None:
    pending = []
    for file in files:
        if file.within:
            pending.append(file)
        else:
            for definition in file.classes:
                _add(root, definition, file)
    for file in sorted(pending, key=lambda f: len(f.within)):
        scope: Scope | None = root
        for name in file.within:
            scope = scope.class_in(name) if scope else None
        if scope is None:
            message = f"there is no package '{'.'.join(file.within)}' for it to be within"
            place = file.classes[0].name_span if file.classes else _first_line([file])
            hint = "give the package's file as well, name its folder with --path, or leave 'within' out"
            root.report.error("E0202", message, place, hint=hint)
            continue
        for definition in file.classes:
            _add(scope, definition, file)


def _add(scope: Scope, definition: tree.Class, file: tree.File) -> None:
    added = scope.add_class(definition)
    added.folders = own_folders(file, definition)


def choose_model(root: Scope, files: Sequence[tree.File], name: str | None) -> Scope:
    """The model of that name; without one, the only model that no other class of the files uses or extends.

    The one `model` at the top is meant too: it may bring a library along, in packages or as blocks, of which it need
    not use everything.
    """
    models = [scope for scope in _own_classes(root, files) if can_run(scope)]
    if name is not None:
        return _named(root, models, str(name))
    if not models:
        if root.report.errors:
            raise Wrong()  # a class has been left out: it appears in no package, say
        hint = "a scene is 'model Name … end Name;'"
        raise NoModel("E0602", "there is no model to run in the file", _first_line(files), hint=hint)
    uses = _uses(_own_classes(root, files))
    used = {id(target) for user, _, target in uses if target is not user}
    free = [scope for scope in models if id(scope) not in used]
    top = {id(definition) for file in files for definition in file.classes}
    at_top = [scope for scope in models if id(scope.definition) in top and scope.kind == "model"]
    of_no_model = [scope for scope in free if scope.parent.definition is None or scope.parent.kind == "package"]
    for meant in (free, at_top, of_no_model):
        if len(meant) == 1:
            return meant[0]
    if not free:
        _refuse_cycle(uses)
    message = "several models could be meant" if free else "every model here is used by another one"
    candidates = free or models
    labels = tuple(Label(scope.definition.name_span, "or this one") for scope in candidates[1:_SHOWN])
    names = tuple(scope.full_name for scope in candidates)
    raise SeveralModels(names, "E0603", message, candidates[0].definition.name_span, labels=labels,
                        hint="select one with --model NAME")  # fmt: skip


def _first_line(files: Sequence[tree.File]) -> Span | None:
    return Span(files[0].span.source, 0, 0) if files else None


def _own_classes(root: Scope, files: Sequence[tree.File]) -> list[Scope]:
    """All classes that the files define, those inside of others included."""
    inner = {id(c.span.source): k for k, file in enumerate(files) for c in _with_inner(file.classes)}
    sources = {id(file.span.source): k for k, file in enumerate(files)} | inner
    found, pending = [], [root]
    while pending:
        for scope in pending.pop().local.values():
            pending.append(scope)
            if id(scope.definition.span.source) in sources:
                found.append(scope)
    return sorted(found, key=lambda s: sources[id(s.definition.span.source)])


def can_run(scope: Scope) -> bool:
    return scope.kind in ("model", "block", "class") and not scope.definition.partial


def _named(root: Scope, models: list[Scope], name: str) -> Scope:
    first, *rest = split(name)
    scope: Scope | None = root
    found: Scope | None = None
    while scope is not None and found is None:  # the user's classes, then the library's
        found = scope.class_in(first)
        scope = scope.parent
    inside: Scope = root
    for part in (first, *rest):
        if part is not first:
            inside, found = found, found.element(part)
        if not isinstance(found, Scope):
            raise _no_model(inside, part, name, models)
    if found.definition.partial:
        raise Wrong("E0209", f"'{name}' is partial: a model must extend it", found.definition.name_span)
    if not can_run(found):
        raise Wrong("E0601", f"'{name}' is a {found.kind}, not a model", found.definition.name_span)
    return found


def _no_model(inside: Scope, part: str, name: str, models: list[Scope]) -> Wrong:
    """Return the mistake for a class that contains no class of that name."""
    inside.refuse_files(part)
    names = [s.full_name for s in models]
    hint = nearest(name, names) or nearest(part, list(inside.names()))
    if inside.definition is not None:
        return Wrong("E0601", f"'{inside.full_name}' has no model '{part}'", inside.definition.name_span, hint=hint)
    places = ", ".join(f"'{folder.path}'" for folder in inside.folders)
    hint = hint or (f"the file has {', '.join(names)}" if names else f"it was looked for in {places}" if places else "")
    return Wrong("E0601", f"there is no model '{name}'", None, hint=hint)


def _uses(classes: Sequence[Scope]) -> list[tuple[Scope, tree.Ref, Scope]]:
    """Return which class uses which other one, as the type of a part, a base or under a new name, and where."""
    uses: list[tuple[Scope, tree.Ref, Scope]] = []
    for scope in classes:
        definition = scope.definition
        refs: list[tuple[tree.Ref, Scope]] = []
        for element in definition.elements:
            if isinstance(element, tree.Component):
                refs += [(ref, scope) for ref in (element.type, *_redeclared(element.modification))]
            elif isinstance(element, tree.Extends):
                refs += [(ref, scope) for ref in (element.base, *_redeclared(element.modification))]
        if definition.short is not None:
            refs.append((definition.short.base, scope.parent))
        for ref, where in refs:
            try:
                target = where.find_class(ref, inherited=False)
            except Wrong:
                continue  # reported where the class is used
            if isinstance(target, Scope):
                uses.append((scope, ref, target))
    return uses


def _refuse_cycle(uses: Sequence[tuple[Scope, tree.Ref, Scope]]) -> None:
    """Raise an error for the first cycle among the uses; return where there is none."""
    following: dict[int, list[tuple[Scope, tree.Ref, Scope]]] = {}
    for use in uses:
        following.setdefault(id(use[0]), []).append(use)
    finished: set[int] = set()
    for start, _, _ in uses:
        path: list[tuple[Scope, tree.Ref, Scope]] = []
        pending = [iter(following[id(start)])]
        while pending:
            use = next(pending[-1], None)
            if use is None:
                pending.pop()
                finished.add(id(path.pop()[2]) if path else id(start))
                continue
            target = use[2]
            around = [id(user) for user, _, _ in (*path, use)]
            if id(target) in around:
                raise _cycle([*path, use][around.index(id(target)) :])
            if id(target) not in finished:
                path.append(use)
                pending.append(iter(following.get(id(target), ())))


def _cycle(path: Sequence[tuple[Scope, tree.Ref, Scope]]) -> Wrong:
    (first, place, _), *rest = path
    names = [user.full_name for user, _, _ in path]
    labels = tuple(Label(ref.span, f"'{user.name}' needs '{target.name}'") for user, ref, target in rest)
    return Wrong(
        "E0208", f"'{first.full_name}' contains or extends itself", place.span, labels=labels,
        found=" → ".join([*names, names[0]]), hint="a class cannot contain itself: remove one of these declarations",
    )  # fmt: skip


def _redeclared(modification: tree.Modification | None) -> Iterator[tree.Ref]:
    """Types of the parts that a modification redeclares."""
    for argument in modification.arguments if modification else ():
        if isinstance(argument, tree.ElementModification):
            yield from _redeclared(argument.modification)
        elif isinstance(argument.element, tree.Component):
            yield argument.element.type
        elif argument.element.short is not None:
            yield argument.element.short.base
