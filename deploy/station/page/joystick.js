// SPDX-License-Identifier: MIT
// The joystick for touch and mouse: it drives as long as one pointer holds it.

import { byId } from "./dom.js";

/** Leaning less than this share is rest: no hand is that still. */
const DEAD_ZONE = 0.06;

export class Joystick {
  /** @param {object} driving what it drives @param {function} refused called when it is grasped and does not drive */
  constructor(driving, refused) {
    this._pad = byId("joystick");
    this._knob = byId("knob");
    this._driving = driving;
    this._refused = refused;
    this._pointer = null;
    driving.ended = () => this._letGo();
    this._pad.addEventListener("pointerdown", (event) => this._grasp(event));
    this._pad.addEventListener("pointermove", (event) => this._holds(event) && this._lean(event));
    for (const name of ["pointerup", "pointercancel", "pointerleave", "lostpointercapture"]) {
      this._pad.addEventListener(name, (event) => this._holds(event) && this._driving.end());
    }
  }

  _holds(event) {
    return this._pointer !== null && event.pointerId === this._pointer;
  }

  _grasp(event) {
    if (this._pointer !== null || event.button !== 0) return;
    event.preventDefault();
    // Whoever grasps the joystick no longer types: the field would take the keys.
    if (document.activeElement instanceof HTMLElement) document.activeElement.blur();
    this._pointer = event.pointerId;
    this._pad.setPointerCapture(event.pointerId);
    this._lean(event);
  }

  _lean(event) {
    const box = this._pad.getBoundingClientRect();
    const reach = box.width / 2;
    const x = (event.clientX - box.left - reach) / reach;
    const y = (event.clientY - box.top - reach) / reach;
    const length = Math.hypot(x, y);
    const scale = length < DEAD_ZONE ? 0 : 1 / Math.max(1, length);
    // To the left is counter-clockwise, which is positive.
    if (!this._driving.lean(-y * scale, -x * scale)) {
      this._letGo();
      this._refused();
      return;
    }
    this._show(x * scale, y * scale);
  }

  _letGo() {
    const pointer = this._pointer;
    this._pointer = null;
    if (pointer !== null && this._pad.hasPointerCapture(pointer)) this._pad.releasePointerCapture(pointer);
    this._show(0, 0);
  }

  _show(x, y) {
    const reach = (this._pad.clientWidth - this._knob.offsetWidth) / 2;
    this._knob.style.transform = `translate(${(x * reach).toFixed(1)}px, ${(y * reach).toFixed(1)}px)`;
  }
}
