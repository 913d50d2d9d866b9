// SPDX-License-Identifier: MIT
// Which time plots show: the last seconds or minutes, or a time that is held, by a pause or a zoom.

/** What is chosen at first, s. */
const FIRST_S = 20;
/** A zoom to less than this is a slip of the hand, s. */
const LEAST_S = 0.3;

/** Times are those of the station's clock, s. */
export class PlotView {
  constructor() {
    this.spanS = FIRST_S;
    this.held = null;
  }

  /** What is shown where `newest` is the newest time: from, to. */
  window(newest) {
    return this.held ?? [newest - this.spanS, newest];
  }

  /** Show the last seconds, as they come. */
  choose(spanS) {
    this.spanS = spanS;
    this.held = null;
  }

  /** Hold what is shown, or go on. */
  toggle(newest) {
    this.held = this.held === null ? this.window(newest) : null;
  }

  /** Hold a part of it. */
  zoom(from, to) {
    if (to - from >= LEAST_S) this.held = [from, to];
  }
}
