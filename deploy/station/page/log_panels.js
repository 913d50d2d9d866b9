// SPDX-License-Identifier: MIT
// What is shown of the moment: the robot's state and figures, and the events, with the one that was last.

import { attribute, byId, make, text, visible } from "./dom.js";
import { DASH, degrees, figure } from "./format.js";
import { placeAt } from "./log_source.js";
import { stateOf } from "./state.js";
import { tiltLimits } from "./tilt_limits.js";

const SAME_S = 5e-7;

const clock = new Intl.DateTimeFormat(undefined, {
  hour: "2-digit", minute: "2-digit", second: "2-digit", fractionalSecondDigits: 3, hourCycle: "h23",
});
const day = new Intl.DateTimeFormat(undefined, { dateStyle: "medium" });

/** When it was, by the robot's clock at the log's beginning. */
export const clockAt = (view, t) => clock.format(new Date(view.begin_ns / 1e6 + 1e3 * t));
export const dayOf = (view) => day.format(new Date(view.begin_ns / 1e6));

/** A moment of the log, s. */
export const moment = (t) => `${t.toFixed(3)} s`;

const FIGURES = [
  ["Cycle", (r) => (r.cycle === null ? DASH : String(r.cycle))],
  ["Clock", (r, { view, t }) => clockAt(view, t)],
  ["Tilt, \u00b0", (r) => figure(degrees(r.pitch), 1)],
  ["To limit, \u00b0", (r) => figure(degrees(tiltLimits(r)?.left), 1)],
  ["Speed, m/s", (r) => figure(r.linear_velocity, 2)],
  ["Turn, rad/s", (r) => figure(r.angular_velocity, 2)],
  ["Set-point, m/s", (r) => figure(r.linear_setpoint, 2)],
  ["Position, m", (r) => (r.x === null ? DASH : `${figure(r.x, 2)}, ${figure(r.y, 2)}`)],
  ["Heading, \u00b0", (r) => figure(degrees(r.heading), 0)],
  ["Battery, V", (r) => figure(r.supply_v, 1)],
  ["Drives", (r) => (r.is_off === null ? DASH : r.is_off ? "off" : "not off")],
];

/** The robot's state at the moment. */
export class StatePanel {
  constructor(view) {
    const of = (wanted) => view.events.filter(({ kind }) => kind === wanted);
    this._steps = { mode: of("mode"), posture: of("posture") };
    this._times = Object.fromEntries(Object.entries(this._steps).map(([kind, steps]) => [kind, steps.map((step) => step.time_s)]));
    this._values = FIGURES.map(([label, format]) => {
      const value = make("dd");
      byId("readouts").append(make("div", "", "", make("dt", "", label), value));
      return { value, format };
    });
  }

  /** The last step of a kind before a moment; null before the first. */
  last(kind, t) {
    return this._steps[kind][placeAt(this._times[kind], t + SAME_S)] ?? null;
  }

  /** What a robot that balances was doing; empty for any other. */
  postureAt(robot, t) {
    return robot.can_stand ? this.last("posture", t)?.name ?? "" : "";
  }

  draw(robot, context) {
    const posture = this.last("posture", context.t);
    const mode = this.last("mode", context.t);
    const { headline, mode: word, kind } = stateOf({ ...robot, is_alive: true });
    text(byId("headline"), headline ?? "");
    visible(byId("headline"), Boolean(headline));
    text(byId("mode"), word);
    attribute(byId("mode"), "class", headline ? "mode-under" : "mode-word");
    attribute(byId("mode-box"), "data-mode", kind);
    const fell = posture?.name === "FALLEN" && posture.text ? posture.text : "";
    text(byId("reason"), (mode?.name === robot.mode && mode.text) || fell);
    for (const { value, format } of this._values) text(value, format(robot, context));
    return `${moment(context.t)}, ${headline ? `${headline}, ` : ""}${word}`;
  }
}

/** What an event says, in one line. */
function wordsOf(event) {
  const what = { mode: "Mode", posture: "Posture" }[event.kind];
  const name = event.name ? `${what}: ${event.name}` : "";
  return [name, event.text].filter(Boolean).join(" \u2013 ");
}

function row(event, seek) {
  const level = event.level === "info" ? "" : event.level;
  const words = make("span", "event-text", wordsOf(event));
  if (level) words.prepend(make("strong", "", `${level}: `));
  const button = make("button", "log-event", "", make("span", "log-event-time figures", moment(event.time_s)), words);
  button.type = "button";
  button.addEventListener("click", () => seek(event.time_s));
  return make("li", level, "", button);
}

/** A fall and the fault that it is happen at once, for one reason: it stands with the fault. */
function reasons(view) {
  const faults = new Set(view.events.filter(({ kind }) => kind === "mode").map(({ time_s: t, text: why }) => `${t} ${why}`));
  const isSaid = ({ kind, time_s: t, text: why }) => kind === "posture" && faults.has(`${t} ${why}`);
  return view.events.map((event) => (isSaid(event) ? { ...event, text: "" } : event));
}

/** The events, each a button that leads to its moment. */
export class EventPanel {
  constructor(view, seek) {
    this._times = view.events.map((event) => event.time_s);
    this._rows = reasons(view).map((event) => row(event, seek));
    this._current = null;
    byId("log-events").append(...this._rows);
    visible(byId("events-left-off"), view.events_left_off > 0);
    text(byId("events-left-off"), `${view.events_left_off} more happened and are not listed.`);
  }

  draw({ t }) {
    const current = this._rows[placeAt(this._times, t + SAME_S)] ?? null;
    if (current === this._current) return;
    if (this._current) attribute(this._current.firstChild, "aria-current", null);
    this._current = current;
    if (current === null) return;
    attribute(current.firstChild, "aria-current", "true");
    const box = byId("events-scroll"); // it alone scrolls, not the page
    const [top, bottom] = [current.offsetTop, current.offsetTop + current.offsetHeight];
    if (top < box.scrollTop || bottom > box.scrollTop + box.clientHeight) box.scrollTop = top - box.clientHeight / 2;
  }
}

/** What a log lacks, in words; nothing of one that is whole. */
export function lacksOf(view) {
  const gaps = view.gaps.slice(0, 20).map(([from, to]) => `Nothing was recorded from ${moment(from)} to ${moment(to)}.`);
  if (view.gaps.length > gaps.length) gaps.push(`Nothing was recorded in ${view.gaps.length - gaps.length} more places.`);
  const end = "It ends before its time: it is being written, the node was killed, or power was cut.";
  const isShort = view.is_cut;
  return [...view.damage, ...gaps, ...(isShort ? [end] : [])];
}
