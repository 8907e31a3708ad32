// What the body of a robot does beside what it should do: per axis and for the tip, with what is allowed.

import { h, setHidden, setText, shown } from "./dom.js";

const EXPLAINED = "Expected is the range of a healthy axis on its way: 0 inside it. Beyond what is allowed the robot stops with a fault.";

export class Follow {
  /** `units` of the axes by name; `follow` describes what is allowed. */
  constructor(units, follow) {
    this.summary = h("span", { "aria-live": "polite" });
    this.axes = Object.entries(follow).map(([axis, allowed]) => {
      const tolerance = allowed[`tolerance_${units[axis]}`];
      const decimals = Math.min(Math.max(2 - Math.floor(Math.log10(tolerance)), 1), 4);
      return { axis, tolerance, decimals, ...row(axis, `±${Number(tolerance.toPrecision(3))} ${units[axis]}`) };
    });
    this.tips = [["tip", "tip_mm"], ["tip, tracked", "measured_tip_mm"]].map(([name, field]) => ({ field, ...row(name, "") }));
    for (const { element } of this.tips) element.hidden = true;
    this.element = h("table", { className: "follow", title: EXPLAINED },
      h("caption", {}, "Measured minus", this.summary),
      h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "Axis"), ...["commanded", "expected", "allowed"].map((each) => h("th", { scope: "col", className: "number" }, each)))),
      h("tbody", {}, ...[...this.axes, ...this.tips].map((each) => each.element)));
  }

  /** Nothing is known any more. */
  lost() {
    setText(this.summary, "not known");
    this.summary.className = "";
    for (const each of this.axes) mark(each, "");
    for (const each of [...this.axes, ...this.tips]) for (const cell of [each.commanded, each.expected]) setText(cell, "–");
  }

  /** The newest frame. */
  show(robot) {
    const { expected } = robot;
    const [outside, pushing] = [[], []];
    this.axes.forEach((each, i) => {
      const [at, to] = [robot.measured?.[i] ?? null, robot.command[i]];
      setText(each.commanded, signed(at === null || to === null ? null : at - to, each.decimals));
      const off = expected?.off[i] ?? null;
      setText(each.expected, signed(off, each.decimals));
      const isOutside = Math.abs(off ?? 0) > each.tolerance;
      const pushes = isOutside && expected.pushes[i];
      if (isOutside) (pushes ? pushing : outside).push(each.axis);
      mark(each, !isOutside ? "" : pushes ? "pushes" : "outside");
    });
    for (const { field, element, commanded } of this.tips) {
      const [at, to] = [robot[field], robot.command_tip_mm];
      setHidden(element, !at || !to || (field === "tip_mm" && !robot.measured));
      if (!element.hidden) setText(commanded, `${shown(Math.hypot(...at.map((value, k) => value - to[k])), 2)} mm`);
    }
    const found = [[outside, "outside"], [pushing, pushing.length > 1 ? "push" : "pushes"]].filter(([axes]) => axes.length).map(([axes, what]) => `${axes.join(", ")} ${what}`);
    setText(this.summary, !expected ? "not commanded" : `${expected.at_fault ? "at the fault: " : ""}${found.join("; ") || "follows"}`);
    this.summary.className = outside.length ? "outside" : "";
  }
}

/** How a line is marked: "outside", "pushes" or "". */
function mark(line, what) {
  line.element.className = what;
  setText(line.mark, what && `${what} `);
}

/** One line: the cells that change, and what is allowed. */
function row(name, allowed) {
  const [commanded, expected] = [1, 2].map(() => h("td", { className: "number" }, "–"));
  const mark = h("b", {});
  const element = h("tr", {}, h("th", { scope: "row" }, name), commanded, expected, h("td", { className: "number" }, mark, allowed));
  return { element, commanded, expected, mark };
}

/** With its sign, unless it is rounded to 0. */
function signed(value, decimals) {
  const text = shown(value, decimals);
  return value > 0 && Number(text) > 0 ? `+${text}` : text;
}
