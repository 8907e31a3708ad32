// What a robot is made of, as meshes along the lines that the panel sends.

import { add, cross, sub, unit } from "./gl.js";
import { Mesh, smooth } from "./shapes.js";

const RIM_OF_ROD = 0.2; // radius of the rod of a tendon robot, in those of its discs
const RIM_OF_TENDON = 0.045; // thicker than real ones: they are to be seen
const THICK_OF_RIM = 0.16;

/** Meshes of a body: the robot's colour, the second colour, and one for each tendon. */
export function bodyOf(robot, strips) {
  const main = new Mesh(), second = new Mesh(), tendons = [];
  if (strips.length === 0) return { main, second, tendons };
  if (robot.planar) fingers(main, second, strips, robot.length_mm);
  else if (robot.tendons) tendonRobot(main, second, tendons, strips, robot);
  else arm(main, second, strips, robot);
  return { main, second, tendons };
}

/** A body as one plain shape: where a robot is commanded to. */
export function ghostOf(robot, strips) {
  const mesh = new Mesh();
  if (robot.planar) for (const edge of strips.slice(-2)) mesh.tube(edge.map(point), robot.length_mm * 0.018, 8);
  else for (const strip of backbone(robot, strips)) mesh.tube(smooth(strip.map(point), 2), robot.radius_mm * (robot.tendons ? RIM_OF_ROD : 0.9), 12);
  return mesh;
}

export const point = (p) => [p[0], p[1], p[2] ?? 0];

const backbone = (robot, strips) => strips.slice(0, strips.length - robot.tendons - robot.discs);

/** A planar finger: its two flexible racks, the links between them, the backbone. */
function fingers(main, second, strips, length) {
  const lines = strips.map((strip) => strip.map(point));
  const [left, right] = lines.slice(-2);
  for (const edge of [left, right]) main.tube(edge, length * 0.018, 10);
  for (let i = 0; i < left.length; i += 3) second.tube([left[i], right[i]], length * 0.009, 8);
  second.tube([left.at(-1), right.at(-1)], length * 0.02, 10);
}

/** A rod with discs, and the tendons through them. */
function tendonRobot(main, second, tendons, strips, robot) {
  const rim = robot.radius_mm;
  for (const strip of backbone(robot, strips)) main.tube(smooth(strip.map(point), 3), rim * RIM_OF_ROD, 12);
  const first = strips.length - robot.tendons - robot.discs;
  for (const line of strips.slice(first, first + robot.tendons)) {
    const mesh = new Mesh();
    mesh.tube(line.map(point), rim * RIM_OF_TENDON, 6);
    tendons.push(mesh);
  }
  strips.slice(first + robot.tendons).forEach((strip, number) => {
    const line = strip.map(point);
    const corners = line.slice(0, -1); // it is closed
    const center = corners.reduce((sum, each) => add(sum, each, 1 / corners.length), [0, 0, 0]);
    const normal = unit(cross(sub(corners[0], center), sub(corners[Math.floor(corners.length / 4)], center)));
    const ends = number > 0 && number % robot.discs_per_section === 0; // a thicker one where tendons end
    second.plate(center, normal, rim * (number === 0 ? 1.15 : 1), rim * THICK_OF_RIM * (ends ? 1.8 : number === 0 ? 2.2 : 1));
  });
}

/** A spatial arm: a ribbed tube per section with a collar between them, and its base. */
function arm(main, second, strips, robot) {
  const radius = robot.radius_mm;
  strips.forEach((strip, number) => {
    const line = smooth(strip.map(point), 4);
    const pitch = Math.max(Math.round((radius * 0.8 * line.length) / (robot.length_mm / strips.length)), 4);
    const size = radius * (1 - 0.12 * number);
    main.tube(line, (i) => size * (1 + 0.07 * Math.cos((2 * Math.PI * i) / pitch)), 18);
    second.tube(line.slice(-3), size * 1.12, 18);
  });
  const start = strips[0].map(point);
  const along = sub(start[1], start[0]);
  const k = (radius * 0.5) / (Math.hypot(...along) || 1);
  second.tube([add(start[0], along, -k), start[0]], radius * 1.5, 28);
}
