// SPDX-License-Identifier: MIT
// The links to the drives, and the timing of the robot's loop.

import { attribute, byId, keep, make, text, visible } from "./dom.js";
import { words } from "./format.js";

const GOOD = ["active"];
const POOR = ["warning", "passive"];
/** What is shown of a link at once; the rest is behind `More`. */
const FIRST = [
  ["received_per_s", "received", "/s"],
  ["sent_per_s", "sent", "/s"],
  ["errors_per_s", "errors", "/s"],
  ["load_percent", "load", " %"],
];
const PHASE = /^p50 ([\d.]+) us, p99 ([\d.]+) us, p99\.9 ([\d.]+) us, max ([\d.]+) us$/;

function grade(state) {
  if (GOOD.includes(state)) return "ok";
  return POOR.includes(state) ? "warning" : "blocks";
}

function linkCard(name) {
  const state = make("span", "chip");
  const use = make("span", "tag", "in use");
  const first = make("p", "figures");
  const about = make("p", "muted");
  const lost = make("p", "failure");
  const rest = make("dl", "rest");
  const more = make("details", "", "", make("summary", "", `All of ${name}`), rest);
  const head = make("div", "link-head", "", make("h3", "", name), state, use);
  const root = make("div", "link", "", head, about, first, lost, more);
  return { root, state, use, about, first, lost, rest, more, rows: new Map() };
}

function pair(name) {
  const value = make("dd");
  return { root: make("div", "", "", make("dt", "", words(name)), value), value };
}

function drawLink(card, health, isOwner) {
  // What joins two links has no state of its own.
  visible(card.state, "state" in health);
  attribute(card.state, "data-check", grade(health.state));
  text(card.state, health.state ?? "");
  visible(card.use, isOwner);
  const known = FIRST.filter(([key]) => key in health);
  text(card.first, known.map(([key, label, unit]) => `${label} ${health[key]}${unit}`).join("  \u00b7  "));
  text(card.lost, [health.lost, health.reopening].filter(Boolean).join("; "));
  text(card.about, health.description ?? "");
  if (!card.more.open) return;
  const keys = Object.keys(health);
  keep(card.rest, card.rows, keys, pair).forEach(({ value }, index) => text(value, health[keys[index]]));
}

export class Links {
  constructor() {
    this._cards = new Map();
    this._none = make("p", "muted", "The robot reports none.");
    byId("links").after(this._none);
  }

  draw({ robot }) {
    const names = Object.keys(robot.links);
    const cards = keep(byId("links"), this._cards, names, linkCard);
    const owner = robot.links.link?.owner;
    names.forEach((name, index) => drawLink(cards[index], robot.links[name], name === owner));
    visible(this._none, names.length === 0);
  }
}

function phaseRow(name) {
  const cells = Array.from({ length: 4 }, () => make("td"));
  const head = make("th", "", words(name));
  head.scope = "row";
  return { root: make("tr", "", "", head, ...cells), cells };
}

function rate(timing) {
  const parts = [];
  if (timing.rate_hz) parts.push(`${Number(timing.rate_hz).toFixed(2)} Hz of ${timing.wanted_rate_hz ?? "?"} Hz`);
  for (const name of ["late", "overrun", "skipped"]) if (name in timing) parts.push(`${name} ${timing[name]}`);
  return parts.join("  \u00b7  ") || "Not reported yet.";
}

export class Timing {
  constructor() {
    this._rows = new Map();
  }

  draw({ robot }) {
    text(byId("timing-rate"), rate(robot.timing));
    const phases = Object.entries(robot.timing).filter(([, value]) => PHASE.test(value));
    const rows = keep(byId("timing"), this._rows, phases.map(([name]) => name), phaseRow);
    phases.forEach(([, value], index) => {
      PHASE.exec(value).slice(1).forEach((figure, column) => text(rows[index].cells[column], figure));
    });
  }
}
