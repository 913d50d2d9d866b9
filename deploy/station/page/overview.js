// SPDX-License-Identifier: MIT
// The selected robot at a glance: its mode and why, its tilt drawn, and its figures.

import { attribute, byId, make, text, visible } from "./dom.js";
import { DASH, degrees, duration, figure, milliseconds, timeOfDay } from "./format.js";
import { titleOf } from "./robots.js";
import { nextStep, stateOf } from "./state.js";
import { tiltLimits } from "./tilt_limits.js";

const SVG = "http://www.w3.org/2000/svg";
const TICKS_DEGREES = [-40, -30, -20, -10, 0, 10, 20, 30, 40];

/** Each figure: its label and its text. The first stand beside the drawing. */
const MAIN = [
  ["Tilt, \u00b0", (r) => figure(degrees(r.pitch), 1)],
  ["To limit, \u00b0", (r) => figure(degrees(tiltLimits(r)?.left), 1)],
  ["Speed, m/s", (r) => figure(r.linear_velocity, 2)],
  ["Turn, rad/s", (r) => figure(r.angular_velocity, 2)],
  ["Battery, V", (r) => figure(r.supply_v, 1)],
];
const MORE = [
  ["Last message", (r, since) => duration(r.age_s + since)],
  ["Round trip", (r) => milliseconds(r.round_trip_s)],
  ["Drives", (r) => drives(r)],
  ["Control", (r) => r.controller || "nobody"],
  ["Position, m", (r) => (r.x === null ? DASH : `${figure(r.x, 1)}, ${figure(r.y, 1)}`)],
  ["Heading, \u00b0", (r) => figure(degrees(r.heading), 0)],
];

/** Whether its motors are live, which nobody knows of a robot that is lost. */
function drives(robot) {
  if (!robot.is_alive || !robot.drives) return DASH;
  return robot.is_zero ? `${robot.drives}, zero` : robot.drives;
}

function tick(angle) {
  const line = document.createElementNS(SVG, "line");
  const isMain = angle % 20 === 0;
  const entries = { x1: 0, x2: 0, y1: -110, y2: isMain ? -120 : -115, transform: `rotate(${angle})` };
  for (const [name, value] of Object.entries(entries)) line.setAttribute(name, String(value));
  return line;
}

/** The panel at the top. */
export class Overview {
  constructor() {
    byId("attitude-scale").append(...TICKS_DEGREES.map(tick));
    this._values = [...figures("readouts", MAIN), ...figures("more-readouts", MORE)];
    this._leaning = new Set();
  }

  draw({ robot, since }) {
    const { headline, mode, kind } = stateOf(robot);
    text(byId("robot-name"), titleOf(robot));
    text(byId("headline"), headline);
    visible(byId("headline"), headline !== "");
    text(byId("mode"), mode);
    attribute(byId("mode"), "class", headline === "" ? "mode-word" : "mode-under");
    attribute(byId("mode-box"), "data-mode", kind);
    text(byId("reason"), robot.is_alive ? robot.reason : lostReason(robot, since));
    const next = nextStep(robot);
    text(byId("next"), next);
    visible(byId("next"), next !== "");
    for (const { value, format } of this._values) text(value, format(robot, since));
    this._lean(robot);
  }

  /** A robot that never reported a tilt has no drawing; of one that reported it and is lost, only the body is missing. */
  _lean({ robot: namespace, pitch }) {
    if (pitch !== null) this._leaning.add(namespace);
    visible(byId("attitude"), this._leaning.has(namespace));
    attribute(byId("attitude-body"), "visibility", pitch === null ? "hidden" : null);
    if (pitch !== null) attribute(byId("attitude-body"), "transform", `rotate(${degrees(pitch).toFixed(1)})`);
  }
}

function figures(place, readouts) {
  return readouts.map(([label, format]) => {
    const value = make("dd");
    byId(place).append(make("div", "", "", make("dt", "", label), value));
    return { value, format };
  });
}

function lostReason(robot, since) {
  const last = robot.mode ? ` It was ${robot.mode}: ${robot.reason}` : "";
  const age = robot.age_s + since;
  return `No message for ${duration(age)}, since ${timeOfDay(age)}.${last}`;
}
