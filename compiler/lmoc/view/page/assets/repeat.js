// The scene simulated again in the page, for other values of its parameters.

import { Answer } from "./answer.js";
import { Scene } from "./scene.js";
import { simulate } from "./simulate.js";

const LIMIT = 4000; // ms that a simulation may take
const MOST_MORE = 5000; // output times beyond those given

export class Repeater {
  /** `script` is the data of a scene with its `parameters`; `make` returns the functions written by the compiler. */
  constructor(script, make, data, now) {
    this.scene = new Scene(script, make);
    this.parameters = new Map(script.parameters.map((p) => [p.name, p]));
    this.registers = [...new Set(data.variables.filter((v) => v.register !== undefined).map((v) => v.register))];
    this.variables = data.variables;
    this.now = now;
    this.spent = 0; // ms that the last simulation has taken
  }

  /** Output times of a run: the given ones and, where the model may end it later with other values, more like them. */
  timesOf(given) {
    const { end } = this.scene.data;
    const last = given[given.length - 1];
    const step = (last - given[0]) / Math.max(1, given.length - 1);
    if (!(step > 0) || !(end - last > 1e-9 * Math.abs(end))) return given;
    const more = Math.min(MOST_MORE, Math.ceil((end - last) / step - 1e-9));
    return Float64Array.from([...given, ...Array.from({ length: more }, (_, k) => last + ((k + 1) * (end - last)) / more)]);
  }

  /** The answer at `times` for parameter values by name, {name: value}; those not named are the model's. */
  run(times, values) {
    const changed = [];
    for (const [name, value] of Object.entries(values)) {
      const parameter = this.parameters.get(name);
      if (parameter === undefined || parameter.fixed || !Number.isFinite(value)) continue;
      for (const slot of [parameter.slot, ...parameter.alike]) changed.push([slot, value]);
    }
    const began = this.now();
    const limits = { deadline: began + LIMIT, now: this.now };
    const run = simulate(this.scene, changed, times, this.registers, limits);
    this.spent = this.now() - began;
    const place = new Map(this.registers.map((register, k) => [register, k]));
    const columns = new Map();
    for (const { name, register, value, undetermined } of this.variables) {
      if (register !== undefined) columns.set(name, run.columns[place.get(register)]);
      else if (undetermined) columns.set(name, NaN);
      else if (value !== undefined) columns.set(name, value ?? NaN);
    }
    return new Answer(run.time, columns, run);
  }
}
