// The events of a run: when the next one comes, its effect, and its record, as `numerics/events/event_handler.py`.

import { DiscreteState, nearTo } from "./discrete_state.js";
import { Stopped } from "./stopped.js";

const START_ROUNDS = 50; // of finding states and discrete values at the start that agree
const LEAST_LOOKS = 120; // steps at least in a run with relations of time that are not linear in it
const BEGINS = 4; // what changes at an instant, as `engine/c/page_scene.h` has it
const KINDS = ["when", "time", "terminal"];

export class EventHandler {
  constructor(scene) {
    const { data } = scene;
    Object.assign(this, { scene, own: data.events, begin: data.begin, end: data.end });
    this.discrete = new DiscreteState(scene);
    this.places = this.own.told.map(({ register }) => this.own.discrete.indexOf(register));
    this.records = [];
  }

  /** States and discrete values that agree, behind what happens at the start. `states()` finds the states. */
  start(states) {
    const { discrete, begin } = this;
    let x = this.firstStates(states);
    discrete.literal = false;
    discrete.remember();
    if (discrete.nextTime(begin, true) > begin + nearTo(begin)) return x;
    return this.happened(begin, discrete.ask("event", begin, x));
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
    return Math.min(this.discrete.next, this.end);
  }

  get longestStep() {
    return this.own.looksAtTime ? (this.end - this.begin) / LEAST_LOOKS : Infinity;
  }

  /** Tell of what the engine has carried out; the states behind it. */
  happened(t, found) {
    const { discrete, own } = this;
    const happened = discrete.outcome(found, t);
    const kind = KINDS[happened.kind];
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
