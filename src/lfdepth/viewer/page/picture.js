"use strict";
// Pictures made from the views: a camera anywhere in the aperture, refocused, in focus everywhere, past occluders.
// The point that the reference view shows at x with disparity D is at x − D·u in view u; a camera at u0 that is
// focused on D therefore samples view u at x + D·(u0 − u). This is lfdepth.refocus for u0 = 0 and all views.
(() => {
  const MOST = 1024; // views: as many as every WebGL 2 holds in a block of uniforms

  const fragment = (sample) => `#version 300 es
    precision highp float; precision highp int; precision highp sampler2DArray; precision highp isampler2DArray;
    uniform sampler2DArray views; uniform isampler2DArray fronts; uniform sampler2D map;
    layout(std140) uniform Chosen { vec4 chosen[${MOST}]; }; // u, v, layer, weight
    uniform int count, reference, mode; // mode 0: a plane; 1: every pixel at its own disparity; 2: past what is near
    uniform float focus, limit, jump, scale; uniform vec2 size, camera;
    out vec4 colour;
    void main() {
      vec2 at = (gl_FragCoord.xy - .5) * scale + .5 * (scale - 1.);
      float plane = focus, nearest = limit;
      if (mode == 1) { plane = texelFetch(map, ivec2(at), 0).r; nearest = plane + jump; }
      vec3 all = vec3(0), behind = vec3(0); float weight = 0., seeing = 0.;
      vec2 last = size - 1. + 5e-5;
      for (int k = 0; k < count; k++) {
        vec4 view = chosen[k];
        vec2 place = at + plane * (camera - view.xy);
        if (any(lessThan(place, vec2(-5e-5))) || any(greaterThan(place, last))) continue;
        vec3 sampled = ${sample}.rgb * view.w;
        all += sampled; weight += view.w;
        if (mode != 0) {
          float front = float(texelFetch(fronts, ivec3(clamp(place, vec2(0), size - 1.), view.z), 0).r) * .001;
          if (front <= nearest) { behind += sampled; seeing += view.w; }
        }
      }
      if (mode != 0 && seeing > 0.) { all = behind; weight = seeing; }
      else if (mode == 1) { all = texelFetch(views, ivec3(at, reference), 0).rgb; weight = 1.; }
      colour = weight > 0. ? vec4(all / weight, 1) : vec4(.5, .5, .5, 1);
    }`;

  const EXACT = "textureLod(views, vec3((place + .5) / size, view.z), 0.)";
  const FAST = "texelFetch(views, ivec3(place + .5, view.z), 0)"; // half the time where a processor draws

  const NOTHING = -32768, PARTS = 1000;

  // What a view shows of a map, as lfdepth's own splat: nearest wins, gaps within a surface are filled.
  function splat(disparity, width, height, v, u, jump) {
    const front = new Int16Array(width * height).fill(NOTHING);
    const level = (i) => Math.max(-32000, Math.min(32000, Math.round(disparity[i] * PARTS)));
    const land = (place, step, d) => Math.floor(Math.fround(Math.fround(place - Math.fround(step * d)) + 0.5));
    const put = (row, column, value) => {
      if (row < 0 || row >= height || column < 0 || column >= width) return;
      const at = row * width + column;
      if (value > front[at]) front[at] = value;
    };
    const rows = new Int32Array(width * height), columns = new Int32Array(width * height);
    for (let y = 0, i = 0; y < height; y++) for (let x = 0; x < width; x++, i++) {
      const d = disparity[i];
      rows[i] = land(y, v, d); columns[i] = land(x, u, d);
      put(rows[i], columns[i], level(i));
      if (x > 0 && columns[i] - columns[i - 1] === 2 && Math.abs(d - disparity[i - 1]) < jump)
        put(rows[i], columns[i] - 1, Math.min(level(i), level(i - 1)));
      if (y > 0 && rows[i] - rows[i - width] === 2 && Math.abs(d - disparity[i - width]) < jump)
        put(rows[i] - 1, columns[i], Math.min(level(i), level(i - width)));
    }
    return front;
  }

  // Nearest within 3×3 px, and within the pixels that a bilinear sample right and down of each touches.
  function grown(front, width, height, down, across) {
    const along = new Int16Array(front.length), out = new Int16Array(front.length);
    const right = across ? 2 : 1, below = down ? 2 : 1;
    for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
      let most = NOTHING;
      for (let i = Math.max(x - 1, 0); i <= Math.min(x + right, width - 1); i++)
        most = Math.max(most, front[y * width + i]);
      along[y * width + x] = most;
    }
    for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
      let most = NOTHING;
      for (let j = Math.max(y - 1, 0); j <= Math.min(y + below, height - 1); j++)
        most = Math.max(most, along[j * width + x]);
      out[y * width + x] = most;
    }
    return out;
  }

  const BUDGET = 24; // ms for a picture while something moves
  const SLOW = 100; // ms for an exact picture from which on no graphics processor seems to be there

  class Picture {
    constructor(gl) {
      const { scene } = LF, { width, height } = scene;
      Object.assign(this, { gl, width, height, loaded: [], cost: [4e-6, 2e-6], exact: false, pending: 0 });
      this.program = new LF.Program(gl, fragment(EXACT));
      this.preview = new LF.Program(gl, fragment(FAST));
      this.views = LF.texture(gl, gl.TEXTURE_2D_ARRAY, "LINEAR");
      this.layers = scene.present.length;
      const most = Math.min(gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS), MOST);
      if (this.layers > most)
        throw new Error(`This browser holds ${most} views, the scene has ${this.layers}: use --views.`);
      gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGB8, width, height, this.layers);
      this.table = gl.createBuffer();
      gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, this.table);
      gl.bufferData(gl.UNIFORM_BUFFER, 16 * MOST, gl.DYNAMIC_DRAW);
      this.finest = LF.target(gl, width, height);
      this.coarser = [2, 4].map((by) => LF.target(gl, Math.ceil(width / by), Math.ceil(height / by)));
      this.shown = this.finest;
      this.software = new LF.Software(this);
      this.nothing = LF.floatTexture(gl, new Float32Array(1), 1, 1);
      this.fronts = null; this.frontsOf = null; this.map = null;
      this.reference = scene.centre[0] * scene.grid[1] + scene.centre[1];
    }

    add(index, pixels) {
      const gl = this.gl;
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.views);
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
      const place = [gl.TEXTURE_2D_ARRAY, 0, 0, 0, index, this.width, this.height, 1, gl.RGB, gl.UNSIGNED_BYTE];
      gl.texSubImage3D(...place, pixels);
      if (pixels.close) pixels.close();
      this.loaded.push(index);
    }

    // Views that take part, with their weights: a tent around the camera that is flat within the aperture.
    chosen(look, thin = 1) {
      const { offsets, grid, centre } = LF.scene, [v0, u0] = look.camera, radius = look.aperture;
      const found = [];
      for (const k of this.loaded) {
        const [v, u] = offsets[k], dv = Math.abs(v - v0), du = Math.abs(u - u0);
        const row = Math.floor(k / grid[1]) - centre[0], column = (k % grid[1]) - centre[1];
        if (thin > 1 && radius > 1 && (Math.abs(row) % thin || Math.abs(column) % thin)) continue;
        const tent = (d) => Math.max(0, Math.min(1, 1 + radius - d));
        let weight = look.shape === "round" && radius > 0 ? tent(Math.hypot(dv, du)) : tent(dv) * tent(du);
        if (look.all) weight = 1;
        if (weight > 1e-6) found.push([u, v, k, weight]);
      }
      if (!found.length && this.loaded.length) { // absent views all around: the nearest one there is
        const far = (k) => Math.hypot(offsets[k][0] - v0, offsets[k][1] - u0);
        const k = this.loaded.reduce((a, b) => (far(a) <= far(b) ? a : b));
        found.push([offsets[k][1], offsets[k][0], k, 1]);
      }
      return found;
    }

    draw(look, target, views, rows) {
      const gl = this.gl;
      gl.bindBuffer(gl.UNIFORM_BUFFER, this.table);
      gl.bufferSubData(gl.UNIFORM_BUFFER, 0, new Float32Array(views.flat()));
      const mode = this.fronts && this.map ? { plane: 0, sharp: 1, past: 2 }[look.mode] : 0;
      gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
      gl.viewport(0, 0, target.width, target.height);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(0, rows[0], target.width, rows[1] - rows[0]);
      (target === this.finest ? this.program : this.preview).use({
        views: { unit: 1, target: gl.TEXTURE_2D_ARRAY, texture: this.views },
        fronts: { unit: 2, target: gl.TEXTURE_2D_ARRAY, texture: this.fronts || this.none() },
        map: { unit: 3, texture: this.map || this.nothing },
        count: { int: views.length }, reference: { int: this.reference }, mode: { int: mode },
        focus: look.focus, limit: look.limit, jump: LF.scene.jump, scale: this.width / target.width,
        size: [this.width, this.height], camera: [look.camera[1], look.camera[0]],
      });
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      gl.disable(gl.SCISSOR_TEST);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    }

    none() {
      if (!this.empty) {
        const gl = this.gl;
        this.empty = LF.texture(gl, gl.TEXTURE_2D_ARRAY, "NEAREST");
        gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.R16I, 1, 1, 1);
      }
      return this.empty;
    }

    // Waits for the graphics processor, and learns what a sample costs.
    measure(target, samples, started) {
      const gl = this.gl, kind = target === this.finest ? 0 : 1;
      gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      const spent = performance.now() - started;
      if (samples < 5e5 && this.cost[kind] * 5e5 < BUDGET) return spent; // too few to tell from what a draw costs anyway
      this.cost[kind] = 0.6 * this.cost[kind] + 0.4 * spent / Math.max(samples, 1e4);
      return spent;
    }

    // The picture as fine as there is time for while something moves; `finish` makes it exact afterwards.
    quick(look) {
      const full = this.chosen(look), area = this.width * this.height;
      if (area * full.length * this.cost[0] > SLOW && this.software.ready(look, full)) {
        const fits = (target) => target.width * target.height * full.length * this.software.cost <= BUDGET;
        const target = [this.finest, ...this.coarser].find(fits) || this.coarser.at(-1);
        const spent = this.software.draw(look, target, full);
        this.shown = target;
        this.exact = false;
        this.quality = { share: (target.width * target.height) / area, views: full.length, of: full.length, spent };
        this.pending = 0;
        return;
      }
      const choices = [[this.finest, 1], [this.coarser[0], 1], [this.coarser[0], 2], [this.coarser[1], 2],
        [this.coarser[1], 4]];
      for (const [target, thin] of choices) {
        const views = thin === 1 ? full : this.chosen(look, thin);
        const samples = target.width * target.height * views.length;
        if (samples * this.cost[target === this.finest ? 0 : 1] > BUDGET && thin !== 4) continue;
        const started = performance.now();
        this.draw(look, target, views, [0, target.height]);
        const spent = this.measure(target, samples, started);
        this.shown = target;
        this.exact = target === this.finest && views.length === full.length;
        this.quality = { share: (target.width * target.height) / area, views: views.length, of: full.length, spent };
        this.pending = this.exact ? this.height : 0;
        return;
      }
    }

    // Some more rows of the exact picture; true when it is done.
    finish(look) {
      if (this.exact) return true;
      const views = this.chosen(look), each = this.width * views.length;
      const rows = Math.max(4, Math.floor(40 / (each * this.cost[0])));
      const end = Math.min(this.pending + rows, this.height), started = performance.now();
      this.draw(look, this.finest, views, [this.pending, end]);
      this.measure(this.finest, (end - this.pending) * each, started);
      this.pending = end;
      if (end < this.height) return false;
      this.shown = this.finest;
      this.exact = true;
      this.quality = { share: 1, views: views.length, of: views.length };
      return true;
    }

    // Samples (H, W, 4) of the exact picture, first row first.
    read(look) {
      const gl = this.gl, pixels = new Uint8Array(4 * this.width * this.height);
      while (!this.finish(look));
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.finest.frame);
      gl.readPixels(0, 0, this.width, this.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      return pixels;
    }

    // What every view shows of a map, needed before something hidden can be left out; `tell` gets the share done.
    async see(map, tell) {
      const gl = this.gl, { offsets, present, jump } = LF.scene, { width, height } = this;
      if (this.frontsOf === map.id) return;
      const made = LF.texture(gl, gl.TEXTURE_2D_ARRAY, "NEAREST");
      gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.R16I, width, height, this.layers);
      for (let k = 0; k < this.layers; k++) {
        if (!present[k]) continue;
        const [v, u] = offsets[k];
        const front = grown(splat(map.disparity, width, height, v, u, jump), width, height, v !== 0, u !== 0);
        gl.bindTexture(gl.TEXTURE_2D_ARRAY, made);
        gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
        gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, k, width, height, 1, gl.RED_INTEGER, gl.SHORT, front);
        if (k % 6 === 5) { tell(k / this.layers); await new Promise((done) => setTimeout(done)); }
      }
      if (this.fronts) gl.deleteTexture(this.fronts);
      this.fronts = made; this.frontsOf = map.id; this.map = map.textures.disparity;
      tell(1);
    }
  }

  LF.Picture = Picture;
})();
