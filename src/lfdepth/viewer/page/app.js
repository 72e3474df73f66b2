"use strict";
// What is chosen, and what happens when somebody drags, presses or clicks.
(() => {
  const { scene, facts, svg, element } = LF;
  const $ = (id) => document.getElementById(id);
  const [V, U] = scene.grid, [row0, column0] = scene.centre;
  const reach = { v: Math.max(row0, V - 1 - row0), u: Math.max(column0, U - 1 - column0) };
  const farthest = Math.max(reach.v, reach.u);

  class App {
    constructor() {
      this.look = { camera: [0, 0], focus: 0, aperture: 0, shape: "square", all: false, mode: "plane", limit: 0 };
      this.state = { mode: "pictures", layout: "two", split: 0.5, layers: ["picture", "a/disparity"], colours: "viridis",
        ends: [0, 1], limit: 0.3, a: null, b: null, pixel: null };
      this.maps = new Map();
      this.truth = null;
      this.dirty = { picture: true, stage: true, words: true };
    }

    async start() {
      $("name").textContent = scene.name;
      const camera = scene.camera ? "" : ", camera unknown";
      $("summary").textContent = `${U}×${V} views of ${scene.width}×${scene.height} px, ` +
        `${scene.channels === 1 ? "grey" : "colour"}${camera}${facts.served ? "" : " (exported page)"}`;
      this.stage = new LF.Stage($("canvas"));
      this.picture = new LF.Picture(this.stage.gl);
      this.solid = new LF.Solid(this.stage.gl);
      this.controls();
      this.pointer();
      this.keys();
      new ResizeObserver(() => { this.stage.resize(this.count()); this.arrange(); this.touch(); }).observe($("stage"));
      $("canvas").addEventListener("webglcontextlost", (event) => { event.preventDefault();
        this.tell(new Error("The browser took the graphics memory away; reload the page. If it comes again: --views or --scale.")); });
      requestAnimationFrame(() => this.frame());
      await this.loadView(scene.centre[0] * U + scene.centre[1]);
      if (scene.truth) this.truth = await this.layer("truth", "truth");
      for (const map of facts.maps) this.maps.set(map.id, map);
      this.listMaps();
      const [first, second] = facts.maps;
      if (first) await this.choose("a", first.id);
      if (second) await this.choose("b", second.id);
      this.state.layers = second ? ["a/disparity", "b/disparity"] : ["picture", first ? "a/disparity" : "picture"];
      if (!first) this.setLayout("one");
      this.resetRanges();
      this.arrange();
      if (facts.served) {
        $("run-panel").hidden = false;
        this.live = new LF.Live($("run"), this);
        setInterval(() => this.ping(), 3000);
      }
      this.why();
      if (this.state.a) $("readout").textContent = "Point at a pixel to read its disparity, click to see why.";
      await this.loadViews();
      this.ready = true;
    }

    // --- data

    async loadView(index) {
      this.picture.add(index, await LF.view(Math.floor(index / U), index % U));
      this.touch(true);
    }

    // The views around the reference view first.
    async loadViews() {
      const far = (k) => Math.hypot(...scene.offsets[k]);
      const waiting = scene.present.map((there, k) => k).filter((k) => scene.present[k] && !this.picture.loaded.includes(k))
        .sort((a, b) => far(a) - far(b));
      const total = waiting.length + 1;
      $("loading").hidden = false;
      const worker = async () => {
        while (waiting.length) {
          await this.loadView(waiting.shift());
          $("loading").textContent = `loading views, ${this.picture.loaded.length} of ${total}`;
        }
      };
      try { await Promise.all([worker(), worker(), worker(), worker()]); } catch (error) { this.tell(error); }
      $("loading").hidden = true;
    }

    async layer(name) {
      const values = await LF.floats(name);
      return { values, texture: LF.floatTexture(this.stage.gl, values, scene.width, scene.height) };
    }

    async load(id) {
      const map = this.maps.get(id);
      if (map.textures) return map;
      const textures = {};
      for (const name of map.layers) {
        const loaded = await this.layer(`map/${id}/${name}`);
        map[name] = loaded.values;
        textures[name] = loaded.texture;
      }
      map.textures = textures;
      return map;
    }

    // Puts a map in place "a", the one shown, or "b", the one compared with.
    async choose(place, id) {
      try {
        this.state[place] = id === null ? null : await this.load(id);
      } catch (error) { this.tell(error); return; }
      $(`map-${place}`).value = id === null ? "" : String(id);
      if (place === "a") { this.describe(); this.why(); if (this.look.mode !== "plane") this.occlusion(); }
      this.arrange();
      this.touch();
    }

    // A run ended: its map is shown, and the one before compared with it.
    async addMap(id) {
      for (const map of await (await LF.ask("maps")).json()) if (!this.maps.has(map.id)) this.maps.set(map.id, map);
      this.listMaps();
      const before = this.state.a;
      await this.choose("a", id);
      await this.choose("b", before ? before.id : null);
      this.state.layers = before ? ["a/disparity", "b/disparity"] : ["picture", "a/disparity"];
      if (before && this.state.layout === "one") this.setLayout("slider");
      this.resetRanges();
      this.arrange();
    }

    // --- panels

    controls() {
      const ends = scene.range || (facts.maps[0] || { span: [-1, 1] }).span;
      const wide = 0.15 * (ends[1] - ends[0]);
      this.slider("focus", ends[0] - wide, ends[1] + wide, (value) => { this.look.focus = Number(value.toFixed(4)); }, () => `${this.look.focus.toFixed(3)} px`);
      this.slider("aperture", 0, farthest, (value) => this.setAperture(value), () => this.look.all ? "all views"
        : this.look.aperture === 0 ? "pinhole" : `± ${this.look.aperture.toFixed(2)} steps`);
      this.slider("past-limit", ends[0], ends[1], (value) => { this.look.limit = value; }, () => `${this.look.limit.toFixed(3)} px`, "past-value");
      this.look.focus = Math.min(Math.max(0, ends[0]), ends[1]);
      this.look.limit = (ends[0] + ends[1]) / 2;
      this.choice("mode", { pictures: "Pictures", solid: "3-D" }, this.state.mode, (mode) => this.setMode(mode));
      this.choice("layout", { one: "One", two: "Side by side", slider: "Slider" }, this.state.layout, (layout) => this.setLayout(layout));
      this.choice("shape", { square: "Square", round: "Round" }, this.look.shape, (shape) => { this.look.shape = shape; this.setAperture(this.look.aperture); this.touch(true); });
      this.choice("solid-kind", { mesh: "Mesh", points: "Points" }, this.solid.kind, (kind) => { this.solid.kind = kind; $("point-row").hidden = kind === "mesh"; this.touch(); });
      $("point-row").hidden = true;
      this.slider("cut", 0.01, Math.max(1, 2 * scene.cut), (value) => { this.solid.cut = value; }, () => `${this.solid.cut.toFixed(2)} px`);
      this.slider("point", 1, 6, (value) => { this.solid.point = value; }, () => `${this.solid.point} px`);
      $("solid-unit").textContent = this.solid.metres ? "In metres, by the scene's camera."
        : "The camera is unknown: heights are disparities, not metres.";
      for (const name of ["sharp", "past"]) $(name).addEventListener("change", () => {
        if ($(name).checked) $(name === "sharp" ? "past" : "sharp").checked = false;
        this.occlusion();
      });
      $("centre").addEventListener("click", () => { this.moveCamera(0, 0); });
      $("whole").addEventListener("click", () => { this.stage.fit(this.count()); this.solid.reset(); this.touch(); });
      for (const place of ["a", "b"]) $(`map-${place}`).addEventListener("change", (event) =>
        this.choose(place, event.target.value === "" ? null : Number(event.target.value)));
      const names = { viridis: "Viridis", cividis: "Cividis", grey: "Grey" };
      $("colours").append(...Object.entries(names).map(([value, textContent]) => element("option", { value, textContent })));
      $("colours").addEventListener("change", () => { this.state.colours = $("colours").value; this.touch(); this.bars(); });
      for (const [k, name] of ["low", "high"].entries()) $(name).addEventListener("change", () => {
        const ends = [...this.state.ends], value = Number($(name).value);
        ends[k] = value;
        if ($(name).value !== "" && ends[0] < ends[1]) this.state.ends = ends;
        else this.tell(new Error("The lowest disparity has to be below the highest."), 4000);
        this.showRanges();
      });
      $("limit").addEventListener("change", () => { const value = Number($("limit").value); if (value > 0) this.state.limit = value; this.showRanges(); });
      $("auto").addEventListener("click", () => this.resetRanges());
      $("split").addEventListener("keydown", (event) => { const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
        if (step) { this.setSplit(this.state.split + step); event.preventDefault(); } });
      this.drawGrid();
    }

    slider(id, low, high, change, text, output = `${id}-value`) {
      const input = $(id);
      input.min = low; input.max = high;
      if (input.step === "any") input.step = (high - low) / 1000;
      input.addEventListener("input", () => { change(Number(input.value)); this.touch(true); });
      (this.outputs ||= []).push(() => {
        const values = { focus: this.look.focus, aperture: this.look.all ? farthest : this.look.aperture, "past-limit": this.look.limit,
          cut: this.solid.cut, point: this.solid.point };
        if (document.activeElement !== input || Math.abs(Number(input.value) - values[id]) > Number(input.step)) input.value = values[id];
        $(output).textContent = text();
      });
    }

    choice(id, names, chosen, change) {
      const buttons = Object.entries(names).map(([value, textContent]) => {
        const button = element("button", { type: "button", textContent });
        button.dataset.value = value;
        button.addEventListener("click", () => { this.press(id, value); change(value); });
        return button;
      });
      $(id).replaceChildren(...buttons);
      this.press(id, chosen);
    }

    press(id, value) { for (const button of $(id).children) button.setAttribute("aria-pressed", String(button.dataset.value === value)); }

    setAperture(value) {
      this.look.all = value >= farthest && this.look.shape === "square";
      this.look.aperture = value;
    }

    setMode(mode) {
      this.state.mode = mode;
      if (mode === "solid") $("solid-panel").open = true;
      this.press("mode", mode);
      this.arrange();
      this.touch();
    }

    setLayout(layout) {
      this.state.layout = layout;
      this.press("layout", layout);
      if (this.stage.fitted) this.stage.fit(this.count());
      this.arrange();
      this.touch();
    }

    setSplit(share) { this.state.split = Math.min(Math.max(share, 0.02), 0.98); this.placeSplit(); this.touch(); }

    count() { return this.state.layout === "two" && this.state.mode === "pictures" ? 2 : 1; }

    moveCamera(v, u) {
      const inside = (value, low, high) => Math.min(Math.max(value, low), high);
      this.look.camera = [inside(v, -row0, V - 1 - row0), inside(u, -column0, U - 1 - column0)];
      this.touch(true);
    }

    focusOn(x, y) {
      const map = this.state.a;
      if (!map) { this.tell(new Error("There is no map that says where the pixel is; give one, or run a method."), 5000); return; }
      this.look.focus = map.disparity[y * scene.width + x];
      if (this.look.aperture === 0) this.setAperture(farthest);
      this.touch(true);
    }

    // Starts or ends leaving out what is hidden: takes what every view shows of the map.
    async occlusion() {
      const wanted = $("sharp").checked ? "sharp" : $("past").checked ? "past" : "plane";
      $("past-row").hidden = wanted !== "past";
      if (wanted !== "plane" && !this.state.a) {
        $("sharp").checked = $("past").checked = false;
        this.tell(new Error("This takes a map; give one, or run a method."), 5000);
        return;
      }
      if (wanted !== "plane") {
        this.look.camera = [0, 0];
        if (this.look.aperture === 0) this.setAperture(farthest);
        $("loading").hidden = false;
        await this.picture.see(this.state.a, (share) => { $("loading").textContent = `what each view sees, ${Math.round(100 * share)} %`; });
        $("loading").hidden = true;
      }
      this.look.mode = wanted;
      this.touch(true);
    }

    listMaps() {
      const options = () => [...this.maps.values()].map((map) => element("option", { value: map.id, textContent: `${map.id + 1}: ${map.name}` }));
      for (const place of ["a", "b"]) {
        const chosen = this.state[place];
        $(`map-${place}`).replaceChildren(...(place === "b" || !this.maps.size ? [element("option", { value: "", textContent: "none" })] : []), ...options());
        $(`map-${place}`).value = chosen ? String(chosen.id) : "";
      }
    }

    describe() {
      const map = this.state.a, lines = [];
      if (map && map.method) lines.push(`${map.method}, ${map.planes} planes, ${map.runtime_s.toFixed(1)} s`);
      if (map && map.range) lines.push(`searched ${map.range.map((end) => end.toFixed(3)).join(" to ")} px per view step${map.range_found ? " (found in the views)" : ""}`);
      if (map && map.disparity && this.truth) {
        let wrong = 0, known = 0;
        this.truth.values.forEach((t, i) => { if (Number.isFinite(t)) { known++; wrong += Math.abs(map.disparity[i] - t) > 0.07; } });
        if (known) lines.push(`${(100 * wrong / known).toFixed(2)} % of the pixels are off by more than 0.07 px`);
      }
      const warnings = (map && map.warnings) || [];
      $("facts").replaceChildren(...lines.map((textContent) => element("li", { textContent })),
        ...warnings.map((textContent) => element("li", { textContent, className: "warning" })));
    }

    resetRanges() {
      const values = this.truth ? this.truth.values : this.state.a && this.state.a.disparity;
      let low = Infinity, high = -Infinity;
      for (const value of values || []) if (Number.isFinite(value)) { if (value < low) low = value; if (value > high) high = value; }
      if (low > high) [low, high] = scene.range || [-1, 1]; // no map
      if (low === high) [low, high] = [low - 0.5, high + 0.5];
      this.state.ends = [low, high];
      this.showRanges();
    }

    showRanges() {
      const tidy = (value) => String(+value.toPrecision(4));
      [$("low").value, $("high").value] = this.state.ends.map(tidy);
      $("limit").value = this.state.limit;
      this.bars();
      this.touch();
    }

    // --- panes

    // Layers that there are, by key, with what people call them.
    layers() {
      const found = { picture: "Picture (views)" };
      for (const place of ["a", "b"]) {
        const map = this.state[place];
        if (!map) continue;
        const who = this.maps.size > 1 ? ` – ${map.id + 1}: ${map.name}` : ` – ${map.name}`;
        found[`${place}/disparity`] = `Disparity${who}`;
        if (map.confidence) found[`${place}/confidence`] = `Confidence${who}`;
        if (map.sigma) found[`${place}/sigma`] = `Standard error${who}`;
        if (this.truth) found[`${place}/error`] = `Error${who}`;
      }
      if (this.truth) found.truth = "Truth";
      if (this.state.a && this.state.b) {
        found.difference = "Difference of the two maps";
        if (this.truth) found.better = "Which map is nearer to the truth";
      }
      return found;
    }

    spec(key) {
      const { a, b, ends, colours, limit } = this.state, [place, name] = key.split("/"), map = this.state[place];
      const signed = { colours: "signed", ends: [-limit, limit] };
      const unit = "px per view step";
      if (key === "picture") return { kind: 0, first: this.picture.shown.texture, coarse: this.picture.shown !== this.picture.finest };
      if (key === "truth") return { kind: 1, first: this.truth.texture, colours, ends, unit };
      if (key === "difference") return { kind: 2, first: a.textures.disparity, second: b.textures.disparity, ...signed, unit: `first − second, ${unit}` };
      if (key === "better") return { kind: 3, first: a.textures.disparity, second: b.textures.disparity, truth: this.truth.texture, ...signed, unit: "blue: first map nearer, red: second" };
      if (name === "disparity") return { kind: 1, first: map.textures.disparity, colours, ends, unit };
      if (name === "confidence") return { kind: 1, first: map.textures.confidence, colours: "cividis", ends: [0, 1], unit: "confidence" };
      if (name === "sigma") return { kind: 1, first: map.textures.sigma, colours: "cividis", ends: [0, limit / 3], unit: `standard error, ${unit}` };
      return { kind: 2, first: map.textures.disparity, second: this.truth.texture, ...signed, unit: "red: too near, blue: too far" };
    }

    // Puts the panes' menus and colour bars in their places.
    arrange() {
      if (!this.stage) return;
      const pictures = this.state.mode === "pictures", known = this.layers();
      const fallbacks = ["picture", this.state.a ? "a/disparity" : "picture"];
      this.state.layers = this.state.layers.map((key, k) => (known[key] ? key : fallbacks[k]));
      const count = pictures ? (this.state.layout === "one" ? 1 : 2) : 0;
      $("stage").classList.toggle("two", this.count() === 2);
      $("layout").hidden = !pictures;
      $("split").hidden = !(pictures && this.state.layout === "slider");
      const places = this.stage.places(this.state.layout), panes = [];
      for (let k = 0; k < count; k++) {
        const menu = element("select", { ariaLabel: `Layer ${k + 1}` },
          ...Object.entries(known).map(([value, textContent]) => element("option", { value, textContent })));
        menu.value = this.state.layers[k];
        menu.addEventListener("change", () => { this.state.layers[k] = menu.value; this.bars(); this.touch(); });
        const pane = element("div", { className: "pane" }, menu, element("div", { className: "bar", hidden: true }));
        let [left, top, w, h] = places[k];
        if (this.state.layout === "slider") { w = w / 2; left = k * w; if (k === 1) pane.style.alignItems = "flex-end"; }
        Object.assign(pane.style, { left: `${left}px`, top: `${top}px`, width: `${w}px`, height: `${h}px` });
        panes.push(pane);
      }
      $("panes").replaceChildren(...panes);
      this.placeSplit();
      this.bars();
    }

    placeSplit() {
      $("split").style.left = `${100 * this.state.split}%`;
      $("split").setAttribute("aria-valuenow", String(Math.round(100 * this.state.split)));
    }

    bars() {
      [...$("panes").children].forEach((pane, k) => {
        const bar = pane.querySelector(".bar"), { colours, ends, unit } = this.spec(this.state.layers[k]);
        bar.hidden = !colours;
        bar.style.display = colours ? "" : "none";
        if (!colours) return;
        const canvas = element("canvas", { width: 256, height: 1 }), table = LF.bytesOf(facts.colours[colours]);
        const pixels = new ImageData(256, 1);
        for (let i = 0; i < 256; i++) pixels.data.set([table[3 * i], table[3 * i + 1], table[3 * i + 2], 255], 4 * i);
        canvas.getContext("2d").putImageData(pixels, 0, 0);
        bar.replaceChildren(element("span", { textContent: String(+ends[0].toPrecision(3)) }), canvas,
          element("span", { textContent: String(+ends[1].toPrecision(3)) }), element("small", { textContent: unit }));
      });
    }

    // --- drawing

    // Something has changed: where and what is shown, or only the picture itself.
    touch(picture = false) {
      this.dirty.words = true;
      if (picture && this.state.mode === "pictures") this.dirty.picture = true; else this.dirty.stage = true;
    }

    frame() {
      requestAnimationFrame(() => this.frame());
      if (!this.picture.loaded.length) return;
      const now = performance.now();
      const seen = this.state.mode === "pictures" && (this.state.layers[0] === "picture" || (this.state.layout !== "one" && this.state.layers[1] === "picture"));
      let news = false;
      if (this.dirty.picture && seen) {
        this.picture.quick(this.look);
        this.movedAt = now;
        this.dirty.picture = false;
        news = true;
      } else if (seen && !this.picture.exact && now - this.movedAt > 150) news = this.picture.finish(this.look);
      if (this.dirty.words || news) this.words();
      if (!this.dirty.stage && !news) return;
      const only = !this.dirty.stage; // nothing but the picture has changed
      this.dirty.stage = false;
      this.render(only);
    }

    render(only = false) {
      const around = this.background();
      if (this.state.mode === "solid") {
        const canvas = $("canvas");
        if (this.state.a) this.solid.draw(this.state.a, this.picture, canvas.width, canvas.height, around);
      } else {
        const layers = this.state.layers.slice(0, this.state.layout === "one" ? 1 : 2)
          .map((key) => (only && key !== "picture" ? null : this.spec(key)));
        this.stage.draw(layers, this.state.layout, this.state.split, around);
      }
      if (!only) this.drawMarks();
    }

    // What the panel says of the picture, and the place of the camera in the grid.
    words() {
      this.dirty.words = false;
      for (const show of this.outputs) show();
      const quality = this.picture.quality;
      $("quality").textContent = !quality || this.picture.exact || this.state.mode !== "pictures" ? "" : `Preview while something moves: ${quality.views} of ${quality.of} views` +
        (quality.share < 0.9 ? `, ${Math.round(1 / Math.sqrt(quality.share))} times coarser.` : ", whole pixels.");
      this.moveDot();
    }

    background() {
      const found = getComputedStyle($("stage")).backgroundColor.match(/[\d.]+/g).map(Number);
      return found.slice(0, 3).map((part) => part / 255);
    }

    drawMarks() {
      const marks = [];
      if (this.state.pixel && this.state.mode === "pictures") {
        const [x, y] = this.state.pixel, places = this.stage.places(this.state.layout).slice(0, this.state.layout === "two" ? 2 : 1);
        for (const place of places) {
          const [cx, cy] = this.stage.toStage(x + 0.5, y + 0.5, place), r = Math.max(6, this.stage.zoom * 0.8);
          if (cx < place[0] || cy < place[1] || cx > place[0] + place[2] || cy > place[1] + place[3]) continue;
          for (const [stroke, wide] of [["#000", 3], ["#fff", 1.4]])
            marks.push(svg("path", { stroke, "stroke-width": wide, fill: "none",
              d: `M${cx - r - 6},${cy}h6M${cx + r},${cy}h6M${cx},${cy - r - 6}v6M${cx},${cy + r}v6M${cx - r},${cy - r}h${2 * r}v${2 * r}h${-2 * r}z` }));
        }
      }
      $("marks").replaceChildren(...marks);
    }

    drawGrid() {
      const drawing = $("grid"), side = 96, cell = (side - 12) / Math.max(2 * farthest, 1);
      drawing.setAttribute("viewBox", `0 0 ${side} ${side}`);
      const at = (step) => side / 2 + step * cell;
      drawing.append(...scene.offsets.map(([v, u], k) => svg("circle", { cx: at(u), cy: at(v), r: Math.min(3, cell * 0.32),
        fill: scene.present[k] ? "var(--soft)" : "none", stroke: "var(--line)" })));
      this.dot = svg("circle", { r: 5, fill: "var(--accent)", stroke: "var(--panel)", "stroke-width": 1.5 });
      this.lens = svg("g", { fill: "var(--accent)", "fill-opacity": 0.18, stroke: "var(--accent)" });
      drawing.append(this.lens, this.dot);
      this.gridAt = at;
      const go = (event) => {
        const box = drawing.getBoundingClientRect(), step = (place, size) => (place * side / size - side / 2) / cell;
        this.moveCamera(step(event.clientY - box.top, box.height), step(event.clientX - box.left, box.width));
      };
      drawing.addEventListener("pointerdown", (event) => { drawing.setPointerCapture(event.pointerId); go(event); });
      drawing.addEventListener("pointermove", (event) => { if (event.buttons) go(event); });
    }

    moveDot() {
      const [v, u] = this.look.camera, at = this.gridAt, { aperture } = this.look;
      this.dot.setAttribute("cx", at(u)); this.dot.setAttribute("cy", at(v));
      const wide = at(aperture) - at(0);
      this.lens.replaceChildren(this.look.shape === "round" ? svg("circle", { cx: at(u), cy: at(v), r: wide })
        : svg("rect", { x: at(u) - wide, y: at(v) - wide, width: 2 * wide, height: 2 * wide }));
    }

    // --- hands

    paneAt(x, y) {
      const places = this.stage.places(this.state.layout);
      if (this.state.layout === "one") return [0, places[0]];
      if (this.state.layout === "slider") return [x / this.stage.width < this.state.split ? 0 : 1, places[0]];
      const second = x >= places[1][0] && y >= places[1][1];
      return [second ? 1 : 0, places[second ? 1 : 0]];
    }

    pixelAt(x, y) {
      const [px, py] = this.stage.toScene(x, y, this.paneAt(x, y)[1]).map(Math.floor);
      return px >= 0 && py >= 0 && px < scene.width && py < scene.height ? [px, py] : null;
    }

    pointer() {
      const canvas = $("canvas"), fingers = new Map();
      const place = (event) => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
      let moved = 0, pinch = null, grabbed = "picture"; // what a drag began on
      canvas.addEventListener("pointerdown", (event) => {
        canvas.setPointerCapture(event.pointerId);
        fingers.set(event.pointerId, place(event));
        moved = fingers.size > 1 ? 99 : 0;
        pinch = null;
        grabbed = this.state.layers[this.state.layout === "one" ? 0 : this.paneAt(...place(event))[0]];
      });
      canvas.addEventListener("pointermove", (event) => {
        const at = place(event), before = fingers.get(event.pointerId);
        if (!before) { this.hover(at); return; }
        const [dx, dy] = [at[0] - before[0], at[1] - before[1]];
        moved += Math.abs(dx) + Math.abs(dy);
        fingers.set(event.pointerId, at);
        if (fingers.size === 2) { pinch = this.pinch([...fingers.values()], pinch); return; }
        if (moved < 4) return;
        const aside = event.shiftKey || event.buttons > 1;
        if (this.state.mode === "solid") { if (aside) this.solid.slide(dx, dy, this.stage.height); else this.solid.turn(dx, dy); this.touch(); return; }
        if (aside || grabbed !== "picture" || this.look.mode !== "plane") { this.stage.move(-dx / this.stage.zoom, -dy / this.stage.zoom); this.touch(); return; }
        // Across a quarter of the stage the camera goes from one end of the grid to the other; it follows the hand's
        // view of the scene: what is near moves with the hand.
        const step = 4 / Math.min(this.stage.width, this.stage.height);
        this.moveCamera(this.look.camera[0] - dy * step * reach.v, this.look.camera[1] - dx * step * reach.u);
      });
      const up = (event) => {
        const at = fingers.get(event.pointerId);
        fingers.delete(event.pointerId);
        if (event.type === "pointerup" && at && moved < 4 && event.button === 0 && this.state.mode === "pictures") this.click(at);
      };
      canvas.addEventListener("pointerup", up);
      canvas.addEventListener("pointercancel", up);
      canvas.addEventListener("contextmenu", (event) => event.preventDefault());
      canvas.addEventListener("wheel", (event) => {
        event.preventDefault();
        const factor = Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0016)), at = place(event);
        if (this.state.mode === "solid") this.solid.approach(factor); else this.stage.zoomAt(factor, ...at, this.paneAt(...at)[1]);
        this.touch();
      }, { passive: false });
      const split = $("split");
      split.addEventListener("pointerdown", (event) => split.setPointerCapture(event.pointerId));
      split.addEventListener("pointermove", (event) => { if (event.buttons) this.setSplit(place(event)[0] / this.stage.width); });
    }

    pinch([a, b], before) {
      const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], apart = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (before && this.state.mode === "solid") { this.solid.approach(apart / before.apart); this.solid.slide(middle[0] - before.middle[0], middle[1] - before.middle[1], this.stage.height); }
      else if (before) {
        this.stage.move(-(middle[0] - before.middle[0]) / this.stage.zoom, -(middle[1] - before.middle[1]) / this.stage.zoom);
        this.stage.zoomAt(apart / before.apart, ...middle, this.paneAt(...middle)[1]);
      }
      this.touch();
      return { middle, apart };
    }

    keys() {
      $("canvas").addEventListener("keydown", (event) => {
        const step = event.shiftKey ? 1 : 0.25, [v, u] = this.look.camera;
        const moves = { ArrowLeft: [v, u - step], ArrowRight: [v, u + step], ArrowUp: [v - step, u], ArrowDown: [v + step, u] };
        if (event.ctrlKey || event.metaKey || event.altKey) return;
        if (moves[event.key] && this.state.mode === "solid") this.solid.turn(...{ ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, -20], ArrowDown: [0, 20] }[event.key]);
        else if (moves[event.key] && this.look.mode === "plane") this.moveCamera(...moves[event.key]);
        else if (event.key === "+" || event.key === "=" || event.key === "-") {
          const factor = event.key === "-" ? 0.8 : 1.25;
          if (this.state.mode === "solid") this.solid.approach(factor); else this.zoomMiddle(factor);
        } else if (event.key === "0") { this.stage.fit(this.count()); this.solid.reset(); this.moveCamera(0, 0); }
        else if (event.key === "f" && this.state.pixel) this.focusOn(...this.state.pixel);
        else return;
        this.touch();
        event.preventDefault();
      });
    }

    zoomMiddle(factor) {
      const place = this.stage.places(this.state.layout)[0];
      this.stage.zoomAt(factor, place[0] + place[2] / 2, place[1] + place[3] / 2, place);
    }

    hover(at) {
      if (this.state.mode !== "pictures") return;
      const pixel = this.pixelAt(...at);
      if (pixel) this.readout(...pixel);
    }

    readout(x, y) {
      const i = y * scene.width + x, parts = [["x", x], ["y", y]];
      for (const [place, label] of [["a", "disparity"], ["b", "second map"]]) {
        const map = this.state[place];
        if (!map) continue;
        const d = map.disparity[i];
        parts.push([label, d.toFixed(4) + (map.sigma ? ` ± ${map.sigma[i].toFixed(4)}` : "") + " px"]);
        if (place === "b") continue;
        if (scene.camera) { const z = this.solid.depth(d); parts.push(["depth", Number.isFinite(z) ? `${z.toFixed(3)} m` : "infinite"]); }
        if (map.confidence) parts.push(["confidence", map.confidence[i].toFixed(2)]);
      }
      if (this.truth) {
        const t = this.truth.values[i];
        parts.push(["truth", Number.isFinite(t) ? `${t.toFixed(4)} px` : "unknown"]);
        if (Number.isFinite(t) && this.state.a) parts.push(["error", (this.state.a.disparity[i] - t).toFixed(4)]);
      }
      $("readout").replaceChildren(...parts.map(([name, value]) => element("span", {}, `${name} `, element("b", { textContent: String(value) }), " ")));
    }

    click(at) {
      const pixel = this.pixelAt(...at);
      $("canvas").focus({ preventScroll: true });
      if (!pixel) return;
      this.state.pixel = pixel;
      this.readout(...pixel);
      if ($("click-focus").checked) this.focusOn(...pixel);
      this.touch();
      const wide = matchMedia("(min-width: 761px)").matches && !$("click-focus").checked;
      return this.why().then(() => {
        if (wide) { $("why-panel").open = true; $("why-panel").scrollIntoView({ block: "start" }); }
      });
    }

    // --- why

    async why() {
      const panel = $("why"), { pixel, a } = this.state;
      const hint = (textContent) => panel.replaceChildren(element("p", { className: "hint", textContent }));
      if (!facts.served) { hint("An exported page holds no evidence: it is computed on demand. Run lfdepth view on the scene to ask about pixels."); return; }
      if (!a) { hint("Evidence takes a map; give one, or run a method."); return; }
      if (!pixel) { hint("Click a pixel to see its evidence."); return; }
      const asked = (this.asked = {}), began = performance.now();
      try {
        const evidence = await (await LF.ask(`why?map=${a.id}&x=${pixel[0]}&y=${pixel[1]}`)).json();
        if (this.asked !== asked) return; // another pixel was clicked meanwhile
        this.evidence = evidence;
        LF.showWhy(panel, evidence);
        this.whyTook = performance.now() - began;
      } catch (error) { hint(error.message); if (error instanceof LF.Gone) this.tell(error); }
    }

    // --- the server

    async ping() {
      try { await LF.ask("ping"); if (this.gone) { this.gone = false; $("message").hidden = true; } } catch (error) { this.gone = true; this.tell(error); }
    }

    tell(error, forget = 0) {
      $("message").textContent = error.message;
      $("message").hidden = false;
      clearTimeout(this.forgetting);
      if (forget) this.forgetting = setTimeout(() => { $("message").hidden = true; }, forget);
    }
  }

  LF.app = new App();
  LF.app.start().catch((error) => { LF.app.tell(error); console.error(error); });
})();
