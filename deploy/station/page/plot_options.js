// SPDX-License-Identifier: MIT
// How one plot is drawn: its scales, axes, lines, and what the mouse does.

const LIMITS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
/** Where the axis of time has labels, as shares: of what goes on, and of what is held, whose labels are longer. */
const GOING_ON = [0, 0.25, 0.5, 0.75, 1];
const HELD = [1 / 6, 1 / 2, 5 / 6];
/** So much is told in seconds, s. */
const SECONDS_S = 120;

export const HEIGHT = 104;

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

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

/** How long before now, the first with its unit. */
function ago(seconds) {
  const isShort = seconds[0] <= SECONDS_S;
  return seconds.map((each, index) => {
    const value = Number((isShort ? each : each / 60).toFixed(1));
    const unit = index === 0 ? ` ${isShort ? "s" : "min"}` : "";
    return value === 0 ? "0" : `\u2212${value}${unit}`;
  });
}

/**
 * Options of a plot.
 * @param {{least: number, series: Array}} graph what is drawn
 * @param {number} width in dots
 * @param {{range: function, isHeld: function, clock: function, zoom: function, moved: function, drawn: ?function}} view
 *   `range()` what is shown, from and to, `isHeld()` whether that stands, `clock(time)` the time of day, `zoom(from, to)` after
 *   a drag, `moved()` of the cursor, `drawn(plot, graph)` when a plot was drawn
 */
export function options(graph, width, view) {
  const splits = () => {
    const [from, to] = view.range();
    return (view.isHeld() ? HELD : GOING_ON).map((share) => from + share * (to - from));
  };
  const values = (u, times) => (view.isHeld() ? times.map(view.label ?? view.clock) : ago(times.map((time) => view.range()[1] - time)));
  return {
    width,
    height: HEIGHT,
    legend: { show: false },
    cursor: { y: false, points: { show: false }, sync: { key: "plots" }, drag: { x: true, y: false, setScale: false } },
    padding: [8, 12, 0, 0],
    scales: {
      x: { time: false, range: () => view.range() },
      y: { range: (u, low, high) => symmetric(graph.least, low, high) },
    },
    axes: [axis({ size: 24, gap: 4, splits, values }), axis({ size: 44, gap: 4, space: 28 })],
    series: [{}, ...graph.series.map(([label, name]) => ({
      label, width: 1.75, stroke: () => colour(name), points: { show: false },
      ...(label === "set-point" ? { dash: [5, 4] } : {}),
    }))],
    hooks: {
      setSelect: [(u) => select(u, view.zoom)], setCursor: [view.moved], draw: view.drawn ? [(u) => view.drawn(u, graph)] : [],
    },
  };
}

/** A drag has ended: zoom to it, and show it no longer. */
function select(u, zoom) {
  const { left, width } = u.select;
  if (width === 0) return;
  u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  zoom(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
}
