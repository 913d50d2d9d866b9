// SPDX-License-Identifier: MIT
// Commands: each waits for its reply where it can be seen, and a failure gives its reason.

import { attribute, byId, make, text, visible } from "./dom.js";
import { marksOf } from "./keys.js";
import { whyNoCommand, whyNot } from "./permissions.js";
import { titleOf } from "./robots.js";

/** The station itself gives up on a robot after 2 s, on a trial after 30 s; what takes longer was lost on the way, ms. */
const ANSWER_MS = 5000;
const TRIAL_MS = 35000;

export const LABELS = {
  arm: "Arm",
  disarm: "Disarm",
  clear_fault: "Clear fault",
  stand: "Stand up",
  sit: "Sit down",
  take_control: "Take control",
  release_control: "Release control",
  dismiss: "Dismiss",
  play: "Play",
  break_off: "Break off",
  stop: "Stop",
  try: "Try",
  cancel_stop: "Take back the stop of",
};
const BUTTONS = {
  "command-buttons": ["take_control", "release_control", "arm", "disarm", "clear_fault", "stand", "sit", "dismiss"],
  "sequence-buttons": ["play", "break_off"],
};
/** Those that only some robots have: by act, whether this one does. */
const HAS = { stand: (robot) => robot.can_stand, sit: (robot) => robot.can_stand, dismiss: (robot) => !robot.is_alive };

/** Sends commands and follows them to their replies. */
export class Commands {
  /**
   * @param {object} connection to the station
   * @param {function} now what is known now
   * @param {Record<string, function>} fill by act, what else the command carries; it may throw an Error with the reason
   */
  constructor(connection, now, fill) {
    this._connection = connection;
    this._now = now;
    this._fill = fill;
    this._pending = new Map();
    this._done = null;
    this._buttons = Object.entries(BUTTONS).flatMap(([place, acts]) => acts.map((act) => this._button(place, act)));
  }

  /** Send a command to the robot; `answered(isAccepted, text)` is called once. False where it could not be sent. */
  send(act, robot, fields = {}, answered = null) {
    const id = this._connection.send("command", { robot: robot.robot, act, ...fields });
    if (id === null) return false;
    const label = `${LABELS[act]} ${titleOf(robot)}`;
    const unanswered = { id, is_accepted: false, text: "the base station did not answer" };
    const timer = setTimeout(() => this.reply(unanswered), act === "try" ? TRIAL_MS : ANSWER_MS);
    this._pending.set(id, { act, robot: robot.robot, label, answered, timer });
    this._show(`${label}: requested`, "");
    return true;
  }

  /** Take a reply; one that is no longer waited for is ignored. */
  reply({ id, is_accepted: isAccepted, text: answer }) {
    const pending = this._pending.get(id);
    if (!pending) return;
    clearTimeout(pending.timer);
    this._pending.delete(id);
    pending.answered?.(isAccepted, answer);
    if (isAccepted) this._succeed(pending, answer || "done");
    else this._show("", `${pending.label} failed: ${answer || "no reason was given"}`);
  }

  /** The socket closed: what was not answered never will be, and what was done may be undone meanwhile. */
  lost() {
    this._forget();
    for (const id of [...this._pending.keys()]) {
      this.reply({ id, is_accepted: false, text: "the connection broke before an answer came" });
    }
  }

  /** Show why something was not even sent. */
  fail(why) {
    this._show("", why);
  }

  /** Follow who has control, and whether what is shown is still true: what a command came to counts no longer than that. */
  update({ robots, hello, isFresh }) {
    if (this._done === null) return;
    const { act, robot: namespace } = this._done;
    const controller = robots.find((robot) => robot.robot === namespace)?.controller ?? "";
    const isOurs = controller === hello?.who;
    const isOver = act === "release_control" ? !isOurs && controller !== "" : this._done.wasOurs && !isOurs;
    this._done.wasOurs ||= isOurs;
    if (isOver || !isFresh) this._forget();
  }

  draw(now) {
    const why = whyNoCommand(now);
    text(byId("commands-reason"), why);
    visible(byId("commands-reason"), why !== "");
    for (const { act, button } of this._buttons) {
      const isWaiting = this._isWaiting(act, now.robot);
      visible(button, this.has(act, now));
      attribute(button, "aria-disabled", isWaiting || whyNot(act, now) ? "true" : null);
      attribute(button, "aria-busy", isWaiting ? "true" : null);
      attribute(button, "title", whyNot(act, now) || null);
    }
  }

  /** Whether there is a button for this now. */
  has(act, { robot }) {
    return this._buttons.some((button) => button.act === act) && (HAS[act]?.(robot) ?? true);
  }

  _isWaiting(act, robot) {
    return [...this._pending.values()].some((pending) => pending.act === act && pending.robot === robot.robot);
  }

  _button(place, act) {
    const button = make("button", act === "arm" || act === "play" ? "primary" : "", LABELS[act]);
    button.type = "button";
    attribute(button, "data-act", act);
    attribute(button, "aria-keyshortcuts", marksOf(act).join(" ") || null);
    button.addEventListener("click", () => this.press(act));
    byId(place).append(button);
    return { act, button };
  }

  /** Do what a button does; one that is disabled keeps the focus and shows why. */
  press(act) {
    const now = this._now();
    const why = whyNot(act, now);
    if (why) return this.fail(`${LABELS[act]}: ${why}`);
    if (this._isWaiting(act, now.robot)) return undefined;
    try {
      const fields = this._fill[act]?.() ?? {};
      if (!this.send(act, now.robot, fields)) this.fail(`${LABELS[act]}: no connection to the base station`);
    } catch (error) {
      this.fail(`${LABELS[act]}: ${error.message}`);
    }
    return undefined;
  }

  _succeed({ act, robot, label }, answer) {
    this._show(`${label}: ${answer}`, "");
    this._done = { act, robot, wasOurs: false };
  }

  /** What was done is no longer shown. */
  _forget() {
    if (this._done !== null) text(byId("command-state"), "");
    this._done = null;
  }

  _show(state, failure) {
    this._done = null;
    text(byId("command-state"), state);
    text(byId("command-failure"), failure);
  }
}
