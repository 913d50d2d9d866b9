// SPDX-License-Identifier: MIT
// A gamepad's button stops, wherever the focus is.

import { byId } from "./dom.js";

/** Gamepads tell nothing by themselves: how often they are looked at, ms. */
const LOOK_MS = 20;
/** B, the right one of the four, where the browser knows the lay-out (W3C Gamepad, "standard gamepad"). */
export const STOP_BUTTON = 1;

/**
 * Which of the buttons that stop are held. Where the browser does not know the lay-out any button stops: none of them is
 * known to mean anything else.
 */
function held({ mapping, buttons }) {
  const isStop = (index) => mapping !== "standard" || index === STOP_BUTTON;
  return new Set([...buttons.keys()].filter((index) => isStop(index) && buttons[index].pressed));
}

const gamepads = () => [...(navigator.getGamepads?.() ?? [])].filter(Boolean);

export class GamepadStop {
  /** @param {function} press called once for each press of the button */
  constructor(press) {
    this._press = press;
    this._held = new Map();
    this._timer = null;
    // A browser shows a gamepad only once one of its buttons is pressed: that press counts.
    addEventListener("gamepadconnected", () => this._watch());
    addEventListener("gamepaddisconnected", () => this._watch());
    this._watch();
  }

  _watch() {
    const isThere = gamepads().length > 0;
    if (isThere && this._timer === null) this._timer = setInterval(() => this._look(), LOOK_MS);
    if (!isThere) {
      clearInterval(this._timer);
      this._timer = null;
    }
    this._look();
  }

  _look() {
    // What a gamepad held that is gone is forgotten: the press that shows it again counts.
    const before = this._held;
    this._held = new Map(gamepads().map((gamepad) => [gamepad.index, held(gamepad)]));
    for (const [gamepad, buttons] of this._held) {
      const isPressed = [...buttons].some((button) => !before.get(gamepad)?.has(button));
      if (isPressed && !byId("station").hidden) this._press();
    }
  }
}
