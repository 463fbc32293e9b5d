// The engine in WebAssembly, and the programs of a scene in it (`engine/c/page.c`).

import { decodeBytes } from "./answer.js";

const FAILED = 1; // a bit of what a program returns: a nonlinear block has no solution

/** `engine` is compiled; `w` are the registers; `x`, `answer` and `atol` are as long as the state. */
export class Programs {
  constructor(engine, code, stateCount) {
    const host = {
      laws: () => this.dynamics.tellLaws(),
      steps: (found) => this.dynamics.tellSteps(found),
      event: (found) => this.dynamics.tellEvent(found),
      states: () => this.answer.set(this.states()),
      equations: (first) => this.equations(first),
    };
    const { exports } = new WebAssembly.Instance(engine, { host });
    exports._initialize();
    const bytes = decodeBytes(code);
    const room = exports.lmoc_page_room(bytes.length);
    new Uint8Array(exports.memory.buffer).set(bytes, room);
    const page = exports.lmoc_page_new(room, bytes.length);
    if (page === 0) throw new Error("there is no memory for the scene");
    const { buffer } = exports.memory;
    const numbers = (at, count) => new Float64Array(buffer, at, count);
    const registers = exports.lmoc_page_registers(page);
    this.w = numbers(registers, (buffer.byteLength - registers) >> 3);
    this.x = numbers(exports.lmoc_page_state(page), stateCount);
    this.answer = numbers(exports.lmoc_page_answer(page), stateCount);
    this.atol = numbers(exports.lmoc_page_tolerances(page), stateCount);
    Object.assign(this, { exports, page, buffer });
  }

  /** Run a program as the registers stand; whether all blocks were solved. */
  run(number, time) {
    return this.checked(this.exports.lmoc_page_run(this.page, number, time));
  }

  /** Run a program for a state at a time, nonlinear blocks near their last solution; whether they were solved. */
  evaluate(number, time, x) {
    this.x.set(x);
    return this.checked(this.exports.lmoc_page_evaluate(this.page, number, time));
  }

  rates(time, x, out) {
    this.x.set(x);
    this.exports.lmoc_page_rates(this.page, time);
    out.set(this.answer);
  }

  /** What the host sees of the memory is no longer its own where that has grown: it has room for what grows. */
  checked(status) {
    if (this.exports.memory.buffer !== this.buffer) throw new Error("the memory of the scene is too small");
    return (status & FAILED) === 0;
  }

  /** What a function of the engine has come to, where that is no program. */
  checkedStatus(status) {
    this.checked(0);
    return status;
  }

  /** The shortest vector that minimizes |matrix·x − right|; singular values below a share of the largest count as none. */
  leastSquares(matrix, right, share) {
    const { exports, page, buffer } = this;
    const n = Math.max(matrix.length, matrix[0].length);
    const room = exports.lmoc_page_matrix(page, n);
    this.checked(0);
    if (room === 0) throw new Error("there is no memory for a matrix");
    const own = new Float64Array(buffer, room, n * (n + 1));
    matrix.forEach((row, i) => own.set(row, i * n));
    own.set(right, n * n);
    return new Float64Array(buffer, exports.lmoc_page_least_squares(page, share), matrix[0].length).slice();
  }

  sample(time) {
    this.exports.lmoc_page_sample(this.page, time);
  }

  /** Parameters have changed. */
  forget() {
    this.exports.lmoc_page_forget(this.page);
  }

  /** Let nonlinear blocks begin from what stands in the registers. */
  seed() {
    this.exports.lmoc_page_seed(this.page);
  }

  /** The functions whose signs end a piece that begins at a place, {signs, value}; null where there are none. */
  roots(t, x) {
    const { exports, page, buffer } = this;
    this.x.set(x);
    const count = exports.lmoc_page_roots(page, t);
    this.checked(0);
    if (count === 0) return null;
    const value = (time, state) => {
      this.x.set(state);
      return new Float64Array(buffer, exports.lmoc_page_root_values(page, time), count).slice();
    };
    const signs = [...new Float64Array(buffer, exports.lmoc_page_sides(page), count)];
    return { signs, value };
  }
}
