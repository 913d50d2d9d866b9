// SPDX-License-Identifier: MIT
// The page that plays a log. The address names the log and the moment; everything that is shown is of that moment.

import { session } from "./access.js";
import { byId, make, text, visible } from "./dom.js";
import { blurWhatIsClicked } from "./driving.js";
import { Bar, drawMarks } from "./log_bar.js";
import { listenToKeys } from "./log_keys.js";
import { Address, linkTo, parseLink, pathOf } from "./log_link.js";
import { dayOf, EventPanel, lacksOf, moment, StatePanel } from "./log_panels.js";
import { Player, RATES } from "./log_player.js";
import { LogPlots } from "./log_plots.js";
import { LogSource } from "./log_source.js";
import { Scene } from "./scene.js";

const TRAIL_S = 20;
const TRAIL_POINTS = 400;

const link = parseLink(location.hash);
const source = new LogSource(pathOf(link), () => redraw(), (why) => fail(why));
const player = new Player(source, () => redraw());
const address = new Address(link);
let shown = { robot: null, isLive: false };
let panels = null;
let isDrawing = false;

function fail(why) {
  text(byId("log-failure"), why ? `This log cannot be shown: ${why}` : "");
}

function redraw() {
  if (isDrawing) return;
  isDrawing = true;
  requestAnimationFrame(() => {
    isDrawing = false;
    if (panels) draw();
  });
}

function draw() {
  const { view } = source;
  const { t } = player;
  const robot = source.robotAt(t);
  address.moved(t);
  text(byId("play"), player.isPlaying ? "Pause" : "Play");
  text(byId("player-time"), `${moment(t)} of ${moment(view.duration_s)}`);
  panels.events.draw({ t });
  panels.plots.draw(t);
  if (robot === null) {
    panels.bar.draw(moment(t));
    return;
  }
  robot.posture = panels.state.postureAt(robot, t);
  shown = { robot, isLive: robot.is_alive };
  document.body.dataset.cycle = String(robot.cycle);
  panels.bar.draw(panels.state.draw(robot, { view, t }));
  drawGap(view, robot, t);
  panels.scene.draw({ robot });
  panels.scene.retrace(view.robot, source.trailUntil(t, TRAIL_S, TRAIL_POINTS));
}

function drawGap(view, robot, t) {
  const gap = robot.is_alive ? undefined : view.gaps.find(([from, to]) => from <= t && t <= to);
  document.body.dataset.live = String(robot.is_alive);
  visible(byId("scene-gap"), !robot.is_alive);
  text(byId("scene-gap"), gap ? `Not recorded from ${moment(gap[0])} to ${moment(gap[1])}` : "Not recorded");
}

function summary(view) {
  const part = view.part > 1 || !view.has_end ? `, part ${view.part} of the run` : "";
  return `${dayOf(view)}, ${moment(view.duration_s)}, ${view.cycles} cycles${part}`;
}

function show(view) {
  text(byId("log-name"), link.log);
  document.title = `${link.log} - recorded log`;
  text(byId("log-summary"), summary(view));
  text(byId("robot-name"), view.robot);
  const lacks = lacksOf(view);
  visible(byId("log-damage"), lacks.length > 0);
  byId("damage-list").append(...lacks.map((lack) => make("li", "", lack)));
  drawMarks(view);
  const scene = new Scene(() => shown);
  panels = {
    state: new StatePanel(view), events: new EventPanel(view, (t) => player.seek(t)), bar: new Bar(player),
    plots: new LogPlots(source, (t) => player.seek(t)), scene,
  };
  for (const id of ["log", "player"]) visible(byId(id), true);
  player.seek(link.t);
}

function listen() {
  for (const rate of RATES) byId("rate").append(new Option(`${rate} \u00d7`, String(rate), rate === 1, rate === 1));
  byId("rate").addEventListener("change", (event) => { player.rate = Number(event.target.value); });
  const clicks = {
    play: () => player.toggle(), "cycle-back": () => player.step(-1), "cycle-on": () => player.step(1),
    "event-back": () => player.toEvent(-1), "event-on": () => player.toEvent(1), "copy-link": () => void copyLink(),
  };
  for (const [id, act] of Object.entries(clicks)) byId(id).addEventListener("click", act);
  visible(byId("copy-link"), Boolean(navigator.clipboard)); // a browser offers it over TLS and on this machine only
  listenToKeys(player);
  blurWhatIsClicked();
  addEventListener("hashchange", (event) => {
    const next = parseLink(new URL(event.newURL).hash); // by now `address` may have written another
    if (next.log === link.log && next.robot === link.robot) player.seek(next.t);
    else location.reload();
  });
}

async function copyLink() {
  address.settle();
  const where = `${location.origin}${location.pathname}${linkTo(link, player.t)}`;
  try {
    await navigator.clipboard.writeText(where);
    text(byId("announcer"), `The link to ${moment(player.t)} was copied`);
    text(byId("copy-link"), "Copied");
  } catch {
    text(byId("copy-link"), "Not copied: see the address");
  }
}

async function start() {
  const known = await session();
  visible(byId("pages"), Boolean(known?.login || known?.who)); // where one log alone is served there are no others
  if (known?.login) throw new Error("sign in at the base station first, then load this page anew");
  if (!link.log) throw new Error("the address names none; choose one from the list of all logs");
  show(await source.open());
}

start()
  .then(listen)
  .catch((error) => fail(error.message))
  .finally(() => visible(byId("log-waiting"), false));
