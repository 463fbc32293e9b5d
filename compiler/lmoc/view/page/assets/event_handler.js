// The events of a run: when the next one comes, its effect, and its record, as `numerics/events/event_handler.py`.

import { DiscreteState, nearTo } from "./discrete_state.js";
import { Stopped } from "./stopped.js";

const START_ROUNDS = 50; // of finding states and discrete values at the start that agree
const LEAST_LOOKS = 120; // steps at least in a run with relations of time that are not linear in it
const [CROSSED, BACK, ENDS, BEGINS] = [1, 2, 3, 4]; // what changes at an instant beside samples that are due

export class EventHandler {
  constructor(scene) {
    const { data } = scene;
    Object.assign(this, { scene, own: data.events, begin: data.begin, end: data.end });
    this.discrete = new DiscreteState(scene);
    this.places = this.own.told.map(({ register }) => this.own.discrete.indexOf(register));
    this.records = [];
    this.next = Infinity;
  }

  /** States and discrete values that agree, behind what happens at the start. `states()` finds the states. */
  start(states) {
    const { discrete, begin } = this;
    let x = this.firstStates(states);
    discrete.literal = false;
    discrete.remember();
    this.next = discrete.nextTime(begin, true);
    return this.next <= begin + nearTo(begin) ? this.event(begin, x, "time") : x;
  }

  firstStates(states) {
    const { discrete, own, begin } = this;
    const { w, functions } = this.scene;
    this.flag(own.initial, 1);
    const initialEquations = (first) =>
      own.initialEquations.forEach(({ waits, same }, k) => {
        if (first && waits) return;
        functions.initialEquations[k](begin);
        if (first) for (const [past, now] of same) w[now] = w[past];
      });
    initialEquations(true);
    let x;
    for (let round = 0, changed = true; changed; round++) {
      if (round === START_ROUNDS) throw new Stopped("no states and discrete values agree at the start");
      const before = discrete.all();
      x = states();
      discrete.look(begin, x);
      for (const [now, past] of own.unheld) w[past] = w[now];
      initialEquations(false);
      discrete.assign();
      changed = discrete.all().some((v, k) => v !== before[k] && !(Number.isNaN(v) && Number.isNaN(before[k])));
    }
    x = discrete.reinit(begin, x) ?? x;
    this.flag(own.initial, 0);
    discrete.remember();
    return discrete.outcome(discrete.ask("event", begin, x, BEGINS), begin).x;
  }

  flag(register, value) {
    if (register >= 0) this.scene.w[register] = value;
  }

  /** s, where the present piece ends at the latest. */
  get until() {
    return Math.min(this.next, this.end);
  }

  get longestStep() {
    return this.own.looksAtTime ? (this.end - this.begin) / LEAST_LOOKS : Infinity;
  }

  /** Do what happens where a piece has ended; the states behind it, null at the end of the run. */
  after(t, x, roots) {
    const { discrete, own } = this;
    if (roots !== null) {
      const { count, rounded } = own.zeros;
      const which = Array.from({ length: count }, (_, k) => Number(Boolean(roots[k])));
      rounded.forEach((k, i) => {
        if (roots[count + i]) which[k] = 2;
      });
      discrete.cross(t, x, which);
      const behind = this.event(t, x, "when", CROSSED);
      return this.jumped && discrete.turnedBack(t, behind) ? this.event(t, behind, "when", BACK) : behind;
    }
    if (t >= this.next - nearTo(t)) return this.event(t, x, "time");
    if (own.terminal >= 0 && this.scene.w[own.terminal] === 0) return this.event(t, x, "terminal", ENDS);
    return null;
  }

  /** The next time event where it is as near to a time as that, else the time. */
  instant(t, near) {
    return Math.abs(this.next - t) <= near ? this.next : t;
  }

  event(t, x, reason, change) {
    return this.happened(t, reason, this.discrete.ask("event", t, x, change));
  }

  /** Tell of what the engine has carried out; the states behind it. */
  happened(t, reason, found) {
    const { discrete, own } = this;
    const happened = discrete.outcome(found, t);
    this.next = happened.next;
    this.jumped = happened.jumped;
    const kind = happened.due && reason === "when" ? "time" : reason;
    const news = happened.told.map((k) => own.news[k]);
    this.tell(t, kind, news.filter(({ when }) => when), happened.before, happened.lost);
    const broken = news.find(({ error }) => error);
    if (broken) throw new Stopped(`an assertion does not hold: ${broken.message} (t = ${t.toPrecision(6)} s)`);
    const end = news.find(({ ends }) => ends);
    if (end) throw new Stopped(end.message, false);
    return happened.x;
  }

  tell(t, kind, whens, before, loss) {
    const { own, scene } = this;
    let lost = loss;
    const add = (record) => this.records.push({ time: t, before: "", after: "", impulse: 0, energy_lost: 0, note: "", ...record });
    for (const { name, text } of whens) {
      add({ name, kind: kind === "terminal" ? "when" : kind, after: text, energy_lost: lost });
      lost = 0;
    }
    own.told.forEach(({ register, name, boolean, hidden }, k) => {
      const [past, now] = [before[this.places[k]], scene.w[register]];
      if (now === past || (!hidden && whens.length)) return;
      const shown = (value) => (boolean ? String(Boolean(value)) : String(Number(value.toPrecision(6))));
      add({ name, kind: hidden ? "relation" : "change", before: shown(past), after: shown(now) });
    });
  }
}
