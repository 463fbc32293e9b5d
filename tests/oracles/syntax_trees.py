"""Random syntax trees: everything that the grammar can say."""

from hypothesis import strategies as st

from lmoc.messages.source import Source, Span
from lmoc.syntax import tree

NOWHERE = Source("generated", "")


def here() -> Span:
    """A place of its own: declarations that share one are printed together."""
    return Span(NOWHERE, 0, 0)


def make(kind: type, **fields: st.SearchStrategy) -> st.SearchStrategy:
    """Nodes of a kind, with a place.

    Drawn by a function, because a strategy made of strategies is spelled out with all of them, level by level, and
    that text grows without bound.
    """

    @st.composite
    def node(draw: st.DrawFn):
        return kind(**{name: draw(field) for name, field in fields.items()}, span=here())

    return node()


def ref(name: str) -> tree.Ref:
    return tree.Ref((tree.RefPart(name, (), here()),), False, here())


def tuples(items: st.SearchStrategy, least: int = 0, most: int = 3) -> st.SearchStrategy:
    return st.lists(items, min_size=least, max_size=most).map(tuple)


names = st.sampled_from(["a", "b2", "_c", "mass", "x_y", "'quoted name'", "'it\\'s'", "T"])
texts = st.text(alphabet="ab \"\\\n\t'é/*", max_size=6)
part = make(tree.RefPart, name=names, subscripts=st.just(()))
plain_refs = make(tree.Ref, parts=tuples(part, 1), absolute=st.booleans())

numbers = make(tree.Number, value=st.integers(0, 10**6).map(float), integer=st.just(True)) | make(
    tree.Number, value=st.floats(0, 1e300, allow_nan=False), integer=st.just(False)
)
leaves = (
    numbers
    | make(tree.String, value=texts)
    | make(tree.Boolean, value=st.booleans())
    | plain_refs
)
OPERATORS = "or and < <= > >= == <> + - .+ .- * / .* ./ ^ .^".split()


def indices(inner: st.SearchStrategy) -> st.SearchStrategy:
    return tuples(make(tree.ForIndex, name=names, range=st.none() | inner), 1, 2)


def grown(inner: st.SearchStrategy) -> st.SearchStrategy:
    """Expressions with `inner` ones in them."""
    subscripts = inner | make(tree.Colon) | make(tree.EndSubscript)
    parts = tuples(make(tree.RefPart, name=names, subscripts=tuples(subscripts, 0, 2)), 1, 2)
    refs = make(tree.Ref, parts=parts, absolute=st.booleans())
    comprehension = make(tree.Comprehension, element=inner, indices=indices(inner))
    named = st.lists(st.tuples(names, inner), max_size=2, unique_by=lambda pair: pair[0]).map(tuple)
    special = st.sampled_from(["der", "initial"]).map(ref)
    results = tuples(inner | st.none(), 2, 3) | st.just((None,))
    return (
        refs
        | make(tree.Unary, op=st.sampled_from(["+", "-", "not"]), operand=inner)
        | make(tree.Binary, op=st.sampled_from(OPERATORS), left=inner, right=inner)
        | make(tree.If, branches=tuples(st.tuples(inner, inner), 1, 2), otherwise=inner)
        | make(tree.Call, function=refs | special, arguments=tuples(inner), named=named)
        | make(tree.Call, function=plain_refs, arguments=st.tuples(comprehension), named=st.just(()))
        | comprehension
        | make(tree.Range, start=inner, step=st.none() | inner, stop=inner)
        | make(tree.Array, items=tuples(inner))
        | make(tree.Matrix, rows=tuples(tuples(inner, 1, 2), 1, 2))
        | make(tree.Tuple, items=results)
    )


expressions = st.recursive(leaves, grown, max_leaves=8)
calls = make(tree.Call, function=plain_refs, arguments=tuples(expressions, 0, 2), named=st.just(()))


# ------------------------------------------------------------ modifications


def modifications(inner: st.SearchStrategy) -> st.SearchStrategy:
    """Modifications with the given arguments; one without arguments has a value."""
    return make(tree.Modification, arguments=tuples(inner, 0, 2), value=st.none() | expressions)


def arguments(inner: st.SearchStrategy) -> st.SearchStrategy:
    modification = st.none() | modifications(inner)
    plain = make(
        tree.ElementModification,
        name=tuples(names, 1, 2),
        modification=modification,
        each=st.booleans(),
        final=st.booleans(),
        description=texts,
    )
    return plain | st.builds(
        lambda element, each: tree.Redeclaration(element, each, element.final, here()),
        components(modification, st.just(True)) | short_classes(modification, st.just(True)),
        st.booleans(),
    )


def constraints(modification: st.SearchStrategy) -> st.SearchStrategy:
    return st.just((None, None)) | st.tuples(plain_refs, modification.filter(lambda m: m is None or m.value is None))


def components(modification: st.SearchStrategy, redeclare: st.SearchStrategy) -> st.SearchStrategy:
    def build(constraint: tuple, **fields: object) -> tree.Component:
        base, modifiers = constraint
        return tree.Component(
            protected=False, span=here(), name_span=here(), constrained_by=base, constraint=modifiers, **fields
        )

    return st.builds(
        build,
        constraint=constraints(modification),
        name=names,
        type=plain_refs,
        dimensions=tuples(expressions | make(tree.Colon), 0, 2),
        modification=modification,
        condition=st.none() | expressions,
        description=texts,
        annotation=st.none(),
        flow=st.booleans(),
        variability=st.sampled_from(["", "parameter", "constant", "discrete"]),
        causality=st.sampled_from(["", "input", "output"]),
        inner=st.booleans(),
        outer=st.booleans(),
        final=st.booleans(),
        replaceable=st.booleans(),
        redeclare=redeclare,
    )


KINDS = "class model block connector type record package function".split()


def classes(
    redeclare: st.SearchStrategy, constraint: st.SearchStrategy, **body: st.SearchStrategy
) -> st.SearchStrategy:
    """Classes with a given body, everything else being empty."""

    def build(constraint: tuple, **fields: object) -> tree.Class:
        empty = dict.fromkeys(("elements", "equations", "initial_equations", "statements", "initial_statements"), ())
        empty |= {"annotation": None, "short": None, "literals": None, "description": ""}
        base, modifiers = constraint
        return tree.Class(
            **{**empty, **fields},
            protected=False,
            span=here(),
            name_span=here(),
            constrained_by=base,
            constraint=modifiers,
        )

    return st.builds(
        build,
        constraint=constraint,
        kind=st.sampled_from(KINDS),
        name=names,
        partial=st.booleans(),
        encapsulated=st.booleans(),
        description=texts,
        final=st.booleans(),
        inner=st.booleans(),
        outer=st.just(False),
        replaceable=st.booleans(),
        redeclare=redeclare,
        **body,
    )


def short_classes(modification: st.SearchStrategy, redeclare: st.SearchStrategy) -> st.SearchStrategy:
    short = make(
        tree.ShortClass,
        base=plain_refs,
        dimensions=tuples(expressions, 0, 2),
        modification=modification.filter(lambda m: m is None or m.value is None),
        causality=st.sampled_from(["", "input", "output"]),
    )
    return classes(redeclare, constraints(modification), short=short)


argument = st.recursive(
    make(
        tree.ElementModification,
        name=tuples(names, 1, 2),
        modification=st.none(),
        each=st.booleans(),
        final=st.booleans(),
        description=texts,
    ),
    arguments,
    max_leaves=2,
)
modification = modifications(argument)
annotation = st.none() | make(tree.Modification, arguments=tuples(argument, 0, 1), value=st.none())
told = {"description": texts, "annotation": annotation}


# ------------------------------------------------- equations and statements


def loops(inner: st.SearchStrategy, kinds: tuple[type, type, type]) -> st.SearchStrategy:
    """``for``, ``if`` and ``when`` around `inner` equations or statements."""
    loop, choice, when = kinds
    body = tuples(inner, 0, 2)
    branches = tuples(st.tuples(expressions, body), 1, 2)
    return (
        make(loop, indices=indices(expressions), body=body, **told)
        | make(choice, branches=branches, otherwise=body, **told)
        | make(when, branches=branches, **told)
    )


simple_equations = (
    make(tree.Equality, left=expressions, right=expressions, **told)
    | make(tree.Connect, left=plain_refs, right=plain_refs, **told)
    | make(tree.CallEquation, call=calls, **told)
)
equations = st.recursive(
    simple_equations, lambda inner: loops(inner, (tree.For, tree.IfEquation, tree.When)), max_leaves=3
)
targets = plain_refs | make(tree.Tuple, items=tuples(plain_refs | st.none(), 2, 3))
simple_statements = (
    make(tree.Assignment, target=targets, value=expressions, **told)
    | make(tree.CallStatement, call=calls, **told)
    | make(tree.Return, **told)
    | make(tree.Break, **told)
)
statements = st.recursive(
    simple_statements,
    lambda inner: loops(inner, (tree.ForStatement, tree.IfStatement, tree.WhenStatement))
    | make(tree.WhileStatement, condition=expressions, body=tuples(inner, 0, 2), **told),
    max_leaves=3,
)


# ----------------------------------------------------------- classes, files

plain_names = st.sampled_from(["A", "B", "C3", "Mechanics"])
paths = tuples(plain_names, 1)
no, none = st.just(False), st.just(())
imports = (
    make(tree.Import, path=paths, alias=st.sampled_from(["", "M"]), wildcard=no, names=none, **told)
    | make(tree.Import, path=paths, alias=st.just(""), wildcard=st.just(True), names=none, **told)
    | make(tree.Import, path=paths, alias=st.just(""), wildcard=no, names=tuples(plain_names, 1, 2), **told)
)
extends = make(
    tree.Extends,
    base=plain_refs,
    modification=st.none() | make(tree.Modification, arguments=tuples(argument, 0, 2), value=st.none()),
    protected=st.booleans(),
    **told,
)
some_modification = st.none() | modification
literals = st.lists(st.tuples(names, texts), max_size=3)


@st.composite
def enumerations(draw: st.DrawFn) -> tree.Class:
    given_literals = draw(literals)
    return draw(
        classes(
            st.booleans(),
            st.just((None, None)),
            literals=st.just(tuple(name for name, _ in given_literals)),
            literal_descriptions=st.just(tuple(text for _, text in given_literals)),
        )
    )


flat_elements = (
    imports
    | extends
    | components(some_modification, st.booleans())
    | short_classes(some_modification, st.booleans())
    | enumerations()
)


def long_classes(elements: st.SearchStrategy) -> st.SearchStrategy:
    return classes(
        st.booleans(),
        st.just((None, None)),
        elements=tuples(elements, 0, 3),
        equations=tuples(equations, 0, 2),
        initial_equations=tuples(equations, 0, 1),
        statements=tuples(statements, 0, 2),
        initial_statements=tuples(statements, 0, 1),
        annotation=annotation,
    )


definitions = st.recursive(flat_elements, long_classes, max_leaves=4).filter(lambda e: isinstance(e, tree.Class))
files = make(tree.File, within=tuples(plain_names, 0, 2), classes=tuples(definitions, 0, 2))
