// SPDX-License-Identifier: MIT
// The keys that drive and command a robot: one table for this page and for the terminal (hil/play/keys.py has it too).

import { byId } from "./dom.js";

/** What it does (a command, a trial or a way to drive), its keys, and its words; a letter is the key that types it. */
export const KEYS = [
  ["ahead", ["ArrowUp", "w"], "ahead"],
  ["back", ["ArrowDown", "s"], "back"],
  ["left", ["ArrowLeft", "a"], "left"],
  ["right", ["ArrowRight", "d"], "right"],
  ["rest", ["x"], "rest"],
  ["stop", ["Escape", "Space"], "STOP"],
  ["take_control", ["t"], "take control"],
  ["arm", ["m"], "arm"],
  ["disarm", ["n"], "disarm"],
  ["clear_fault", ["c"], "clear fault"],
  ["stand", ["u"], "stand up"],
  ["sit", ["j"], "sit down"],
  ["push", ["p"], "push"],
  ["cut", ["b"], "cut the bus"],
  ["recover", ["r"], "repair"],
  ["quit", ["q"], "quit"],
];
const MARKS = { ArrowUp: "\u2191", ArrowDown: "\u2193", ArrowLeft: "\u2190", ArrowRight: "\u2192", Escape: "Esc" };
const ACTS = new Map(KEYS.flatMap(([act, keys]) => keys.map((key) => [key, act])));

const isLetter = (key) => /^[a-z]$/.test(key);

/** A key as the table names it: the letter that it types; where that is none of the Latin alphabet, the one at its place. */
export function nameOf({ key = "", code = "" }) {
  if (key === " ") return "Space";
  const letter = key.toLowerCase();
  if (isLetter(letter)) return letter;
  const place = /^Key([A-Z])$/.exec(code);
  return place && [...key].length === 1 ? place[1].toLowerCase() : key;
}

/** What a key does; undefined for nothing. Letters do nothing while the operator has switched them off. */
export function actOf(event) {
  const name = nameOf(event);
  return isLetter(name) && !byId("letter-keys").checked ? undefined : ACTS.get(name);
}

/** How the keys of an act are called on the screen. */
export function marksOf(act) {
  const [, keys] = KEYS.find(([each]) => each === act) ?? [act, []];
  return keys.map((key) => MARKS[key] ?? (isLetter(key) ? key.toUpperCase() : key));
}
