// The watch over the choice of coordinates at every accepted step, which the engine keeps (`engine/c/coordinate_watch.c`).

const [SERVES, , PASSED, LOST_RANK] = [0, 1, 2, 3]; // what a judgement comes to, as `engine/c/page.h` has it

export class Watch {
  /** `scene` has the registers; the piece begins at {t, x}, behind that of the watch `before`, or null. */
  constructor(scene, t, x, before) {
    const { programs, data } = scene;
    Object.assign(this, { programs, own: data.watch, exports: programs.exports, page: programs.page, found: SERVES });
    this.sizes.fill(0);
    if (before !== null) this.inherit(before);
    programs.x.set(x);
    this.exports.lmoc_page_watch(this.page, t);
  }

  /** The largest magnitude of each entry of the constraints. */
  get sizes() {
    const { rows, variable } = this.own;
    return new Float64Array(this.programs.buffer, this.exports.lmoc_page_sizes(this.page), rows * variable.length);
  }

  /** Compare entries with the sizes that they have had before, in whatever coordinates that was. */
  inherit(before) {
    const { own, sizes } = this;
    const [theirs, width] = [before.sizes, before.own.variable.length];
    const rows = own.source.map((equation) => before.own.source.indexOf(equation));
    const columns = own.variable.map((variable) => before.own.variable.indexOf(variable));
    rows.forEach((r, i) => {
      columns.forEach((c, j) => {
        if (r >= 0 && c >= 0) sizes[i * columns.length + j] = theirs[r * width + c];
      });
    });
  }

  /** Judge an accepted step: whether the coordinates go on being good. */
  judge(t, x) {
    this.programs.x.set(x);
    this.found = this.programs.checkedStatus(this.exports.lmoc_page_judge(this.page, t));
    return this.found === SERVES;
  }

  /** Whether the last step judged has led over a place where the coordinates do not determine the rest. */
  get passedSingular() {
    return this.found === PASSED;
  }

  /** Whether constraints have come to depend on each other. */
  get lostRank() {
    return this.found === LOST_RANK;
  }

  /** Choices that are better than the present one, best first: lists of flat variables that are states there. */
  better(stuck = false) {
    const { rows, variable } = this.own;
    const [count, width] = [this.exports.lmoc_page_better(this.page, Number(stuck)), variable.length - rows];
    const held = new Int32Array(this.programs.buffer, this.exports.lmoc_page_held(this.page), count * width);
    return Array.from({ length: count }, (_, k) => Array.from(held.slice(k * width, (k + 1) * width), (c) => variable[c]));
  }

  /** How to go on where there are no others: {longest, until}, the longest step, 0 where that is none, and until when. */
  shorter(stalled, span) {
    const longest = this.exports.lmoc_page_shorter(this.page, stalled, span);
    return { longest, until: this.exports.lmoc_page_until(this.page) };
  }

  /** Take the last step's coordinates for as good as they can be. */
  tolerate() {
    this.exports.lmoc_page_tolerate(this.page);
  }
}
