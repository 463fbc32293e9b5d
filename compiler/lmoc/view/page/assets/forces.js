// Forces as arrows in the picture, in scale with the largest of the run.

import { format } from "./controls.js";
import { $, putText } from "./dom.js";

export class Forces {
  constructor(items, unitOf) {
    this.names = new Map(items.map((item) => [item, forceNames(item, unitOf)]).filter(([, names]) => names.length));
    this.all = [...this.names.values()].flat();
    this.on = false;
    $("forces").disabled = this.names.size === 0;
    if ($("forces").disabled) $("forces").parentElement.title = "nothing in the picture pulls or pushes";
  }

  turn(on) {
    this.on = on && !$("forces").disabled;
    $("forces").checked = this.on;
  }

  /** The items at which arrows are drawn now. */
  get items() {
    return this.on ? [...this.names.keys()] : [];
  }

  put(answer) {
    this.values = answer.reader(this.all);
    this.largest = 0;
    for (const own of this.names.values()) {
      const parts = own.map((name) => answer.of(name));
      parts[0].forEach((_, k) => (this.largest = Math.max(this.largest, Math.hypot(...parts.map((f) => f[k])) || 0)));
    }
  }

  /** Show them at the instant t, `places` move the picture; none where they are not `wanted`. */
  show(t, stage, motion, places, wanted) {
    this.draw(wanted ? this.values(t) : null, stage, motion, places);
  }

  /** Show forces that have the values of `all`, null for none. One that is larger than any before changes the scale. */
  draw(values, stage, motion, places) {
    let next = 0;
    const forces = this.on && values !== null ? [...this.names].map(([item, { length }]) => [item, [...values.slice(next, (next += length))].map((f) => (item.variables.push ? -f : f))]) : [];
    for (const [, force] of forces) this.largest = Math.max(this.largest, Math.hypot(...force) || 0);
    putText($("scale"), forces.length && this.largest > 0 ? `(longest ${format(this.largest)} N)` : "");
    stage.showForces(motion, places, new Map(forces), this.largest || 1);
  }
}

/** The variables of the force of an item: one between its two ends or along the way of its only one, or two in the plane. */
function forceNames({ ends, symbol, variables: { force = "", push = "", fx, fy } }, unitOf) {
  if (fx && fy) return [fx, fy];
  if (unitOf(push) === "N" && ends.length === 2) return [push];
  return unitOf(force) === "N" && (ends.length === 2 || (symbol === "force" && ends[0].moves.length > 0)) ? [force] : [];
}
