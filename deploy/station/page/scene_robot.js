// SPDX-License-Identifier: MIT
// The shape of a robot: two wheels, and a body that leans; or the plate of a cart. In the measures of the packaged robots.

import {
  BoxGeometry, Color, CylinderGeometry, Group, Mesh, MeshStandardMaterial, TorusGeometry,
} from "./vendor/three.module.min.js";

/** Of the packaged segway, m: node/models/segway_parameters.py. A robot does not report its own. */
export const RADIUS = 0.05;
const TRACK = 0.3048;
const WIDTH = 0.035;
const HEIGHT = 0.56;
const DEPTH = 0.09;

export class RobotShape {
  /** @param {Color} body its colour @param {number} opacity 1 for a robot, less for a ghost */
  constructor(body, opacity) {
    const options = { transparent: opacity < 1, opacity, roughness: 0.7 };
    this._body = new MeshStandardMaterial({ color: body, ...options });
    this._dark = new MeshStandardMaterial({ color: new Color(0x222222), ...options });
    this.root = new Group();
    this.root.rotation.order = "ZYX";
    this._lean = new Group();
    this._lean.position.z = RADIUS;
    this._tall = this._column();
    this._plate = this._flat();
    this._lean.add(this._tall, this._plate);
    this._left = this._wheel(TRACK / 2);
    this._right = this._wheel(-TRACK / 2);
    this.root.add(this._lean, this._left, this._right);
  }

  /** How far the wheels turn, rad, where the robot goes on by so much, m, and turns by so much, rad. */
  rolled(ahead, turn) {
    return [(ahead - (turn * TRACK) / 2) / RADIUS, (ahead + (turn * TRACK) / 2) / RADIUS];
  }

  /** Put it in its place; one that `stands` leans, nose down positive (REP-103). */
  place({ x, y, heading, pitch, left, right }, stands) {
    this.root.position.set(x, y, 0);
    this.root.rotation.z = heading;
    this._lean.rotation.y = stands ? pitch : 0;
    this._tall.visible = stands;
    this._plate.visible = !stands;
    this._left.rotation.y = left;
    this._right.rotation.y = right;
  }

  recolour(body, dark) {
    this._body.color = body;
    this._dark.color = dark;
  }

  _column() {
    const group = new Group();
    const base = box(DEPTH, 0.8 * TRACK, 0.09, this._dark);
    base.position.z = 0.03;
    const mast = box(0.5 * DEPTH, 0.55 * TRACK, 0.72 * HEIGHT, this._body);
    mast.position.z = 0.45 * HEIGHT;
    const head = box(DEPTH, 0.75 * TRACK, 0.12, this._body);
    head.position.z = HEIGHT - 0.06;
    const face = box(0.012, 0.5 * TRACK, 0.06, this._dark);
    face.position.set(DEPTH / 2, 0, HEIGHT - 0.06);
    group.add(base, mast, head, face);
    return group;
  }

  _flat() {
    const group = new Group();
    const plate = box(0.28, 0.8 * TRACK, 0.03, this._body);
    plate.position.set(-0.08, 0, 0.03);
    const nose = box(0.05, 0.25 * TRACK, 0.05, this._dark);
    nose.position.set(0.06, 0, 0.06);
    group.add(plate, nose);
    return group;
  }

  _wheel(y) {
    const group = new Group();
    group.position.set(0, y, RADIUS);
    const tyre = new Mesh(new TorusGeometry(RADIUS - 0.011, 0.011, 10, 28), this._dark);
    tyre.rotation.x = Math.PI / 2;
    tyre.scale.z = WIDTH / 0.022;
    const hub = new Mesh(new CylinderGeometry(0.014, 0.014, WIDTH, 12), this._body);
    const spokes = [0, 1, 2].map((index) => {
      const spoke = box(0.008, 0.6 * WIDTH, 2 * RADIUS - 0.03, this._body);
      spoke.rotation.y = (index * Math.PI) / 3;
      return spoke;
    });
    group.add(tyre, hub, ...spokes);
    return group;
  }
}

const box = (x, y, z, material) => new Mesh(new BoxGeometry(x, y, z), material);
