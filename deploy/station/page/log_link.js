// SPDX-License-Identifier: MIT
// A link to a moment of a log: in the fragment, which no server is sent, stand the log, its robot, and when.

/** How often the address is changed at most, ms: browsers refuse a hundred changes within seconds. */
const SETTLE_MS = 300;

/** What a fragment names: of a log of the station's own, `robot` is empty. */
export function parseLink(fragment) {
  const fields = new URLSearchParams(fragment.replace(/^#/, ""));
  const t = Number(fields.get("t") ?? 0);
  return { log: fields.get("log") ?? "", robot: fields.get("robot") ?? "", t: Number.isFinite(t) ? Math.max(0, t) : 0 };
}

/** The fragment for a moment, s. */
export function linkTo({ log, robot }, t) {
  const fields = new URLSearchParams({ ...(robot ? { robot } : {}), log, t: String(Number(t.toFixed(6))) });
  return `#${fields}`;
}

/** Where the station serves the log. */
export function pathOf({ log, robot }) {
  const name = `logs/${encodeURIComponent(log)}`;
  return robot ? `/robots/${encodeURIComponent(robot)}/${name}` : `/${name}`;
}

/** Keeps the address of the page at the moment that is shown. */
export class Address {
  constructor(link) {
    this._link = link;
    this._timer = null;
    this._t = 0;
  }

  /** The moment has changed. */
  moved(t) {
    this._t = t;
    this._timer ??= setTimeout(() => this.settle(), SETTLE_MS);
  }

  /** Write the address now. */
  settle() {
    clearTimeout(this._timer);
    this._timer = null;
    const fragment = linkTo(this._link, this._t);
    if (fragment !== location.hash) history.replaceState(null, "", fragment);
  }
}
