// SPDX-License-Identifier: MIT
// A sequence: loaded from a file or typed, played by the station, shown with its progress.

import { byId, text } from "./dom.js";

/** The station accepts no more, bytes. */
const LARGEST_BYTES = 64 * 1024;

const sizeOf = (value) => new TextEncoder().encode(value).length;

async function load(file) {
  if (file.size > LARGEST_BYTES) throw new Error(`${file.name} has ${file.size} bytes; at most ${LARGEST_BYTES} are allowed`);
  byId("sequence-text").value = await file.text();
  byId("sequence-name").value = file.name.slice(0, 80);
}

function state(sequence) {
  if (!sequence) return "No sequence yet";
  const percent = `${Math.floor(100 * sequence.fraction)} %`;
  const reason = sequence.reason ? `: ${sequence.reason}` : "";
  return `${sequence.name}: ${sequence.state}${reason}, ${percent}`;
}

export class Sequence {
  /** @param {function} fail called with why a file was not accepted */
  constructor(fail) {
    byId("sequence-file").addEventListener("change", async (event) => {
      const [file] = event.target.files;
      if (!file) return;
      try {
        await load(file);
      } catch (error) {
        fail(`Load a sequence: ${error.message}`);
      }
    });
  }

  /** What a command to play carries. */
  fields() {
    const value = byId("sequence-text").value;
    if (!value.trim()) throw new Error("the sequence is empty");
    if (sizeOf(value) > LARGEST_BYTES) throw new Error(`the sequence is longer than ${LARGEST_BYTES} bytes`);
    return { text: value, name: byId("sequence-name").value.trim() || "typed" };
  }

  draw({ robot }) {
    text(byId("sequence-state"), state(robot.sequence));
    const progress = byId("sequence-progress");
    const value = robot.sequence?.fraction ?? 0;
    if (progress.value !== value) progress.value = value;
  }
}
