// SPDX-License-Identifier: MIT
// One button that leads back from a fault: it clears it, then arms the robot, or has it stand up.

import { attribute, byId, text, visible } from "./dom.js";
import { whyNot } from "./permissions.js";
import { wayBackLabel } from "./state.js";

export class WayBack {
  /** @param {object} commands that send it @param {function} now what is known now */
  constructor(commands, now) {
    this._commands = commands;
    this._now = now;
    byId("way-back").addEventListener("click", () => this._press());
  }

  draw(now) {
    const { robot } = now;
    const why = whyNot("clear_fault", now);
    visible(byId("way-back"), robot.is_alive && robot.mode === "FAULT");
    text(byId("way-back"), wayBackLabel(robot));
    attribute(byId("way-back"), "aria-disabled", why ? "true" : null);
    attribute(byId("way-back"), "title", why || null);
  }

  _press() {
    const now = this._now();
    const { robot } = now;
    const why = whyNot("clear_fault", now);
    if (why) {
      this._commands.fail(`${wayBackLabel(robot)}: ${why}`);
      return;
    }
    const isSent = this._commands.send("clear_fault", robot, {}, (isAccepted) => {
      if (isAccepted) this._commands.send(robot.can_stand ? "stand" : "arm", robot);
    });
    if (!isSent) this._commands.fail(`${wayBackLabel(robot)}: no connection to the base station`);
  }
}
