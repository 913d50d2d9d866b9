// SPDX-License-Identifier: MIT
// The pre-arm checks: those that fail first, each with its fix.

import { attribute, byId, keep, make, text } from "./dom.js";
import { words } from "./format.js";

const ORDER = { blocks: 0, warning: 1, ok: 2 };
const WORD = { blocks: "Fails", warning: "Warning", ok: "Passes" };

/** The robot reports `ok: text`, `warning: text; fix` or `refused: text; fix`. */
function read(name, report) {
  const [, head, rest] = /^(ok|warning|refused)(?::\s*|$)(.*)$/s.exec(report) ?? [null, "refused", report];
  const state = head === "refused" ? "blocks" : head;
  const cut = state === "ok" ? -1 : rest.indexOf("; ");
  const found = cut < 0 ? rest : rest.slice(0, cut);
  return { name, state, found, fix: cut < 0 ? "" : rest.slice(cut + 2) };
}

function row() {
  const state = make("span", "chip");
  const name = make("strong");
  const found = make("span", "check-found");
  const fix = make("span", "check-fix");
  return { root: make("li", "", "", state, make("div", "", "", name, found, fix)), state, name, found, fix };
}

function summary(items, mode) {
  if (items.length === 0) return "This robot has no pre-arm checks.";
  if (mode === "ARMED" || mode === "HOLD") return "Armed already: the checks apply the next time.";
  const blocking = items.filter((item) => item.state === "blocks").length;
  if (blocking === 0) return "All checks pass.";
  return blocking === 1 ? "One check fails." : `${blocking} checks fail.`;
}

export class Checklist {
  constructor() {
    this._rows = new Map();
  }

  draw({ robot }) {
    const items = Object.entries(robot.checklist).map(([name, report]) => read(name, report));
    items.sort((a, b) => ORDER[a.state] - ORDER[b.state]);
    text(byId("checklist-summary"), summary(items, robot.mode));
    const rows = keep(byId("checklist"), this._rows, items.map((item) => item.name), row);
    items.forEach((item, index) => {
      const { state, name, found, fix } = rows[index];
      attribute(state, "data-check", item.state);
      text(state, WORD[item.state]);
      text(name, words(item.name));
      text(found, item.found);
      text(fix, item.fix ? `To do: ${item.fix}` : "");
    });
  }
}
