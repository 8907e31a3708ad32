// The robots in space: bodies, targets, trails, reach; the camera; dragging a target.

import { axisColour, rgba } from "../colours.js";
import { byId, setText } from "../dom.js";
import { bodyOf, ghostOf, point } from "./bodies.js";
import { Camera, Renderer, add, dot, sub } from "./gl.js";
import { installKeys } from "./keys.js";
import { Scale } from "./scale.js";
import { Mesh } from "./shapes.js";

const TRAIL_MS = 6000;
const FRAME_MS = 50;
const GRAB_PX = 26;
const MARGIN_PX = 14;
const BODY = [[0.23, 0.51, 0.96, 1], [0.96, 0.62, 0.04, 1], [0.06, 0.72, 0.51, 1], [0.93, 0.28, 0.6, 1]];
const DARK = [0.2, 0.23, 0.28, 1];
const ROPE = [0.62, 0.45, 0.28, 1];
const OBSTACLE = [0.59, 0.44, 0.38, 1];
const SWING = [0.96, 0.55, 0.08, 1];

export class View {
  constructor(link, jog, pace) {
    this.link = link;
    this.jog = jog;
    this.pace = pace;
    this.canvas = byId("view");
    this.camera = new Camera();
    this.problem = "";
    this.robots = new Map();
    this.fixed = {};
    this.plan = null;
    try {
      this.renderer = new Renderer(this.canvas);
    } catch (error) {
      pace.software = true; // no WebGL means no graphics card: the rest of the page is drawn by a program too
      this.problem = `The robots are not drawn: ${error.message}. Everything else works.`;
      setText(byId("view-note"), this.problem);
      return;
    }
    pace.software = this.renderer.software;
    this.canvas.dataset.drawnBy = pace.software ? "a program" : "a graphics card";
    const ball = new Mesh();
    ball.ball();
    this.ball = this.renderer.mesh(...ball.arrays);
    this.scale = new Scale(byId("labels"), byId("scale"), this.renderer);
    this.pointers();
    installKeys(this);
    byId("view-reset").addEventListener("click", () => this.reset());
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.dark.addEventListener("change", () => this.redraw());
  }

  describe(drawing, problem) {
    this.drawing = this.renderer ? drawing : null;
    if (this.renderer) this.problem = problem && `The robots are not drawn: ${problem}`;
    this.robots.clear();
    if (!this.drawing) return;
    this.size = Math.hypot(...sub(drawing.bounds[1], drawing.bounds[0]));
    const floor = new Mesh();
    for (const line of drawing.floor) floor.tube(line, this.size * 0.0008, 4);
    this.fixed.floor = this.renderer.mesh(...floor.arrays);
    this.scale.describe(drawing.floor, drawing.cell_mm, this.size, drawing.planar);
    this.obstacles = drawing.obstacles.map((shape) => {
      const solid = new Mesh(), plane = new Mesh();
      for (const [center, radius] of shape.balls ?? []) solid.ball(center, radius);
      for (const [start, end, radius] of shape.tubes ?? []) solid.tube([start, end], radius, 20);
      for (const [center, edges] of shape.boxes ?? []) solid.box(center, edges);
      for (const line of shape.lines ?? []) plane.tube(line, this.size * 0.0011, 4);
      return [this.renderer.mesh(...solid.arrays), this.renderer.mesh(...plane.arrays)];
    });
    Object.entries(drawing.robots).forEach(([name, robot], i) => {
      const reach = new Mesh();
      if (robot.surface) reach.surface(robot.surface.points, robot.surface.faces);
      else if (robot.reach.length) reach.tube([...robot.reach, robot.reach[0]], this.size * 0.0014, 5);
      this.robots.set(name, { ...robot, color: BODY[i % BODY.length], trail: [], target: null, tip: null, meshes: {}, reachMesh: this.renderer.mesh(...reach.arrays) });
    });
    this.reset();
  }

  reset() {
    if (!this.drawing) return;
    const [low, high] = this.drawing.bounds;
    const camera = this.camera;
    camera.center = low.map((v, i) => (v + high[i]) / 2);
    camera.flip = Object.values(this.drawing.robots).every((robot) => robot.up[2] < -0.5) ? -1 : 1; // hanging arms hang
    camera.turn = this.drawing.planar ? -Math.PI / 2 : -0.9;
    camera.lift = this.drawing.planar ? 1.25 : 0.35;
    const edge = this.drawing.cell_mm; // numbers stand beside the floor
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((i) => (k >> i) & 1 ? high[i] : low[i]));
    const reaches = Object.values(this.drawing.robots).flatMap((robot) => robot.surface?.points.filter((_, i) => i % 9 === 0) ?? []);
    this.fit([...corners, ...reaches, ...this.drawing.floor.flat().map(([x, y, z]) => [x + (x > camera.center[0] ? edge : 0), y - (y < camera.center[1] ? edge : 0), z])]);
    this.redraw();
  }

  /** Move the camera until points just fit. */
  fit(points) {
    const { camera, canvas } = this;
    for (let step = 0; step < 40; step++) {
      const seen = points.map((each) => camera.project(each, canvas));
      const fits = seen.every((at) => at && at[0] > MARGIN_PX && at[1] > MARGIN_PX && at[0] < canvas.clientWidth - MARGIN_PX && at[1] < canvas.clientHeight - MARGIN_PX);
      if (step === 0) camera.distance = this.size * 0.7;
      else if (fits) return;
      else camera.distance *= 1.06;
    }
  }

  frame(message) {
    if (!this.drawing) return;
    const ropes = message.bodies.ropes;
    let changed = this.moved(this.ropeShape, ropes);
    for (const [name, robot] of this.robots) {
      const data = message.robots[name];
      changed ||= robot.state !== data.state;
      robot.state = data.state;
      robot.tip = data.tip_mm && point(data.tip_mm);
      const command = data.target_mm ?? data.command_tip_mm;
      if (robot !== this.dragged) robot.target = command ? point(command) : robot.tip;
      if (robot.tip && (!robot.trail.length || Math.hypot(...sub(robot.tip, robot.trail.at(-1))) > this.size * 0.0008)) robot.trail.push(robot.tip);
      else if (robot.trail.length) robot.still = (robot.still ?? 0) + 1;
      if (robot.trail.length > TRAIL_MS / Math.max(this.pace.pause, FRAME_MS) || robot.still > 2) {
        robot.trail.shift();
        robot.still = 0;
      }
      const strips = message.bodies.robots[name] ?? [];
      const ghost = message.bodies.ghosts[name] ?? [];
      this.canvas.dataset[`ghost${name}`] = ghost.length > 0;
      if (this.moved(robot.ghost, ghost)) {
        robot.ghost = ghost;
        robot.meshes.ghost = this.renderer.mesh(...ghostOf(robot, ghost).arrays, robot.meshes.ghost);
        changed = true;
      }
      if (!this.moved(robot.strips, strips) && robot.trail.length === robot.trailed) continue;
      robot.strips = strips;
      robot.trailed = robot.trail.length;
      changed = true;
      this.build(robot, strips);
    }
    if (!changed) return; // nothing that could be seen: the noise of measurements needs no image
    const mesh = new Mesh();
    for (const line of ropes) mesh.tube(line, this.size * 0.004, 8);
    this.ropeShape = ropes;
    this.ropes = this.renderer.mesh(...mesh.arrays, this.ropes ?? null);
    this.redraw(true);
  }

  /** Where the robots are is unknown: they stay as they were seen last, grey. */
  lost() {
    for (const robot of this.robots.values()) robot.state = "OFF";
    this.redraw();
  }

  /** True when lines differ by what can be seen. */
  moved(before, now) {
    if (before === undefined || before.length !== now.length) return true;
    const seen = this.size * 0.0004;
    return now.some((line, i) => [line.length >> 1, line.length - 1].some((k) => before[i].length !== line.length || line[k].some((v, x) => Math.abs(v - before[i][k][x]) > seen)));
  }

  build(robot, strips) {
    const { renderer } = this;
    const { main, second, tendons } = bodyOf(robot, strips);
    const trail = new Mesh();
    if (robot.trail.length > 1) trail.tube(robot.trail, (i) => (this.size * 0.0032 * (i + 1)) / robot.trail.length, 6);
    robot.meshes.main = renderer.mesh(...main.arrays, robot.meshes.main);
    robot.meshes.second = renderer.mesh(...second.arrays, robot.meshes.second);
    robot.meshes.trail = renderer.mesh(...trail.arrays, robot.meshes.trail);
    robot.meshes.tendons = tendons.map((each, i) => renderer.mesh(...each.arrays, robot.meshes.tendons?.[i] ?? null));
  }

  /** Draw a swing over a robot, or none. */
  swing(name, swing) {
    const robot = this.drawing && this.robots.get(name);
    if (robot) robot.swing = swing;
    this.redraw();
  }

  /** The body of a robot that is drawn swinging, until that is over or the robot goes elsewhere. */
  swinging(robot) {
    if (!robot.swing) return false;
    robot.swing.from ??= robot.target;
    const left = robot.target && Math.hypot(...sub(robot.target, robot.swing.from)) > this.size * 0.01;
    if (robot.swing.over || left) {
      robot.swing.ended();
      robot.swing = null;
      return false;
    }
    const radius = robot.radius_mm * (robot.tendons ? 0.5 : 0.9);
    robot.meshes.swing = this.renderer.mesh(...robot.swing.body(radius).arrays, robot.meshes.swing);
    robot.meshes.swingEnds = this.renderer.mesh(...robot.swing.ends(radius).arrays, robot.meshes.swingEnds);
    this.renderer.draw(robot.meshes.swing, SWING);
    this.renderer.draw(robot.meshes.swingEnds, [...SWING.slice(0, 3), 0.35], { lit: 0.4 });
    return true;
  }

  /** Draw the paths of a checked trajectory, or none. */
  preview(paths) {
    if (!this.drawing) return;
    const mesh = new Mesh();
    for (const line of Object.values(paths ?? {})) mesh.tube(line.map(point), this.size * 0.003, 5);
    this.plan = this.renderer.mesh(...mesh.arrays, this.plan);
    this.redraw();
  }

  /** Draw soon; `paced`: by a frame, which waited already. */
  redraw(paced = false) {
    if (!this.drawing || this.asked) return;
    this.asked = true;
    const draw = () => requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
    const wait = paced ? 0 : this.pace.wait();
    if (wait > 0) setTimeout(draw, wait);
    else draw();
  }

  draw() {
    const { renderer } = this;
    const dark = this.dark.matches;
    renderer.begin(this.camera);
    renderer.draw(this.fixed.floor, dark ? [0.36, 0.41, 0.48, 0.5] : [0.6, 0.65, 0.72, 0.4], { lit: 0 });
    for (const robot of this.robots.values()) {
      const [r, g, b] = robot.color;
      const live = robot.state !== "OFF" && robot.state !== "FAULT";
      const main = robot.state === "FAULT" ? [0.86, 0.15, 0.15, 1] : live ? robot.color : [0.5, 0.53, 0.58, 1];
      renderer.draw(robot.meshes.main ?? null, main);
      renderer.draw(robot.meshes.second ?? null, dark ? [0.78, 0.81, 0.86, 1] : DARK);
      robot.meshes.tendons?.forEach((mesh, i) => renderer.draw(mesh, live ? rgba(axisColour(i)) : main, { lit: 0.5 }));
      renderer.draw(robot.meshes.trail ?? null, [r, g, b, 0.85], { lit: 0 });
      if (!robot.surface) renderer.draw(robot.reachMesh, [r, g, b, 0.7], { lit: 0 });
    }
    this.scale.draw(dark ? [0.55, 0.6, 0.67, 1] : [0.36, 0.4, 0.45, 1]);
    for (const [solid, plane] of this.obstacles) {
      renderer.draw(solid, OBSTACLE);
      renderer.draw(plane, [...OBSTACLE.slice(0, 3), 0.6], { lit: 0 });
    }
    renderer.draw(this.ropes ?? null, ROPE);
    renderer.draw(this.plan, [0.55, 0.36, 0.96, 0.9], { lit: 0 });
    for (const robot of this.robots.values()) renderer.draw(robot.meshes.ghost ?? null, [...robot.color.slice(0, 3), 0.3], { lit: 0.4 });
    let swings = 0;
    for (const robot of this.robots.values()) swings += this.swinging(robot);
    this.canvas.dataset.swings = swings;
    if (swings) setTimeout(() => this.redraw(), this.pace.pause);
    for (const robot of this.robots.values()) if (robot.surface) renderer.draw(robot.reachMesh, [...robot.color.slice(0, 3), dark ? 0.16 : 0.13], { lit: 0, glass: 1 });
    this.scale.place(this.camera, this.canvas);
    for (const robot of this.robots.values()) {
      if (!robot.target) continue;
      const refused = robot === this.dragged && this.jog.refusals.has(this.draggedName);
      const color = refused ? [0.9, 0.1, 0.1, 0.9] : [0.95, 0.26, 0.36, this.link.mine ? 0.95 : 0.55];
      renderer.draw(this.ball, color, { offset: robot.target, scale: this.size * (robot === this.dragged ? 0.016 : 0.0125), lit: 0.6, over: true });
    }
  }

  /** The robot whose target is near a point of the canvas. */
  near(x, y) {
    let best = null, least = GRAB_PX;
    for (const [name, robot] of this.robots) {
      const at = robot.target && this.camera.project(robot.target, this.canvas);
      const distance = at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
      if (distance < least) [best, least] = [{ name, robot }, distance];
    }
    return best;
  }

  pointers() {
    const { canvas } = this;
    const down = new Map();
    let before = null;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      down.set(event.pointerId, [event.offsetX, event.offsetY]);
      before = null;
      const found = down.size === 1 && this.link.mine ? this.near(event.offsetX, event.offsetY) : null;
      if (!found) return;
      [this.dragged, this.draggedName] = [found.robot, found.name];
      const at = this.camera.project(found.robot.target, canvas);
      this.grip = [at[0] - event.offsetX, at[1] - event.offsetY]; // a hand takes the target where it is
    });
    canvas.addEventListener("pointermove", (event) => {
      const old = down.get(event.pointerId);
      if (!old) {
        canvas.style.cursor = this.link.mine && this.near(event.offsetX, event.offsetY) ? "grab" : "";
        return;
      }
      const now = [event.offsetX, event.offsetY];
      down.set(event.pointerId, now);
      if (this.dragged) this.drag([now[0] + this.grip[0], now[1] + this.grip[1]]);
      else if (down.size === 2) {
        const [a, b] = [...down.values()];
        const span = Math.hypot(a[0] - b[0], a[1] - b[1]);
        if (before) this.camera.distance *= before / span;
        before = span;
      } else if (event.buttons === 2 || event.shiftKey) this.pan(now[0] - old[0], now[1] - old[1]);
      else {
        this.camera.turn -= (now[0] - old[0]) * 0.008 * this.camera.flip;
        this.camera.lift = Math.min(Math.max(this.camera.lift + (now[1] - old[1]) * 0.008, -1.5), 1.5);
      }
      this.redraw();
    });
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => {
      down.delete(event.pointerId);
      if (!this.dragged) return;
      this.dragged = null;
      this.jog.end();
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.camera.distance *= Math.exp(event.deltaY * 0.001);
      this.redraw();
    }, { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  pan(dx, dy) {
    const [right, up] = this.camera.frame();
    const k = (this.camera.distance * Math.tan(this.camera.field / 2) * 2) / this.canvas.clientHeight;
    this.camera.center = add(add(this.camera.center, right, -dx * k), up, dy * k);
  }

  /** Move the target within the plane of a planar robot, else in the plane of the image, inside its bounds. */
  drag([x, y]) {
    const robot = this.dragged;
    const eye = this.camera.eye(), ray = this.camera.ray(x, y, this.canvas);
    const normal = robot.planar ? [0, 0, 1] : this.camera.frame()[2];
    const slope = dot(ray, normal);
    if (Math.abs(slope) < 1e-3) return;
    const t = dot(sub(robot.target, eye), normal) / slope;
    const [low, high] = robot.bounds;
    const inside = (v, i) => Math.min(Math.max(v, Math.min(low[i], robot.target[i])), Math.max(high[i], robot.target[i]));
    robot.target = add(eye, ray, t).map(inside);
    this.jog.to(this.draggedName, robot.tip_columns, robot.target.slice(0, robot.tip_columns.length));
  }
}
