// The scene simulated again in the page, for other values of its parameters.

import { Answer } from "./answer.js";
import { Scene } from "./scene.js";
import { simulate } from "./simulate.js";

const LIMIT = 4000; // ms that a simulation may take
const MOST_MORE = 5000; // output times beyond those given

export class Repeater {
  /** `script` is the data of a scene with its `parameters`; `engine` is compiled. */
  constructor(script, engine, data, now) {
    this.scene = new Scene(script, engine);
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

  /** [[slot, value], …] of parameter values by name; those not named are the model's. */
  slotsOf(values) {
    return Object.entries(values).flatMap(([name, value]) => {
      const parameter = this.parameters.get(name);
      if (parameter === undefined || parameter.fixed || !Number.isFinite(value)) return [];
      return [parameter.slot, ...parameter.alike].map((slot) => [slot, value]);
    });
  }

  /**
   * The answer at `times` for parameter values and states at the start, both {name: value}, and the pulls of a hand, with the
   * tolerances of the compiler or `finer` ones.
   */
  run(times, values, initial = {}, pulls = [], finer = 1) {
    const began = this.now();
    const limits = { deadline: began + LIMIT, now: this.now, initial, pulls, finer };
    const run = simulate(this.scene, this.slotsOf(values), times, this.registers, limits);
    this.spent = this.now() - began;
    return this.answer(run.time, run.columns, run);
  }

  /** The values of all variables, from those of the registers. */
  answer(time, registers, run = {}) {
    const place = new Map(this.registers.map((register, k) => [register, k]));
    const columns = new Map();
    for (const { name, register, value, undetermined } of this.variables) {
      if (register !== undefined) columns.set(name, registers[place.get(register)]);
      else if (undetermined) columns.set(name, NaN);
      else if (value !== undefined) columns.set(name, value ?? NaN);
    }
    return new Answer(time, columns, run);
  }
}
