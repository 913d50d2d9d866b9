// SPDX-License-Identifier: MIT
// Driving by hand is dead-man: whatever ends the operator's hold sends zero at once, and then nothing more.

import { actOf } from "./keys.js";

const LINEAR = { ahead: 1, back: -1 };
const ANGULAR = { left: 1, right: -1 };
const MODIFIERS = ["Control", "Alt", "Meta"];
const NOT_TYPED_IN = ["range", "button", "submit", "reset", "checkbox", "radio", "file", "color"];

/** Whether keys typed there are text. */
export function isTextField(target) {
  if (!(target instanceof HTMLElement)) return false;
  if (target.isContentEditable || target.tagName === "TEXTAREA") return true;
  return target.tagName === "INPUT" && !NOT_TYPED_IN.includes(target.type);
}

/** What Space presses; buttons count also where they are disabled: they show why then. */
const PRESSED = "button, summary, input[type=checkbox], input[type=file]";

/** Whether Space has a use of its own there: it types, or presses what has the focus. */
export const takesSpace = (target) => isTextField(target) || (target instanceof Element && target.matches(PRESSED));

/** Whether a pointer clicked; a keyboard's click, and a screen reader's, counts none. Not all browsers name the pointer. */
export const isByPointer = ({ pointerType, detail }) => Boolean(pointerType) || detail > 0;

/** What a pointer pressed keeps no focus: the next Space, hit in haste, is to stop, and not to press that again. */
export function blurWhatIsClicked() {
  addEventListener("click", (event) => {
    if (!isByPointer(event) || !(event.target instanceof Element)) return; // there the focus stays
    const clicked = event.target.closest(`${PRESSED}, label`);
    const pressed = clicked?.control ?? clicked;
    if (!pressed?.matches(PRESSED)) return;
    pressed.blur();
    if (pressed !== clicked) setTimeout(() => pressed.blur()); // a label hands the focus on after its click
  });
}

/** Whether an element has a use of its own for the key: a text field for each, the slider for the arrows. */
const takes = (target, code) => isTextField(target) || (target.type === "range" && code.startsWith("Arrow"));

/** What is held, as shares of the fastest: -1 to 1. */
function requestOf(acts, lever) {
  const sum = (table) => acts.reduce((total, act) => total + (table[act] ?? 0), 0);
  const limit = (value) => Math.max(-1, Math.min(1, value));
  return { linear: limit(sum(LINEAR) + lever.linear), angular: limit(sum(ANGULAR) + lever.angular) };
}

const REST = { linear: 0, angular: 0 };

export class Driving {
  /**
   * @param {object} connection to the station
   * @param {{now: function, why: function, speed: function, changed: function}} context `now()` what is known, `why(now)` why
   *   not, `speed()` the share of the fastest, `changed()` when there is something to draw
   */
  constructor(connection, context) {
    this._connection = connection;
    this._context = context;
    this._keys = new Map(); // what each key that is held asks for, by its place: the letter that it types may change
    this._lever = REST;
    this._robot = null;
    this.ended = () => {};
    this._listen();
  }

  get isActive() {
    return this._robot !== null;
  }

  /** The speeds that are requested now: m/s, rad/s. */
  get speeds() {
    const { hello } = this._context.now();
    const request = requestOf([...this._keys.values()], this._lever);
    const share = this._context.speed();
    return { linear: request.linear * share * (hello?.max_linear ?? 0), angular: request.angular * share * (hello?.max_angular ?? 0) };
  }

  /** Move the joystick: shares of -1 to 1. True where that drives. */
  lean(linear, angular) {
    this._lever = { linear, angular };
    return this._hold();
  }

  /** End driving where it is no longer allowed: after a picture arrived, and after the connection changed. */
  check() {
    if (!this.isActive) return;
    const now = this._context.now();
    if (now.robot?.robot !== this._robot || this._context.why(now)) this.end();
  }

  /** Zero, at once, and nothing after it; what is still held counts no more until it is pressed anew. */
  end() {
    this._keys.clear();
    this._lever = REST;
    if (!this.isActive) return;
    const robot = this._robot;
    this._robot = null;
    clearInterval(this._timer);
    this._connection.send("drive", { robot, ...REST });
    this.ended();
    this._context.changed();
  }

  _hold() {
    if (this.isActive) return true;
    const now = this._context.now();
    if (this._context.why(now)) {
      this._keys.clear();
      this._lever = REST;
      return false;
    }
    this._robot = now.robot.robot;
    this._timer = setInterval(() => this._renew(), now.hello.drive_period_s * 1e3);
    this._renew();
    return true;
  }

  _renew() {
    this.check();
    if (!this.isActive) return;
    if (!this._connection.isCongested) this._connection.send("drive", { robot: this._robot, ...this.speeds });
    this._context.changed();
  }

  _press(event) {
    if (MODIFIERS.includes(event.key)) return this.end(); // the release of a key may be lost beside one of these
    const act = actOf(event);
    if (!isDriving(act) || event.ctrlKey || event.altKey || event.metaKey || takes(event.target, event.code)) return undefined;
    if (event.repeat) return this.isActive && event.preventDefault();
    this._keys.set(event.code, act);
    const wasActive = this.isActive;
    if (!this._hold()) return undefined;
    event.preventDefault(); // the page does not scroll while it drives
    return wasActive && this._renew();
  }

  _release(event) {
    if (!this._keys.delete(event.code)) return;
    const isLeaning = this._lever.linear !== 0 || this._lever.angular !== 0;
    if (this._keys.size > 0 || isLeaning) this._renew();
    else this.end();
  }

  _listen() {
    const end = () => this.end();
    addEventListener("keydown", (event) => this._press(event));
    addEventListener("keyup", (event) => this._release(event));
    addEventListener("blur", (event) => event.target === window && end());
    addEventListener("pagehide", end);
    addEventListener("contextmenu", end);
    document.addEventListener("visibilitychange", () => document.hidden && end());
    document.addEventListener("freeze", end);
    document.addEventListener("focusin", (event) => isTextField(event.target) && end());
  }
}

const isDriving = (act) => act in LINEAR || act in ANGULAR;
