// SPDX-License-Identifier: MIT
// What a robot reported lately, as columns for plots. Where nothing was heard there is a gap, and no line through it.

/** Between two pictures; where nothing is known for longer, the line ends, s. */
const GAP_S = 1;
/** After the last that was heard the line ends, s. */
const END_S = 1e-3;

/** A column of times, s of the station's clock, and one for each line. */
export class History {
  /** @param {number} lines how many there are @param {number} keptS how long each is kept, s */
  constructor(lines, keptS) {
    this._lines = lines;
    this._keptS = keptS;
    this.hasPast = false;
    this._empty();
  }

  /** Add what was reported, a value for each line; null where the robot is lost. */
  add(timeS, values) {
    const last = this.times.at(-1);
    if (timeS < last) this._empty(); // another station's clock
    else if (timeS - last > GAP_S) this._end(last + END_S);
    if (values === null) this._end(timeS);
    else this._push(timeS, values);
    this._cut(this.times.findIndex((time) => time >= timeS - this._keptS) - 1);
  }

  /** Put before it what was reported earlier, as rows for `add`; what it has itself is left as it is. */
  prepend(rows) {
    const past = new History(this._lines, this._keptS);
    const first = this.times[0] ?? Infinity;
    for (const [timeS, values] of rows) if (timeS < first) past.add(timeS, values);
    if (first - past.times.at(-1) > GAP_S) past._end(past.times.at(-1) + END_S);
    this.hasPast = true;
    this.times = past.times.concat(this.times);
    this.columns = past.columns.map((column, line) => column.concat(this.columns[line]));
  }

  /** Whether a line has ever had a value. */
  has(line) {
    return this.columns[line].some((value) => value !== null);
  }

  _end(timeS) {
    if (!this._isEnded) this._push(timeS, this.columns.map(() => null));
    this._isEnded = true;
  }

  _push(timeS, values) {
    this._isEnded = false;
    this.times.push(timeS);
    this.columns.forEach((column, line) => column.push(values[line]));
  }

  _cut(count) {
    if (count > 0) for (const column of [this.times, ...this.columns]) column.splice(0, count);
  }

  _empty() {
    this.times = [];
    this.columns = Array.from({ length: this._lines }, () => []);
    this._isEnded = true;
  }
}
