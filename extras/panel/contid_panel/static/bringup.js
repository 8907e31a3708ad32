// Which axes have been brought up, with which devices, and what is pending: by the daemon, when its run began.

import { byId, h } from "./dom.js";

const OPEN = new Set(["pending", "changed", "failed"]);
/** While one of its axes is so, a robot is slow. */
const SLOW = new Set(["changed", "failed"]);

export class BringupCard {
  constructor() {
    this.body = h("div", {});
    byId("bringup").append(h("h2", {}, "Bring-up"), this.body);
  }

  /** What does not change while a daemon runs. */
  describe({ robots, file }) {
    const axes = Object.entries(robots).flatMap(([name, robot]) => Object.entries(robot.bringup ?? {}).map(([axis, found]) => ({ robot: name, axis: `${name}.${axis}`, ...found })));
    const listed = axes.filter((each) => each.state !== "none");
    this.body.replaceChildren(
      h("ul", { className: "plain" }, ...Object.keys(robots).map((name) => h("li", {}, summary(name, axes.filter((each) => each.robot === name))))),
      h("ul", { className: "plain axes" }, ...listed.map(line)),
      ...(listed.some((each) => OPEN.has(each.state)) ? [h("p", { className: "facts" }, "To do, when this run has ended: ", h("code", {}, `contid bringup ${quoted(file)}`))] : []));
  }
}

/** One robot in a sentence. */
function summary(name, axes) {
  const able = axes.filter((each) => each.state !== "none");
  if (!axes.length) return `${name}: not known, the daemon is of an earlier version`;
  if (!able.length) return `${name}: nothing to bring up, ${[...new Set(axes.map((each) => each.message))].join(", ")}`;
  const proven = able.filter((each) => each.state === "proven").length;
  const slow = able.filter((each) => SLOW.has(each.state)).map((each) => each.axis.slice(name.length + 1));
  return `${name}: ${proven} of ${able.length} axes proven${slow.length ? `, slow until ${slow.join(", ")} ${slow.length > 1 ? "are" : "is"}` : ""}`;
}

/** A path as a word of a shell. */
function quoted(path) {
  return /^[\w@%+=:,./-]+$/.test(path) ? path : `'${path.replaceAll("'", "'\\''")}'`;
}

function line({ axis, state, message, date, device, firmware, bus, driver }) {
  const met = device === undefined ? `not met yet: bus ${bus}, ${driver}` : `device ${device}, firmware ${firmware}`;
  return h("li", {}, h("b", {}, axis), h("b", { className: `tier ${state}` }, state), h("span", {}, state === "proven" ? `${date}; ${met}` : `${message}; ${met}`));
}
