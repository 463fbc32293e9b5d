// Sign changes of functions of time and state within a step, which the engine finds on the step's own dense output.

/** Follows the signs of root functions, {signs, value(t, x)}, from step to step. */
export class RootFinder {
  constructor({ programs }, roots, t, x) {
    const count = roots.signs.length;
    this.programs = programs;
    this.followed = roots.followed ?? (() => {}); // to be told that a step has been looked at
    const first = roots.value(t, x);
    programs.watch(Float64Array.from(roots.signs, (s, k) => (s === 0 ? Math.sign(first[k]) || 0 : s)), (method, time) => {
      const state = new Float64Array(method.x.length);
      if (time === method.t) state.set(method.x);
      else method.interpolate(time, state);
      return roots.value(time, state);
    });
    this.which = new Array(count).fill(0); // of those that vanish at the root found last
  }

  /** The place {t, x} in the last step of a method at which the integration ends; null where it goes on. */
  first(method) {
    const t = this.programs.rootOf(method);
    this.followed();
    if (t === null) return null;
    this.which = this.programs.vanishing(this.which.length);
    const x = Float64Array.from(method.x);
    if (t !== method.t) method.interpolate(t, x);
    return { t, x };
  }
}
