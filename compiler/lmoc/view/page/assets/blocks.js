// Implicit equations of a program: linear ones by elimination, others by Newton's method from the last solution.
//
// The matrix comes from differences: exact for a linear block but for rounding, which one step of refinement removes,
// and good enough for Newton's method, whose residual is exact. Damping follows Deuflhard, Newton Methods for Nonlinear
// Problems (2004), 3.3.

import { factorize, substitute } from "./linear.js";

const DIFFERENCE = 1e-7; // of the size of an unknown
const TIGHT = 1e-12; // of the size of the unknowns: the correction after such a one changes nothing
const LOOSE = 1e-8; // good enough where the corrections do not shrink any more
const NEAR = 0.25; // of the size of an unknown: a solution farther away is that of another branch
const FEW = 12; // iterations from nearby …
const MANY = 60; // … and from a first guess
const HALVINGS = 12;

/**
 * The memory of a program's blocks. While it is patient, a solution is sought from far away, too; `failed` is set where
 * none was found. While it is `same`, the matrices of linear blocks are those of the time before: only their right-hand
 * sides change. `changes` counts those of parameters, discrete variables and modes.
 */
export function makeBlocks(count) {
  return { memory: Array.from({ length: count }, () => null), patient: true, failed: false, same: false, changes: 0 };
}

/** The signs of the determinants of all nonlinear blocks, as they were factorized last; null where they were not. */
export function signsOf(blocks) {
  return blocks.memory.map((m) => (m === null || m.linear ? null : [...m.signs]));
}

/** Whether a determinant of the first `count` blocks has changed its sign between two answers of `signsOf`. */
export function turned(before, now, count) {
  const differ = (a, b) => a !== null && b !== null && a.some((sign, i) => sign !== b[i]);
  return now.some((signs, k) => k < count && differ(signs, before[k]));
}

/** The last solutions of all blocks, to be put back with `putSolutions`. */
export function solutionsOf(blocks) {
  return blocks.memory.map((m) => (m === null ? null : m.last));
}

export function putSolutions(blocks, solutions) {
  blocks.memory.forEach((m, k) => {
    if (m !== null && k < solutions.length && solutions[k] !== undefined) m.last = solutions[k];
  });
}

function memoryOf(blocks, number, unknowns, size, linear) {
  const known = blocks.memory[number];
  if (known !== null) return known;
  const instances = unknowns.length / size;
  return (blocks.memory[number] = {
    linear,
    changes: -1,
    last: null,
    signs: new Int8Array(instances),
    a: Array.from({ length: instances }, () => new Float64Array(size * size)),
    pivots: Array.from({ length: instances }, () => new Int32Array(size)),
    b: new Float64Array(size),
  });
}

/**
 * Fill w[unknowns] so that w[residuals] vanish, instance after instance of `size` unknowns; NaN where nothing was found.
 *
 * `inner` computes the residuals. `guess` holds registers to begin from, or -1. `kind` is 0 of a nonlinear block, 1 of a
 * linear one, 2 of one whose matrix depends on what changes at events only.
 */
export function solve(blocks, number, w, time, unknowns, residuals, size, kind, guess, inner) {
  const linear = kind > 0;
  const memory = memoryOf(blocks, number, unknowns, size, linear);
  const block = { memory, w, time, unknowns, residuals, size, inner };
  if (linear) solveLinear(block, blocks.same || (kind === 2 && memory.changes === blocks.changes), blocks.changes);
  else if (!solveNonlinear(block, blocks.patient, guess)) blocks.failed = true;
  inner(w, time);
}

function solveLinear(block, same, changes) {
  const { memory, w, unknowns, inner, time } = block;
  for (const u of unknowns) w[u] = 0;
  inner(w, time);
  if (!same) linearize(block, () => 1);
  memory.changes = changes;
  for (let round = 0; round < 2; round++) {
    correct(block);
    inner(w, time);
  }
}

/** Whether a solution was found, and near the last one unless patient. */
function solveNonlinear(block, patient, guess) {
  const { memory, w, unknowns } = block;
  const start = Float64Array.from(unknowns, (u, k) => {
    if (memory.last !== null) return memory.last[k];
    if (Number.isFinite(w[u])) return w[u];
    return guess !== null && guess[k] >= 0 && Number.isFinite(w[guess[k]]) ? w[guess[k]] : 0;
  });
  put(block, start);
  const found = newton(block, patient ? MANY : FEW, patient);
  const far = (u, k) => !(Math.abs(w[u] - start[k]) <= NEAR * (1 + Math.abs(start[k])));
  if (!found || (!patient && unknowns.some(far))) {
    for (const u of unknowns) w[u] = NaN;
    return false;
  }
  memory.last = Float64Array.from(unknowns, (u) => w[u]);
  return true;
}

/** Newton's steps from where the unknowns stand; whether they have led to a solution. */
function newton(block, most, damped) {
  const { w, unknowns, inner, time } = block;
  let before = Infinity;
  inner(w, time);
  for (let iteration = 0; iteration < most; iteration++) {
    linearize(block, (value) => DIFFERENCE * (1 + Math.abs(value)));
    const here = Float64Array.from(unknowns, (u) => w[u]);
    const length = correct(block);
    inner(w, time);
    if (!Number.isFinite(length)) return false;
    const size = 1 + unknowns.reduce((most, u) => Math.max(most, Math.abs(w[u])), 0);
    if (length <= TIGHT * size || (length <= LOOSE * size && length >= 0.5 * before)) return true;
    if (damped) damp(block, here, length);
    before = length;
  }
  return false;
}

/** Halve a step until the next simplified correction is shorter than the step was. */
function damp(block, here, length) {
  const { w, unknowns, inner, time } = block;
  const whole = Float64Array.from(unknowns, (u, k) => w[u] - here[k]);
  for (let k = 0, factor = 1; k < HALVINGS; k++, factor /= 2) {
    unknowns.forEach((u, i) => (w[u] = here[i] + factor * whole[i]));
    inner(w, time);
    const next = Float64Array.from(unknowns, (u) => w[u]);
    const after = correct(block);
    put(block, next);
    inner(w, time);
    if (after <= (1 - factor / 4) * length) return;
  }
}

function put({ w, unknowns }, values) {
  for (let k = 0; k < unknowns.length; k++) w[unknowns[k]] = values[k];
}

/** Factorize the matrices at the place where `inner` has been run last. */
function linearize(block, difference) {
  const { memory, w, time, unknowns, residuals, size, inner } = block;
  const before = Float64Array.from(residuals, (r) => w[r]);
  const instances = unknowns.length / size;
  for (let column = 0; column < size; column++) {
    const kept = new Float64Array(instances);
    for (let i = 0; i < instances; i++) {
      const u = unknowns[i * size + column];
      kept[i] = w[u];
      w[u] += difference(w[u]);
    }
    inner(w, time);
    for (let i = 0; i < instances; i++) {
      const u = unknowns[i * size + column];
      const change = w[u] - kept[i];
      for (let row = 0; row < size; row++) {
        const at = i * size + row;
        memory.a[i][row * size + column] = (w[residuals[at]] - before[at]) / change;
      }
      w[u] = kept[i];
    }
  }
  inner(w, time);
  for (let i = 0; i < instances; i++) memory.signs[i] = factorize(memory.a[i], size, memory.pivots[i]);
}

/** Subtract the correction; the largest of its components, NaN where a matrix is singular. */
function correct({ memory, w, unknowns, residuals, size }) {
  let length = 0;
  for (let i = 0; i * size < unknowns.length; i++) {
    const b = memory.b;
    for (let row = 0; row < size; row++) b[row] = w[residuals[i * size + row]];
    if (memory.signs[i] === 0) b.fill(NaN);
    else substitute(memory.a[i], size, memory.pivots[i], b);
    for (let row = 0; row < size; row++) {
      w[unknowns[i * size + row]] -= b[row];
      length = Number.isNaN(b[row]) ? NaN : Math.max(length, Math.abs(b[row]));
    }
  }
  return length;
}
