// SPDX-License-Identifier: MIT
// The list of robots: each with its mode as a colour and a word, or how long it has been lost.

import { attribute, byId, keep, make, text, visible } from "./dom.js";
import { duration } from "./format.js";
import { stateOf, wordOf } from "./state.js";

const nameOf = (robot) => robot.name || robot.robot;

/** What the operator calls it: with its namespace, as two may have the same name; that of the root is left out. */
export const titleOf = (robot) => (robot.name && robot.robot !== "/" ? `${robot.name} ${robot.robot}` : nameOf(robot));

function row(namespace, choose) {
  const title = make("span", "robot-title");
  const place = make("span", "robot-namespace", namespace);
  const mode = make("span", "chip");
  const age = make("span", "robot-age");
  const button = make("button", "robot-button", "", title, mode, place, age);
  button.type = "button";
  button.addEventListener("click", () => choose(namespace));
  return { root: make("li", "", "", button), button, title, mode, age };
}

function note(robot, since) {
  if (!robot.is_alive) return `for ${duration(robot.age_s + since)}`;
  return robot.controller ? `with ${robot.controller}` : "";
}

function summary(robots) {
  const count = (predicate) => robots.filter(predicate).length;
  const lost = count((robot) => !robot.is_alive);
  const faults = count((robot) => robot.is_alive && robot.mode === "FAULT");
  const parts = [`${robots.length} ${robots.length === 1 ? "robot" : "robots"}`];
  if (lost) parts.push(`${lost} lost`);
  if (faults) parts.push(`${faults} in fault`);
  return parts.join(" \u00b7 ");
}

/** The list; `choose(namespace)` is called when one is selected. */
export class RobotList {
  constructor(choose) {
    this._rows = new Map();
    this._choose = choose;
  }

  draw({ robots, robot: selected, since }, wanted) {
    const names = robots.map((robot) => robot.robot);
    const rows = keep(byId("robots"), this._rows, names, (name) => row(name, this._choose));
    robots.forEach((robot, index) => {
      const { button, title, mode, age } = rows[index];
      text(title, nameOf(robot)); // its namespace stands beside it
      text(mode, wordOf(robot));
      attribute(mode, "data-mode", stateOf(robot).kind);
      text(age, note(robot, since));
      attribute(button, "aria-current", robot === selected ? "true" : null);
    });
    visible(byId("no-robots"), !selected);
    text(byId("no-robots"), robots.length ? `${wanted} was not found. Choose a robot.` : "None found yet; discovery is automatic.");
    text(byId("summary"), summary(robots));
  }
}

/** Announces to screen readers when a robot's mode changes, is lost or comes back; numbers that stream are not announced. */
export class Announcer {
  constructor() {
    this._announced = new Map();
  }

  update(robots) {
    for (const robot of robots) {
      const word = wordOf(robot);
      const before = this._announced.get(robot.robot);
      this._announced.set(robot.robot, word);
      if (before === undefined || before === word) continue;
      const isAlarm = ["LOST", "FAULT", "FALLEN"].includes(word);
      const reason = word === "LOST" ? "no messages from it" : robot.reason;
      text(byId(isAlarm ? "alarm" : "announcer"), `${titleOf(robot)}: ${word}, ${reason}`);
    }
  }
}
