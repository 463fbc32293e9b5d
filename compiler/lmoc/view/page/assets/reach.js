// A start that is reached by the hand: the states at which a point of the picture is nearest to a place.

const REACHING_ROUNDS = 12; // of Gauss and Newton
const ASIDE = 1e-6; // of a state and 1, for differences
const NEAR_ENOUGH = 1e-3; // px
const RANK = 1e-9; // of the largest singular value: a point that cannot go that way stays
const FIRM = 1e4; // weight of a gap against pixels
const SHORTENED = 12;
const MISSED_GAP = 1e-12; // by which a gap may be missed: a start whose gaps are negative by more is refused
const RESTORED = 6; // times that a step is brought back onto gaps that curve away from it

/**
 * States near `x` at which `point(w)`, [x, y] in pixels, is as near to a place `to` as gaps of laws allow.
 *
 * Only states that the point depends on change, as little as possible; what is constrained is constrained within the
 * equations, so that it stays so.
 */
export function reach(scene, x, point, to) {
  const { begin, laws } = scene.data;
  const gaps = (laws?.gap ?? []).filter((register) => register >= 0);
  scene.dynamics?.laws?.open(); // positions alone count, whatever is closed
  const measure = (state) => {
    const w = scene.observe(begin, state);
    const [px, py] = point(w);
    return { miss: [to[0] - px, to[1] - py], gap: gaps.map((register) => w[register]) };
  };
  const first = measure(x);
  const least = first.gap.map((gap) => Math.min(gap, 0));
  const allowed = ({ gap }) => gap.every((g, k) => g >= least[k] - MISSED_GAP);
  const restored = (start, columns) => {
    const state = Float64Array.from(start);
    for (let k = 0; ; k++) {
      const there = measure(state);
      if (k === RESTORED || allowed(there)) return [state, there];
      const short = there.gap.flatMap((gap, i) => (gap < least[i] ? [i] : []));
      const rows = short.map((i) => columns.map((c) => c.gap[i]));
      scene.programs.leastSquares(rows, short.map((i) => least[i] - there.gap[i]), RANK).forEach((v, i) => (state[columns[i].j] += v));
    }
  };
  let [state, now] = [Float64Array.from(x), first];
  let counting = Array.from(x, (_, j) => j); // states that the point or a gap depends on: only they are looked at again
  for (let round = 0; round < REACHING_ROUNDS && distance(now.miss) > NEAR_ENOUGH; round++) {
    const columns = derivatives(measure, state, now, counting).filter(({ point, gap }) => [...point, ...gap].some((v) => v !== 0));
    counting = columns.map(({ j }) => j);
    if (counting.length === 0) break;
    const step = new Float64Array(x.length);
    direction(scene.programs, columns, now).forEach((v, k) => (step[counting[k]] = v));
    let better = null;
    for (let k = 0, share = 1; k < SHORTENED && better === null; k++, share /= 2) {
      const [next, there] = restored(state.map((v, j) => v + share * step[j]), columns);
      if (allowed(there) && distance(there.miss) < distance(now.miss)) better = [next, there];
    }
    if (better === null) break;
    const gained = distance(now.miss) - distance(better[1].miss);
    [state, now] = better;
    if (gained < NEAR_ENOUGH) break;
  }
  return state;
}

const distance = ([a, b]) => Math.hypot(a, b);

/** Derivatives of the point and of the gaps by some states, [{j, point, gap}, …]. */
function derivatives(measure, x, now, counting) {
  return counting.map((j) => {
    const h = ASIDE * Math.max(1, Math.abs(x[j]));
    const aside = measure(x.map((u, i) => (i === j ? u + h : u)));
    return { j, point: aside.miss.map((m, k) => (now.miss[k] - m) / h), gap: aside.gap.map((g, k) => (g - now.gap[k]) / h) };
  });
}

/** The step of least squares: towards the place, and along those gaps that it would close. */
function direction(programs, columns, now) {
  let closing = [];
  for (;;) {
    const rows = [0, 1].map((k) => columns.map((c) => c.point[k]));
    for (const k of closing) rows.push(columns.map((c) => FIRM * c.gap[k]));
    const step = programs.leastSquares(rows, [...now.miss, ...closing.map((k) => -FIRM * Math.max(now.gap[k], 0))], RANK);
    const passed = now.gap.flatMap((gap, k) => {
      const change = columns.reduce((sum, c, j) => sum + c.gap[k] * step[j], 0);
      return gap + change < -MISSED_GAP && !closing.includes(k) ? [k] : [];
    });
    if (passed.length === 0) return step;
    closing = [...closing, ...passed];
  }
}
