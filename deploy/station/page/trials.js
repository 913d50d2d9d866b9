// SPDX-License-Identifier: MIT
// What can be done to a simulated robot: a button each, and what its safety did.

import { attribute, byId, keep, make, text, visible } from "./dom.js";
import { marksOf } from "./keys.js";
import { whyNoCommand } from "./permissions.js";

const KEPT = 5;

export class Trials {
  /** @param {object} commands that send it @param {function} now what is known now */
  constructor(commands, now) {
    this._commands = commands;
    this._now = now;
    this._buttons = new Map();
    this._rows = new Map();
    this._results = [];
    this._count = 0;
    this._waiting = null;
  }

  draw(now) {
    const trials = now.hello?.trials ?? [];
    visible(byId("trials"), trials.length > 0);
    const why = this._why(now);
    const buttons = keep(byId("trial-buttons"), this._buttons, trials.map((trial) => trial.name), (name) => this._button(name));
    trials.forEach((trial, index) => {
      const { root } = buttons[index];
      text(root, trial.title);
      attribute(root, "title", why || trial.effect);
      attribute(root, "aria-disabled", why ? "true" : null);
      attribute(root, "aria-busy", this._waiting === trial.name ? "true" : null);
    });
    const doing = trials.find((trial) => trial.name === this._waiting);
    text(byId("trial-state"), doing ? `${doing.title}: ${doing.effect}` : "");
    visible(byId("trial-state"), Boolean(doing));
    const rows = keep(byId("trial-results"), this._rows, this._results.map((result) => result.number), row);
    this._results.forEach((result, index) => {
      text(rows[index].title, result.title);
      text(rows[index].words, result.words);
    });
  }

  _why(now) {
    return whyNoCommand(now) || (this._waiting ? "Wait for what the last one led to" : "");
  }

  _button(name) {
    const root = make("button", name === "recover" ? "primary" : "");
    root.type = "button";
    attribute(root, "data-trial", name);
    attribute(root, "aria-keyshortcuts", marksOf(name).join(" ") || null);
    root.addEventListener("click", () => this.press(name));
    return { root };
  }

  /** Whether there is a button for this now. */
  has(name, { hello }) {
    return (hello?.trials ?? []).some((trial) => trial.name === name);
  }

  /** Do what a button does. */
  press(name) {
    const now = this._now();
    const trial = now.hello?.trials.find((each) => each.name === name);
    const why = this._why(now);
    if (why) {
      this._commands.fail(`${trial.title}: ${why}`);
      return;
    }
    const isSent = this._commands.send("try", now.robot, { name }, (isAccepted, answer) => {
      this._waiting = null;
      this._count += 1;
      const words = isAccepted ? answer : `failed: ${answer}`;
      this._results = [{ number: this._count, title: trial.title, words }, ...this._results].slice(0, KEPT);
    });
    if (isSent) this._waiting = name;
    else this._commands.fail(`${trial.title}: no connection to the base station`);
  }
}

function row() {
  const [title, words] = [make("strong"), make("span")];
  return { root: make("li", "", "", title, ": ", words), title, words };
}
