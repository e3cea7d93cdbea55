// The playback clock: which instant of lab time is shown.
//
// Two modes. "live": follows the run 0.3 s behind, so that late and bunched arrivals do not show. The lab time at the
// server is estimated from the earliest arrivals of the last seconds (the others waited somewhere), and the clock is
// steered to it by its rate instead of by jumps. "free": plays from where it is, at a speed of its own, or stands.

export const BUFFER_S = 0.3;
const WINDOW_S = 4; // arrivals that are compared
const JUMP_S = 2; // farther away than this the clock jumps
const STEER = 2; // share of the distance that is made up in a second

export class PlaybackClock {
  constructor() {
    this.begin = 0;
    this.end = 0; // the newest instant known
    this.t = 0;
    this.over = false; // whether nothing more can come
    this.running = false; // whether the run goes on
    this.live = false; // the mode
    this.playing = false;
    this.speed = 1;
    this.runSpeed = 1;
    this.samples = [];
    this.wall = null;
  }

  /** The server's time was `t` when the message left; it arrived at `arrival` (both seconds). */
  sample(t, arrival, { running = this.running, speed = this.runSpeed, end = t } = {}) {
    if (speed !== this.runSpeed || running !== this.running) this.samples = [];
    this.running = running;
    this.runSpeed = speed;
    this.end = Math.max(this.end, end, t);
    this.samples.push([arrival, t - arrival * speed]);
    while (this.samples.length > 1 && arrival - this.samples[0][0] > WINDOW_S) this.samples.shift();
  }

  /** Return the instant to steer for at `wall`. */
  target(wall) {
    if (!this.running || !this.samples.length) return this.end;
    const offset = Math.max(...this.samples.map(([, value]) => value));
    return Math.min(this.end, offset + (wall - BUFFER_S) * this.runSpeed);
  }

  /** Advance to the wall time `wall`, seconds; return the instant that is to be shown. */
  frame(wall) {
    const passed = this.wall === null ? 0 : Math.min(0.25, Math.max(0, wall - this.wall));
    this.wall = wall;
    if (this.live) this.follow(wall, passed);
    else if (this.playing) this.play(wall, passed);
    return this.t;
  }

  follow(wall, passed) {
    const away = this.target(wall) - this.t;
    if (Math.abs(away) > JUMP_S * Math.max(1, this.runSpeed)) this.t += away;
    else {
      const rate = this.running ? this.runSpeed : 0;
      const made = passed * (rate + away * STEER);
      this.t += Math.max(0, this.running ? made : Math.max(made, Math.min(away, passed)));
    }
    this.t = Math.min(this.end, this.t);
    if (this.over && this.end - this.t < 1e-3) this.live = this.playing = false;
  }

  play(wall, passed) {
    this.t += passed * this.speed;
    const last = this.running ? this.target(wall) : this.end;
    if (this.t < last) return;
    this.t = last;
    if (this.running) this.live = true;
    else this.playing = false;
  }

  /** Show the instant `t`, and leave the run's own time. */
  seek(t) {
    this.live = false;
    this.t = Math.min(this.end, Math.max(this.begin, t));
  }

  goLive() {
    this.live = this.playing = true;
  }

  toggle() {
    if (this.live || this.playing) this.live = this.playing = false;
    else {
      if (!this.running && this.t >= this.end - 1e-6) this.t = this.begin;
      this.playing = true;
    }
  }
}
