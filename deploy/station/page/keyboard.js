// SPDX-License-Identifier: MIT
// The keys that command, each as its button does, and all keys shown; driving and stopping listen for themselves.

import { byId, keep, make } from "./dom.js";
import { isTextField } from "./driving.js";
import { KEYS, actOf, marksOf } from "./keys.js";

const DRIVING = ["ahead", "back", "left", "right", "rest", "stop"];

export class Keyboard {
  /**
   * @param {function} now what is known now
   * @param {object} commands that have a button, and `has(act, robot)` @param {object} trials the same of a simulated robot
   * @param {function} rest brings to rest what is driven
   */
  constructor(now, commands, trials, rest) {
    this._now = now;
    this._commands = commands;
    this._trials = trials;
    this._rest = rest;
    this._rows = new Map();
    addEventListener("keydown", (event) => this._press(event));
  }

  draw(now) {
    const acts = KEYS.map(([act]) => act).filter((act) => DRIVING.includes(act) || this._doer(act, now));
    keep(byId("keys"), this._rows, acts, row);
  }

  _press(event) {
    const isMeant = !event.repeat && !event.ctrlKey && !event.altKey && !event.metaKey && !isTextField(event.target);
    if (!isMeant || byId("station").hidden) return;
    const [act, now] = [actOf(event), this._now()];
    const doer = this._doer(act, now);
    if (act === "rest") this._rest();
    else if (doer) doer.press(act);
    else return;
    event.preventDefault();
  }

  /** What has a button for this act now, if anything. */
  _doer(act, now) {
    if (!now.robot) return undefined;
    return [this._commands, this._trials].find((each) => each.has(act, now));
  }
}

function row(act) {
  const [, , words] = KEYS.find(([each]) => each === act);
  return { root: make("li", "", "", ...marksOf(act).flatMap((mark) => [make("kbd", "", mark), " "]), words) };
}
