// Triangle meshes of what is drawn: tubes along lines, balls, boxes, plates, surfaces.

import { add, cross, dot, sub, unit } from "./gl.js";

/** Collects shapes into one mesh. */
export class Mesh {
  constructor() {
    this.vertices = [];
    this.indices = [];
  }

  get arrays() {
    return [new Float32Array(this.vertices), new Uint16Array(this.indices)];
  }

  /** A tube along points; `radius` is a number or a function of the point's number. Ends are rounded. */
  tube(points, radius, sides = 12) {
    const line = points.filter((p, i) => i === 0 || Math.hypot(...sub(p, points[i - 1])) > 1e-6);
    if (line.length < 2) return;
    const r = typeof radius === "function" ? radius : () => radius;
    const along = line.map((p, i) => unit(sub(line[Math.min(i + 1, line.length - 1)], line[Math.max(i - 1, 0)])));
    let side = unit(cross(along[0], Math.abs(along[0][2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
    const rings = [];
    line.forEach((p, i) => {
      side = unit(add(side, along[i], -dot(side, along[i]))); // parallel transport: no twist
      rings.push([p, side, along[i], r(i)]);
    });
    for (const end of [0, rings.length - 1]) {
      const [p, s, t, size] = rings[end];
      const out = end === 0 ? -1 : 1;
      const caps = [0.5, 0.87, 1].map((h) => [add(p, t, out * h * size * 0.5), s, t, Math.max(size * Math.sqrt(1 - h * h), 1e-3)]);
      end === 0 ? rings.unshift(...caps.reverse()) : rings.push(...caps);
    }
    const first = this.vertices.length / 6;
    rings.forEach(([p, s, t, size], k) => {
      const up = cross(t, s);
      const lean = k < 3 ? -k * 0.3 + 0.9 : k >= rings.length - 3 ? (k - rings.length + 4) * 0.3 : 0;
      for (let i = 0; i < sides; i++) {
        const angle = (2 * Math.PI * i) / sides;
        const c = Math.cos(angle), d = Math.sin(angle);
        const n = [c * s[0] + d * up[0], c * s[1] + d * up[1], c * s[2] + d * up[2]];
        const m = lean === 0 ? n : unit(add(n, t, k < 3 ? -lean * 2 : lean * 2));
        this.vertices.push(p[0] + size * n[0], p[1] + size * n[1], p[2] + size * n[2], m[0], m[1], m[2]);
      }
    });
    this.skin(first, rings.length, sides);
  }

  /** Triangles between rings of vertices, each with the same number of `sides`. */
  skin(first, rings, sides) {
    for (let k = 0; k + 1 < rings; k++) for (let i = 0; i < sides; i++) {
      const a = first + k * sides + i, b = first + k * sides + ((i + 1) % sides);
      this.indices.push(a, b, a + sides, b, b + sides, a + sides);
    }
  }

  /** Triangles with smooth edges: points and the numbers of their corners. */
  surface(points, faces) {
    const first = this.vertices.length / 6;
    const normals = points.map(() => [0, 0, 0]);
    for (const [a, b, c] of faces) {
      const n = cross(sub(points[b], points[a]), sub(points[c], points[a]));
      for (const corner of [a, b, c]) normals[corner] = add(normals[corner], n);
      this.indices.push(first + a, first + b, first + c);
    }
    points.forEach((p, i) => this.vertices.push(...p, ...unit(normals[i])));
  }

  /** A round plate with flat faces, its middle at `center`. */
  plate(center, normal, radius, thick, sides = 32) {
    const side = unit(cross(normal, Math.abs(normal[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
    const up = cross(normal, side);
    const around = [...Array(sides).keys()].map((i) => {
      const angle = (2 * Math.PI * i) / sides;
      return [0, 1, 2].map((x) => Math.cos(angle) * side[x] + Math.sin(angle) * up[x]);
    });
    const first = this.vertices.length / 6;
    for (const way of [-1, 1]) for (const n of around) this.vertices.push(...add(add(center, normal, (way * thick) / 2), n, radius), ...n);
    this.skin(first, 2, sides);
    for (const way of [-1, 1]) {
      const middle = this.vertices.length / 6, face = add(center, normal, (way * thick) / 2), out = normal.map((v) => v * way);
      this.vertices.push(...face, ...out);
      for (const n of around) this.vertices.push(...add(face, n, radius), ...out);
      for (let i = 0; i < sides; i++) this.indices.push(middle, middle + 1 + i, middle + 1 + ((i + 1) % sides));
    }
  }

  /** A box: its center and its three half edges. */
  box(center, edges) {
    for (const [i, j, k] of [[0, 1, 2], [1, 2, 0], [2, 0, 1]]) for (const way of [1, -1]) {
      const first = this.vertices.length / 6;
      const n = unit(edges[i].map((v) => v * way));
      for (const [a, b] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) this.vertices.push(...add(add(add(center, edges[i], way), edges[j], a), edges[k], b), ...n);
      this.indices.push(first, first + 1, first + 2, first, first + 2, first + 3);
    }
  }

  /** A ball. */
  ball(center = [0, 0, 0], radius = 1, sides = 20) {
    const poles = [];
    for (let k = 0; k <= sides / 2; k++) poles.push([0, 0, -Math.cos((2 * Math.PI * k) / sides)]);
    const first = this.vertices.length / 6;
    for (const [, , z] of poles) {
      const r = Math.sqrt(Math.max(1 - z * z, 0));
      for (let i = 0; i < sides; i++) {
        const n = [r * Math.cos((2 * Math.PI * i) / sides), r * Math.sin((2 * Math.PI * i) / sides), z];
        this.vertices.push(...add(center, n, radius), ...n);
      }
    }
    this.skin(first, poles.length, sides);
  }
}

/** A line with `times` as many points, through the given ones (Catmull-Rom). */
export function smooth(points, times) {
  const found = [];
  const at = (i) => points[Math.min(Math.max(i, 0), points.length - 1)];
  for (let i = 0; i + 1 < points.length; i++) {
    const [a, b, c, d] = [at(i - 1), at(i), at(i + 1), at(i + 2)];
    for (let k = 0; k < times; k++) {
      const t = k / times;
      found.push([0, 1, 2].map((x) => 0.5 * (2 * b[x] + (c[x] - a[x]) * t + (2 * a[x] - 5 * b[x] + 4 * c[x] - d[x]) * t * t + (3 * b[x] - a[x] - 3 * c[x] + d[x]) * t * t * t)));
    }
  }
  found.push(points.at(-1));
  return found;
}
