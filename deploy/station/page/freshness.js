// SPDX-License-Identifier: MIT
// How old what is shown is: in the head of the page, and across it where that is too old to act on.

import { attribute, byId, text, visible } from "./dom.js";
import { duration, figure, timeOfDay } from "./format.js";

/** The age goes up and down with every picture; what is shown is the most of so long, ms. */
const SHOWN_MS = 1000;

/** Draws both. */
export class Freshness {
  constructor() {
    this._most = 0;
    this._nextMs = 0;
  }

  draw({ isFresh, trouble, age }, isShown) {
    visible(byId("stale"), isShown && !isFresh);
    text(byId("stale-why"), trouble);
    text(byId("stale-age"), age === null ? "- nothing was received yet" : `- what you see is ${duration(age)} old, of ${timeOfDay(age)}`);
    attribute(document.body, "data-fresh", String(isFresh));
    visible(byId("picture-age"), isFresh);
    if (isFresh) this._drawAge(age);
    else [this._most, this._nextMs] = [0, 0];
  }

  _drawAge(age) {
    this._most = Math.max(this._most, age);
    if (performance.now() < this._nextMs) return;
    text(byId("picture-age"), `Pictures ${figure(1e3 * this._most, 0)} ms old`);
    this._nextMs = performance.now() + SHOWN_MS;
    this._most = 0;
  }
}
