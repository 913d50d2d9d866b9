// SPDX-License-Identifier: MIT
// A log as the station gives it: its cycles in pieces, of which the last few are kept, however long the log is.

/** Before each piece comes so much of the one before, as a share of it: the cycle that was in force, and the trail. */
const OVERLAP = 0.2;
const KEPT_PIECES = 12;
/** The station gives no more; a piece with what comes before it has fewer, so that each cycle has a row. */
const MOST_ROWS = 4000;
const SLIGHTLY_S = 5e-7;
const AGAIN_MS = 1000;
const BUSY = 503;

/** The last place whose time is not later; -1 where all are. */
export function placeAt(times, t) {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** When the cycle of a moment began, s; in a gap, the moment. */
function startOfCycle({ time_s: times, cycle }, t) {
  const place = placeAt(times, t + SLIGHTLY_S);
  return place >= 0 && cycle[place] !== null ? times[place] : t;
}

async function request(path) {
  let response = await fetch(path, { cache: "no-store" });
  while (response.status === BUSY || response.status === 429) {
    await new Promise((done) => setTimeout(done, AGAIN_MS));
    response = await fetch(path, { cache: "no-store" });
  }
  const content = await response.json().catch(() => ({}));
  if (!response.ok) throw new Error(content.error ?? `the station answered ${response.status}`);
  return content;
}

export class LogSource {
  /** @param {string} path of the log @param {function} changed called when more is here @param {function} failed with why not */
  constructor(path, changed, failed) {
    this._path = path;
    this._changed = changed;
    this._failed = failed;
    this._pieces = new Map();
    this.view = null;
  }

  /** Read the log as a whole. */
  async open() {
    this.view = await request(`${this._path}/view`);
    return this.view;
  }

  /** The rows from then to then, s, at most so many. */
  async rows(from, to, most) {
    const rows = await request(`${this._path}/rows?from=${Math.max(0, from)}&to=${Math.max(0, to)}&most=${most}`);
    if (rows.begin_ns !== this.view.begin_ns) throw new Error("the log was replaced by another; load the page anew");
    return rows;
  }

  /** The piece around a moment; null while it is on its way. */
  pieceAt(t) {
    const number = Math.floor(Math.min(t, this.view.duration_s) / this.view.piece_s);
    const piece = this._pieces.get(number);
    if (piece === undefined) void this._load(number).catch(() => {});
    else this._keep(number, piece);
    return piece?.rows ?? null;
  }

  /** Have what follows a moment on its way. */
  prefetch(t) {
    if (t < this.view.duration_s) this.pieceAt(t);
  }

  /** What was recorded last before a moment, as a robot; null while it is on its way, or where there is nothing. */
  robotAt(t) {
    const rows = this.pieceAt(t);
    if (rows === null) return null;
    let place = placeAt(rows.time_s, t + SLIGHTLY_S);
    const isMissing = place >= 0 && rows.cycle[place] === null;
    while (place >= 0 && rows.cycle[place] === null) place -= 1; // within a gap
    if (place < 0) return null;
    const { robot: name, is_balancing: canStand, tilt_limit_rad: tiltLimit, down_rad: down } = this.view;
    const robot = { robot: name, is_alive: !isMissing, can_stand: canStand, tilt_limit_rad: tiltLimit, down_rad: down };
    for (const [key, column] of Object.entries(rows)) if (Array.isArray(column)) robot[key] = column[place];
    return { ...robot, mode: this.view.modes[robot.mode] ?? "" };
  }

  /** When the next cycle started, or the one before that of a moment, s; of the last one itself. */
  async cycleBeside(t, direction) {
    const { duration_s: end, piece_s: length } = this.view;
    const [here, last] = [Math.floor(Math.min(t, end) / length), Math.floor(end / length)];
    const from = direction > 0 ? t : startOfCycle((await this._load(here)).rows, t);
    for (let number = here; number >= 0 && number <= last; number += direction) {
      const { time_s: times, cycle } = (await this._load(number)).rows;
      let place = direction > 0 ? placeAt(times, from + SLIGHTLY_S) + 1 : placeAt(times, from - SLIGHTLY_S);
      while (place >= 0 && place < times.length && cycle[place] === null) place += direction;
      if (place >= 0 && place < times.length) return times[place];
    }
    return direction > 0 ? end : 0;
  }

  /** Where the robot was in the seconds before a moment: x and y, m. */
  trailUntil(t, seconds, most) {
    const rows = this._pieces.get(Math.floor(Math.min(t, this.view.duration_s) / this.view.piece_s))?.rows;
    const before = this._pieces.get(Math.floor(Math.max(0, t - seconds) / this.view.piece_s))?.rows;
    const points = [];
    for (const each of before === rows ? [rows] : [before, rows]) {
      if (!each) continue;
      const [first, last] = [placeAt(each.time_s, t - seconds), placeAt(each.time_s, t)];
      const step = Math.max(1, Math.floor((last - first) / most));
      for (let place = Math.max(0, first); place <= last; place += step) {
        if (each.x[place] !== null) points.push([each.x[place], each.y[place]]);
      }
    }
    return points;
  }

  _keep(number, piece) {
    this._pieces.delete(number);
    this._pieces.set(number, piece);
    if (this._pieces.size > KEPT_PIECES) this._pieces.delete(this._pieces.keys().next().value);
  }

  /** A piece, which is asked for once. */
  _load(number) {
    const known = this._pieces.get(number);
    if (known) return known.loaded;
    const { piece_s: length } = this.view;
    const piece = { rows: null };
    piece.loaded = this.rows((number - OVERLAP) * length, (number + 1) * length, MOST_ROWS).then((rows) => {
      piece.rows = rows;
      this._changed();
      return piece;
    });
    piece.loaded.catch((error) => {
      this._pieces.delete(number);
      this._failed(error.message);
    });
    this._keep(number, piece);
    return piece.loaded;
  }
}
