// The worker behind a page: it repeats the run, simulates with other values, and finds starts.

import { difference, parting, revived } from "./answer.js";
import { Motion } from "./motion.js";
import { inflatedBytes } from "./inflate.js";
import { gripAt } from "./grip.js";
import { Pull, pullsOf } from "./pull.js";
import { reach } from "./reach.js";
import { Repeater } from "./repeat.js";

const TENTH = 0.1; // factor on the tolerances of the run that tells how accurate another one is
const VISIBLE = 1e-3; // of the largest value: what can be seen in a plot

/** Answer the requests of a page; `engine` is the engine's text, packed. */
export function serve(engine) {
  const compiled = inflatedBytes(engine).then((bytes) => new WebAssembly.Module(bytes));
  let work = null;
  onmessage = async ({ data }) => {
    try {
      if (work === null) work = compiled.then((module) => new Work(data, module));
      else postMessage({ result: (await work)[data.kind](data.body) });
    } catch (failed) {
      postMessage({ error: String(failed.stack ?? failed) });
    }
  };
}

class Work {
  constructor({ script, variables, picture }, engine) {
    this.units = new Map(variables.map((v) => [v.name, v.unit]));
    this.picture = picture;
    this.repeater = new Repeater(script, engine, { variables }, () => performance.now());
    this.script = script;
    this.pulling = null;
  }

  /** The run itself, and by how much it differs from the compiler's. */
  repeat({ times, check, sizes, complete, given }) {
    const again = this.repeater.run(times, {});
    const missed = difference(again, check, sizes, (name) => this.units.get(name) ?? "", complete);
    return { reason: again.reason, missed, times: this.repeater.timesOf(given) };
  }

  run({ times, values, initial, pulls = [] }, finer = 1) {
    return this.repeater.run(times, values, initial, pullsOf(this.script.hands, pulls), finer);
  }

  /** How accurate an answer is, by a finer run: {missed, from, reason}, as `parting` has them, and why the finer run has ended. */
  accuracy({ answer, ...request }) {
    const finer = this.run(request, TENTH);
    const { names } = this.script;
    return { ...parting(revived(answer), finer, names, (name) => this.units.get(name) ?? "", VISIBLE), reason: finer.reason };
  }

  /** Begin to pull at a part at a time; whether it can be pulled. */
  grab({ t, motion, item, vertex, speed, watched, ...setup }) {
    const own = this.picture.items[item];
    const held = gripAt(own, vertex, this.script);
    if (held === undefined) return false;
    const moves = new Motion(this.picture, motion.names, motion.references, motion.extremes);
    const grip = { ...held, item: own, vertex, motion: moves, read: this.reader(motion.names), speed };
    this.watched = this.reader(watched);
    this.pulling = new Pull(this.repeater, setup, grip, t);
    return !this.pulling.done;
  }

  /** Pull towards a place of the picture until a time: what moves the picture there, and what is watched; null where the run has ended. */
  pull({ to, t }) {
    const found = this.pulling.to(to, t);
    return found === null ? null : { places: found.places, at: found.at, watched: this.watched(found.w) };
  }

  /** Let go: the answer, and what has been pulled. */
  letGo() {
    return this.pulling.letGo();
  }

  /**
   * The start at which a point of an item of the picture is nearest to a place, {initial, states, places, watched}, the values of
   * all states there, of what moves the picture and of what is watched; constraints hold. `motion` has what `Motion` is made of, `vertex` the point in the item's frame.
   */
  reach({ values, initial, motion, item, vertex, watched, to }) {
    const { repeater, picture } = this;
    const { scene } = repeater;
    const x = scene.start(repeater.slotsOf(values), initial);
    const moves = new Motion(picture, motion.names, motion.references, motion.extremes);
    const found = reach(scene, x, this.pointOf(moves, motion.names, picture.items[item], vertex), to);
    const begin = scene.data.begin;
    const w = scene.observe(begin, found);
    const changed = scene.data.names.flatMap((name, j) => (found[j] !== x[j] || name in initial ? [[name, found[j]]] : []));
    const states = Object.fromEntries(scene.data.names.map((name, j) => [name, found[j]]));
    return { initial: Object.fromEntries(changed), states, places: this.reader(motion.names)(w), watched: this.reader(watched)(w) };
  }

  /** Where a point of an item is in the picture, as a function of the registers. */
  pointOf(motion, names, item, vertex) {
    const read = this.reader(names);
    return (w) => motion.point(item, vertex, read(w));
  }

  /** The values of variables as a function of the registers. */
  reader(names) {
    const known = new Map(this.repeater.variables.map((v) => [v.name, v]));
    const places = names.map((name) => known.get(name) ?? {});
    return (w) => places.map(({ register, value }) => (register === undefined ? (value ?? NaN) : w[register]));
  }
}
