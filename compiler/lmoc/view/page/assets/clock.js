// Time events: the instants at which `sample` is true, and at which relations of time alone change, as `engine/c/instant.c`.

import { nearTo } from "./discrete_state.js";

/** The first time event behind a time, or, where asked for, at the time itself; infinity where there is none. */
export function nextTime(discrete, t, include = false) {
  const { own, w, scene } = discrete;
  const least = include ? t - nearTo(t) : t + nearTo(t);
  let found = Infinity;
  for (const { start, interval } of own.samples) {
    start.forEach((register, k) => (found = Math.min(found, tick(w[register], w[interval[k]], least))));
  }
  scene.functions.timed(t);
  for (const { op, slope, offset } of own.timed) {
    slope.forEach((register, k) => {
      const [rate, shift] = [w[register], w[offset[k]]];
      let level = 0;
      if (op === "floor") {
        level = Math.floor(rate * least + shift) + Number(rate > 0);
        if (rate < 0 && level === rate * least + shift) level--;
      }
      const at = (level - shift) / rate;
      if (Number.isFinite(at) && at > least) found = Math.min(found, at);
    });
  }
  return found;
}

/** Set the variables of `sample` whose instant this is. */
export function ring(discrete, t) {
  const { own, w } = discrete;
  for (const { target, start, interval } of own.samples) {
    target.forEach((register, i) => {
      const [begin, length] = [w[start[i]], w[interval[i]]];
      const k = Math.round((t - begin) / length);
      w[register] = Number(k >= 0 && Math.abs(begin + k * length - t) <= nearTo(t));
    });
  }
}

/** The first of start + k·interval behind a time. */
function tick(start, interval, least) {
  if (!(interval > 0)) return Infinity;
  let k = Math.max(0, Math.floor((least - start) / interval));
  while (start + k * interval <= least) k++;
  return start + k * interval;
}
