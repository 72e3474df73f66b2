"use strict";
// Points or a mesh of the visible surface: metres where the camera is known, or else disparity as height.
(() => {
  const VERTEX = `#version 300 es
    precision highp float; precision highp int; precision highp sampler2DArray;
    uniform sampler2D map; uniform sampler2DArray views;
    uniform mat4 turn; uniform vec4 camera; // scale, inverse focus, cx, cy
    uniform float ray, cut, point, flatness; uniform int reference, mesh, stride, across;
    out vec3 shade;
    float at(ivec2 p) { return texelFetch(map, p, 0).r; }
    void main() {
      ivec2 size = textureSize(map, 0), p, a, b, c;
      bool drawn = true;
      if (mesh == 1) {
        int square = gl_VertexID / 6, corner = gl_VertexID % 6;
        ivec2 o = ivec2(square % across, square / across) * stride;
        ivec2 e = min(o + stride, size - 1);
        if (corner < 3) { a = o; b = ivec2(o.x, e.y); c = ivec2(e.x, o.y); }
        else { a = ivec2(e.x, o.y); b = ivec2(o.x, e.y); c = e; }
        p = corner % 3 == 0 ? a : corner % 3 == 1 ? b : c;
        float low = min(at(a), min(at(b), at(c))), high = max(at(a), max(at(b), at(c)));
        drawn = high - low < cut;
      } else p = ivec2(gl_VertexID % across, gl_VertexID / across) * stride;
      float d = at(p);
      vec3 place;
      if (camera.x != 0.) {
        float inverse = d / camera.x + camera.y;
        drawn = drawn && inverse > 0.;
        float z = 1. / inverse;
        place = vec3((vec2(p) - camera.zw) * ray * z, z);
      } else place = vec3((vec2(p) - .5 * vec2(size)) / float(size.x), -d * flatness);
      gl_Position = drawn ? turn * vec4(place, 1) : vec4(2, 2, 2, 1);
      gl_PointSize = point;
      shade = texelFetch(views, ivec3(p, reference), 0).rgb;
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float; in vec3 shade; out vec4 colour;
    void main() { colour = vec4(shade, 1); }`;

  const LARGEST = 400000; // squares; more are thinned out, so that phones and software renderers keep up

  // Half of the angle of view, as its tangent.
  function halfAngle(scene, pixels) {
    return scene.camera ? scene.camera.step * pixels / 2 : 0.36 * pixels / scene.width;
  }

  function product(a, b) { // column by column
    const out = new Float32Array(16);
    for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++)
      for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
    return out;
  }

  class Solid {
    constructor(gl) {
      this.gl = gl;
      this.program = new LF.Program(gl, FRAGMENT, VERTEX);
      this.kind = "mesh"; this.cut = LF.scene.cut; this.point = 2; this.angles = [0, 0]; this.near = 1; this.shift = [0, 0];
    }

    get metres() { return LF.scene.camera !== null; }

    depth(d) {
      const { camera } = LF.scene;
      const inverse = d / camera.scale + camera.inverse_focus;
      return inverse > 0 ? 1 / inverse : Infinity;
    }

    // Where the middle of the scene is and how far it reaches, by all but the outermost hundredth of disparities.
    look(map) {
      const sorted = Float32Array.from(map.disparity.filter((_, i) => i % 17 === 0)).sort();
      const at = (share) => sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
      const [low, middle, high] = [at(0.01), at(0.5), at(0.99)];
      if (!this.metres) {
        const reach = Math.max(high - low, 1e-6);
        this.flatness = 0.5 / reach;
        this.middle = [0, 0, -((low + high) / 2) * this.flatness];
        this.radius = 0.75; this.distance = 1.7;
        return;
      }
      const nearest = this.depth(high), farthest = Math.min(this.depth(low), 8 * this.depth(middle));
      const z = (nearest + farthest) / 2;
      this.middle = [0, 0, z];
      this.distance = z; // the reference camera stands at 0
      this.radius = Math.max((farthest - nearest) / 2, z * 0.1);
    }

    draw(map, picture, width, height, around) {
      const gl = this.gl, { scene } = LF;
      if (this.lookedAt !== map.id) { this.look(map); this.lookedAt = map.id; }
      const squares = scene.width * scene.height, stride = Math.max(1, Math.ceil(Math.sqrt(squares / LARGEST)));
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.viewport(0, 0, width, height);
      gl.clearColor(...around, 1);
      gl.enable(gl.DEPTH_TEST);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const mesh = this.kind === "mesh";
      const across = mesh ? Math.ceil((scene.width - 1) / stride) : Math.ceil(scene.width / stride);
      const down = mesh ? Math.ceil((scene.height - 1) / stride) : Math.ceil(scene.height / stride);
      const camera = scene.camera;
      this.program.use({
        map: { unit: 0, texture: map.textures.disparity },
        views: { unit: 1, target: gl.TEXTURE_2D_ARRAY, texture: picture.views },
        turn: this.matrix(width / height), cut: this.cut, point: this.point * (window.devicePixelRatio || 1),
        camera: camera ? [camera.scale, camera.inverse_focus, camera.cx, camera.cy] : [0, 0, 0, 0],
        ray: camera ? camera.step : 1, flatness: this.flatness || 1,
        reference: { int: picture.reference }, mesh: { int: mesh ? 1 : 0 }, stride: { int: stride }, across: { int: across },
      });
      gl.drawArrays(mesh ? gl.TRIANGLES : gl.POINTS, 0, across * down * (mesh ? 6 : 1));
      gl.disable(gl.DEPTH_TEST);
      this.stride = stride;
    }

    // From the scene (x right, y down, z forward) to the screen: turned about the middle, seen from a distance.
    matrix(aspect) {
      const { scene } = LF, [yaw, pitch] = this.angles, [mx, my, mz] = this.middle;
      const [tx, ty] = [scene.width, scene.height].map((n) => halfAngle(scene, n));
      const back = this.distance * this.near;
      const view = [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, -mx, my, mz, 1]; // y up, towards the viewer, about the middle
      const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
      const about = [cy, 0, -sy, 0, 0, 1, 0, 0, sy, 0, cy, 0, 0, 0, 0, 1];
      const over = [1, 0, 0, 0, 0, cp, sp, 0, 0, -sp, cp, 0, this.shift[0], this.shift[1], -back, 1];
      const fy = 0.98 * Math.min(1 / ty, aspect / tx), fx = fy / aspect, near = back * 0.04, far = back * 40;
      const lens = [fx, 0, 0, 0, 0, fy, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
      return product(lens, product(over, product(about, view)));
    }

    turn(dx, dy) {
      this.angles[0] += dx * 0.006;
      this.angles[1] = Math.max(-1.5, Math.min(1.5, this.angles[1] + dy * 0.006));
    }

    slide(dx, dy, height) {
      const step = this.distance * this.near / height;
      this.shift[0] += dx * step; this.shift[1] -= dy * step;
    }

    approach(factor) { this.near = Math.max(0.05, Math.min(10, this.near / factor)); }

    reset() { this.angles = [0, 0]; this.near = 1; this.shift = [0, 0]; }
  }

  LF.Solid = Solid;
})();
