// SPDX-License-Identifier: MIT
// How near a robot is to the tilt at which its safety takes the torque, or counts it as fallen.

/** From this share of the nearer limit on it is near. */
const NEAR = 0.7;
const ACTIVE = ["ARMED", "HOLD"];
/** In these postures it leans on its bumper, or comes from there: it cannot fall from there, but can be turned over. */
const LOW = ["RESTING", "STANDING UP", "SITTING DOWN"];

/**
 * The limits of a robot and where it is between them, rad; null of one that reports no tilt or has no limit.
 * @returns {?{first: number, last: number, left: number, kind: string}} `first` is the nearer of two limits, `left` how far it
 *   is from there, `kind` one of `ok`, `near`, `beyond`, or `off` where it has no torque that could be taken
 */
export function tiltLimits(robot) {
  const limits = [robot.tilt_limit_rad, LOW.includes(robot.posture) ? null : robot.down_rad].filter((limit) => limit > 0);
  if (limits.length === 0 || robot.pitch === null || robot.pitch === undefined) return null;
  const [first, last] = [Math.min(...limits), Math.max(...limits)];
  const tilt = Math.abs(robot.pitch);
  const kind = tilt >= first ? "beyond" : tilt >= NEAR * first ? "near" : "ok";
  return { first, last, left: first - tilt, kind: ACTIVE.includes(robot.mode) ? kind : "off" };
}
