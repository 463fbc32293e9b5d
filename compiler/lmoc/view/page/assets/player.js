// The clock of the page: play, pause, scrub, speed, loop.

const SPEEDS = [0.1, 0.2, 0.5, 1, 2, 4]; // beside the usual one
const [SHORTEST, LONGEST] = [1, 60]; // s of a run that is shown in its own time
const WATCHED = 8; // s that others are to take, within half a power of ten

/** The usual speed of a run of a length, s: one whose motion can be seen. */
export function usualSpeed(length) {
  return length < SHORTEST || length > LONGEST ? 10 ** Math.round(Math.log10(length / WATCHED)) : 1;
}

export class Player {
  /** `show(t)` is called with each new time, `changed()` when it begins or ends to play. */
  constructor(begin, end, show, changed, frame = (f) => requestAnimationFrame(f)) {
    const usual = end > begin ? usualSpeed(end - begin) : 1;
    const speeds = SPEEDS.map((s) => Number((s * usual).toPrecision(3)));
    Object.assign(this, { begin, end, show, changed, frame, usual, speeds, t: begin, speed: usual, loop: true, playing: false });
    this.last = null;
  }

  seek(t) {
    this.t = Math.min(Math.max(Number.isFinite(t) ? t : this.begin, this.begin), this.end);
    this.show(this.t);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    if (this.playing || !(this.end > this.begin)) return;
    if (this.t >= this.end) this.t = this.begin;
    this.playing = true;
    this.last = null;
    this.changed();
    this.frame((now) => this.tick(now));
  }

  pause() {
    this.playing = false;
    this.changed();
  }

  /** One frame, `now` in milliseconds. */
  tick(now) {
    if (!this.playing) return;
    const passed = this.last === null ? 0 : Math.min(now - this.last, 100) / 1000;
    this.last = now;
    let t = this.t + passed * this.speed;
    if (t >= this.end) {
      if (!this.loop) {
        this.seek(this.end);
        this.pause();
        return;
      }
      t = this.begin + ((t - this.begin) % (this.end - this.begin));
    }
    this.seek(t);
    this.frame((next) => this.tick(next));
  }

  faster(steps) {
    const { speeds } = this;
    const k = speeds.reduce((best, s, i) => (Math.abs(s - this.speed) < Math.abs(speeds[best] - this.speed) ? i : best), 0);
    this.speed = speeds[Math.min(Math.max(k + steps, 0), speeds.length - 1)];
    this.changed();
  }
}
