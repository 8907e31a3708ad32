// A small WebGL renderer: lit and plain triangle meshes, and the matrices of a camera.

const VERTEX = `
attribute vec3 position; attribute vec3 normal;
uniform mat4 viewProjection; uniform vec3 offset; uniform float scale;
varying vec3 n; varying vec3 p;
void main() { p = position * scale + offset; n = normal; gl_Position = viewProjection * vec4(p, 1.0); }`;
const FRAGMENT = `
precision mediump float;
uniform vec4 color; uniform float lit; uniform float glass; uniform vec3 eye; uniform float flip;
varying vec3 n; varying vec3 p;
void main() {
  vec3 normal = normalize(n + vec3(0.0, 0.0, 1e-6)); vec3 toEye = normalize(eye - p);
  vec3 key = normalize(vec3(0.35, -0.5, 0.8 * flip)); vec3 half_ = normalize(key + toEye);
  float wrapped = 0.5 + 0.5 * dot(normal, key);
  float shine = pow(max(dot(normal, half_), 0.0), 40.0) * 0.28;
  float rim = pow(1.0 - abs(dot(normal, toEye)), 3.0) * 0.18;
  vec3 shaded = color.rgb * (0.34 + 0.72 * wrapped) + shine + rim * color.rgb;
  float seen = mix(1.0, 0.3 + 2.6 * pow(1.0 - abs(dot(normal, toEye)), 2.0), glass); // a skin is dense at its edge
  gl_FragColor = vec4(mix(color.rgb, shaded, lit), min(color.a * seen, 1.0));
}`;

/** Programs that draw in place of a graphics card. */
const PROGRAMS = /swiftshader|llvmpipe|softpipe|basic render|software/i;

/** True when a program draws: asked of a canvas of its own, as the real one is made once, with or without smooth edges. */
function software() {
  const gl = document.createElement("canvas").getContext("webgl", { failIfMajorPerformanceCaveat: true });
  if (gl === null) return true;
  // A browser that was started with a program as its graphics card sees no caveat.
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  const found = PROGRAMS.test(gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return found;
}

export class Renderer {
  constructor(canvas) {
    this.canvas = canvas;
    this.software = software(); // without a graphics card: plainer images, and fewer (`Pace`)
    const gl = canvas.getContext("webgl", { antialias: !this.software, alpha: true, premultipliedAlpha: false });
    if (gl === null) throw new Error("this browser has no WebGL");
    this.gl = gl;
    this.program = this.link();
    this.place = Object.fromEntries(["viewProjection", "offset", "scale", "color", "lit", "glass", "eye", "flip"].map((name) => [name, gl.getUniformLocation(this.program, name)]));
    this.position = gl.getAttribLocation(this.program, "position");
    this.normal = gl.getAttribLocation(this.program, "normal");
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  link() {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    return program;
  }

  /** Upload vertices (position and normal, six numbers each) and indices; reuses the buffers of `mesh`. */
  mesh(vertices, indices, mesh = null) {
    const gl = this.gl;
    const made = mesh ?? { vertices: gl.createBuffer(), indices: gl.createBuffer(), count: 0 };
    gl.bindBuffer(gl.ARRAY_BUFFER, made.vertices);
    gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.DYNAMIC_DRAW);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, made.indices);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.DYNAMIC_DRAW);
    made.count = indices.length;
    return made;
  }

  begin(camera) {
    const { gl, canvas } = this;
    const ratio = this.software ? 1 : Math.min(devicePixelRatio, 2);
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(this.place.viewProjection, false, camera.matrix(width / Math.max(height, 1)));
    gl.uniform3fv(this.place.eye, camera.eye());
    gl.uniform1f(this.place.flip, camera.flip);
    gl.enableVertexAttribArray(this.position);
    gl.enableVertexAttribArray(this.normal);
  }

  draw(mesh, color, { lit = 1, glass = 0, offset = [0, 0, 0], scale = 1, over = false } = {}) {
    if (mesh === null || mesh.count === 0) return;
    const { gl, place } = this;
    gl.uniform4fv(place.color, color);
    gl.uniform1f(place.lit, lit);
    gl.uniform1f(place.glass, glass);
    gl.uniform3fv(place.offset, offset);
    gl.uniform1f(place.scale, scale);
    gl.bindBuffer(gl.ARRAY_BUFFER, mesh.vertices);
    gl.vertexAttribPointer(this.position, 3, gl.FLOAT, false, 24, 0);
    gl.vertexAttribPointer(this.normal, 3, gl.FLOAT, false, 24, 12);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.indices);
    gl.depthMask(color[3] === 1);
    if (over) gl.disable(gl.DEPTH_TEST);
    gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_SHORT, 0);
    gl.enable(gl.DEPTH_TEST);
    gl.depthMask(true);
  }
}

export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const add = (a, b, k = 1) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export function unit(a) {
  const length = Math.hypot(...a) || 1;
  return [a[0] / length, a[1] / length, a[2] / length];
}

/** A camera that turns around a point; z is up, or down with `flip` -1. */
export class Camera {
  constructor() {
    this.center = [0, 0, 0];
    this.distance = 300;
    this.turn = -0.9;
    this.lift = 0.35;
    this.field = 0.6;
    this.flip = 1;
  }

  eye() {
    const flat = Math.cos(this.lift) * this.distance;
    return [this.center[0] + flat * Math.cos(this.turn), this.center[1] + flat * Math.sin(this.turn), this.center[2] + this.flip * Math.sin(this.lift) * this.distance];
  }

  /** Right, up and backward directions of the image. */
  frame() {
    const back = unit(sub(this.eye(), this.center));
    const right = [-this.flip * Math.sin(this.turn), this.flip * Math.cos(this.turn), 0];
    return [right, cross(back, right), back];
  }

  /** View and projection, column-major. */
  matrix(aspect) {
    const [right, up, back] = this.frame();
    const eye = this.eye();
    const f = 1 / Math.tan(this.field / 2);
    const near = this.distance / 50, far = this.distance * 20;
    const a = (far + near) / (near - far), b = (2 * far * near) / (near - far);
    const row = (v) => [...v, -dot(v, eye)];
    const [r, u, k] = [row(right), row(up), row(back)];
    const found = new Float32Array(16);
    for (let i = 0; i < 4; i++) {
      found[4 * i] = (f / aspect) * r[i];
      found[4 * i + 1] = f * u[i];
      found[4 * i + 2] = a * k[i] + (i === 3 ? b : 0);
      found[4 * i + 3] = -k[i];
    }
    return found;
  }

  /** Where a point is drawn on a canvas [CSS pixels], null behind the camera. */
  project(point, canvas) {
    const m = this.matrix(canvas.clientWidth / canvas.clientHeight);
    const at = [0, 1, 3].map((i) => m[i] * point[0] + m[4 + i] * point[1] + m[8 + i] * point[2] + m[12 + i]);
    if (at[2] <= 0) return null;
    return [(0.5 + (0.5 * at[0]) / at[2]) * canvas.clientWidth, (0.5 - (0.5 * at[1]) / at[2]) * canvas.clientHeight];
  }

  /** The direction in which a pixel looks. */
  ray(x, y, canvas) {
    const [right, up, back] = this.frame();
    const t = Math.tan(this.field / 2);
    const across = ((2 * x) / canvas.clientWidth - 1) * t * (canvas.clientWidth / canvas.clientHeight);
    const high = (1 - (2 * y) / canvas.clientHeight) * t;
    return unit(add(add(right.map((v) => v * across), up, high), back, -1));
  }
}
