// SPDX-License-Identifier: MIT
// STOP: always there, for viewers too, one key, latched until it is cleared, and confirmed by the drives.
//
// A stop is kept here, however long the station is away, until the station reports that it has it on its disk or that it
// is confirmed. Then the station keeps it. It is taken back by hand only.
//
// Esc, Space and a gamepad's button stop. Esc works everywhere, in a text field too. Space does not where it has a use of its
// own: it types in a text field and presses the button that has the focus, which a click does not give to any.

import { attribute, byId, text, visible } from "./dom.js";
import { blurWhatIsClicked, isByPointer, takesSpace } from "./driving.js";
import { duration, milliseconds, timeOfDay } from "./format.js";
import { actOf, marksOf, nameOf } from "./keys.js";
import { titleOf } from "./robots.js";

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

  /** Stop these robots; the key or button was pressed at `pressedMs`, by the page's clock. */
  press(robots, pressedMs) {
    this._before();
    // Also where the picture is stale: it may be the way to us that is broken, not the one to the robot.
    for (const robot of robots) {
      this._latches.set(robot.robot, newLatch(pressedMs, robot.stop));
      this._send(robot);
    }
  }

  /** Stop the robot that is selected; see `press`. */
  pressSelected(pressedMs) {
    const { robot } = this._now();
    if (robot) this.press([robot], pressedMs);
    else this._commands.fail("Stop: no robot is selected, and nothing was stopped");
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
      if (!latch) continue;
      // What was confirmed when this one was pressed is the stop before it: that tells nothing of this one.
      latch.isAlone ||= robot.stop !== "confirmed";
      if (!latch.isAlone) continue;
      // Somebody else may have cleared it, or taken it back.
      if (latch.isSeen && robot.stop === "") this._latches.delete(robot.robot);
      else if (robot.stop !== "") {
        latch.isSeen = true;
        latch.isKept = robot.stop_kept || robot.stop === "confirmed";
        if (robot.stop === "confirmed") latch.confirmedMs ??= performance.now();
      }
    }
    // A picture that may still be believed would have it by now.
    const againMs = 1e3 * this._now().hello.fresh_s;
    for (const [name, latch] of this._latches) {
      const isDue = !latch.isSeen && !latch.isKept && performance.now() - latch.sentMs > againMs;
      if (isDue) this._send(robots.find((robot) => robot.robot === name) ?? { robot: name });
    }
  }

  draw(now) {
    const { robot, robots } = now;
    const status = robot ? withAge(this._status(robot), now) : { kind: "", words: "" };
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
      latch.isAlone ||= isAccepted;
    });
    if (isSent) Object.assign(latch, { isSent, sentMs: performance.now() });
  }

  _status(robot) {
    const latch = this._latches.get(robot.robot);
    if (latch && !latch.isSent) return { kind: "failed", words: UNSENT };
    if (robot.stop === "confirmed") return { kind: "confirmed", words: confirmed(robot, latch) };
    if (latch?.why) return { kind: "failed", words: `Stop failed: ${latch.why}. Use the robot's own switch` };
    if (!latch && robot.stop !== "requested") return { kind: "", words: "" };
    const waitedMs = latch ? performance.now() - latch.pressedMs : 0;
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
    text(byId("stop-keys"), `${marksOf("stop").join(", ")} or gamepad B`);
    const pressSelected = (event) => this.pressSelected(event.timeStamp);
    // At once on touch, not when the finger leaves; a click without a pointer before it comes from a keyboard.
    onPress(byId("stop"), pressSelected);
    onPress(byId("stop-all"), (event) => this.press(this._now().robots, event.timeStamp));
    byId("stop-clear").addEventListener("click", () => this._clear());
    addEventListener("keydown", (event) => this._key(event), { capture: true });
    addEventListener("keyup", (event) => isStopKey(event) && event.preventDefault(), { capture: true });
    blurWhatIsClicked();
  }

  _key(event) {
    if (!isStopKey(event)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) this.pressSelected(event.timeStamp);
  }
}

function isStopKey(event) {
  if (byId("station").hidden) return false;
  if (actOf(event) !== "stop") return false;
  // On STOP itself Space acts when it is pressed, and not when it is let go, as on any other button.
  return nameOf(event) !== "Space" || !takesSpace(event.target) || event.target === byId("stop");
}

function onPress(button, act) {
  button.addEventListener("pointerdown", act);
  button.addEventListener("click", (event) => isByPointer(event) || act(event));
}

/** Who pressed it is told the time from there to the picture that confirms it; everybody else, the station's part of it. */
function confirmed(robot, latch) {
  const what = robot.drives === "none" ? "commands zero" : `drives ${robot.drives || "unknown"}`;
  const stations = robot.stop_after_s === null ? "" : milliseconds(robot.stop_after_s);
  if (!latch) return stations ? `Stop confirmed ${stations} after it reached the station: ${what}` : `Stop confirmed: ${what}`;
  if (!latch.confirmedMs) return `Stop confirmed: ${what}`;
  const whole = milliseconds((latch.confirmedMs - latch.pressedMs) / 1e3);
  return `Stop confirmed after ${whole}${stations ? ` (${stations} at the station)` : ""}: ${what}`;
}

/** What was confirmed is true of the moment of the picture: where nothing came since, of when that was. */
function withAge({ kind, words }, { robot, isFresh, since }) {
  if (kind !== "confirmed" || (isFresh && robot.is_alive)) return { kind, words };
  return { kind: "past", words: `${words}, as of ${timeOfDay(robot.age_s + since)}` };
}

const newLatch = (pressedMs, before) => ({
  pressedMs, confirmedMs: null, sentMs: -Infinity, why: "",
  isSent: false, isAlone: before !== "confirmed", isSeen: false, isKept: false,
});
