// SPDX-License-Identifier: MIT
// The keys of the page that plays a log. None of them is a letter, so that nothing that is spoken or typed is one.

import { takesSpace } from "./driving.js";

const SECOND = 1;

/** Have keys act on a player. */
export function listenToKeys(player) {
  const arrow = (direction) => (event) => {
    if (event.shiftKey) player.seek(player.t + direction * SECOND);
    else void player.step(direction);
  };
  const acts = {
    ArrowLeft: arrow(-1), ArrowRight: arrow(1), Home: () => player.seek(0), End: () => player.seek(player.duration),
    Space: (event) => !event.repeat && player.toggle(),
  };
  addEventListener("keydown", (event) => {
    const act = acts[event.code];
    const isTaken = event.target instanceof HTMLSelectElement || (event.code === "Space" && takesSpace(event.target));
    if (!act || isTaken || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault(); // neither the page nor the slider moves by itself
    act(event);
  });
}
