// Velocities that the closed laws of a mode hold at zero, as `engine/c/manifold.c`, which says why.

import { filled, largest } from "./matrix.js";

const NO_ENTRY = 1e-12; // entries below this share of the largest of their row are zero

/** Which of `count` velocities vanish wherever linear forms in them do: Gauss-Jordan elimination, rows with one entry. */
export function heldVelocities(forms, count) {
  const work = forms.filter((row) => largest(row) > 0).map((row) => [...row]);
  const scale = work.map(largest);
  const left = filled(work.length, true);
  for (;;) {
    let [size, row, column] = [NO_ENTRY, -1, -1];
    work.forEach((own, i) => {
      own.forEach((v, j) => {
        if (left[i] && Math.abs(v) / scale[i] > size) [size, row, column] = [Math.abs(v) / scale[i], i, j];
      });
    });
    if (row < 0) break;
    left[row] = false;
    const pivot = work[row][column];
    const chosen = (work[row] = work[row].map((v) => v / pivot));
    work.forEach((own, i) => {
      const factor = own[column];
      if (i === row || factor === 0) return;
      work[i] = own.map((v, j) => {
        const change = factor * chosen[j];
        const noise = NO_ENTRY * Math.max(Math.abs(v), Math.abs(change));
        return Math.abs(v - change) <= noise ? 0 : v - change;
      });
    });
  }
  const held = filled(count, false);
  work.forEach((own, i) => {
    const entries = own.flatMap((v, j) => (v === 0 ? [] : [j]));
    if (!left[i] && entries.length === 1) held[entries[0]] = true;
  });
  return held;
}
