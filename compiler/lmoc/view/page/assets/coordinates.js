// The watch over the choice of coordinates at every accepted step, as `numerics/coordinates/watch.py` and `tableau.py`:
// by the tableau T = A⁻¹B of the constraints A·dq_dependent + B·dq_state = 0, whose entries are the factors by which the
// determinant of A grows where a dependent coordinate and a state change places.

import { factorize, substitute } from "./linear.js";

const TWICE = 2; // by which the largest entry must have grown since the choice was made
const TOLERATED = 25; // the largest entry that a choice may have from the beginning and still count as good
const GOOD = 1.5; // the largest entry with which exchanges end

export class Watch {
  /** `scene` has the registers; the piece begins at {t, x}. */
  constructor(scene, t, x) {
    Object.assign(this, { scene, own: scene.data.watch });
    const { rows, columns } = this.own;
    this.size = new Float64Array(rows * columns); // largest entries so far
    this.rate = new Float64Array(scene.data.states.length);
    this.accepted = this.look(t, x);
    this.limit = TWICE * Math.min(Math.max(1, this.accepted.worst), TOLERATED);
  }

  /** Judge an accepted step: whether the coordinates go on being good. */
  judge(t, x) {
    this.last = this.look(t, x);
    if (this.last.worst > this.limit || this.passedSingular()) return false;
    this.accepted = this.last;
    return true;
  }

  /** Whether the last step judged has led over a place where the coordinates do not determine the rest. */
  passedSingular() {
    return this.last.sign === 0 || this.last.sign !== this.accepted.sign;
  }

  /** Whether others are better where no step could be made. */
  isStuck() {
    this.last = this.accepted;
    return this.better().length > 0;
  }

  /** Take the last step's coordinates for as good as they can be. */
  tolerate() {
    this.limit = TWICE * Math.max(this.limit, this.last.worst);
    this.accepted = this.last;
  }

  /** Choices that are better than the present one, best first: lists of flat variables that are states there. */
  better() {
    const { own } = this;
    const place = this.passedSingular() ? this.accepted : this.last;
    const exchanges = exchanged(place.table, own.watched.length, own.columns - own.rows);
    return (exchanges.length > 1 ? [exchanges, exchanges.slice(0, 1)] : exchanges.length ? [exchanges] : []).map((some) => {
      const columns = Array.from({ length: own.columns }, (_, k) => k);
      for (const [i, j] of some) {
        const [a, b] = [own.watched[i], own.rows + j];
        [columns[a], columns[b]] = [columns[b], columns[a]];
      }
      return columns.slice(own.rows).map((k) => own.variable[k]);
    });
  }

  look(t, x) {
    const { scene, own, size } = this;
    const { rows, columns } = own;
    scene.rates(t, x, this.rate);
    scene.functions.constraints(t);
    const matrix = new Float64Array(rows * columns);
    own.register.forEach((register, k) => (matrix[own.row[k] * columns + own.column[k]] += scene.w[register]));
    matrix.forEach((v, k) => (size[k] = Math.max(size[k], Math.abs(v))));
    const range = this.ranges();
    const a = new Float64Array(rows * rows);
    for (let i = 0; i < rows; i++) for (let j = 0; j < rows; j++) a[i * rows + j] = matrix[i * columns + j];
    const pivots = new Int32Array(rows);
    const sign = matrix.every(Number.isFinite) ? factorize(a, rows, pivots) : 0;
    const states = columns - rows;
    const table = own.watched.map(() => new Float64Array(states));
    for (let j = 0; j < states && sign !== 0; j++) {
      const b = Float64Array.from({ length: rows }, (_, i) => matrix[i * columns + rows + j]);
      substitute(a, rows, pivots, b);
      own.watched.forEach((row, i) => (table[i][j] = (b[row] * range[row]) / range[rows + j]));
    }
    const worst = sign === 0 ? Infinity : table.reduce((most, row) => row.reduce((m, v) => Math.max(m, Math.abs(v)), most), 0);
    return { t, x: Float64Array.from(x), sign, table, worst };
  }

  /** The largest share of each coordinate in an equation. */
  ranges() {
    const { rows, columns } = this.own;
    const found = new Float64Array(columns);
    for (let i = 0; i < rows; i++) {
      const row = this.size.subarray(i * columns, (i + 1) * columns);
      const most = row.reduce((m, v) => Math.max(m, v), 0) || 1;
      row.forEach((v, j) => (found[j] = Math.max(found[j], v / most)));
    }
    return found.map((v) => (v > 0 ? v : 1));
  }
}

/** The exchanges (row of the tableau, state) that lead to a good choice, the first of them the best. */
function exchanged(from, rows, states) {
  const table = from.map((row) => Float64Array.from(row));
  const found = [];
  for (let round = 0; round < 4 * rows * states; round++) {
    let [most, i, j] = [GOOD, -1, -1];
    table.forEach((row, r) => {
      row.forEach((v, c) => {
        if (Math.abs(v) > most && Number.isFinite(v)) [most, i, j] = [Math.abs(v), r, c];
      });
    });
    if (i < 0) break;
    found.push([i, j]);
    const pivot = table[i][j];
    const row = table[i].map((v) => v / pivot);
    const column = table.map((own) => own[j]);
    table.forEach((own, r) => {
      for (let c = 0; c < states; c++) own[c] -= column[r] * row[c];
      own[j] = -column[r] / pivot;
    });
    table[i].set(row);
    table[i][j] = 1 / pivot;
  }
  return found;
}
