// The scene simulated again in the page, for other values of its parameters.

import { Answer } from "./answer.js";
import { Scene } from "./scene.js";
import { simulate } from "./simulate.js";

const LIMIT = 2000; // ms that a simulation may take

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

  /** The answer at `times` for parameter values by name, {name: value}; those not named are the model's. */
  run(times, values) {
    const changed = [];
    for (const [name, value] of Object.entries(values)) {
      const parameter = this.parameters.get(name);
      if (parameter !== undefined && !parameter.fixed && Number.isFinite(value)) changed.push([parameter.slot, value]);
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
