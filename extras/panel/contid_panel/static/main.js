// The page: messages of the panel to the parts that show them.

import { BringupCard } from "./bringup.js";
import { byId, setHidden, setText, toast } from "./dom.js";
import { Events } from "./events.js";
import { FaultBanner } from "./faults.js";
import { Gamepad } from "./gamepad.js";
import { Jog } from "./jog.js";
import { Link } from "./link.js";
import { Pace } from "./pace.js";
import { Plots } from "./plots/plots.js";
import { PosesCard } from "./poses.js";
import { installQuestion } from "./question.js";
import { RecordingCard } from "./recording.js";
import { RobotCard } from "./robots.js";
import { LeaseControl, Machine, TrajectoryCard } from "./side.js";
import { Speed } from "./speed.js";
import { installStop, stopAll } from "./stop.js";
import { View } from "./space/view.js";
import { Walk } from "./walk.js";

const STALE_MS = 1500;
const page = { client: 0, readOnly: false, daemon: false, lastFrame: 0, states: "", status: null, robots: {} };
let cards = new Map();

const handlers = {
  hello: (message) => {
    page.readOnly = message.read_only;
    lease.demo = message.demo && !message.read_only;
    document.body.classList.toggle("read-only", page.readOnly);
  },
  client: (message) => { page.client = message.client; },
  daemon: (message) => {
    page.daemon = message.connected;
    if (!message.connected) lost();
    showLink(message.message);
  },
  describe: (message) => {
    const { describe, drawing, problem } = message;
    page.robots = describe.robots;
    setText(byId("name"), describe.name);
    document.title = `${describe.name} · contid`;
    cards = new Map(Object.entries(describe.robots).map(([name, robot]) =>
      [name, new RobotCard(name, robot, drawing?.robots[name], { link, jog, speed, view }, select)]));
    byId("robots").replaceChildren(...[...cards.values()].map((card) => card.element));
    view.describe(drawing, problem);
    plots.describe(describe.robots);
    events.describe(describe.robots);
    poses.describe(describe.robots);
    bringup.describe(describe);
    select(cards.keys().next().value);
  },
  frame: (message) => {
    page.lastFrame = performance.now();
    plots.add(message.t_s, message.robots);
    const states = [link.mine, ...Object.values(message.robots).map((robot) => robot.state)].join();
    const drawn = pace.wait() === 0;
    if (!drawn && states === page.states) return;
    page.states = states;
    for (const [name, robot] of Object.entries(message.robots)) cards.get(name)?.frame(robot);
    showStatus();
    if (!drawn) return; // a new state is written at once; the rest follows with the next image
    pace.begin();
    view.frame(message);
    plots.show();
    events.show();
  },
  status: (message) => {
    const { status } = message;
    const mine = page.client !== 0 && status.lease.client === page.client;
    if (link.mine && !mine && document.visibilityState === "visible") toast(controlLost(status), "error");
    link.mine = mine;
    events.status(status.lease);
    page.status = status;
    page.recorded = message.recorded;
    if (performance.now() - page.lastFrame > STALE_MS) showStatus(); // else with the next frame
  },
  poses: (message) => poses.show(message),
  event: (message) => events.add(message.event),
};

const link = new Link((message) => handlers[message.kind]?.(message), (open, reason) => {
  if (!open) lost();
  showLink(reason);
});
const speed = new Speed(link);
const jog = new Walk(link, new Jog(link), speed);
const lease = new LeaseControl(link);
const faults = new FaultBanner();
const machine = new Machine();
const bringup = new BringupCard();
const events = new Events(link);
const plots = new Plots();
const poses = new PosesCard(link, speed);
const pace = new Pace();
const view = new View(link, jog, pace);
const trajectory = new TrajectoryCard(link, (paths) => view.preview(paths));
const recording = new RecordingCard(link, (name) => trajectory.again(name));
for (const id of ["space", "robots"]) byId(id).addEventListener("pointerdown", () => lease.touched());
installStop(link, () => page.robots);
installQuestion();
new Gamepad(jog, speed, () => cards.get(page.selected), stopAll);

function showStatus() {
  const { status } = page;
  page.status = null;
  if (status === null) return;
  for (const [name, robot] of Object.entries(status.robots)) cards.get(name)?.status(robot, status.lease);
  faults.show(status.robots, (name) => cards.get(name)?.element.dataset.state);
  lease.show(status.lease, page.readOnly);
  trajectory.update();
  poses.update();
  recording.show(status.recordings ?? [], page.recorded ?? []);
  machine.show(status);
}

/** Why this page has the lease no more, and in which states the robots are: after a stop they are without torque. */
function controlLost({ lease, robots }) {
  const why = lease.stopped_by ? `${lease.stopped_by} stopped the robots` : lease.holder ? `${lease.holder} has it` : "the lease is free";
  return `Control was lost: ${why}. ${Object.entries(robots).map(([name, robot]) => `${name} ${robot.state}`).join(", ")}`;
}

function select(name) {
  page.selected = name;
  plots.select(name);
  for (const card of cards.values()) card.element.classList.toggle("selected", card.name === name);
}

document.addEventListener("visibilitychange", () => pace.forget());

function lost() {
  page.status = null;
  page.states = "";
  faults.lost();
  for (const card of cards.values()) card.lost();
  view.lost();
  trajectory.update();
  poses.update();
  recording.lost();
}

function showLink(reason) {
  const pill = byId("link");
  const stale = page.daemon && page.lastFrame > 0 && performance.now() - page.lastFrame > STALE_MS;
  const state = !link.open ? "lost" : !page.daemon ? "waiting" : stale ? "stale" : "live";
  const text = { lost: "no panel", waiting: "no daemon", stale: "no data", live: page.readOnly ? "live, read-only" : "live" };
  pill.dataset.state = state;
  setText(pill, text[state]);
  pill.title = reason || "";
  const note = byId("view-note");
  const why = { lost: `No connection to the panel: ${reason}.`, waiting: `No daemon: ${reason}. The page connects again; robots are never resumed by it.`, stale: "The daemon sends no data.", live: "" };
  if (reason || state === "stale" || state === "live") setText(note, state === "live" ? view.problem : why[state]);
  setHidden(note, !note.textContent);
}

setInterval(() => { if (link.open && page.daemon) showLink(""); }, 500);
