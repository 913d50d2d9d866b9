// What must hold before the robot arms: what blocks stands first, with how to mend it.

import { attribute, byId, keep, make, text } from "./dom.js";
import { words } from "./format.js";

const ORDER = { blocks: 0, warning: 1, ok: 2 };
const WORD = { blocks: "Blocks", warning: "Warning", ok: "OK" };

/** The robot says `ok: text`, `warning: text; mend` or `refused: text; mend`. */
function read(name, said) {
  const [, head, rest] = /^(ok|warning|refused)(?::\s*|$)(.*)$/s.exec(said) ?? [null, "refused", said];
  const state = head === "refused" ? "blocks" : head;
  const cut = state === "ok" ? -1 : rest.indexOf("; ");
  const found = cut < 0 ? rest : rest.slice(0, cut);
  return { name, state, found, mend: cut < 0 ? "" : rest.slice(cut + 2) };
}

function row() {
  const state = make("span", "chip");
  const name = make("strong");
  const found = make("span", "check-found");
  const mend = make("span", "check-mend");
  return { root: make("li", "", "", state, make("div", "", "", name, found, mend)), state, name, found, mend };
}

function summary(items, mode) {
  if (items.length === 0) return "This robot has no checklist.";
  if (mode === "ARMED" || mode === "HOLD") return "Armed already: this counts the next time.";
  const blocking = items.filter((item) => item.state === "blocks").length;
  if (blocking === 0) return "Nothing stands against arming.";
  return blocking === 1 ? "One check stands against arming." : `${blocking} checks stand against arming.`;
}

export class Checklist {
  constructor() {
    this._rows = new Map();
  }

  draw({ robot }) {
    const items = Object.entries(robot.checklist).map(([name, said]) => read(name, said));
    items.sort((a, b) => ORDER[a.state] - ORDER[b.state]);
    text(byId("checklist-summary"), summary(items, robot.mode));
    const rows = keep(byId("checklist"), this._rows, items.map((item) => item.name), row);
    items.forEach((item, index) => {
      const { state, name, found, mend } = rows[index];
      attribute(state, "data-check", item.state);
      text(state, WORD[item.state]);
      text(name, words(item.name));
      text(found, item.found);
      text(mend, item.mend ? `To do: ${item.mend}` : "");
    });
  }
}
