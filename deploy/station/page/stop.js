// SPDX-License-Identifier: MIT
// STOP: always there, one key, latched until it is cleared, and confirmed by the drives.
//
// Both Esc and Space stop. Esc works everywhere, in a text field too. Space works everywhere but in a text field, where it
// types; it presses no button, as the focus may be on `Arm` when it is hit in haste: buttons are pressed with Enter.

import { attribute, byId, text, visible } from "./dom.js";
import { isTextField } from "./driving.js";
import { duration, milliseconds } from "./format.js";
import { VIEWER } from "./permissions.js";
import { titleOf } from "./robots.js";

/** A stop that could not be sent is sent when the station is back within this time; later it would come as a surprise. */
const KEPT_MS = 10_000;
/** A stop that is not confirmed within this time is shown as not confirmed. */
const SLOW_MS = 1000;

export class Stop {
  /** @param {object} commands that send it @param {function} now what is known now @param {function} before what ends first */
  constructor(commands, now, before) {
    this._commands = commands;
    this._now = now;
    this._before = before;
    this._latches = new Map();
    this._listen();
  }

  /** Stop these robots. */
  press(robots) {
    this._before();
    // Not where the picture is stale: it may be the way to us that is broken, not the one to the robot.
    if (this._now().hello?.role === "viewer") return this._commands.fail(`STOP: ${VIEWER}`);
    for (const robot of robots) this._request(robot);
    return undefined;
  }

  /** The socket is there again: send what could not be sent. */
  reconnected(robots) {
    for (const robot of robots) {
      const latch = this._latches.get(robot.robot);
      if (latch?.state === "unsent" && performance.now() - latch.requestedMs < KEPT_MS) this._request(robot);
    }
  }

  /** Follow the stops as the station reports them. */
  update(robots) {
    for (const robot of robots) {
      const latch = this._latches.get(robot.robot);
      if (!latch) continue;
      // Somebody else may have cleared it.
      if (latch.wasSeen && robot.stop === "") this._latches.delete(robot.robot);
      if (robot.stop !== "") latch.wasSeen = true;
    }
  }

  draw(now) {
    const { robot, robots } = now;
    const status = robot ? this._status(robot) : { kind: "", words: "" };
    text(byId("stop-robot"), robot ? titleOf(robot) : "");
    text(byId("stop-state"), status.words);
    attribute(byId("bar"), "data-stop", status.kind || null);
    attribute(byId("stop"), "aria-disabled", !robot || now.hello?.role === "viewer" ? "true" : null);
    visible(byId("stop-clear"), status.kind !== "");
    visible(byId("stop-all"), robots.length > 1);
  }

  _request(robot) {
    const latch = { requestedMs: performance.now(), state: "requested", why: "", wasSeen: false };
    this._latches.set(robot.robot, latch);
    const isSent = this._commands.send("stop", robot, {}, (isAccepted, why) => {
      if (!isAccepted) Object.assign(latch, { state: "failed", why });
    });
    if (!isSent) latch.state = "unsent";
  }

  _status(robot) {
    const latch = this._latches.get(robot.robot);
    if (latch?.state === "unsent") return { kind: "failed", words: unsent(latch) };
    if (robot.stop === "confirmed") return { kind: "confirmed", words: confirmed(robot) };
    if (latch?.state === "failed") return { kind: "failed", words: `Stop failed: ${latch.why}. Use the robot's own switch` };
    if (!latch && robot.stop !== "requested") return { kind: "", words: "" };
    const waitedMs = latch ? performance.now() - latch.requestedMs : 0;
    if (waitedMs < SLOW_MS) return { kind: "requested", words: "Stop requested" };
    return { kind: "failed", words: `Stop requested ${duration(waitedMs / 1e3)} ago, not confirmed` };
  }

  _clear() {
    const { robot } = this._now();
    if (!robot) return;
    const clearLatch = () => this._latches.delete(robot.robot);
    if (robot.stop === "" && robot.mode !== "FAULT") return clearLatch();
    if (!this._commands.send("clear_fault", robot, {}, (isAccepted) => isAccepted && clearLatch())) {
      this._commands.fail("Clear stop: no connection to the base station");
    }
  }

  _listen() {
    const pressSelected = () => this.press(this._now().robot ? [this._now().robot] : []);
    // At once on touch, not when the finger leaves; a click without a pointer before it comes from a keyboard.
    onPress(byId("stop"), pressSelected);
    onPress(byId("stop-all"), () => this.press(this._now().robots));
    byId("stop-clear").addEventListener("click", () => this._clear());
    addEventListener("keydown", (event) => this._key(event, pressSelected), { capture: true });
    addEventListener("keyup", (event) => isStopKey(event) && event.preventDefault(), { capture: true });
  }

  _key(event, pressSelected) {
    if (!isStopKey(event)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) pressSelected();
  }
}

function isStopKey(event) {
  if (byId("station").hidden) return false;
  return event.key === "Escape" || (event.key === " " && !isTextField(event.target));
}

function onPress(button, act) {
  let wasPointer = false;
  button.addEventListener("pointerdown", () => {
    wasPointer = true;
    act();
  });
  button.addEventListener("click", () => {
    if (!wasPointer) act();
    wasPointer = false;
  });
}

function confirmed(robot) {
  const after = robot.stop_after_s === null ? "" : ` after ${milliseconds(robot.stop_after_s)}`;
  const what = robot.drives === "none" ? "commands zero" : `drives ${robot.drives || "unknown"}`;
  return `Stop confirmed${after}: ${what}`;
}

function unsent(latch) {
  const isKept = performance.now() - latch.requestedMs < KEPT_MS;
  return `Stop not sent: no connection. ${isKept ? "It is sent as soon as there is one" : "Press again, or use the robot's own switch"}`;
}
