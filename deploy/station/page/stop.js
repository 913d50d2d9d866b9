// SPDX-License-Identifier: MIT
// STOP: always there, for viewers too, one key, latched until it is cleared, and confirmed by the drives.
//
// A stop is kept here, however long the station is away, until the station reports that it has it on its disk or that it
// is confirmed. Then the station keeps it. It is taken back by hand only.
//
// Both Esc and Space stop. Esc works everywhere, in a text field too. Space works everywhere but in a text field, where it
// types; it presses no button, as the focus may be on `Arm` when it is hit in haste: buttons are pressed with Enter.

import { attribute, byId, text, visible } from "./dom.js";
import { isTextField } from "./driving.js";
import { duration, milliseconds } from "./format.js";
import { titleOf } from "./robots.js";

/** A stop that the station does not report is sent again after this time, ms. */
const AGAIN_MS = 1000;
/** A stop that is not confirmed within this time is shown as not confirmed. */
const SLOW_MS = 1000;

const UNSENT =
  "Stop not sent: no connection. It is sent as soon as there is one, however late. Use the robot's own switch";

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
    // Also where the picture is stale: it may be the way to us that is broken, not the one to the robot.
    for (const robot of robots) {
      this._latches.set(robot.robot, newLatch());
      this._send(robot);
    }
  }

  /** The socket is there again: send what the station does not keep. */
  reconnected(robots) {
    for (const [name, latch] of this._latches) {
      if (!latch.isKept) this._send(robots.find((robot) => robot.robot === name) ?? { robot: name });
    }
  }

  /** The socket closed: what the station does not keep is ours to send again. */
  lost() {
    for (const latch of this._latches.values()) latch.isSeen = latch.isKept;
  }

  /** Follow the stops as the station reports them, and send again those that it does not. */
  update(robots) {
    for (const robot of robots) {
      const latch = this._latches.get(robot.robot);
      // Somebody else may have cleared it, or taken it back.
      if (latch?.isSeen && robot.stop === "") this._latches.delete(robot.robot);
      else if (latch && robot.stop !== "") {
        latch.isSeen = true;
        latch.isKept = robot.stop_kept || robot.stop === "confirmed";
      }
    }
    for (const [name, latch] of this._latches) {
      const isDue = !latch.isSeen && !latch.isKept && performance.now() - latch.sentMs > AGAIN_MS;
      if (isDue) this._send(robots.find((robot) => robot.robot === name) ?? { robot: name });
    }
  }

  draw(now) {
    const { robot, robots } = now;
    const status = robot ? this._status(robot) : { kind: "", words: "" };
    text(byId("stop-robot"), robot ? titleOf(robot) : "");
    text(byId("stop-state"), status.words);
    attribute(byId("bar"), "data-stop", status.kind || null);
    attribute(byId("stop"), "aria-disabled", robot ? null : "true");
    attribute(byId("stop-clear"), "title", robot ? `The way back: clear stop, then ${robot.posture ? "stand up" : "arm"}` : null);
    visible(byId("stop-clear"), status.kind !== "");
    visible(byId("stop-all"), robots.length > 1);
  }

  _send(robot) {
    const latch = this._latches.get(robot.robot);
    const isSent = this._commands.send("stop", robot, {}, (isAccepted, why) => {
      latch.why = isAccepted ? "" : why;
      latch.isKept ||= isAccepted;
    });
    if (isSent) Object.assign(latch, { isSent, sentMs: performance.now() });
  }

  _status(robot) {
    const latch = this._latches.get(robot.robot);
    if (latch && !latch.isSent) return { kind: "failed", words: UNSENT };
    if (robot.stop === "confirmed") return { kind: "confirmed", words: confirmed(robot) };
    if (latch?.why) return { kind: "failed", words: `Stop failed: ${latch.why}. Use the robot's own switch` };
    if (!latch && robot.stop !== "requested") return { kind: "", words: "" };
    const waitedMs = latch ? performance.now() - latch.requestedMs : 0;
    if (waitedMs < SLOW_MS) return { kind: "requested", words: "Stop requested" };
    return { kind: "failed", words: `Stop requested ${duration(waitedMs / 1e3)} ago, not confirmed` };
  }

  _clear() {
    const { robot } = this._now();
    if (!robot) return;
    const clearLatch = () => this._latches.delete(robot.robot);
    const isFault = robot.is_alive && robot.mode === "FAULT";
    // What is not with the station yet is only here.
    if (!this._latches.get(robot.robot)?.isSent || (robot.stop === "" && !isFault)) clearLatch();
    if (robot.stop === "" && !isFault) return;
    if (!this._commands.send(isFault ? "clear_fault" : "cancel_stop", robot, {}, (isAccepted) => isAccepted && clearLatch())) {
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

const newLatch = () => ({ requestedMs: performance.now(), sentMs: -Infinity, isSent: false, isSeen: false, isKept: false, why: "" });
