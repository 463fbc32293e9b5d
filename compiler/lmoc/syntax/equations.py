"""Actions of the grammar's rules for equations and statements."""

from __future__ import annotations

from lmoc.messages.source import Span
from lmoc.syntax import tree
from lmoc.syntax.expressions import ExpressionActions


class Otherwise(list):
    """The items after ``else``."""


def _split_branches(v: list) -> tuple[tuple, tuple]:
    """The branches of an ``if``, and what follows its ``else``."""
    branches = tuple([b for b in v if type(b) is tuple])
    otherwise = next((tuple(b) for b in v if isinstance(b, Otherwise)), ())
    return branches, otherwise


class EquationActions(ExpressionActions):
    """Equations and statements."""

    def equality(self, v: list, start: int, end: int) -> tree.Equality:
        left, right, comment = v
        return tree.Equality(left, right, comment.description, Span(self.source, start, end), comment.annotation)

    def wrong_equality(self, v: list, start: int, end: int) -> tree.Equality:
        self._wrong_sign(v[0], v[1], ":=", "=", "an equation")
        return self.equality(v, start, end)

    def assignment(self, v: list, start: int, end: int) -> tree.Assignment:
        target, value, comment = v
        for item in target.items if isinstance(target, tree.Tuple) else (target,):
            if item is not None and not isinstance(item, tree.Ref):
                self.report.error(
                    "E0111",
                    "only a variable can be assigned to",
                    item.span,
                    expected="a name, or '(a, b)' for a function with several results",
                )
        return tree.Assignment(target, value, self.span(start, end), *comment)

    def wrong_assignment(self, v: list, start: int, end: int) -> tree.Assignment:
        self._wrong_sign(v[0], v[1], "=", ":=", "an assignment in an algorithm")
        return self.assignment(v, start, end)

    def _wrong_sign(self, left: tree.Expression, right: tree.Expression, found: str, expected: str, what: str) -> None:
        at = self.source.text.find(found, left.span.end, right.span.start)
        self.report.error(
            "E0107",
            f"{what} is written with '{expected}'",
            self.span(at, at + len(found)) if at >= 0 else left.span.to(right.span),
            expected=f"'{expected}'",
            found=f"'{found}'",
        )

    def lone_expression(self, v: list, start: int, end: int) -> tree.Equation:
        expression, comment = v
        place = self.span(start, end)
        if isinstance(expression, tree.Call):
            return tree.CallEquation(expression, comment.description, place, comment.annotation)
        self._not_a_relation(expression, "an equation", "=")
        return tree.Equality(expression, expression, comment.description, place, comment.annotation)

    def lone_statement(self, v: list, start: int, end: int) -> tree.Statement:
        expression, comment = v
        place = self.span(start, end)
        if isinstance(expression, tree.Call):
            return tree.CallStatement(expression, place, *comment)
        self._not_a_relation(expression, "a statement", ":=")
        return tree.Assignment(expression, expression, place, *comment)

    def _not_a_relation(self, expression: tree.Expression, what: str, sign: str) -> None:
        if isinstance(expression, tree.Binary) and expression.op == "==":
            self._wrong_sign(expression.left, expression.right, "==", sign, what)
            return
        self.report.error(
            "E0111",
            f"{what} needs '{sign}'",
            expression.span,
            expected=f"'left {sign} right'",
            found="an expression alone",
        )

    def connect(self, v: list, start: int, end: int) -> tree.Connect:
        left, right, comment = v
        return tree.Connect(left, right, comment.description, self.span(start, end), comment.annotation)

    # ------------------------------------------------------ with branches

    def equation_branch(self, v: list, start: int, end: int) -> tuple:
        return v[0], tuple(self._without_annotations(v[1:]))

    statement_branch = equation_branch

    def otherwise_equations(self, v: list, start: int, end: int) -> Otherwise:
        return Otherwise(self._without_annotations(v))

    otherwise_statements = otherwise_equations

    def _without_annotations(self, items: list) -> list:
        for item in items:
            if isinstance(item, tree.Modification):
                self.report.error("E0101", "an annotation of its own is allowed only at the end of a class", item.span)
        return [item for item in items if not isinstance(item, tree.Modification)]

    def if_equation(self, v: list, start: int, end: int) -> tree.IfEquation:
        branches, otherwise = _split_branches(v)
        return tree.IfEquation(branches, otherwise, self.span(start, end), *v[-1])

    def if_statement(self, v: list, start: int, end: int) -> tree.IfStatement:
        branches, otherwise = _split_branches(v)
        return tree.IfStatement(branches, otherwise, self.span(start, end), *v[-1])

    def when_equation(self, v: list, start: int, end: int) -> tree.When:
        return tree.When(tuple(v[:-1]), self.span(start, end), *v[-1])

    def when_statement(self, v: list, start: int, end: int) -> tree.WhenStatement:
        return tree.WhenStatement(tuple(v[:-1]), self.span(start, end), *v[-1])

    def for_equation(self, v: list, start: int, end: int) -> tree.For:
        return tree.For(*self._loop(v), self.span(start, end), *v[-1])

    def for_statement(self, v: list, start: int, end: int) -> tree.ForStatement:
        return tree.ForStatement(*self._loop(v), self.span(start, end), *v[-1])

    def _loop(self, v: list) -> tuple[tuple, tuple]:
        indices = tuple([i for i in v if isinstance(i, tree.ForIndex)])
        return indices, tuple(self._without_annotations(v[len(indices) : -1]))

    def while_statement(self, v: list, start: int, end: int) -> tree.WhileStatement:
        body = tuple(self._without_annotations(v[1:-1]))
        return tree.WhileStatement(v[0], body, self.span(start, end), *v[-1])

    def return_statement(self, v: list, start: int, end: int) -> tree.Return:
        return tree.Return(self.span(start, end), *v[0])

    def break_statement(self, v: list, start: int, end: int) -> tree.Break:
        return tree.Break(self.span(start, end), *v[0])
