// How far a point of a scene gives way to a force: in the lowest order of time in which it does so at all.

const TO_A_SIDE = 1e-6; // of the size of the states, for differences
const IMMEDIATE = 1e-11; // m/N: less is rounding
const FIRST = 1e-7; // of the rates that a force changes: less is rounding
const LAST_BITS = 1e-14; // of the rates without the force: a change of less is rounding

const minus = (a, b) => a.map((v, k) => v - b[k]);
const size = (a) => a.reduce((most, v) => Math.max(most, Math.abs(v)), 0);

/**
 * The compliance {order, value} of a point in its softest direction: a constant force moves it by value·force·t^order/order!,
 * t being short. The order is 0 at springs alone, 1 at dampers alone, 2 at masses.
 *
 * What moves by no more than rounding, a crank at its dead centre, gives no way at all.
 *
 * `place(x)` are its one or two coordinates in a state; `push(force)` puts a force of as many on it.
 */
export function compliance(scene, { t, x }, count, place, push) {
  const rates = (state) => {
    const out = new Float64Array(x.length);
    scene.rates(t, state, out);
    return out;
  };
  const along = (f, way) => {
    if (size(way) === 0) return Array.from(f(x), () => 0); // places in loops differ in their last bits from call to call
    const h = (TO_A_SIDE * Math.max(1, size(x))) / (size(way) || 1);
    const [a, b] = [1, -1].map((sign) => f(x.map((v, j) => v + sign * h * way[j])));
    return minus(a, b).map((v) => v / (2 * h));
  };
  const none = Array(count).fill(0);
  const under = (force) => (push(force), { place: place(x), rates: rates(x) });
  const still = under(none);
  const moved = none.map((_, k) => under(none.map((v, i) => Number(i === k))));
  push(none);
  const far = Math.max(1, size(still.place));
  const immediate = moved.map((one) => minus(one.place, still.place));
  const least = LAST_BITS * size(still.rates);
  const ways = moved.map((one) => minus(one.rates, still.rates)).map((way) => (size(way) > least ? way : way.map(() => 0)));
  const accelerated = ways.map((way) => along(rates, way));
  const later = [ways, accelerated].map((all) => [all.map((way) => along(place, way)), FIRST * far * size(all.map(size))]);
  const order = [[immediate, IMMEDIATE * far], ...later].findIndex(([found, rounding]) => softest(found) > rounding);
  place(x);
  return { order, value: order < 0 ? 0 : softest([immediate, ...later.map(([found]) => found)][order]) };
}

/** The largest eigenvalue of a symmetric matrix of one or two rows. */
function softest([[a, b], second]) {
  return second === undefined ? a : (a + second[1] + Math.hypot(a - second[1], b + second[0])) / 2;
}
