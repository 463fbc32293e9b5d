// The watch over the choice of coordinates at every accepted step, which the engine keeps (`engine/c/coordinate_watch.c`).

const [SERVES, , PASSED, LOST_RANK] = [0, 1, 2, 3]; // what a judgement comes to, as `engine/c/page.h` has it
const BESIDE = 4; // places from which values next to a singular one are made up, as `engine/c/passage.h` has it

export class Watch {
  /** `scene` has the registers; the piece begins at {t, x}, behind that of the watch `before`, or null. */
  constructor(scene, t, x, before) {
    const { programs, data } = scene;
    const sizes = before === null ? [] : Float64Array.from(before.sizes);
    Object.assign(this, { programs, own: data.watch, exports: programs.exports, page: programs.page });
    this.sizes.fill(0);
    if (before !== null) this.inherit(before.own, sizes);
    programs.x.set(x);
    this.judged(this.exports.lmoc_page_watch(this.page, t, Number(before?.programs === programs)));
  }

  /** The largest magnitude of each entry of the constraints. */
  get sizes() {
    const { rows, variable } = this.own;
    return new Float64Array(this.programs.buffer, this.exports.lmoc_page_sizes(this.page), rows * variable.length);
  }

  /** Compare entries with the sizes that they have had before, in whatever coordinates that was. */
  inherit(before, theirs) {
    const { own, sizes } = this;
    const [rows, columns] = own.keys.map((keys, k) => keys.map((key) => before.keys[k].indexOf(key)));
    rows.forEach((r, i) => {
      columns.forEach((c, j) => {
        if (r >= 0 && c >= 0) sizes[i * columns.length + j] = theirs[r * before.variable.length + c];
      });
    });
  }

  judged(status) {
    this.found = this.programs.checkedStatus(status);
    return this.serves;
  }

  get serves() {
    return this.found === SERVES;
  }

  /** Judge an accepted step: whether the coordinates go on being good. */
  judge(t, x) {
    this.programs.x.set(x);
    return this.judged(this.exports.lmoc_page_judge(this.page, t));
  }

  /** No step was short enough: whether that is because of the coordinates. */
  stuck() {
    return !this.judged(this.exports.lmoc_page_stuck(this.page));
  }

  /** Whether the last step judged has led over a place where the coordinates do not determine the rest. */
  get passedSingular() {
    return this.found === PASSED;
  }

  /** Whether constraints have come to depend on each other. */
  get lostRank() {
    return this.found === LOST_RANK;
  }

  /** Whether the rest follows from the coordinates where the piece begins, however badly. */
  get determines() {
    return this.exports.lmoc_page_determines(this.page) !== 0;
  }

  /** The name of the coordinate that follows least from the others. */
  get lost() {
    return this.own.watched[this.exports.lmoc_page_lost(this.page)];
  }

  /** Have nonlinear blocks go on from where the last step accepted has ended. */
  stand() {
    this.exports.lmoc_page_stand(this.page);
  }

  /** Choices that are better than the present one, best first: lists of flat variables that are states there. */
  better() {
    const { rows, variable } = this.own;
    const [count, width] = [this.exports.lmoc_page_better(this.page), variable.length - rows];
    const held = new Int32Array(this.programs.buffer, this.exports.lmoc_page_held(this.page), count * width);
    return Array.from({ length: count }, (_, k) => Array.from(held.slice(k * width, (k + 1) * width), (c) => variable[c]));
  }

  /** How to go on where there are no others: {longest, until}, the longest step, 0 where that is none, and until when. */
  shorter(stalled, span) {
    const longest = this.exports.lmoc_page_shorter(this.page, stalled, span);
    return { longest, until: this.exports.lmoc_page_until(this.page) };
  }

  /** Take the last step's coordinates for as good as they can be; whether they are worse than a run may begin with. */
  tolerate() {
    return this.exports.lmoc_page_tolerate(this.page) !== 0;
  }

  /** When a passage ends over the singular position ahead, found to tolerances; null where none can be trusted. */
  pass(tolerances, longest) {
    this.programs.atol.set(tolerances);
    const end = this.exports.lmoc_page_pass(this.page, longest);
    this.programs.checked(0);
    return Number.isNaN(end) ? null : end;
  }

  /** The state on the passage at a time, where nonlinear blocks stand from now on. */
  over(time) {
    this.exports.lmoc_page_over(this.page, time);
    return Float64Array.from(this.programs.answer);
  }

  /** Times on the passage with weights, [[time, weight], …], of which values at a time are made up. */
  beside(time) {
    const count = this.exports.lmoc_page_beside(this.page, time);
    const found = new Float64Array(this.programs.buffer, this.exports.lmoc_page_weights(this.page), 2 * BESIDE);
    return Array.from({ length: count }, (_, k) => [found[k], found[BESIDE + k]]);
  }
}
