"""Every hand of a page in turn: what the page answers to a pull, and what Python does to the same force."""

import json
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from oracles.in_javascript import in_engine
from oracles.node import run_script

from lmoc.view.page import contents as page
from lmoc.view.page.contents import contents, drawn, movers
from lmoc.view.page.equations import PageEquations
from lmoc.view.page.hands import elsewhere, run_with_hands, with_hands

AGREES = 1e-6  # of the largest value
VISIBLE = 1e-3  # from there on a page doubts itself
SOME = 50  # variables of a large scene
SHARE = 10  # by which the error of a run may be larger than it was estimated: it and Python's have one each

_BODY = """
const repeater = new Repeater(data.script, engine, data, () => process.cpuUsage().user / 1000);
const given = repeater.run(times, {});
const names = movers(data.picture), columns = names.map((n) => given.of(n)), references = columns.map((c) => c[0]);
const extremes = columns.map((c) => c.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]));
const motion = new Motion(data.picture, names, references, extremes);
const known = new Map(repeater.variables.map((v) => [v.name, v]));
const places = names.map((name) => known.get(name) ?? {});
const read = (w) => places.map(({ register, value }) => (register === undefined ? (value ?? NaN) : w[register]));
const units = new Map(data.variables.map((v) => [v.name, v.unit])), unitOf = (name) => units.get(name) ?? "";
const done = new Set(), told = [];
for (const item of data.picture.items) {
  const vertex = [0.7, 3, -4], held = gripAt(item, vertex, data.script);
  if (held === undefined || done.has(held.hand.name)) continue;
  done.add(held.hand.name);
  const setup = { times, values: {}, initial: {}, pulls: [] };
  const pull = new Pull(repeater, setup, { ...held, item, vertex, motion, read, speed: 1 }, 0);
  const [x, y] = motion.point(item, vertex, references), signals = pull.signals([x + 21, y - 13]);
  const pulled = pullsOf(data.script.hands, [[0, held.hand.name, signals]]);
  const [answer, finer] = [1, 0.1].map((factor) => repeater.run(times, {}, {}, pulled, factor));
  const said = parting(answer, finer, data.script.names, unitOf, 1e-3);
  const ledger = ["ledger.stored", "ledger.work", "ledger.heat"];
  const columns = [...ledger, ...states].map((n) => [...answer.of(n)]);
  told.push([held.hand.name, signals, answer.reason, [said.missed, said.from], columns]);
}
console.log(JSON.stringify(told));
"""


class Pulled(NamedTuple):
    """One hand that pulls from the start on."""

    hand: str
    kind: str
    stiffness: float
    reason: str  # why the page's run has ended
    missed: float  # by what is compared while it is relied on, of the largest of each in Python's run
    moved: float  # by the hand in the whole run, likewise
    balance: float  # error of the page's ledger, of the largest energy
    accuracy: float | None  # what the page says of its run, None where a finer run has ended before
    doubted: float | None  # from when on the page says that its run is not to be relied on

    @property
    def is_right(self) -> bool:
        """Whether it is as accurate as asked for or, where a small change of a scene grows, as the page says."""
        accuracy = 1.0 if self.accuracy is None else self.accuracy
        return self.missed < max(AGREES, SHARE * min(accuracy, VISIBLE)) and (self.doubted or self.balance < AGREES)


def pulled_everywhere(run):
    """Return what each hand does in the page of a run that begins at 0; nothing where the page has none."""
    with patch.object(page, "page_equations", lambda _: PageEquations("")):  # which nobody reads here
        found = contents(run, "M")
    if not found.data["script"].get("hands"):
        return []
    data = f"const data = {json.dumps(found.data)};"
    watched = _watched(run, found.data["variables"])
    states = f"const states = {json.dumps(watched)};"
    times = f"const times = Float64Array.from({json.dumps(run.time.tolist())});"
    told = run_script("\n".join([in_engine("worker.js"), data, states, times, _BODY]))
    _, hands, _ = run_with_hands(run, movers(drawn(run, [])))
    return [_pulled(run, hands, watched, *one) for one in told]


def _watched(run, variables) -> list[str]:
    """The states that a page has; other variables where it is too large to have any."""
    known = [v["name"] for v in variables if "register" in v and not v["name"].startswith("ledger.")]
    own = [name for name in run.states if name in known and not name.startswith("rate of law")]  # numbered anew
    return own or known[:SOME]


def _pulled(run, hands, watched, name, signals, reason, said, columns):
    flat = run.reduced.lawful or run.flat
    extended, own, nothing = with_hands(flat, hands)
    hand = next(h for h in own if h.name == name)
    inputs = {extended.variable_name(v): value for v, value in zip(hand.signals, signals, strict=True)}
    truth = run.extended(extended, nothing | inputs)
    if begun := elsewhere(run, truth):  # the page begins where the run does
        truth = run.extended(extended, nothing | inputs, begun)
    stored, work, heat, *states = np.array(columns, float)
    accuracy, doubted = said
    count = min(len(truth.time), len(stored), len(run.time))
    relied = count if doubted is None else min(count, np.searchsorted(run.time, doubted))
    missed = moved = 0.0
    for state, values in zip(watched, states, strict=True):
        size = max(1e-6, np.abs(truth[state][:count]).max())
        missed = max(missed, np.abs(values[:relied] - truth[state][:relied]).max(initial=0) / size)
        moved = max(moved, np.abs(run[state][:count] - truth[state][:count]).max() / size)
    error = (work - work[0]) - (heat - heat[0]) - (stored - stored[0])
    error = error[run.time[: len(error)] < truth.trajectory.unbooked[0]]  # where a step has done work beyond all bounds
    balance = np.abs(error).max(initial=0) / max(1e-6, truth.energy.scale)
    return Pulled(name, hand.kind, signals[0], reason, float(missed), float(moved), float(balance), accuracy, doubted)
