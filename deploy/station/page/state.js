// SPDX-License-Identifier: MIT
// What a robot is doing, in one word and one colour, and the one thing to do next. Green is balancing or ready.

const KINDS = { DISARMED: "disarmed", ARMED: "armed", HOLD: "hold", FAULT: "fault" };
/** Postures that count more than that the motors are live. */
const BY_POSTURE = { FALLEN: "fault", "STANDING UP": "hold", "SITTING DOWN": "hold" };
const ACTIVE = ["ARMED", "HOLD"];

/**
 * What is shown of a robot's state.
 * @returns {{headline: string, mode: string, kind: string}} `headline` is its posture, or empty where it has none or is lost
 */
export function stateOf(robot) {
  if (!robot.is_alive) return { headline: "", mode: "LOST", kind: "lost" };
  const mode = robot.mode || "UNKNOWN";
  const byMode = KINDS[mode] ?? "unknown";
  return { headline: robot.posture, mode, kind: (ACTIVE.includes(mode) && BY_POSTURE[robot.posture]) || byMode };
}

/** The word of a chip: the mode, but of a robot that fell that it did. */
export function wordOf(robot) {
  const { headline, mode, kind } = stateOf(robot);
  return kind === "fault" && headline === "FALLEN" && mode !== "FAULT" ? headline : mode;
}

/** The one thing to do next, as a sentence; empty where nothing is to be done. */
export function nextStep(robot) {
  if (!robot.is_alive) return "Nothing arrives from it: look at its power and its network, or dismiss it.";
  if (robot.mode === "FAULT") return `When the cause is gone, press ${wayBackLabel(robot)}.`;
  if (robot.mode === "DISARMED") return failing(robot) || (robot.can_stand ? "Press Stand up." : "Press Arm.");
  if (robot.can_stand && ["FALLEN", "RESTING"].includes(robot.posture)) return "Press Stand up.";
  if (robot.mode === "HOLD") return "It holds its place until it is driven.";
  return "";
}

/** What the button is called that leads back from a fault. */
export const wayBackLabel = (robot) => (robot.can_stand ? "Clear and stand up" : "Clear and arm");

function failing(robot) {
  const count = Object.values(robot.checklist).filter((report) => report.startsWith("refused")).length;
  if (count === 0) return "";
  return count === 1 ? "One pre-arm check fails: see below." : `${count} pre-arm checks fail: see below.`;
}
