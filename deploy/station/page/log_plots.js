// SPDX-License-Identifier: MIT
// The plots of a log: some seconds around the moment, or all of it. What was not recorded is a gap.

import { attribute, byId, make, text } from "./dom.js";
import { moment } from "./log_panels.js";
import { LINE_COUNT, PlotFigures, readLines } from "./plot_figures.js";

/** What can be chosen, s; null for all of it. */
const SPANS = [[20, "20 s"], [120, "2 min"], [null, "All"]];
const DRAW_MS = 80;
/** Wider windows are shown by the extremes of many cycles. */
const MOST_ROWS = 2000;
/** What is asked for reaches so far beyond what is shown, as a share of it: a window that moves has what follows. */
const BEYOND = 1;
const LEAST_S = 0.02;

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function columnsOf(rows) {
  const columns = Array.from({ length: LINE_COUNT }, () => []);
  rows.time_s.forEach((_, row) => {
    const values = readLines(Object.fromEntries(Object.entries(rows).map(([name, column]) => [name, column[row]])));
    values.forEach((value, line) => columns[line].push(value));
  });
  return columns;
}

export class LogPlots {
  /** @param {LogSource} source the log @param {function} seek called with the moment that was picked */
  constructor(source, seek) {
    this._source = source;
    this._t = 0;
    [this._spanS] = SPANS[0];
    this._held = null;
    this._asked = null;
    this._data = null;
    this._drawnMs = 0;
    this._figures = new PlotFigures({
      range: () => this._window(),
      isHeld: () => true,
      clock: (time) => moment(time),
      label: (time) => this._label(time),
      zoom: (from, to) => this._zoom(from, to),
      picked: (time) => this._wasDragged || seek(time),
      drawn: (plot) => this._mark(plot),
    }, "the values of the moment are in the figures above");
    this._buttons = SPANS.map(([spanS, label]) => ({ spanS, button: this._button(label, () => this._choose(spanS)) }));
  }

  draw(t) {
    this._t = t;
    const [from, to] = this._window();
    this._describe(from, to);
    void this._ask(from, to);
    const now = performance.now();
    const shown = `${from} ${to} ${t} ${this._data?.number}`;
    if (this._data === null || shown === this._shown) return;
    if (now - this._drawnMs < DRAW_MS) {
      this._later ??= setTimeout(() => { this._later = null; this.draw(this._t); }, DRAW_MS); // the last is never left out
      return;
    }
    [this._drawnMs, this._shown] = [now, shown];
    const { times, columns, has } = this._data;
    this._figures.show(times, columns, (line) => has[line]);
    this._figures.relabel();
    attribute(byId("plots"), "data-moment", String(t));
    attribute(byId("plots"), "data-shown", `${this._data.from} ${this._data.to}`);
  }

  /** From when to when is shown, s. */
  _window() {
    const { duration_s: end } = this._source.view;
    if (this._held) return this._held;
    if (this._spanS === null || this._spanS >= end) return [0, Math.max(end, LEAST_S)];
    const from = Math.min(Math.max(this._t - this._spanS / 2, 0), end - this._spanS);
    return [from, from + this._spanS];
  }

  /** Have what is shown, and somewhat more. */
  async _ask(from, to) {
    const isHere = this._asked && this._asked.from <= from && this._asked.to >= to && this._asked.span <= 4 * (to - from);
    if (isHere) return;
    const span = to - from;
    const { duration_s: end } = this._source.view;
    const asked = { from: Math.max(0, from - BEYOND * span), to: Math.min(end, to + BEYOND * span), span };
    this._asked = asked;
    try {
      const rows = await this._source.rows(asked.from, asked.to, MOST_ROWS);
      if (asked !== this._asked) return;
      const columns = columnsOf(rows);
      const has = columns.map((column) => column.some((value) => value !== null));
      this._data = { times: rows.time_s, columns, has, number: (this._data?.number ?? 0) + 1, from: asked.from, to: asked.to };
      this.draw(this._t);
    } catch (error) {
      text(byId("plots-note"), `The plots cannot be shown: ${error.message}`);
    }
  }

  _choose(spanS) {
    [this._spanS, this._held] = [spanS, null];
    this.draw(this._t);
  }

  _zoom(from, to) {
    this._wasDragged = true;
    setTimeout(() => { this._wasDragged = false; }); // the click that ends a drag picks nothing
    if (to - from >= LEAST_S) this._held = [from, to];
    this.draw(this._t);
  }

  _describe(from, to) {
    text(byId("plots-span"), `${moment(from)} to ${moment(to)}`);
    for (const { spanS, button } of this._buttons) attribute(button, "aria-pressed", String(this._held === null && spanS === this._spanS));
  }

  /** A time on the axis, no finer than the width of the plot tells apart. */
  _label(time) {
    const [from, to] = this._window();
    return `${time.toFixed(to - from < 1 ? 3 : to - from < 30 ? 1 : 0)} s`;
  }

  /** The moment as a line, and what was not recorded as grey. */
  _mark(plot) {
    const { ctx, bbox } = plot;
    const at = (time) => Math.min(Math.max(plot.valToPos(time, "x", true), bbox.left), bbox.left + bbox.width);
    ctx.save();
    ctx.fillStyle = colour("--plot-gap");
    for (const [from, to] of this._source.view.gaps) {
      if (at(to) > at(from)) ctx.fillRect(at(from), bbox.top, at(to) - at(from), bbox.height);
    }
    ctx.fillStyle = colour("--text");
    const [from, to] = this._window();
    if (this._t >= from && this._t <= to) ctx.fillRect(Math.round(at(this._t)) - 1, bbox.top, 2, bbox.height);
    ctx.restore();
  }

  _button(label, act) {
    const button = make("button", "", label);
    button.type = "button";
    button.addEventListener("click", act);
    byId("plots-buttons").append(button);
    return button;
  }
}
