// SPDX-License-Identifier: MIT
// The plots of a robot: which there are, their titles, and what the cursor reads. What they show is given.

import uPlot from "./vendor/uplot.js";
import { attribute, byId, make, text, visible } from "./dom.js";
import { degrees, figure as number } from "./format.js";
import { HEIGHT, options } from "./plot_options.js";

const GRAPHS = [
  { title: "Tilt", unit: "\u00b0", least: 10, series: [["measured", "--plot-1"]], read: (r) => [degrees(r.pitch)] },
  {
    title: "Speed", unit: "m/s", least: 0.5, series: [["measured", "--plot-1"], ["set-point", "--plot-2"]],
    read: (r) => [r.linear_velocity, r.linear_setpoint],
  },
  {
    title: "Turning", unit: "rad/s", least: 0.5, series: [["measured", "--plot-1"], ["set-point", "--plot-2"]],
    read: (r) => [r.angular_velocity, r.angular_setpoint],
  },
];

/** Of the columns that are shown, those of each graph. */
const LINES = GRAPHS.map((graph, index) => {
  const first = GRAPHS.slice(0, index).reduce((sum, before) => sum + before.series.length, 0);
  return graph.series.map((_, line) => first + line);
});

/** How many columns there are. */
export const LINE_COUNT = LINES.flat().length;

/** What a robot reported, a value for each column. */
export const readLines = (robot) => GRAPHS.flatMap((graph) => graph.read(robot));

function figureOf(graph, note) {
  const key = make("span", "plot-key");
  for (const [label] of graph.series) {
    if (graph.series.length > 1) key.append(make("span", `key-${label}`, label));
  }
  const at = make("span", "plot-at");
  const title = make("figcaption", "", "", make("strong", "", graph.title), ` ${graph.unit} `, key, at);
  const place = make("div", "plot");
  attribute(place, "role", "img");
  attribute(place, "aria-label", `${graph.title} over time, ${graph.unit}; ${note}`);
  const root = make("figure", "", "", title, place);
  byId("plots").append(root);
  return { root, place, at };
}

export class PlotFigures {
  /** @param {object} view as `options` takes it, without `moved` @param {string} note where a screen reader finds the values */
  constructor(view, note) {
    this._view = view;
    this._figures = GRAPHS.map((graph) => figureOf(graph, note));
    this._plots = null;
    this._times = [];
    this._columns = [];
    new ResizeObserver(() => this.fit()).observe(byId("plots"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this._plots?.forEach((plot) => plot.redraw()));
  }

  /** Show columns over their times; a graph whose columns have nothing is hidden, by `has(column)`. */
  show(times, columns, has) {
    [this._times, this._columns] = [times, columns];
    this._plots ??= GRAPHS.map((graph, index) => this._plot(graph, index));
    GRAPHS.forEach((graph, index) => {
      visible(this._figures[index].root, LINES[index].some(has));
      this._plots[index].setData([times, ...LINES[index].map((line) => columns[line])]);
      this._readCursor(this._plots[index], index);
    });
    this.fit();
  }

  /** Draw the axes anew: the same time has other labels now. */
  relabel() {
    this._plots?.forEach((plot) => plot.redraw(true, true));
  }

  fit() {
    this._plots?.forEach((plot, index) => {
      const width = this._figures[index].place.clientWidth;
      if (width > 0 && width !== plot.width) plot.setSize({ width, height: HEIGHT });
    });
  }

  _plot(graph, index) {
    const { place } = this._figures[index];
    const view = { ...this._view, moved: (plot) => this._readCursor(plot, index) };
    const plot = new uPlot(options(graph, place.clientWidth, view), [[], ...graph.series.map(() => [])], place);
    if (this._view.picked) plot.over.addEventListener("click", () => this._view.picked(plot.posToVal(plot.cursor.left, "x")));
    return plot;
  }

  /** The values under the cursor, in the order of the lines. */
  _readCursor(plot, index) {
    const row = plot.cursor.idx;
    const time = this._times[row];
    const values = time === undefined ? [] : LINES[index].map((line) => number(this._columns[line][row], 2));
    text(this._figures[index].at, time === undefined ? "" : `${this._view.clock(time)}: ${values.join(", ")}`);
  }
}
