// The modes of a linear scene in its picture: every variable swings about where it stands at the start.

const WIDEST_TURN = 0.6; // rad, the largest amplitude of an angle

/** What moves a picture in one mode: the amplitudes of the variables `names`, about their values at the start. */
export class ModeMotion {
  /** `mode` has {rate, cosine, sine}, in the order of `own`; `isAngle(name)` tells what is measured in radians. */
  constructor(mode, own, names, first, isAngle) {
    const place = new Map(own.map((name, k) => [name, k]));
    const of = (list, name) => (place.has(name) ? list[place.get(name)] : 0);
    this.rate = mode.rate;
    const size = (name) => Math.hypot(of(mode.cosine, name), of(mode.sine, name));
    const widest = Math.max(0, ...names.filter(isAngle).map(size));
    const scale = widest > 0 ? WIDEST_TURN / widest : 1;
    this.first = first;
    this.cosine = names.map((name) => scale * of(mode.cosine, name));
    this.sine = names.map((name) => scale * of(mode.sine, name));
  }

  /** [least, largest] of each variable. */
  extremes() {
    return this.first.map((v, k) => {
      const amplitude = Math.hypot(this.cosine[k], this.sine[k]);
      return [v - amplitude, v + amplitude];
    });
  }

  at(t) {
    const [c, s] = [Math.cos(this.rate * t), Math.sin(this.rate * t)];
    return this.first.map((v, k) => v + this.cosine[k] * c - this.sine[k] * s);
  }
}
