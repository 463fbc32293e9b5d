// The modes of a linear scene in its picture: every variable swings about where it stands at the start.

const WIDEST_TURN = 0.6; // rad, the largest amplitude of an angle

/**
 * What moves a picture in one mode: the amplitudes of the variables `names` about their values `first`, as large as the
 * run's own motion, so that what turns and what is pushed along fit together.
 */
export class ModeMotion {
  /** `mode` has {rate, cosine, sine} in the order of `own`; `extremes` are [least, largest] of each variable in the run. */
  constructor(mode, own, names, first, extremes, unitOf) {
    const place = new Map(own.map((name, k) => [name, k]));
    const of = (list, name) => (place.has(name) ? list[place.get(name)] : 0);
    const sizes = names.map((name) => Math.hypot(of(mode.cosine, name), of(mode.sine, name)));
    const ways = extremes.map(([low, high], k) => Math.max(high - first[k], first[k] - low));
    const scale = amplitude(names.map(unitOf), sizes, ways);
    Object.assign(this, { rate: mode.rate, first });
    this.cosine = names.map((name) => scale * of(mode.cosine, name));
    this.sine = names.map((name) => scale * of(mode.sine, name));
  }

  at(t) {
    const [c, s] = [Math.cos(this.rate * t), Math.sin(this.rate * t)];
    return this.first.map((v, k) => v + this.cosine[k] * c - this.sine[k] * s);
  }
}

/** The factor with which no kind of quantity goes farther in a mode than in the run. */
function amplitude(units, sizes, ways) {
  const factors = [...new Set(units)].flatMap((unit) => {
    const most = (values) => Math.max(0, ...values.filter((v, k) => units[k] === unit && Number.isFinite(v)));
    const [size, way] = [most(sizes), most(ways)];
    const widest = unit === "rad" ? Math.min(way || WIDEST_TURN, WIDEST_TURN) : way;
    return size > 0 && widest > 0 ? [widest / size] : [];
  });
  return factors.length ? Math.min(...factors) : 1;
}
