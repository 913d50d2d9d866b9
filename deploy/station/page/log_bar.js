// SPDX-License-Identifier: MIT
// The bar that scrubs: the modes as a band, gaps in it, and a mark for each event. All of it stands in the list of events too.

import { attribute, byId } from "./dom.js";
import { stateOf } from "./state.js";

const SVG = "http://www.w3.org/2000/svg";
/** Marks closer than this share of the bar are drawn as one. */
const NEAR = 1 / 800;
const LEVELS = ["info", "warning", "error"];

function shape(tag, name, attributes) {
  const element = document.createElementNS(SVG, tag);
  element.setAttribute("class", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

const percent = (share) => `${(100 * share).toFixed(3)}%`;

function band(view) {
  const modes = view.events.filter((event) => event.kind === "mode");
  return modes.map((event, index) => {
    const until = modes[index + 1]?.time_s ?? view.duration_s;
    const { kind } = stateOf({ is_alive: true, mode: event.name, posture: "" });
    const [x, width] = [event.time_s / view.duration_s, (until - event.time_s) / view.duration_s];
    const element = shape("rect", "marks-mode", { x: percent(x), width: percent(width), y: 12, height: 8 });
    element.setAttribute("data-mode", kind);
    return element;
  });
}

function gaps(view) {
  return view.gaps.map(([from, to]) => {
    const width = Math.max((to - from) / view.duration_s, NEAR);
    return shape("rect", "marks-gap", { x: percent(from / view.duration_s), width: percent(width), y: 8, height: 14 });
  });
}

/** What is near each other is one mark, as grave as the gravest. */
function events(view) {
  const marks = [];
  for (const event of view.events) {
    const share = event.time_s / view.duration_s;
    const last = marks.at(-1);
    if (last && share - last.share < NEAR) last.level = Math.max(last.level, LEVELS.indexOf(event.level));
    else marks.push({ share, level: LEVELS.indexOf(event.level) });
  }
  return marks.map(({ share, level }) => {
    const x = percent(share);
    const height = level === 0 ? 6 : 10;
    return shape("line", `marks-event ${LEVELS[level]}`, { x1: x, x2: x, y1: 11 - height, y2: 11 });
  });
}

/** Draw what the log has along the bar. */
export function drawMarks(view) {
  byId("marks").replaceChildren(...(view.duration_s > 0 ? [...band(view), ...gaps(view), ...events(view)] : []));
}

/** The slider and what it says. */
export class Bar {
  /** @param {Player} player whose moment it shows and moves */
  constructor(player) {
    this._player = player;
    this._input = byId("moment");
    this._input.addEventListener("input", () => player.seek(Number(this._input.value)));
  }

  draw(words) {
    attribute(this._input, "max", String(this._player.duration));
    const value = String(this._player.t);
    if (this._input.value !== value) this._input.value = value;
    attribute(this._input, "aria-valuetext", words);
  }
}
