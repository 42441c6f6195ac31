// Draws quads with their edges in a canvas, by WebGL 2: one instance per quad, lit from the viewer, seen from afar in parallel projection.

const vertexShader = `#version 300 es
layout(location = 0) in vec3 p0;
layout(location = 1) in vec3 p1;
layout(location = 2) in vec3 p2;
layout(location = 3) in vec3 p3;
layout(location = 4) in vec4 colour;
uniform mat3 turn;
uniform vec4 frame; // scale x, y; shift x, y
out vec3 at;
out vec2 uv;
flat out vec4 tint;
const int corner[6] = int[6](0, 1, 2, 0, 2, 3);
void main() {
  int c = corner[gl_VertexID];
  at = turn * (c == 0 ? p0 : c == 1 ? p1 : c == 2 ? p2 : p3);
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

function compile(gl, kind, source) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) || 'the graphics driver refuses a shader');
  return shader;
}

function link(gl) {
  const program = gl.createProgram();
  gl.attachShader(program, compile(gl, gl.VERTEX_SHADER, vertexShader));
  gl.attachShader(program, compile(gl, gl.FRAGMENT_SHADER, fragmentShader));
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

export class Scene {
  constructor(canvas) {
    const gl = canvas.getContext('webgl2', { antialias: true });
    if (!gl) throw new Error('this browser has no WebGL 2');
    this.canvas = canvas, this.gl = gl, this.count = 0;
    this.program = link(gl);
    this.at = Object.fromEntries(['turn', 'frame', 'edges'].map(name => [name, gl.getUniformLocation(this.program, name)]));
    this.corners = this.buffer(c => gl.vertexAttribPointer(c, 3, gl.FLOAT, false, 48, 12 * c), [0, 1, 2, 3]);
    this.colours = this.buffer(c => gl.vertexAttribPointer(c, 4, gl.UNSIGNED_BYTE, true, 4, 0), [4]);
    gl.enable(gl.DEPTH_TEST);
    this.edges = true;
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

  buffer(point, locations) {
    const { gl } = this, buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    for (const c of locations) {
      gl.enableVertexAttribArray(c);
      point(c);
      gl.vertexAttribDivisor(c, 1);
    }
    return buffer;
  }

  fill(buffer, data) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, buffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, data, this.gl.STATIC_DRAW);
  }

  /** corners: Float32Array, 12 per quad, within -1..1. */
  setCorners(corners) {
    this.fill(this.corners, corners);
    this.count = corners.length / 12;
  }

  /** colours: Uint8Array, 4 per quad. */
  setColours(colours) { this.fill(this.colours, colours); }

  draw() {
    const { gl, canvas, zoom } = this;
    const width = Math.round(canvas.clientWidth * devicePixelRatio), height = Math.round(canvas.clientHeight * devicePixelRatio);
    if (canvas.width !== width || canvas.height !== height) canvas.width = width, canvas.height = height;
    const least = Math.min(width, height) || 1;
    gl.viewport(0, 0, width, height);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!this.count) return;
    gl.useProgram(this.program);
    gl.uniformMatrix3fv(this.at.turn, false, this.turn());
    gl.uniform4f(this.at.frame, zoom * least / width, zoom * least / height, ...this.shift);
    gl.uniform1f(this.at.edges, this.edges ? 1 : 0);
    gl.drawArraysInstanced(gl.TRIANGLES, 0, 6, this.count);
  }
}
