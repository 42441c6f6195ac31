// Draws quads with their edges, and lines, in a canvas, by WebGL 2: one instance per quad or line, lit from the viewer, seen from afar in parallel projection. Each has a
// way to go when blocks are pulled apart.

const vertexShader = `#version 300 es
layout(location = 0) in vec3 p0;
layout(location = 1) in vec3 p1;
layout(location = 2) in vec3 p2;
layout(location = 3) in vec3 p3;
layout(location = 4) in vec4 colour;
layout(location = 5) in vec3 away;
uniform mat3 turn;
uniform vec4 frame; // scale x, y; shift x, y
uniform float apart;
out vec3 at;
out vec2 uv;
flat out vec4 tint;
const int corner[6] = int[6](0, 1, 2, 0, 2, 3);
void main() {
  int c = corner[gl_VertexID];
  at = turn * ((c == 0 ? p0 : c == 1 ? p1 : c == 2 ? p2 : p3) + apart * away) / (1.0 + apart);
  uv = vec2(c == 1 || c == 2 ? 1.0 : 0.0, c >= 2 ? 1.0 : 0.0);
  tint = colour;
  gl_Position = vec4(at.xy * frame.xy + frame.zw, -at.z * 0.4, 1.0);
}`;

// An edge is a pixel and a half wide; where quads are hardly larger than that, edges fade.
const fragmentShader = `#version 300 es
precision highp float;
in vec3 at;
in vec2 uv;
flat in vec4 tint;
uniform float edges;
out vec4 colour;
void main() {
  vec3 n = normalize(cross(dFdx(at), dFdy(at)));
  vec2 width = fwidth(uv), near = min(uv, 1.0 - uv) / max(width, vec2(1e-6));
  float line = (1.0 - smoothstep(0.4, 1.1, min(near.x, near.y))) * (1.0 - smoothstep(0.2, 0.6, max(width.x, width.y)));
  float light = 0.4 + 0.6 * max(dot(n, normalize(vec3(0.3, 0.4, 1.0))), 0.0);
  colour = vec4(mix(tint.rgb * light, vec3(0.08), 0.75 * edges * line), 1.0);
}`;

// A line is a strip of a few pixels, a little in front of where it is, for quads end there.
const lineVertexShader = `#version 300 es
layout(location = 0) in vec3 p0;
layout(location = 1) in vec3 p1;
layout(location = 4) in vec4 colour; // alpha: pixels wide, by 255
layout(location = 5) in vec3 away;
uniform mat3 turn;
uniform vec4 frame;
uniform float apart;
uniform vec2 pixel; // half of the canvas, in pixels
flat out vec4 tint;
vec4 place(vec3 p) {
  vec3 at = turn * (p + apart * away) / (1.0 + apart);
  return vec4(at.xy * frame.xy + frame.zw, -at.z * 0.4, 1.0);
}
void main() {
  vec4 a = place(p0), b = place(p1);
  vec2 along = (b.xy - a.xy) * pixel, side = length(along) > 0.0 ? normalize(vec2(-along.y, along.x)) : vec2(0.0);
  gl_Position = gl_VertexID < 2 ? a : b;
  gl_Position.z -= 0.004;
  gl_Position.xy += side * (gl_VertexID % 2 == 0 ? 0.5 : -0.5) * colour.a * 255.0 / pixel;
  tint = colour;
}`;

const lineFragmentShader = `#version 300 es
precision highp float;
flat in vec4 tint;
out vec4 colour;
void main() { colour = vec4(tint.rgb, 1.0); }`;

function compile(gl, kind, source) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) || 'the graphics driver refuses a shader');
  return shader;
}

function link(gl, vertex, fragment) {
  const program = gl.createProgram();
  gl.attachShader(program, compile(gl, gl.VERTEX_SHADER, vertex));
  gl.attachShader(program, compile(gl, gl.FRAGMENT_SHADER, fragment));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) || 'the graphics driver refuses the shaders');
  return program;
}

/** Colour of a scaled Jacobian, as [r, g, b] of 0..255: red where it is not positive, from orange to blue above. */
export function qualityColour(q) {
  if (!(q > 0)) return [200, 0, 30];
  const stops = [[238, 120, 50], [246, 214, 110], [140, 200, 180], [120, 175, 220]], x = Math.min(q, 1) * 3, i = Math.min(2, Math.floor(x));
  return stops[i].map((a, k) => a + (stops[i + 1][k] - a) * (x - i));
}

/** Colour of a block: hues as far apart as they come, one after the other. */
export function blockColour(block) {
  if (block < 0) return [170, 170, 170];
  const hue = block * 0.61803398875 % 1 * 6, light = 1 - 0.12 * (block % 3);
  return [5, 3, 1].map(n => 255 * light * (1 - 0.45 * Math.max(0, Math.min((n + hue) % 6, 4 - (n + hue) % 6, 1))));
}

/** Colour of an irregular edge by the number of hexes around it, and its width in pixels: red for fewer than a regular edge has, blue for one more, violet beyond; thin on the boundary. */
export function lineColour(valence, inside) {
  const more = valence - (inside ? 4 : 2), colour = more < 0 ? [214, 39, 40] : more === 1 ? [31, 90, 200] : [140, 40, 170];
  return [...(inside ? colour : colour.map(x => Math.round(0.5 * x))), inside ? 4 : 2];
}

// Instances of one kind: a program, and a buffer for each of their attributes.
class Layer {
  constructor(gl, vertex, fragment, points) {
    this.gl = gl, this.count = 0, this.points = points;
    this.program = link(gl, vertex, fragment);
    this.at = Object.fromEntries(['turn', 'frame', 'edges', 'apart', 'pixel'].map(name => [name, gl.getUniformLocation(this.program, name)]));
    this.array = gl.createVertexArray();
    this.places = this.buffer(3, gl.FLOAT, Array.from({ length: points }, (_, c) => c));
    this.colours = this.buffer(4, gl.UNSIGNED_BYTE, [4]);
    this.ways = this.buffer(3, gl.FLOAT, [5]);
  }

  buffer(size, type, locations) {
    const { gl } = this, buffer = gl.createBuffer(), bytes = type === gl.FLOAT ? 4 * size : size;
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    locations.forEach((location, i) => {
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, size, type, type !== gl.FLOAT, bytes * locations.length, bytes * i);
      gl.vertexAttribDivisor(location, 1);
    });
    return buffer;
  }

  fill(buffer, data) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, buffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, data, this.gl.STATIC_DRAW);
  }

  /** places: Float32Array, 3 numbers per corner or end, within -1..1; ways: 3 per instance. */
  set(places, ways) {
    this.fill(this.places, places);
    this.fill(this.ways, ways);
    this.count = ways.length / 3;
  }

  draw(mode, vertices) {
    this.gl.bindVertexArray(this.array);
    this.gl.drawArraysInstanced(mode, 0, vertices, this.count);
  }
}

export class Scene {
  constructor(canvas) {
    const gl = canvas.getContext('webgl2', { antialias: true });
    if (!gl) throw new Error('this browser has no WebGL 2');
    this.canvas = canvas, this.gl = gl;
    this.quads = new Layer(gl, vertexShader, fragmentShader, 4);
    this.lines = new Layer(gl, lineVertexShader, lineFragmentShader, 2);
    this.edges = true, this.irregular = false, this.apart = 0;
    this.fit(new Float32Array(0));
  }

  /** Looks at all of these corners from the front, a little from above. */
  fit(corners) {
    this.yaw = -0.6, this.pitch = 0.5, this.zoom = 1, this.shift = [0, 0];
    const turn = this.turn(), reach = [1e-3, 1e-3], { clientWidth: w, clientHeight: h } = this.canvas;
    for (let i = 0; i < corners.length; i += 3)
      for (let k = 0; k < 2; k++)
        reach[k] = Math.max(reach[k], Math.abs(turn[k] * corners[i] + turn[3 + k] * corners[i + 1] + turn[6 + k] * corners[i + 2]));
    const least = Math.min(w, h) || 1;
    this.zoom = 0.92 * Math.min((w || 1) / least / reach[0], (h || 1) / least / reach[1]);
  }

  /** Columns of the rotation; z is up. */
  turn() {
    const [c, s, d, t] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    return [c, -t * s, d * s, s, t * c, -d * c, 0, d, t];
  }

  /** corners: Float32Array, 12 per quad, within -1..1; ways: 3 per quad. */
  setQuads(corners, ways) { this.quads.set(corners, ways); }

  /** colours: Uint8Array, 4 per quad. */
  setColours(colours) { this.quads.fill(this.quads.colours, colours); }

  /** ends: Float32Array, 6 per line; ways: 3 per line; colours: Uint8Array, red, green, blue and pixels wide. */
  setLines(ends, ways, colours) {
    this.lines.set(ends, ways);
    this.lines.fill(this.lines.colours, colours);
  }

  /** What both kinds of instances need to know; the canvas is `width` by `height` pixels. */
  use({ program, at }, width, height) {
    const { gl, zoom } = this, least = Math.min(width, height) || 1;
    gl.useProgram(program);
    gl.uniformMatrix3fv(at.turn, false, this.turn());
    gl.uniform4f(at.frame, zoom * least / width, zoom * least / height, ...this.shift);
    gl.uniform1f(at.apart, this.apart);
    gl.uniform1f(at.edges, this.edges ? 1 : 0);
    gl.uniform2f(at.pixel, width / 2 / devicePixelRatio, height / 2 / devicePixelRatio);
  }

  draw() {
    const { gl, canvas } = this;
    const width = Math.round(canvas.clientWidth * devicePixelRatio), height = Math.round(canvas.clientHeight * devicePixelRatio);
    if (canvas.width !== width || canvas.height !== height) canvas.width = width, canvas.height = height;
    gl.viewport(0, 0, width, height);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!this.quads.count && !(this.irregular && this.lines.count)) return;
    gl.enable(gl.DEPTH_TEST);
    this.use(this.quads, width, height);
    this.quads.draw(gl.TRIANGLES, 6);
    if (!this.irregular) return;
    if (!this.apart) gl.disable(gl.DEPTH_TEST); // most lines are inside, and are seen through all unless blocks are apart
    this.use(this.lines, width, height);
    this.lines.draw(gl.TRIANGLE_STRIP, 4);
  }
}
