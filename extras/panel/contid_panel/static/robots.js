// One card per robot: state, fault with its remedy, orders, and sliders for tip and axes.

import { axisVariable } from "./colours.js";
import { attempt, h, setHidden, setText, toast } from "./dom.js";
import { Follow } from "./follow.js";
import { meaningOf } from "./meaning.js";
import { confirmed } from "./question.js";
import { Slider } from "./slider.js";
import { SwingButton } from "./space/swing.js";

const ARMED = new Set(["HOLD", "RUN", "APPROACH"]);
const HOME = "Go to the rest pose of the robot file";
const MOVING = new Set(["RUN", "APPROACH"]);
const STRAIGHT_DEG = 0.05; // of a bend below which its azimuth is only rounding

export class RobotCard {
  constructor(name, description, drawing, { link, jog, speed, view }, selected) {
    this.name = name;
    this.unit = description.unit;
    this.enabled = false;
    this.link = link;
    this.jog = jog;
    this.speed = speed;
    this.tipColumns = drawing?.tip_columns ?? [];
    this.axisColumns = drawing?.axis_columns ?? [];
    const bends = drawing?.bends ?? [];
    this.bendColumns = bends.map((each) => each.column);
    this.commands = new Map(); // by columns
    const rates = (this.rates = drawing?.rates ?? {});
    for (const columns of [this.tipColumns, this.bendColumns, this.axisColumns]) {
      jog.know(columns, columns.map((each) => rates[each] ?? Infinity), () => this.commands.get(columns) ?? null);
    }
    const axes = Object.entries(description.axes);
    const units = {}; // a wrist may be in degrees
    this.axes = axes.map(([axis, limit], i) => {
      const unit = (units[axis] = Object.keys(limit).find((key) => key.startsWith("min_")).slice(4));
      return new Slider(axis, limit[`min_${unit}`], limit[`max_${unit}`], unit, this.hand(this.axisColumns, i), axisVariable(i));
    });
    this.follow = new Follow(units, description.follow ?? {});
    const [low, high] = drawing?.bounds ?? [[], []];
    this.tip = this.tipColumns.map((column, i) => new Slider("xyz"[i], Math.floor(low[i]), Math.ceil(high[i]), "mm", this.hand(this.tipColumns, i)));
    this.bends = bends.map((each, i) => new Slider(each.name, each.minimum, each.maximum, each.unit, this.hand(this.bendColumns, i)));
    this.sliders = [...this.tip, ...this.bends, ...this.axes];
    this.state = h("span", { className: "state" });
    this.meaning = h("span", { className: "meaning" });
    this.fault = h("div", { className: "fault", hidden: true });
    this.note = h("p", { className: "refused", "aria-live": "polite" });
    this.clear = h("button", { type: "button", className: "clear", onclick: () => this.order("clear_fault") }, "Clear fault");
    this.hold = h("button", { type: "button", onclick: () => this.order("hold") }, "Hold");
    this.resume = h("button", { type: "button", onclick: () => this.resumes() }, "Resume");
    this.rest = h("button", { type: "button", onclick: () => this.order("stop"), title: "Stop by the policy of the robot file" }, "Stop");
    this.home = h("button", { type: "button", disabled: true, onclick: () => this.goesHome() }, "Rest pose");
    this.recover = h("button", { type: "button", hidden: true, onclick: () => this.order("recover") }, "Recover");
    this.element = h("article", { className: "card robot", tabIndex: -1, "aria-label": `Robot ${name}`, onfocusin: () => selected(name), onpointerdown: () => selected(name) },
      h("header", {}, h("h2", {}, name), this.state, this.meaning),
      this.fault,
      h("div", { className: "orders" }, this.hold, this.resume, this.rest, this.home, this.recover, this.clear),
      this.tip.length ? h("fieldset", {}, h("legend", {}, "Tip", h("span", {}, "measured")), ...this.tip.map((s) => s.row)) : null,
      this.bends.length ? h("fieldset", {}, h("legend", {}, "Bends"), ...this.bends.map((s) => s.row)) : null,
      h("fieldset", {}, h("legend", {}, "Axes", h("span", {}, "measured")), ...this.axes.map((s) => s.row)),
      drawing?.swings ? new SwingButton(name, view).element : null,
      this.note, this.follow.element);
    this.element.dataset.robot = name;
    this.element.id = `robot-${name}`;
  }

  /** What a hand on the slider of one column does: the robot goes to what was ordered last, with that number replaced. */
  hand(columns, i) {
    const to = (value, row) => {
      if (row === null || row.some((each) => each === null)) return null;
      const bend = columns.indexOf(columns[i].replace("azimuth", "bend"));
      if (bend !== i && Math.abs(row[bend]) < STRAIGHT_DEG) return this.refuse(`${columns[i]} turns nothing where the robot is straight: bend it first`);
      this.jog.to(this.name, columns, row.map((each, k) => (k === i ? value : each)));
      return value;
    };
    return {
      moved: (value) => to(value, this.ordered(columns)),
      stepped: (step, minimum, maximum) => {
        const row = this.ordered(columns);
        if (row === null) return null;
        const value = Math.min(Math.max(row[i] + step, minimum), maximum);
        return value === row[i] ? this.refuse(`${columns[i]} is at the end of its range`) : to(value, row);
      },
      ended: () => this.jog.end(),
      typed: (value) => attempt(async () => {
        const row = this.ordered(columns);
        if (row === null || row.some((each) => each === null)) throw new Error(`${this.name}: where it is is not known yet`);
        await this.link.order("goto", { target: Object.fromEntries(columns.map((each, k) => [each, k === i ? value : row[k]])), share: this.speed.share });
      }),
    };
  }

  /** The reason on the card why a number is not ordered. */
  refuse(why) {
    this.jog.refusals.set(this.name, why);
    return null;
  }

  /** The numbers of columns that were ordered last: of the jog that goes on, else where the robot was commanded to. */
  ordered(columns) {
    return this.jog.ordered(this.name, columns) ?? this.commands.get(columns) ?? null;
  }

  goesHome() {
    return attempt(() => this.link.order("home", { robots: [this.name], share: this.speed.share }));
  }

  order(verb) {
    return attempt(async () => {
      const result = await this.link.order(verb, { robots: [this.name] });
      if (result.refused) toast(Object.values(result.refused).join("; "), "error");
    });
  }

  async resumes() {
    if (this.stoppedBy && !(await confirmed(`${this.stoppedBy} stopped the robots. Look at them before they are armed again.`, "Resume"))) return;
    this.order("resume");
  }

  /** The newest frame: what moves. */
  frame(robot) {
    setText(this.state, robot.state);
    setText(this.meaning, meaningOf(robot.state, this.unit, this.enabled));
    this.element.dataset.state = robot.state;
    const jogging = this.link.mine && ARMED.has(robot.state);
    for (const slider of this.sliders) slider.disable(!jogging);
    this.home.disabled = !jogging;
    this.home.title = jogging ? HOME : `${HOME}: take control first, and arm it`;
    this.commands.set(this.tipColumns, robot.command_tip_mm?.slice(0, this.tipColumns.length) ?? null);
    this.commands.set(this.axisColumns, robot.command);
    this.commands.set(this.bendColumns, robot.bends);
    if (!MOVING.has(robot.state)) this.jog.arrived(this.name);
    const target = robot.target_mm ?? robot.command_tip_mm;
    this.tip.forEach((slider, i) => slider.show(target?.[i] ?? null, robot.tip_mm?.[i] ?? null, []));
    this.bends.forEach((slider, i) => slider.show(robot.bends?.[i] ?? null, null, []));
    this.axes.forEach((slider, i) => slider.show(robot.command[i], robot.measured?.[i] ?? null, robot.limits[i] ?? []));
    this.follow.show(robot);
    const refusal = this.jog.refusals.get(this.name);
    setText(this.note, refusal ? `Refused, holds: ${refusal}` : "");
    setHidden(this.clear, robot.state !== "FAULT");
    if (robot.state !== "FAULT") setHidden(this.fault, true);
  }

  /** The newest status: the fault in full. */
  status(robot, lease) {
    this.enabled = robot.enabled ?? false;
    this.stoppedBy = lease.stopped_by ?? null;
    this.element.dataset.stoppedBy = this.stoppedBy ?? "";
    // A status is older than the newest frame: a fault that was cleared meanwhile is not shown again.
    const fault = this.element.dataset.state === "FAULT" ? robot.fault : null;
    setHidden(this.fault, !fault);
    setHidden(this.recover, fault?.number !== 109);
    if (!fault) return;
    const text = `${fault.number}:${fault.what}`;
    if (this.shownFault === text) return;
    this.shownFault = text;
    this.fault.replaceChildren(
      h("strong", {}, `Fault ${fault.number}: ${fault.name.replaceAll("-", " ")}`), h("p", {}, fault.what),
      h("dl", {}, h("dt", {}, "Cause"), h("dd", {}, fault.cause), h("dt", {}, "Reaction"), h("dd", {}, fault.reaction),
        h("dt", {}, "Remedy"), h("dd", {}, fault.remedy), h("dt", {}, "Page"), h("dd", {}, h("code", {}, fault.page))));
  }

  /** Nothing is known any more. */
  lost() {
    this.element.dataset.state = "LOST";
    setText(this.state, "UNKNOWN");
    setText(this.meaning, "no connection to the daemon");
    for (const slider of this.sliders) slider.disable(true);
    this.home.disabled = true;
    this.follow.lost();
  }
}
