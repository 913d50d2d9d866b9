// SPDX-License-Identifier: MIT
// The tilts that a robot may have, as a fan around its axle: its edges are the limits of its safety, a bead is where it is.

import {
  Color, DoubleSide, Group, Mesh, MeshBasicMaterial, RingGeometry, SphereGeometry,
} from "./vendor/three.module.min.js";
import { RADIUS } from "./scene_robot.js";

/** Of the fan, m: beyond the head of the packaged robots, so that it is seen around it. */
const INNER = 0.64;
const OUTER = 0.68;
const EDGE = 0.012;
const BEAD = 0.028;
const UP = Math.PI / 2;
/** Which colour of the theme says how near it is; the words beside the scene say it too. */
const COLOURS = { ok: "--ok", near: "--warning", beyond: "--danger", off: "--muted" };

/** A part of a ring between two tilts, nose down positive; x ahead, y up, before it is set upright. */
const ring = (inner, outer, from, to) => new RingGeometry(inner, outer, 32, 1, UP - to, to - from);

export class Envelope {
  /** @param {function} colour gives a colour of the theme by its name */
  constructor(colour) {
    this._colour = colour;
    this._materials = Object.fromEntries(["free", "beyond", "edge", "bead"].map((name) => [
      name, new MeshBasicMaterial({ color: new Color(), side: DoubleSide, transparent: true, opacity: name === "beyond" ? 0.45 : 0.85 }),
    ]));
    this._fan = new Group();
    this._fan.rotation.x = UP;
    this._bead = new Mesh(new SphereGeometry(BEAD, 14, 10), this._materials.bead);
    this._fan.add(this._bead);
    this.root = new Group();
    this.root.add(this._fan);
    this.root.visible = false;
    this._shape = "";
    this._kind = "";
  }

  /** What of it has changed changes this. */
  get key() {
    return this.root.visible ? `${this._shape} ${this._kind}` : "";
  }

  /** How near the limit is; empty where nothing is shown. */
  get kind() {
    return this.root.visible ? this._kind : "";
  }

  /** Put it around a robot that is there; nothing is shown of one that has no limits. */
  place({ x, y, heading, pitch }, limits) {
    this.root.visible = limits !== null;
    if (limits === null) return;
    this._build(limits);
    this.root.position.set(x, y, RADIUS);
    this.root.rotation.z = heading;
    const middle = (INNER + OUTER) / 2;
    this._bead.position.set(middle * Math.sin(pitch), middle * Math.cos(pitch), 0);
    if (limits.kind !== this._kind) this._paint(limits.kind);
  }

  recolour() {
    this._paint(this._kind || "off");
  }

  _build({ first, last }) {
    const shape = `${first} ${last}`;
    if (shape === this._shape) return;
    this._shape = shape;
    for (const child of this._fan.children.filter((each) => each !== this._bead)) {
      this._fan.remove(child);
      child.geometry.dispose();
    }
    const { free, beyond, edge } = this._materials;
    this._fan.add(new Mesh(ring(INNER, OUTER, -first, first), free));
    const sides = last > first ? [[-last, -first], [first, last]] : [];
    for (const [from, to] of sides) this._fan.add(new Mesh(ring(INNER, OUTER, from, to), beyond));
    for (const side of [-1, 1]) {
      const [from, to] = [side * last - EDGE, side * last + EDGE];
      this._fan.add(new Mesh(ring(0.2, OUTER + 0.03, from, to), edge));
    }
  }

  _paint(kind) {
    this._kind = kind;
    const { free, beyond, edge, bead } = this._materials;
    free.color = this._colour(kind === "off" ? "--muted" : "--ok");
    beyond.color = this._colour(kind === "off" ? "--muted" : "--warning");
    edge.color = this._colour(kind === "off" ? "--muted" : "--danger");
    bead.color = this._colour(COLOURS[kind]);
  }
}
