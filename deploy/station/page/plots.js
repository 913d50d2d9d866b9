// SPDX-License-Identifier: MIT
// Tilt, speed and turning of the last minutes, as they arrive; they stop and turn grey when nothing arrives.
//
// What was before the page was loaded comes from the station, which keeps the last ten minutes: nothing is kept here.

import { attribute, byId, make, text, visible } from "./dom.js";
import { duration, timeOfDay } from "./format.js";
import { LINE_COUNT, PlotFigures, readLines } from "./plot_figures.js";
import { History } from "./plot_history.js";
import { PlotView } from "./plot_view.js";

const KEPT_S = 600;
const DRAW_MS = 100;
/** What can be chosen, s. */
const SPANS = [[20, "20 s"], [120, "2 min"], [600, "10 min"]];

/** What a robot reported, a value for each line; null where it is lost, or reports none. */
function valuesOf(robot) {
  const values = readLines(robot);
  return robot.is_alive === false || values.every((value) => value === null) ? null : values;
}

/** What the station keeps of a robot, as rows of a history; nothing where it does not answer. */
async function past(namespace) {
  try {
    const response = await fetch(`/robots/${encodeURIComponent(namespace)}/trace`, { cache: "no-store" });
    const trace = response.ok ? await response.json() : { time_s: [] };
    const robot = (row) => Object.fromEntries(Object.entries(trace).map(([name, column]) => [name, column[row]]));
    return trace.time_s.map((timeS, row) => [timeS, valuesOf(robot(row))]);
  } catch {
    return [];
  }
}

export class Plots {
  constructor() {
    this._histories = new Map();
    this._asked = new WeakSet();
    this._view = new PlotView();
    this._figures = new PlotFigures({
      range: () => this._view.window(this._history?.times.at(-1) ?? 0),
      isHeld: () => this._view.held !== null,
      clock: (time) => this._clock(time),
      zoom: (from, to) => this._view.zoom(from, to),
    }, "the newest value is in the figures above");
    this._history = null;
    this._sinceS = 0;
    this._newestS = 0;
    this._drawnMs = 0;
    this._drawn = null;
    this._described = null;
    this._labelled = null;
    this._heldWords = "";
    this._buttons = SPANS.map(([spanS, label]) => ({ spanS, button: this._button(label, () => this._view.choose(spanS)) }));
    // From what is drawn on: of a lost robot that has ended some time ago.
    this._pause = this._button("Pause", () => this._view.toggle(this._history?.times.at(-1) ?? this._newestS));
  }

  /** Add a picture of the fleet. */
  add({ time_s: timeS, robots }) {
    if (timeS < this._newestS) this._view.choose(this._view.spanS); // another station's clock: what is held is not of it
    this._newestS = timeS;
    for (const robot of robots) {
      if (!this._histories.has(robot.robot)) this._histories.set(robot.robot, new History(LINE_COUNT, KEPT_S));
      this._histories.get(robot.robot).add(timeS, valuesOf(robot));
    }
    this._forget(timeS, new Set(robots.map((robot) => robot.robot)));
  }

  /** Forget robots that are no longer in the picture, once nothing of them would be kept. */
  _forget(timeS, names) {
    for (const [name, { times }] of this._histories) {
      const isOld = times.length === 0 || times.at(-1) < timeS - KEPT_S;
      if (isOld && !names.has(name)) this._histories.delete(name);
    }
  }

  draw({ robot, since, isLive }) {
    const age = robot.age_s + since;
    this._sinceS = since;
    attribute(byId("plots"), "data-live", isLive ? "true" : "false");
    this._describe(isLive ? "" : `stopped ${duration(age)} ago, at ${timeOfDay(age)}`);
    const history = this._histories.get(robot.robot);
    const nowMs = performance.now();
    const { held, spanS } = this._view;
    const shown = `${robot.robot} ${history?.hasPast} ${held ?? `${spanS} ${history?.times.at(-1)}`}`;
    if (!history || shown === this._drawn || nowMs - this._drawnMs < DRAW_MS) return;
    this._drawnMs = nowMs;
    this._drawn = shown;
    this._show(history);
    // The same time has other labels once it is held: a plot of the same range keeps them by itself.
    if (held !== this._labelled) this._figures.relabel();
    this._labelled = held;
    if (!this._asked.has(history)) void this._loadPast(robot.robot, history);
  }

  async _loadPast(namespace, history) {
    this._asked.add(history);
    history.prepend(await past(namespace));
  }

  /** Which time is shown, and whether it goes on. */
  _describe(stopped) {
    const { held, spanS } = this._view;
    const [, label] = SPANS.find(([each]) => each === spanS);
    if (held !== this._described) this._heldWords = held ? held.map((time) => this._clock(time)).join(" to ") : "";
    this._described = held;
    text(byId("plots-span"), this._heldWords || `Last ${label}`);
    visible(byId("plots-state"), stopped !== "" || held !== null);
    text(byId("plots-state"), stopped || "paused");
    for (const { spanS: each, button } of this._buttons) attribute(button, "aria-pressed", String(held === null && each === spanS));
    attribute(this._pause, "aria-pressed", String(held !== null));
    text(this._pause, held ? "Go on" : "Pause");
  }

  _show(history) {
    this._history = history;
    this._figures.show(history.times, history.columns, (line) => history.has(line));
    attribute(byId("plots"), "data-newest", String(history.times.at(-1)));
    attribute(byId("plots"), "data-oldest", String(history.times[0]));
  }

  /** What a clock on the wall showed at a time of the station's. */
  _clock(timeS) {
    return timeOfDay(this._sinceS + this._newestS - timeS);
  }

  _button(label, act) {
    const button = make("button", "", label);
    button.type = "button";
    button.addEventListener("click", act);
    byId("plots-buttons").append(button);
    return button;
  }
}
