"use strict";
// One or two panes that show layers (the picture, maps, errors) with one zoom and one place.
(() => {
  // A program for each kind of layer, as a renderer without a graphics processor goes through every branch.
  // 0: picture, nearest pixel; 1: values; 2: first − second; 3: |first − truth| − |second − truth|; 4: picture, smooth
  const fragment = (kind) => `#version 300 es
    #define kind ${kind}
    precision highp float;
    uniform sampler2D first, second, truth, colours;
    uniform vec2 middle, centre, size, ends; uniform float zoom; uniform vec3 around;
    out vec4 colour;
    float value(ivec2 at) {
      float a = texelFetch(first, at, 0).r;
      #if kind == 1
      return a;
      #else
      float b = texelFetch(second, at, 0).r;
      #if kind == 2
      return a - b;
      #else
      float t = texelFetch(truth, at, 0).r;
      return abs(a - t) - abs(b - t);
      #endif
      #endif
    }
    void main() {
      vec2 at = centre + vec2(1, -1) * (gl_FragCoord.xy - middle) / zoom;
      if (any(lessThan(at, vec2(0))) || any(greaterThanEqual(at, size))) { colour = vec4(around, 1); return; }
      #if kind == 0
      colour = vec4(texelFetch(first, ivec2(at), 0).rgb, 1);
      #elif kind == 4
      colour = vec4(textureLod(first, at / size, 0.).rgb, 1);
      #else
      float found = value(ivec2(at));
      if (isnan(found) || isinf(found)) { colour = vec4(vec3(160. / 255.), 1); return; }
      float share = clamp((found - ends.x) / (ends.y - ends.x), 0., 1.);
      colour = vec4(texelFetch(colours, ivec2(min(share * 256., 255.), 0), 0).rgb, 1);
      #endif
    }`;

  class Stage {
    constructor(canvas) {
      const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
      if (!gl) throw new Error("This browser has no WebGL 2, which the page draws with; try another browser, " +
        "or switch hardware acceleration on.");
      if (!gl.getExtension("EXT_color_buffer_float")) gl.getExtension("EXT_color_buffer_half_float");
      Object.assign(this, { canvas, gl, zoom: 1, centre: [LF.scene.width / 2, LF.scene.height / 2], fitted: true });
      this.programs = [0, 1, 2, 3, 4].map((kind) => new LF.Program(gl, fragment(kind)));
      this.colours = {};
      for (const [name, table] of Object.entries(LF.facts.colours))
        this.colours[name] = LF.colourTexture(gl, LF.bytesOf(table));
      this.resize();
    }

    // Takes the canvas's size; keeps the whole picture in sight as long as nobody zoomed.
    resize(count = 1) {
      const box = this.canvas.getBoundingClientRect(), density = window.devicePixelRatio || 1;
      this.width = Math.max(box.width, 1); this.height = Math.max(box.height, 1); this.density = density;
      const size = [Math.round(this.width * density), Math.round(this.height * density)];
      if (this.canvas.width !== size[0] || this.canvas.height !== size[1])
        [this.canvas.width, this.canvas.height] = size;
      this.upright = this.height > this.width * 0.9; // two panes one above the other
      if (this.fitted) this.fit(count);
    }

    // Places of panes, in CSS px: [left, top, width, height].
    places(layout) {
      const { width: w, height: h } = this;
      if (layout !== "two") return [[0, 0, w, h], [0, 0, w, h]];
      if (this.upright) return [[0, 0, w, Math.floor(h / 2) - 1], [0, Math.ceil(h / 2) + 1, w, Math.floor(h / 2) - 1]];
      return [[0, 0, Math.floor(w / 2) - 1, h], [Math.ceil(w / 2) + 1, 0, Math.floor(w / 2) - 1, h]];
    }

    fit(count) {
      const { scene } = LF, [, , w, h] = this.places(count === 2 ? "two" : "one")[0];
      this.fitZoom = Math.min(w / scene.width, h / scene.height);
      this.zoom = this.fitZoom;
      this.centre = [scene.width / 2, scene.height / 2];
      this.fitted = true;
    }

    // Zooms about a place of the stage, so that the pixel there stays.
    zoomAt(factor, x, y, place) {
      const before = this.toScene(x, y, place);
      this.zoom = Math.min(Math.max(this.zoom * factor, this.fitZoom / 4), 64);
      const after = this.toScene(x, y, place);
      this.move(before[0] - after[0], before[1] - after[1]);
    }

    move(dx, dy) {
      const { scene } = LF, inside = (c, size) => Math.min(Math.max(c, 0), size);
      this.centre = [inside(this.centre[0] + dx, scene.width), inside(this.centre[1] + dy, scene.height)];
      this.fitted = false;
    }

    // Scene coordinates, in which pixel (x, y) covers [x, x + 1) × [y, y + 1), of a place of the stage and back.
    toScene(x, y, [left, top, w, h]) {
      return [this.centre[0] + (x - left - w / 2) / this.zoom, this.centre[1] + (y - top - h / 2) / this.zoom];
    }

    toStage(x, y, [left, top, w, h]) {
      return [left + w / 2 + (x - this.centre[0]) * this.zoom, top + h / 2 + (y - this.centre[1]) * this.zoom];
    }

    // Draws layers: [{kind, first, second, colours, ends}], a pane each; with `split` both in one place. Layers that
    // are null stay as they were drawn before.
    draw(layers, layout, split, around) {
      const gl = this.gl, places = this.places(layout), density = this.density;
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.disable(gl.DEPTH_TEST);
      gl.clearColor(...around, 1);
      gl.viewport(0, 0, this.canvas.width, this.canvas.height);
      gl.disable(gl.SCISSOR_TEST);
      if (layers.every((layer) => layer)) gl.clear(gl.COLOR_BUFFER_BIT);
      gl.enable(gl.SCISSOR_TEST);
      layers.forEach((layer, number) => {
        if (!layer) return;
        let [left, top, w, h] = places[number];
        const middle = [(left + w / 2) * density, this.canvas.height - (top + h / 2) * density];
        if (layout === "slider") {
          if (number === 0) w = split * w;
          else { left = split * w; w = w - left; }
        }
        const scissor = (x, y, wide, high) => gl.scissor(Math.round(x * density),
          Math.round(this.canvas.height - (y + high) * density), Math.round(wide * density), Math.round(high * density));
        scissor(left, top, w, h);
        gl.clear(gl.COLOR_BUFFER_BIT);
        // Around the scene nothing is computed: where a processor draws, every pixel counts.
        const [x0, y0] = this.toStage(0, 0, places[number]), [x1, y1] = this.toStage(LF.scene.width, LF.scene.height, places[number]);
        const near = [Math.max(left, Math.floor(x0)), Math.max(top, Math.floor(y0))];
        const far = [Math.min(left + w, Math.ceil(x1)), Math.min(top + h, Math.ceil(y1))];
        if (far[0] <= near[0] || far[1] <= near[1]) return;
        scissor(...near, far[0] - near[0], far[1] - near[1]);
        const smooth = layer.kind === 0 && (this.zoom * density < 1.5 || layer.coarse);
        this.programs[smooth ? 4 : layer.kind].use({
          first: { unit: 0, texture: layer.first }, second: { unit: 1, texture: layer.second || layer.first },
          truth: { unit: 2, texture: layer.truth || layer.first },
          colours: { unit: 3, texture: this.colours[layer.colours || "viridis"] },
          middle, centre: this.centre, size: [LF.scene.width, LF.scene.height],
          ends: layer.ends || [0, 1], zoom: this.zoom * density, around,
        });
        gl.drawArrays(gl.TRIANGLES, 0, 3);
      });
      gl.disable(gl.SCISSOR_TEST);
    }
  }

  LF.Stage = Stage;
})();
