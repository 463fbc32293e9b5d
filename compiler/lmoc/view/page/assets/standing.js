// A run without states: nothing moves, but functions of time may have roots. Even steps in time.

const EVEN_STEPS = 400; // looks at the functions over a piece

export class Standing {
  constructor(t, x, end, maxStep) {
    Object.assign(this, { t, x, end, before: t, steps: 0, rejected: 0, evaluations: 0 });
    this.length = Math.min((end - t) / EVEN_STEPS, maxStep);
  }

  step() {
    this.before = this.t;
    this.t = Math.min(this.t + this.length, this.end);
    this.steps++;
    return true;
  }

  interpolate() {}
}
