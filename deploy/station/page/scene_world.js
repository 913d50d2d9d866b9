// SPDX-License-Identifier: MIT
// What is in the scene: floor, trail, the robot, and its ghost where the set-point leads to. Metres; x ahead, y left, z up.

import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, Line, LineBasicMaterial, LineSegments,
  PerspectiveCamera, Scene, Vector3, WebGLRenderer,
} from "./vendor/three.module.min.js";
import { Envelope } from "./scene_envelope.js";
import { RobotShape } from "./scene_robot.js";
import { tiltLimits } from "./tilt_limits.js";

/** Of the floor's lines, m: how far apart, and how many cells either way. */
const CELL = 0.5;
const CELLS = 14;
const TRAIL_POINTS = 2000;
const TRAIL_STEP = 0.02;
/** How soon what is shown has come to what was received, ms: pictures come every 50 ms, and are drawn more often. */
const SMOOTH_MS = 40;
const FAR = 3;

const colour = (name) => new Color(getComputedStyle(document.documentElement).getPropertyValue(name).trim());

function geometryOf(numbers) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(numbers), 3));
  return geometry;
}

/** Each side of each cell is a line of its own: of a long one that begins behind the camera some drivers show nothing. */
function gridPoints() {
  const points = [];
  for (let along = -CELLS; along <= CELLS; along += 1) {
    for (let from = -CELLS; from < CELLS; from += 1) {
      const [at, begin, end] = [along * CELL, from * CELL, (from + 1) * CELL];
      points.push(begin, at, 0, end, at, 0, at, begin, 0, at, end, 0);
    }
  }
  return points;
}

export class World {
  /** @param {HTMLCanvasElement} canvas to draw on; throws where it cannot be drawn on */
  constructor(canvas) {
    this._canvas = canvas;
    this._renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: "low-power" });
    this._scene = new Scene();
    this._camera = new PerspectiveCamera(38, 1, 0.05, 60);
    this._camera.up.set(0, 0, 1);
    this._sun = new DirectionalLight(0xffffff, 2.2);
    this._grid = new LineSegments(geometryOf(gridPoints()), new LineBasicMaterial());
    this._robot = new RobotShape(colour("--accent"), 1);
    this._ghost = new RobotShape(colour("--plot-2"), 0.35);
    this._trails = new Map();
    this._trail = new Line(new BufferGeometry(), new LineBasicMaterial({ color: colour("--plot-1") }));
    this._plan = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: colour("--plot-2") }));
    this._plan.frustumCulled = this._trail.frustumCulled = false;
    this._envelope = new Envelope(colour);
    this._scene.add(new AmbientLight(0xffffff, 1.6), this._sun, this._sun.target, this._grid, this._trail);
    this._scene.add(this._robot.root, this._ghost.root, this._plan, this._envelope.root);
    this._pose = null;
    this._name = "";
    this._recolour();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this._recolour());
  }

  /** A robot was here. */
  pass(name, x, y) {
    if (!this._trails.has(name)) this._trails.set(name, []);
    const points = this._trails.get(name);
    const last = points.at(-1);
    if (last && Math.hypot(x - last[0], y - last[1]) < TRAIL_STEP) return;
    points.push([x, y]);
    if (points.length > TRAIL_POINTS) points.shift();
  }

  /** A robot came this way, and no other. */
  retrace(name, points) {
    const [old, newest] = [this._trails.get(name), points.at(-1)];
    const isSame = old?.length === points.length && old[0]?.[0] === points[0]?.[0] && old.at(-1)?.[0] === newest?.[0];
    if (!isSame) this._trails.set(name, points);
  }

  /** Take the size of the canvas, at a share of this screen's dots. */
  fit(share) {
    const { clientWidth: width, clientHeight: height } = this._canvas;
    const ratio = share * Math.min(devicePixelRatio, 2);
    const key = `${width} ${height} ${ratio}`;
    if (key === this._size || width === 0 || height === 0) return;
    this._size = key;
    this._renderer.setPixelRatio(ratio);
    this._renderer.setSize(width, height, false);
    this._camera.aspect = width / height;
    this._camera.updateProjectionMatrix();
  }

  /** Show a robot as it was received last; what is shown moves there smoothly, and not at all where that is long ago. */
  show(robot, { ms, isLive, aheadS }) {
    const wanted = { x: robot.x, y: robot.y, heading: robot.heading ?? 0, pitch: robot.pitch ?? 0 };
    const isOther = this._name !== robot.robot || this._pose === null;
    if (isOther || Math.hypot(wanted.x - this._pose.x, wanted.y - this._pose.y) > FAR) this._jump(robot, wanted);
    else if (isLive) this._approach(wanted, ms - this._ms);
    this._ms = ms;
    const stands = robot.pitch !== null;
    this._robot.place(this._pose, stands);
    this._placeGhost(robot, isLive, aheadS, stands);
    this._drawTrail(robot.robot);
    this._drawPlan(robot.sequence?.path ?? []);
    this._envelope.place(this._pose, tiltLimits(robot));
  }

  /** What is shown beside the robot, in words: how near its tilt limit is, and how many points its way has. */
  get described() {
    return { tilt: this._envelope.kind, planned: String(this._plan.geometry.attributes.position?.count ?? 0) };
  }

  /** Draw it as it is looked at; false where it looks as before, and was not drawn. */
  render(view) {
    const { x, y, heading, pitch } = this._pose;
    const ghost = this._ghost.root.visible ? [...this._ghost.root.position, this._ghost.root.rotation.z] : [];
    const seen = [x, y, heading, pitch, ...ghost, view.azimuth, view.elevation, view.distance].map((value) => value.toFixed(3));
    const key = [...seen, view.isTop, this._size, this._name, this._drawnTrails, this._theme, this._planned, this._envelope.key].join(" ");
    if (key === this._rendered) return false;
    this._rendered = key;
    this._look(view);
    this._renderer.render(this._scene, this._camera);
    return true;
  }

  /** Look at the robot from behind, or from above. */
  _look({ azimuth, elevation, distance, isTop }) {
    const { x, y, heading } = this._pose;
    const target = new Vector3(x, y, isTop ? 0 : 0.22);
    const way = isTop ? 0 : heading + azimuth + Math.PI;
    const up = isTop ? 1.55 : elevation;
    const reach = isTop ? 2 * distance : distance;
    const flat = reach * Math.cos(up);
    this._camera.position.set(x + flat * Math.cos(way), y + flat * Math.sin(way), target.z + reach * Math.sin(up));
    if (isTop) this._camera.position.x = x - 0.02;
    this._camera.lookAt(target);
    this._sun.position.set(x - 2, y + 3, 5);
    this._sun.target.position.copy(target);
    this._grid.position.set(Math.round(x / CELL) * CELL, Math.round(y / CELL) * CELL, 0);
  }

  _jump(robot, wanted) {
    this._name = robot.robot;
    this._pose = { ...wanted, left: 0, right: 0 };
  }

  _approach(wanted, passedMs) {
    const share = 1 - Math.exp(-Math.max(passedMs, 0) / SMOOTH_MS);
    const pose = this._pose;
    const [dx, dy] = [share * (wanted.x - pose.x), share * (wanted.y - pose.y)];
    const turn = share * Math.atan2(Math.sin(wanted.heading - pose.heading), Math.cos(wanted.heading - pose.heading));
    const [left, right] = this._robot.rolled(dx * Math.cos(pose.heading) + dy * Math.sin(pose.heading), turn);
    this._pose = {
      x: pose.x + dx, y: pose.y + dy, heading: pose.heading + turn, pitch: pose.pitch + share * (wanted.pitch - pose.pitch),
      left: pose.left + left, right: pose.right + right,
    };
  }

  /** Where the robot would be in a while if it did what it is told: an arc. */
  _placeGhost(robot, isLive, aheadS, stands) {
    const [v, w] = [robot.linear_setpoint ?? 0, robot.angular_setpoint ?? 0];
    this._ghost.root.visible = isLive && (v !== 0 || w !== 0);
    if (!this._ghost.root.visible) return;
    const { x, y, heading } = this._pose;
    const middle = heading + (w * aheadS) / 2;
    const chord = w === 0 ? v * aheadS : ((2 * v) / w) * Math.sin((w * aheadS) / 2);
    const there = { x: x + chord * Math.cos(middle), y: y + chord * Math.sin(middle), heading: heading + w * aheadS };
    this._ghost.place({ ...there, pitch: 0, left: 0, right: 0 }, stands);
  }

  _drawTrail(name) {
    const points = this._trails.get(name) ?? [];
    if (this._drawn === points && this._drawnCount === points.length && points.length < TRAIL_POINTS) return;
    [this._drawn, this._drawnCount] = [points, points.length];
    this._drawnTrails = (this._drawnTrails ?? 0) + 1;
    this._trail.geometry.dispose();
    this._trail.geometry = geometryOf(points.flatMap(([x, y]) => [x, y, 0.003]));
  }

  /** Where a sequence leads, dashed: every second piece of the line is drawn. */
  _drawPlan(path) {
    const planned = path.length > 1 ? `${path.length} ${path[0]} ${path.at(-1)}` : "";
    if (planned === (this._planned ?? "")) return;
    this._planned = planned;
    this._plan.geometry.dispose();
    const pieces = path.slice(0, path.length - (path.length % 2));
    this._plan.geometry = geometryOf(pieces.flatMap(([x, y]) => [x, y, 0.004]));
  }

  _recolour() {
    this._theme = (this._theme ?? 0) + 1;
    this._renderer.setClearColor(colour("--sunk"));
    this._grid.material.color = colour("--edge");
    this._trail.material.color = colour("--plot-1");
    this._plan.material.color = colour("--plot-2");
    this._envelope.recolour();
    this._robot.recolour(colour("--accent"), colour("--text"));
    this._ghost.recolour(colour("--plot-2"), colour("--plot-2"));
  }
}
