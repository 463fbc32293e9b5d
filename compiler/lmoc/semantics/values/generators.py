"""Pseudo-random numbers by shifts and exclusive ors, and the hash of a text: functions of state in, state out.

The generators are those of S. Vigna, "An experimental exploration of Marsaglia's xorshift generators, scrambled" (ACM
Trans. Math. Softw. 42, 2016, article 30) and "Further scramblings of Marsaglia's xorshift generators" (J. Comput. Appl.
Math. 315, 2017, 175–181), the hash is A. Partow's. As Modelica's library has them: a word of 64 bits is two Integers,
the lower half first, 64* keeps the product and 128+ the sum as its state, and a word is read with its sign, which makes
a number w·2⁻⁶⁴ + 1/2.
"""

from __future__ import annotations

from collections.abc import Callable

from lmoc.expression import dag
from lmoc.expression.dag import Expr
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.semantics.values.builtins import arguments, builtin
from lmoc.semantics.values.context import Context
from lmoc.semantics.values.value import Value, number, stack
from lmoc.syntax import tree

_HALF = 2.0**32
Word = tuple[Expr, Expr]  # the lower and the upper 32 bits, as whole numbers


def _floor(x: Expr) -> Expr:
    return dag.function("floor", x)


def _rest(x: Expr, size: float) -> Expr:
    return dag.function("mod", x, dag.const(size))


def _xor(x: Word, y: Word) -> Word:
    return dag.function("xor", x[0], y[0]), dag.function("xor", x[1], y[1])


def _right(x: Word, n: int) -> Word:
    low, high = x
    return _floor(low / 2.0**n) + _rest(high, 2.0**n) * 2.0 ** (32 - n), _floor(high / 2.0**n)


def _left(x: Word, n: int) -> Word:
    low, high = x
    return _rest(low * 2.0**n, _HALF), _rest(high * 2.0**n, _HALF) + _floor(low / 2.0 ** (32 - n))


def _sum(x: Word, y: Word) -> Word:
    low = x[0] + y[0]
    return _rest(low, _HALF), _rest(x[1] + y[1] + _floor(low / _HALF), _HALF)


def _product(x: Word, factor: int) -> Word:
    """By quarters of 16 bits, whose products are exact."""
    size = 2.0**16
    own = [_rest(x[0], size), _floor(x[0] / size), _rest(x[1], size), _floor(x[1] / size)]
    other = [factor >> 16 * k & 0xFFFF for k in range(4)]
    found, carry = [], dag.ZERO
    for k in range(4):
        total = carry
        for i in range(k + 1):
            total = total + own[i] * float(other[k - i])
        found.append(_rest(total, size))
        carry = _floor(total / size)
    return found[0] + found[1] * size, found[2] + found[3] * size


def _signed(half: Expr) -> Expr:
    return _rest(half + _HALF / 2, _HALF) - _HALF / 2


def _unit(x: Word) -> Expr:
    """The number in (0, 1] that a word stands for."""
    return (_signed(x[1]) * _HALF + x[0]) * 2.0**-64 + 0.5


def _star64(state: list[Word]) -> tuple[Word, list[Word]]:
    (x,) = state
    x = _xor(x, _right(x, 12))
    x = _xor(x, _left(x, 25))
    x = _product(_xor(x, _right(x, 27)), 2685821657736338717)
    return x, [x]


def _plus128(state: list[Word]) -> tuple[Word, list[Word]]:
    x, y = state
    x = _xor(x, _left(x, 23))
    total = _sum(_xor(_xor(x, y), _xor(_right(x, 17), _right(y, 26))), y)
    return total, [y, total]


def _star1024(state: list[Word], place: Expr) -> tuple[Word, list[Word], Expr]:
    """`place` tells which of the sixteen words has been made last."""
    following = _rest(place + 1.0, 16.0)
    last, x = (_chosen(state, at) for at in (_rest(place, 16.0), following))
    x = _xor(x, _left(x, 31))
    x = _xor(_xor(x, _right(x, 11)), _xor(last, _right(last, 30)))
    kept = []
    for k, (low, high) in enumerate(state):
        here = dag.function("eq", following, dag.const(k))
        kept.append((dag.if_(here, x[0], low), dag.if_(here, x[1], high)))
    return _product(x, 1181783497276652981), kept, following


def _chosen(state: list[Word], at: Expr) -> Word:
    low, high = state[-1]
    for k, word in enumerate(state[:-1]):
        here = dag.function("eq", at, dag.const(k))
        low, high = dag.if_(here, word[0], low), dag.if_(here, word[1], high)
    return low, high


def drawn(halves: list[Expr]) -> tuple[Expr, list[Expr]]:
    """Return the next number and the next state; the generator is told by how many halves there are."""
    words = [_rest(half, _HALF) for half in halves]
    state = list(zip(words[0::2], words[1::2], strict=False))
    place = []
    if len(halves) == 33:
        word, state, following = _star1024(state, halves[-1])
        place = [following]
    else:
        make: Callable[[list[Word]], tuple[Word, list[Word]]] = {2: _star64, 4: _plus128}[len(halves)]
        word, state = make(state)
    return _unit(word), [*(_signed(half) for word in state for half in word), *place]


@builtin("__lmoc_random")
def _random(context: Context, call: tree.Call) -> Value:
    return Value(drawn(halves(context, call))[0])


@builtin("__lmoc_random_state")
def _random_state(context: Context, call: tree.Call) -> Value:
    return stack([Value(half, (), "Integer") for half in drawn(halves(context, call))[1]], (), "Integer")


def halves(context: Context, call: tree.Call) -> list[Expr]:
    """Return the halves of the words of the state that a call is given."""
    (state,) = arguments(context, call, 1)
    if state.type != "Integer" or state.dims not in ((2,), (4,), (33,)):
        raise Wrong("E0301", f"the state of '{call.function}' is 2, 4 or 33 Integers", call.span, found=state.type)
    return [half.expr for half in context.arrays.scalars(state)]


@builtin("__lmoc_hash")
def _hash(context: Context, call: tree.Call) -> Value:
    (x,) = arguments(context, call, 1)
    if x.type != "String" or x.dims:
        raise Wrong("E0301", f"'{call.function}' takes a text", call.span, found=x.type)
    found = 0xAAAAAAAA
    for k, byte in enumerate(x.text.encode()):
        mixed = ~((found << 11) + (byte ^ found >> 5)) if k % 2 else (found << 7) ^ byte * (found >> 3)
        found = (found ^ mixed) & 0xFFFFFFFF
    return number(found - 2**32 if found >> 31 else found, "Integer")
