// SPDX-License-Identifier: MIT
// Tilt, speed and turning over the last 20 s, as they arrive; they stop and turn grey when nothing arrives.

import uPlot from "./vendor/uplot.js";
import { attribute, byId, make, text, visible } from "./dom.js";
import { degrees, duration } from "./format.js";

const SPAN_S = 20;
const DRAW_MS = 100;
const HEIGHT = 104;
const MOST_POINTS = 1000;
const LIMITS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];

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

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** The history of one robot: a column of times, s of the station's clock, and one for each line of each graph. */
class History {
  constructor() {
    this.times = [];
    this.columns = GRAPHS.map((graph) => graph.series.map(() => []));
    this._isGap = true;
  }

  add(timeS, robot) {
    if (!robot.is_alive && this._isGap) return;
    if (timeS < this.times.at(-1)) this._cut(this.times.length); // another station's clock
    this._isGap = !robot.is_alive;
    this.times.push(timeS);
    GRAPHS.forEach((graph, index) => {
      const values = graph.read(robot);
      this.columns[index].forEach((column, line) => column.push(robot.is_alive ? values[line] : null));
    });
    const first = this.times.findIndex((time) => time >= timeS - SPAN_S);
    this._cut(Math.max(first - 1, this.times.length - MOST_POINTS));
  }

  _cut(count) {
    if (count <= 0) return;
    for (const column of [this.times, ...this.columns.flat()]) column.splice(0, count);
  }
}

/** The smallest round limit that holds all values, so that the scale rarely changes. */
function symmetric(least, low, high) {
  const most = Math.max(least, Math.abs(low ?? 0), Math.abs(high ?? 0));
  const limit = LIMITS.find((round) => round >= most) ?? most;
  return [-limit, limit];
}

function axis(extra) {
  return {
    stroke: () => colour("--muted"),
    font: "12px system-ui, sans-serif",
    grid: { stroke: () => colour("--plot-grid"), width: 1 },
    ticks: { show: false },
    ...extra,
  };
}

function options(graph, width) {
  const ages = (u) => [20, 15, 10, 5, 0].map((age) => u.scales.x.max - age);
  return {
    width,
    height: HEIGHT,
    legend: { show: false },
    cursor: { show: false },
    padding: [8, 12, 0, 0],
    scales: {
      x: { time: false, range: (u, low, high) => [(high ?? 0) - SPAN_S, high ?? 0] },
      y: { range: (u, low, high) => symmetric(graph.least, low, high) },
    },
    axes: [
      axis({ size: 24, gap: 4, splits: ages, values: () => ["\u221220 s", "\u221215", "\u221210", "\u22125", "0"] }),
      axis({ size: 44, gap: 4, space: 28 }),
    ],
    series: [{}, ...graph.series.map(([label, name]) => ({
      label, width: 1.75, stroke: () => colour(name), points: { show: false },
      ...(label === "set-point" ? { dash: [5, 4] } : {}),
    }))],
  };
}

function figureOf(graph) {
  const key = make("span", "plot-key");
  for (const [label] of graph.series) {
    if (graph.series.length > 1) key.append(make("span", `key-${label}`, label));
  }
  const title = make("figcaption", "", "", make("strong", "", graph.title), ` ${graph.unit} `, key);
  const place = make("div", "plot");
  attribute(place, "role", "img");
  attribute(place, "aria-label", `${graph.title} over the last 20 s, ${graph.unit}; the newest value is in the figures above`);
  const root = make("figure", "", "", title, place);
  byId("plots").append(root);
  return { root, place };
}

export class Plots {
  constructor() {
    this._histories = new Map();
    this._figures = GRAPHS.map(figureOf);
    this._plots = null;
    this._drawnMs = 0;
    this._drawn = null;
    new ResizeObserver(() => this._fit()).observe(byId("plots"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this._plots?.forEach((plot) => plot.redraw()));
  }

  /** Add a picture of the fleet. */
  add({ time_s: timeS, robots }) {
    for (const robot of robots) {
      if (!this._histories.has(robot.robot)) this._histories.set(robot.robot, new History());
      this._histories.get(robot.robot).add(timeS, robot);
    }
  }

  draw({ robot, since, isLive }) {
    attribute(byId("plots"), "data-live", isLive ? "true" : "false");
    visible(byId("plots-state"), !isLive);
    text(byId("plots-state"), isLive ? "" : `stopped ${duration(robot.age_s + since)} ago`);
    const history = this._histories.get(robot.robot);
    const nowMs = performance.now();
    const newest = `${robot.robot} ${history?.times.at(-1)}`;
    if (!history || newest === this._drawn || nowMs - this._drawnMs < DRAW_MS) return;
    this._drawnMs = nowMs;
    this._drawn = newest;
    this._show(history);
  }

  _show(history) {
    this._plots ??= GRAPHS.map((graph, index) => {
      const { place } = this._figures[index];
      return new uPlot(options(graph, place.clientWidth), [[], ...graph.series.map(() => [])], place);
    });
    GRAPHS.forEach((graph, index) => {
      const columns = history.columns[index];
      visible(this._figures[index].root, columns.some((column) => column.some((value) => value !== null)));
      this._plots[index].setData([history.times, ...columns]);
    });
    this._fit();
    const { root } = this._figures[0];
    attribute(byId("plots"), "data-newest", root ? String(history.times.at(-1)) : null);
  }

  _fit() {
    this._plots?.forEach((plot, index) => {
      const width = this._figures[index].place.clientWidth;
      if (width > 0 && width !== plot.width) plot.setSize({ width, height: HEIGHT });
    });
  }
}
