// SPDX-License-Identifier: MIT
// Numbers as an operator reads them. A value that the robot does not report is a dash.

const MINUS = "\u2212";
export const DASH = "\u2013";

/** A number with a fixed count of decimals and a true minus sign, or a dash. */
export function figure(value, decimals, unit = "") {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  const digits = Math.abs(value).toFixed(decimals);
  const sign = value < 0 && Number(digits) !== 0 ? MINUS : "";
  return `${sign}${digits}${unit ? ` ${unit}` : ""}`;
}

export const degrees = (radians) => (radians === null || radians === undefined ? null : (radians * 180) / Math.PI);

/** How long ago, short: 0.1 s, 12.3 s, 4 min 5 s, 2 h 10 min. */
export function duration(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return DASH;
  if (seconds < 60) return `${Math.max(0, seconds).toFixed(1)} s`;
  const whole = Math.floor(seconds);
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
}

const clock = new Intl.DateTimeFormat(undefined, { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23" });

/** What the clock on the wall here showed so many seconds ago. */
export const timeOfDay = (secondsAgo) => clock.format(Date.now() - 1e3 * secondsAgo);

/** Milliseconds, for what is fast. */
export function milliseconds(seconds) {
  if (seconds === null || seconds === undefined) return DASH;
  return figure(seconds * 1e3, seconds < 0.0095 ? 1 : 0, "ms");
}

/** A name of the robot's as words: `imu_still` is `imu still`. */
export const words = (name) => name.replaceAll("_", " ");
