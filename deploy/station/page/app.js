// SPDX-License-Identifier: MIT
// The page of the base station. The station's messages arrive here, and are drawn at most once per frame.

import { LoginForm, session, signOut } from "./access.js";
import { Checklist } from "./checklist.js";
import { Commands } from "./commands.js";
import { Connection } from "./connection.js";
import { attribute, byId, text, visible } from "./dom.js";
import { Driving } from "./driving.js";
import { EventLog } from "./events.js";
import { figure } from "./format.js";
import { Freshness } from "./freshness.js";
import { GamepadStop } from "./gamepad.js";
import { Links, Timing } from "./health.js";
import { Joystick } from "./joystick.js";
import { Keyboard } from "./keyboard.js";
import { Overview } from "./overview.js";
import { whyNoDriving } from "./permissions.js";
import { Plots } from "./plots.js";
import { Announcer, RobotList } from "./robots.js";
import { Scene } from "./scene.js";
import { Sequence } from "./sequence.js";
import { Stop } from "./stop.js";
import { Trials } from "./trials.js";
import { WayBack } from "./way_back.js";

/** Ages grow while nothing comes, so the page is drawn this often at least, ms. */
const DRAW_MS = 100;

let hello = null;
let robots = [];
let selected = decodeURIComponent(location.hash.slice(1));
let isDrawing = false;

const connection = new Connection(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`, {
  message: (kind, fields) => receive[kind]?.(fields),
  change: changed,
  closed: () => void closed(),
});
const commands = new Commands(connection, now, { play: () => sequence.fields() });
const driving = new Driving(connection, {
  now, why: whyNoDriving, speed: () => Number(byId("speed").value) / 100, changed: redraw,
});
new Joystick(driving, () => commands.fail(`Drive: ${whyNoDriving(now())}`));
const stop = new Stop(commands, now, () => driving.end());
new GamepadStop(() => stop.pressSelected(performance.now()));
const login = new LoginForm(() => void start());
const [plots, sequence, events, announcer] = [new Plots(), new Sequence((why) => commands.fail(why)), new EventLog(), new Announcer()];
const list = new RobotList(choose);
const scene = new Scene(now);
const trials = new Trials(commands, now);
const freshness = new Freshness();
const panels = [
  new Overview(), commands, plots, new Checklist(), new Links(), new Timing(), sequence, scene, trials,
  new WayBack(commands, now), new Keyboard(now, commands, trials, () => driving.end()),
];

/** What is known now; every panel draws from it. */
function now() {
  const age = connection.age(performance.now());
  const robot = robots.find((each) => each.robot === selected) ?? null;
  return {
    hello, robots, robot, age,
    since: age ?? 0, // what has to be added to the ages in the picture, s
    isFresh: connection.isFresh,
    trouble: connection.trouble,
    isLive: connection.isFresh && robot !== null && robot.is_alive,
  };
}

const receive = {
  hello: (fields) => {
    hello = fields;
    text(byId("who"), `${hello.who}, ${hello.role}`);
    stop.reconnected(robots);
    redraw();
  },
  fleet: (fields) => {
    robots = fields.robots;
    // The selection never moves by itself: STOP goes to the robot that the operator looks at.
    selected ||= robots[0]?.robot ?? "";
    plots.add(fields);
    scene.add(fields);
    announcer.update(robots);
    stop.update(robots);
    commands.update(now());
    driving.check();
    redraw();
  },
  event: (fields) => {
    events.add(fields);
    redraw();
  },
  reply: (fields) => {
    commands.reply(fields);
    redraw();
  },
};

function changed(isFresh) {
  driving.check();
  commands.update(now());
  text(byId("alarm"), connection.trouble);
  text(byId("announcer"), isFresh ? "Connected to the base station" : "");
  redraw();
}

async function closed() {
  driving.end();
  commands.lost();
  stop.lost();
  redraw();
  const known = await session();
  if (known?.login) showLogin();
}

function choose(namespace) {
  if (namespace !== selected) driving.end();
  selected = namespace;
  history.replaceState(null, "", `#${encodeURIComponent(namespace)}`);
  redraw();
}

function redraw() {
  if (isDrawing) return;
  isDrawing = true;
  requestAnimationFrame(() => {
    isDrawing = false;
    draw(now());
  });
}

function draw(seen) {
  const { robot } = seen;
  freshness.draw(seen, !byId("station").hidden);
  visible(byId("robot"), robot !== null);
  attribute(byId("robot"), "data-live", String(seen.isLive));
  list.draw(seen, selected);
  stop.draw(seen);
  events.draw();
  if (robot === null) return;
  for (const panel of panels) panel.draw(seen);
  drawDriving(seen);
  const bundle = byId("bundle-link");
  visible(bundle, hello?.role === "operator");
  attribute(bundle, "href", `/robots/${encodeURIComponent(robot.robot)}/bundle`);
}

function drawDriving(seen) {
  const why = whyNoDriving(seen);
  text(byId("drive-reason"), why);
  visible(byId("drive-reason"), why !== "");
  attribute(byId("joystick"), "aria-disabled", why ? "true" : null);
  attribute(byId("joystick"), "data-active", driving.isActive ? "true" : null);
  const share = Number(byId("speed").value) / 100;
  const limits = hello ? `${figure(share * hello.max_linear, 2, "m/s")}, ${figure(share * hello.max_angular, 2, "rad/s")}` : "";
  text(byId("speed-text"), limits);
  attribute(byId("speed"), "aria-valuetext", limits);
  const { linear, angular } = driving.speeds;
  const requested = `Requesting ${figure(linear, 2, "m/s")}, ${figure(angular, 2, "rad/s")}`;
  text(byId("drive-now"), driving.isActive ? requested : "Not driving");
}

function showLogin() {
  connection.close();
  commands.lost();
  stop.lost();
  showStation(false);
  login.show();
}

function showStation(isShown) {
  for (const id of ["station", "bar", "change-user"]) visible(byId(id), isShown);
  if (!isShown) visible(byId("stale"), false);
}

async function start() {
  const known = await session();
  if (known?.login) return showLogin();
  login.hide();
  showStation(true);
  connection.open();
  return redraw();
}

byId("speed").addEventListener("input", redraw);
// Else the arrow keys would go on moving the slider instead of the robot.
byId("speed").addEventListener("pointerup", () => byId("speed").blur());
byId("change-user").addEventListener("click", async () => {
  driving.end();
  await signOut();
  showLogin();
});
setInterval(redraw, DRAW_MS);
void start();
