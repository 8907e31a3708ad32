// Jogging at a chosen speed: a target that a hand sets at once is approached in steps of at most the speed.
//
// At full speed rows pass unchanged, and the limits of the robot file hold. Below it this page sends every step: one
// that is hidden, frozen or closed sends no more, and the robot holds where it is.

const PERIOD_MS = 50;

/** How far a column goes; an azimuth goes the short way around. */
function wayOf(column, from, to) {
  const way = to - from;
  return column.endsWith("azimuth_deg") ? way - 360 * Math.round(way / 360) : way;
}

export class Walk {
  constructor(link, jog, speed) {
    this.jog = jog;
    this.speed = speed;
    this.rows = new Map(); // by columns: their rates and where the robot is commanded to
    this.goal = null;
    const ordered = link.ordered;
    link.ordered = (verb) => {
      ordered(verb);
      if (!verb.startsWith("jog")) this.goal = null;
    };
    setInterval(() => this.step(), PERIOD_MS);
  }

  get refusals() {
    return this.jog.refusals;
  }

  /** `rates` of columns at full speed [1/s]; `present` gives where the robot is commanded to, null where unknown. */
  know(columns, rates, present) {
    this.rows.set(columns, { rates, present });
  }

  to(robot, columns, values) {
    const present = this.ordered(robot, columns) ?? this.rows.get(columns)?.present();
    if (this.speed.share >= 1 || !present || present.some((each) => each === null)) {
      this.goal = null;
      this.jog.to(robot, columns, values);
      return;
    }
    const { rates } = this.rows.get(columns);
    const still = columns.find((_, i) => rates[i] === 0 && values[i] !== present[i]); // the azimuth of a planar robot
    if (still !== undefined) {
      this.goal = null;
      this.jog.end();
      this.refusals.set(robot, `${still} has no speed of which this could be a share: choose full speed, or type a number`);
      return;
    }
    const before = this.goal?.columns === columns ? this.goal : { at: present, begun: false, stepped: performance.now() - PERIOD_MS };
    this.goal = { robot, columns, values, at: before.at, ending: false, begun: before.begun, stepped: before.stepped };
  }

  end() {
    if (this.goal === null) this.jog.end();
    else this.goal.ending = true;
  }

  arrived(robot) {
    if (this.goal?.robot !== robot) this.jog.arrived(robot);
  }

  /** The row that a robot is on its way to by these columns; null when it is not jogged. */
  ordered(robot, columns) {
    if (this.goal?.robot === robot && this.goal.columns === columns) return this.goal.values;
    return this.jog.ordered(robot, columns);
  }

  step() {
    const { goal } = this;
    if (goal === null) return;
    if (!goal.begun) this.refusals.delete(goal.robot); // of what was ordered before
    else if (this.refusals.has(goal.robot) || this.jog.active !== goal.robot) {
      this.goal = null; // refused, stopped, or without control
      this.jog.end();
      return;
    }
    const now = performance.now();
    const passed_s = Math.min(now - goal.stepped, 2 * PERIOD_MS) / 1e3; // a page that stood still does not catch up
    goal.stepped = now;
    const { rates } = this.rows.get(goal.columns);
    // All columns with the same share of their way, so that the path is straight.
    const ways = goal.columns.map((column, i) => wayOf(column, goal.at[i], goal.values[i]));
    const share = Math.min(1, ...ways.map((way, i) => (rates[i] * this.speed.share * passed_s) / Math.abs(way)).filter((each) => !Number.isNaN(each)));
    if (share >= 1) {
      if (goal.at !== goal.values) this.jog.to(goal.robot, goal.columns, goal.values);
      goal.at = goal.values;
      goal.begun = true;
      if (!goal.ending) return;
      this.goal = null;
      this.jog.end();
      return;
    }
    goal.at = goal.at.map((each, i) => each + share * ways[i]);
    this.jog.to(goal.robot, goal.columns, goal.at);
    goal.begun = true;
  }
}
