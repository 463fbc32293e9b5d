// The clock of the page: play, pause, scrub, speed, loop.

export const SPEEDS = [0.1, 0.2, 0.5, 1, 2, 4];

export class Player {
  /** `show(t)` is called with each new time, `changed()` when it begins or ends to play. */
  constructor(begin, end, show, changed, frame = (f) => requestAnimationFrame(f)) {
    Object.assign(this, { begin, end, show, changed, frame, t: begin, speed: 1, loop: true, playing: false });
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
    const k = SPEEDS.reduce((best, s, i) => (Math.abs(s - this.speed) < Math.abs(SPEEDS[best] - this.speed) ? i : best), 0);
    this.speed = SPEEDS[Math.min(Math.max(k + steps, 0), SPEEDS.length - 1)];
    this.changed();
  }
}
