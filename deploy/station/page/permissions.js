// SPDX-License-Identifier: MIT
// Which commands are allowed now, and why not. The robot and the station decide; this predicts their decision.

const ACTIVE = ["ARMED", "HOLD"];
const PLAYING = ["waiting", "running"];
export const VIEWER = "You are signed in as a viewer: you can watch and stop, but not command";

/** Why no command to the selected robot is allowed, or an empty text. */
export function whyNoCommand({ trouble, hello, robot }) {
  if (!robot) return "No robot is selected";
  if (trouble) return trouble;
  if (hello?.role !== "operator") return VIEWER;
  return "";
}

const whyNotReached = ({ robot }) => (robot.is_alive ? "" : "The robot is lost");

function whyNotOurs({ hello, robot }) {
  if (robot.controller && robot.controller !== hello.who) return `${robot.controller} has control; take it first`;
  return "";
}

const isPlaying = (robot) => PLAYING.includes(robot?.sequence?.state);
const isActive = (robot) => ACTIVE.includes(robot.mode);
const isMine = ({ robot, hello }) => robot.controller === hello.who;

const WHY = {
  arm: (now) => (now.robot.mode === "DISARMED" ? "" : `The robot is in ${now.robot.mode}`),
  disarm: (now) => (isActive(now.robot) ? "" : "The robot is not armed"),
  clear_fault: (now) => (now.robot.mode === "FAULT" ? "" : "There is no fault to clear"),
  stand: () => "",
  sit: () => "",
  take_control: (now) => (isMine(now) ? "You have control" : ""),
  release_control: (now) => (isMine(now) ? "" : "You do not have control"),
  dismiss: (now) => whyNotOurs(now) || whyNotDismissed(now.robot),
  play: (now) => whyNotActive(now) || (isPlaying(now.robot) ? "A sequence is being played" : ""),
  break_off: (now) => (isPlaying(now.robot) ? "" : "No sequence is being played"),
};

function whyNotDismissed(robot) {
  if (robot.is_alive) return "The robot is not lost";
  return robot.stop === "requested" ? "Clear the stop first" : "";
}

function whyNotActive(now) {
  if (!isMine(now)) return "Take control first";
  return isActive(now.robot) ? "" : "Arm the robot first";
}

/** These are between the operators and the station, whatever has become of the robot. */
const STATIONS_OWN = ["take_control", "release_control", "dismiss"];

/** Why this command is not allowed now, or an empty text. */
export function whyNot(act, now) {
  const whyNotHere = STATIONS_OWN.includes(act) ? "" : whyNotReached(now) || whyNotOurs(now);
  return whyNoCommand(now) || whyNotHere || WHY[act](now);
}

/** Why the robot cannot be driven now, or an empty text; driving breaks off a sequence. */
export function whyNoDriving(now) {
  const why = whyNoCommand(now) || whyNotReached(now) || whyNotOurs(now) || whyNotActive(now);
  return why || (now.robot.stop ? "Clear the stop first" : "");
}
