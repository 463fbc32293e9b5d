// The worker behind a page: it repeats the run, simulates with other values, and finds starts.

import { difference } from "./answer.js";
import { Motion } from "./motion.js";
import { reach } from "./reach.js";
import { Repeater } from "./repeat.js";

/** Answer the requests of a page; `make` returns the functions written by the compiler. */
export function serve(make) {
  let work = null;
  onmessage = ({ data }) => {
    if (work === null) {
      work = new Work(data, make);
      return;
    }
    try {
      postMessage({ result: work[data.kind](data.body) });
    } catch (failed) {
      postMessage({ error: String(failed.stack ?? failed) });
    }
  };
}

class Work {
  constructor({ script, variables, picture }, make) {
    this.units = new Map(variables.map((v) => [v.name, v.unit]));
    this.picture = picture;
    this.repeater = new Repeater(script, make, { variables }, () => performance.now());
    this.drag = null;
  }

  /** The run itself, and by how much it differs from the compiler's. */
  repeat({ times, check, sizes, complete, given }) {
    const again = this.repeater.run(times, {});
    const missed = difference(again, check, sizes, (name) => this.units.get(name) ?? "", complete);
    return { reason: again.reason, missed, times: this.repeater.timesOf(given) };
  }

  run({ times, values, initial }) {
    return this.repeater.run(times, values, initial);
  }

  /**
   * The start at which a point of an item of the picture is nearest to a place, {initial, columns}, the values of all
   * variables there; constraints hold. `motion` has what `Motion` is made of, `vertex` the point in the item's frame.
   */
  reach({ values, initial, motion, item, vertex, to }) {
    const { repeater, picture } = this;
    const { scene } = repeater;
    const x = scene.start(repeater.slotsOf(values), initial);
    const moves = new Motion(picture, motion.names, motion.references, motion.extremes);
    const found = reach(scene, x, this.pointOf(moves, motion.names, picture.items[item], vertex), to);
    const begin = scene.data.begin;
    const w = scene.observe(begin, found);
    const columns = repeater.registers.map((register) => Float64Array.of(w[register]));
    const changed = scene.data.names.flatMap((name, j) => (found[j] !== x[j] || name in initial ? [[name, found[j]]] : []));
    return { ...repeater.answer(Float64Array.of(begin), columns), initial: Object.fromEntries(changed) };
  }

  /** Where a point of an item is in the picture, as a function of the registers. */
  pointOf(motion, names, item, vertex) {
    const known = new Map(this.repeater.variables.map((v) => [v.name, v]));
    const read = names.map((name) => known.get(name) ?? {});
    return (w) => {
      const values = read.map(({ register, value }) => (register === undefined ? (value ?? NaN) : w[register]));
      return motion.point(item, vertex, values);
    };
  }
}
