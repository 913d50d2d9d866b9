// SPDX-License-Identifier: MIT
// What happened, the newest first.

import { byId, make } from "./dom.js";

const SHOWN = 200;
/** More than the station keeps, so that repeated events are recognised. */
const REMEMBERED = 2000;

const clock = new Intl.DateTimeFormat(undefined, {
  hour: "2-digit", minute: "2-digit", second: "2-digit", fractionalSecondDigits: 1, hour12: false,
});

function row(event) {
  const when = new Date(event.wall_ns / 1e6);
  const time = make("time", "", clock.format(when));
  time.dateTime = when.toISOString();
  const where = make("span", "event-robot", event.robot || "station");
  const message = make("span", "event-text", event.who ? `${event.text} (${event.who})` : event.text);
  const level = event.level === "info" ? "" : event.level;
  const item = make("li", level, "", time, where, message);
  if (level) message.prepend(make("strong", "", `${level}: `));
  return item;
}

export class EventLog {
  constructor() {
    this._waiting = [];
    this._last = new Map();
  }

  /** A new socket repeats the events before it; what is shown already is ignored. */
  add(event) {
    const key = `${event.number} ${event.wall_ns}`;
    if (this._last.has(key)) return;
    this._last.set(key, true);
    if (this._last.size > REMEMBERED) this._last.delete(this._last.keys().next().value);
    this._waiting.push(event);
    if (this._waiting.length > SHOWN) this._waiting.shift();
  }

  draw() {
    if (this._waiting.length === 0) return;
    const list = byId("events");
    list.prepend(...this._waiting.reverse().map(row));
    this._waiting = [];
    while (list.children.length > SHOWN) list.lastElementChild.remove();
  }
}
