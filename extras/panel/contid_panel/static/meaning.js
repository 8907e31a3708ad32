// What a state means for a person beside the robot, above all where it has no torque: it does not hold then.

const MEANING = {
  CONNECTING: "waiting for its devices", READY: "devices answer, not armed: no torque",
  ARMING: "torque comes on", APPROACH: "on its way", RUN: "follows its target", HOLD: "holds its position",
  STOPPING: "on its way to rest", FAULT: "stopped by a fault",
};
/** What a robot does after an emergency stop, by the policy of its file. */
const STOPPED = {
  relax: "no torque, it may sink", vent: "pressure is released, it may sink",
  hold: "holds where it stopped", rest: "goes to its rest pose",
};

/** `unit` of its axes; `enabled` as the status has it. */
export function meaningOf(state, unit, enabled) {
  if (state !== "OFF") return MEANING[state] ?? "";
  if (enabled) return "not commanded, its devices are still on";
  return unit === "bar" ? "not commanded: no pressure is held" : "not commanded: no torque";
}

/** What became of the robots when STOP was confirmed: by the policy of the file where they are off, else by their state. */
export function afterStop(described, states) {
  const names = new Map();
  for (const [name, state] of Object.entries(states)) {
    const policy = described[name]?.stop.estop;
    const what = state === "OFF" && policy in STOPPED ? STOPPED[policy] : state;
    names.set(what, [...(names.get(what) ?? []), name]);
  }
  return [...names].map(([what, of]) => `${of.join(", ")}: ${what}`);
}
