// SPDX-License-Identifier: MIT
// The moment that is shown: it plays, at a speed, is moved by hand, and steps by cycles and events.

/** How many times as fast as it was. */
export const RATES = [0.1, 0.25, 0.5, 1, 2, 5, 10];
/** A page that was not drawn for longer goes on from where it was, s. */
const LONGEST_FRAME_S = 0.25;
/** Before an event by less than this, the one before that is meant by the one before, s. */
const SAME_S = 1e-4;

export class Player {
  /** @param {object} source the log @param {function} changed called when there is something to draw */
  constructor(source, changed) {
    this._source = source;
    this._changed = changed;
    this._lastMs = null;
    this._step = Promise.resolve();
    this.t = 0;
    this.rate = 1;
    this.isPlaying = false;
  }

  get duration() {
    return this._source.view.duration_s;
  }

  play() {
    if (this.t >= this.duration) this.t = 0;
    this.isPlaying = true;
    this._lastMs = null;
    requestAnimationFrame((ms) => this._frame(ms));
    this._changed();
  }

  pause() {
    this.isPlaying = false;
    this._changed();
  }

  toggle() {
    if (this.isPlaying) this.pause();
    else this.play();
  }

  /** Show a moment; what plays goes on from there. */
  seek(t) {
    this.t = Math.min(Math.max(t, 0), this.duration);
    this._changed();
  }

  /** One cycle on, or back; several are taken one after the other. */
  step(direction) {
    this.isPlaying = false;
    this._step = this._step
      .then(async () => this.seek(await this._source.cycleBeside(this.t, direction)))
      .catch(() => {}); // why is shown by the source
    return this._step;
  }

  /** To the next event, or the one before. */
  toEvent(direction) {
    const times = this._source.view.events.map((event) => event.time_s);
    const time = direction > 0 ? times.find((each) => each > this.t + SAME_S) : times.findLast((each) => each < this.t - SAME_S);
    this.pause();
    if (time !== undefined) this.seek(time);
  }

  _frame(ms) {
    if (!this.isPlaying) return;
    requestAnimationFrame((next) => this._frame(next));
    const passed = this._lastMs === null ? 0 : Math.min((ms - this._lastMs) / 1e3, LONGEST_FRAME_S);
    this._lastMs = ms;
    const isHere = this._source.pieceAt(this.t) !== null; // what is on its way is waited for
    if (!isHere) return;
    this._source.prefetch(this.t + Math.max(this._source.view.piece_s / 2, 2 * this.rate));
    this.t = Math.min(this.t + passed * this.rate, this.duration);
    if (this.t >= this.duration) this.isPlaying = false;
    this._changed();
  }
}
