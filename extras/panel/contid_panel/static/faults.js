// Faults in one line each below the header, where they are seen and announced wherever the page is scrolled.

import { byId, h, setHidden } from "./dom.js";

export class FaultBanner {
  constructor() {
    this.faults = new Map(); // by robot: what is shown
    this.element = byId("faults");
  }

  /** The newest status: which robots have a fault. `state` gives the newest state of a robot. */
  show(robots, state) {
    const found = new Map();
    for (const [name, { fault }] of Object.entries(robots)) {
      // A status is older than the newest frame: a fault that was cleared meanwhile is not announced again.
      if (fault && state(name) === "FAULT") found.set(name, `${name}: fault ${fault.number}, ${fault.what}`);
    }
    if ([...found.values()].join() === [...this.faults.values()].join()) return;
    this.faults = found;
    this.element.replaceChildren(...[...found].map(([name, text]) => h("p", {}, text, " ", h("a", { href: `#robot-${name}`, onclick: goes }, "Cause and remedy"))));
    setHidden(this.element, found.size === 0);
  }

  lost() {
    this.faults = new Map();
    setHidden(this.element, true);
  }
}

/** The address keeps its token: the link scrolls and sets the focus, and does not navigate. */
function goes(event) {
  event.preventDefault();
  const card = byId(event.currentTarget.getAttribute("href").slice(1));
  card.scrollIntoView({ block: "center" });
  card.focus({ preventScroll: true });
}
