// Tables as signals: piecewise polynomials that hold their ends, as `numerics/signals/curves.py` makes them.

/** The value at a time; where the curve jumps, that behind the jump. */
export function curveAt(curve, t) {
  const { knots, order, ends } = curve;
  const last = knots.length - 1;
  if (t < knots[0] || t > knots[last] || (t === knots[last] && order === 0)) {
    return order > 0 ? 0 : ends[t >= knots[last] ? 1 : 0];
  }
  let low = 0;
  let high = last;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (knots[middle] <= t) low = middle;
    else high = middle;
  }
  const length = knots[low + 1] - knots[low] || 1;
  const u = (t - knots[low]) / length;
  const value = curve.coefficients[low].reduceRight((sum, c) => sum * u + c, 0);
  if (order > 0) return value / length ** order;
  return Math.min(Math.max(value, curve.low[low] ?? -Infinity), curve.high[low] ?? Infinity);
}
