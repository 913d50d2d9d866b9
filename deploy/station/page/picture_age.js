// SPDX-License-Identifier: MIT
// How old the newest picture is, from where the station made it: the two clocks are compared over the socket itself.
//
// The page tells the station at once that a picture arrived, and the station when, by its clock, it heard so. By then the
// page had the picture, so a picture is never taken for younger than it is, and for older by no more than the fastest of
// these messages took.

/** Of so many messages the fastest counts: more would follow clocks that drift too slowly. */
const COMPARED = 50;
/** Clocks of browsers are coarse, and those of two machines drift, s. */
const CLOCK_STEP_S = 0.05;

export class PictureAge {
  constructor() {
    this._forget();
  }

  /** A picture arrived that was made at `timeS` by the station's clock; the first of a socket may be another station's. */
  arrived(timeS, nowMs, isFirst) {
    if (isFirst) this._forget();
    this._timeS = timeS;
    this._arrivedMs = nowMs;
    this._arrivals.set(timeS, nowMs);
    // From the future: one of the two machines slept, and its clock with it.
    if (this.isMeasured && this.ageS(nowMs) < -CLOCK_STEP_S) this._ahead = [];
  }

  /** The station heard at `at_s` by its clock that the picture of `time_s` had arrived. */
  heard({ time_s: timeS, at_s: atS }) {
    const arrivedMs = this._arrivals.get(timeS);
    for (const time of this._arrivals.keys()) if (time <= timeS) this._arrivals.delete(time);
    if (arrivedMs === undefined) return;
    this._ahead.push(atS - arrivedMs / 1e3);
    if (this._ahead.length > COMPARED) this._ahead.shift();
  }

  /** Whether the age is known; else only how long ago the picture arrived. */
  get isMeasured() {
    return this._ahead.length > 0;
  }

  /** How old the newest picture is, s; null before the first. Where it is not measured, it is older. */
  ageS(nowMs) {
    if (this._timeS === null) return null;
    if (!this.isMeasured) return (nowMs - this._arrivedMs) / 1e3;
    return nowMs / 1e3 + Math.min(...this._ahead) - this._timeS;
  }

  /** How long the newest picture was on the way at most, s; 0 where that is not measured. */
  get onTheWayS() {
    return this.isMeasured ? this.ageS(this._arrivedMs) : 0;
  }

  _forget() {
    this._timeS = null;
    this._arrivedMs = null;
    this._arrivals = new Map();
    this._ahead = [];
  }
}
