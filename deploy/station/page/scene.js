// SPDX-License-Identifier: MIT
// The robot in its surroundings: when it is drawn, from where it is looked at, and how much drawing this screen can take.

import { attribute, byId, text, visible } from "./dom.js";

/** How long after the last picture the next is drawn, ms: 30 a second are enough. */
const PICTURE_MS = 32;
/** Pictures that come further apart, on average, are drawn with fewer dots, ms. */
const SLOW_MS = 45;
const MEASURED = 30;
const LEAST_SHARE = 0.4;
const AZIMUTH_PER_PIXEL = 0.008;
const ELEVATION = { least: 0.08, most: 1.5, perPixel: 0.006 };
const DISTANCE = { least: 0.6, most: 8, perNotch: 1.1 };
const FAR_AHEAD_S = 1;

export class Scene {
  /** @param {function} now what is known now */
  constructor(now) {
    this._now = now;
    this._canvas = byId("scene");
    this._view = { azimuth: -0.75, elevation: 0.3, distance: 1.7, isTop: false };
    this._world = null;
    this._isLoading = false;
    this._hasFailed = false;
    this._share = 1;
    this._apart = [];
    this._lastMs = 0;
    this._seen = new Set();
    this._retraced = null;
    this._listen();
  }

  /** Keep where the robots were, for their trails. */
  add({ robots }) {
    for (const robot of robots) {
      if (robot.is_alive && robot.x !== null) this._world?.pass(robot.robot, robot.x, robot.y);
    }
  }

  /** Have a robot's trail be this, x and y, m: of a log, where any moment may follow any other. */
  retrace(name, points) {
    this._retraced = [name, points];
    this._world?.retrace(name, points);
  }

  /** A robot that never told where it is has no scene; nor has a browser that cannot draw one. */
  draw({ robot }) {
    if (robot.x !== null) this._seen.add(robot.robot);
    const isThere = this._seen.has(robot.robot) && !this._hasFailed;
    visible(byId("scene-panel"), isThere);
    if (isThere && this._world === null && !this._isLoading) void this._load();
  }

  async _load() {
    this._isLoading = true;
    try {
      const { World } = await import("./scene_world.js");
      this._world = new World(this._canvas);
      if (this._retraced) this._world.retrace(...this._retraced);
      requestAnimationFrame((ms) => this._frame(ms));
    } catch {
      this._hasFailed = true; // no WebGL here: the drawing of the tilt remains
    }
  }

  _frame(ms) {
    requestAnimationFrame((next) => this._frame(next));
    const { robot, isLive } = this._now();
    if (ms - this._lastMs < PICTURE_MS || robot === null || robot.x === null || byId("scene-panel").hidden) return;
    this._world.fit(this._share);
    this._world.show(robot, { ms, isLive, aheadS: FAR_AHEAD_S });
    for (const [name, value] of Object.entries(this._world.described)) attribute(this._canvas, `data-${name}`, value);
    if (this._world.render(this._view)) this._measure(ms - this._lastMs);
    else this._apart = [];
    this._lastMs = ms;
  }

  /** Draw fewer dots where pictures come too slowly; what is still is not drawn again. */
  _measure(apartMs) {
    this._apart.push(apartMs);
    if (this._apart.length < MEASURED) return;
    const mean = this._apart.reduce((sum, each) => sum + each, 0) / this._apart.length;
    this._apart = [];
    if (mean > SLOW_MS) this._share = Math.max(0.75 * this._share, LEAST_SHARE);
    attribute(this._canvas, "data-share", this._share.toFixed(2));
    attribute(this._canvas, "data-apart-ms", mean.toFixed(0));
  }

  _listen() {
    const { _canvas: canvas, _view: view } = this;
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      view.azimuth -= AZIMUTH_PER_PIXEL * event.movementX;
      view.elevation = within(view.elevation + ELEVATION.perPixel * event.movementY, ELEVATION);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      view.distance = within(view.distance * DISTANCE.perNotch ** Math.sign(event.deltaY), DISTANCE);
    }, { passive: false });
    byId("scene-top").addEventListener("click", () => {
      view.isTop = !view.isTop;
      attribute(byId("scene-top"), "aria-pressed", String(view.isTop));
      text(byId("scene-top"), view.isTop ? "View from behind" : "View from above");
    });
  }
}

const within = (value, { least, most }) => Math.min(Math.max(value, least), most);
