// The end of a run on its way, with the reason.

export class Stopped extends Error {
  /** `fails`: whether the run has failed; a model may also end it by `terminate`. */
  constructor(reason, fails = true) {
    super(reason);
    this.fails = fails;
  }
}
