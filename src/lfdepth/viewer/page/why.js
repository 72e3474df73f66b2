"use strict";
// The evidence of a pixel, drawn: profiles along the planes, the angular patch, epipolar-plane images, decisions.
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const CAUSES = { 0: "no view here", 1: "sees the pixel", 2: "something nearer hides it", 3: "outside the view" };

  function svg(name, attributes = {}, ...children) {
    const element = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    element.append(...children);
    return element;
  }

  function element(name, properties = {}, ...children) {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
  }

  // A chart of profiles: series {values, class, dashes}, with lines at the chosen disparity and the truth.
  function chart(evidence, series, ends, label) {
    const width = 330, height = 120, left = 38, bottom = 18, top = 6, right = 6;
    const { planes } = evidence, low = Math.min(...planes), high = Math.max(...planes);
    const x = (d) => left + (d - low) / (high - low) * (width - left - right);
    const y = (v) => top + (ends[1] - v) / (ends[1] - ends[0]) * (height - top - bottom);
    const drawing = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label });
    for (const at of [ends[0], (ends[0] + ends[1]) / 2, ends[1]]) drawing.append(
      svg("line", { class: "axis", x1: left, x2: width - right, y1: y(at), y2: y(at) }),
      svg("text", { x: left - 4, y: y(at) + 3, "text-anchor": "end" }, String(+at.toPrecision(2))));
    for (const share of [0, 0.5, 1]) {
      const at = low + share * (high - low), anchor = ["start", "middle", "end"][2 * share];
      drawing.append(svg("text", { x: x(at), y: height - 4, "text-anchor": anchor },
        at.toFixed(2) + (share === 0.5 ? " px per view step" : "")));
    }
    const upright = (d, stroke, dashes) => drawing.append(svg("line", { x1: x(d), x2: x(d), y1: top,
      y2: height - bottom, stroke, "stroke-width": 1.6, "stroke-dasharray": dashes }));
    if (evidence.truth !== null && evidence.truth >= low && evidence.truth <= high)
      upright(evidence.truth, "var(--truth)", "2 2");
    upright(Math.min(Math.max(evidence.disparity, low), high), "var(--ink)", "");
    for (const { values, colour, dashes = "" } of series) {
      const points = values.map((v, k) => `${x(planes[k]).toFixed(1)},${y(Math.min(Math.max(v, ends[0]), ends[1])).toFixed(1)}`);
      drawing.append(svg("polyline", { class: "line", points: points.join(" "), stroke: colour, "stroke-dasharray": dashes }));
    }
    return drawing;
  }

  function legend(...entries) {
    return element("div", { className: "legend" }, ...entries.map(([name, text]) =>
      element("span", { className: name, textContent: text })));
  }

  function pictureUrl({ width, height, data }) {
    const bytes = LF.bytesOf(data), canvas = element("canvas", { width, height });
    const pixels = new ImageData(width, height);
    for (let i = 0; i < width * height; i++) pixels.data.set([bytes[3 * i], bytes[3 * i + 1], bytes[3 * i + 2], 255], 4 * i);
    canvas.getContext("2d").putImageData(pixels, 0, 0);
    return canvas.toDataURL();
  }

  function patch(evidence) {
    const { colours, states } = evidence, bytes = LF.bytesOf(colours.data), { width: columns, height: rows } = colours;
    const cell = Math.min(18, 320 / columns), width = columns * cell, height = rows * cell;
    const lines = svg("pattern", { id: "hidden", width: 5, height: 5, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" },
      svg("rect", { width: 5, height: 5, fill: "#0007" }), svg("line", { x1: 0, x2: 0, y1: 0, y2: 5, stroke: "#fff", "stroke-width": 2.4 }));
    const drawing = svg("svg", { viewBox: `-1 -1 332 ${height + 2}`, role: "img", "aria-label": "Angular patch" }, svg("defs", {}, lines));
    for (let v = 0; v < rows; v++) for (let u = 0; u < columns; u++) {
      const i = 3 * (v * columns + u), state = states[v][u];
      const place = { x: u * cell, y: v * cell, width: cell - 1, height: cell - 1 };
      const fill = state === 1 || state === 2 ? `rgb(${bytes[i]},${bytes[i + 1]},${bytes[i + 2]})` : "none";
      const box = svg("rect", { ...place, fill, stroke: "var(--line)" });
      const agrees = evidence.agrees[v][u] ? "agrees in colour" : "differs in colour";
      box.append(svg("title", {}, `view ${v}, ${u}: ${CAUSES[state]}${state === 1 || state === 2 ? ", " + agrees : ""}`));
      drawing.append(box);
      if (state === 2) drawing.append(svg("rect", { ...place, fill: "url(#hidden)", "pointer-events": "none" }));
      if (state === 0 || state === 3) drawing.append(svg("path", { stroke: "var(--line)",
        d: `M${place.x},${place.y}l${cell - 1},${cell - 1}m0,${1 - cell}l${1 - cell},${cell - 1}` }));
      if ((state === 1 || state === 2) && !evidence.agrees[v][u]) drawing.append(svg("circle", { cx: place.x + cell / 2 - 0.5,
        cy: place.y + cell / 2 - 0.5, r: cell / 5, fill: "#fff", stroke: "#000", "stroke-width": 0.8, "pointer-events": "none" }));
    }
    const [v, u] = LF.scene.centre;
    drawing.append(svg("rect", { x: u * cell - 1, y: v * cell - 1, width: cell + 1, height: cell + 1, fill: "none",
      stroke: "var(--accent)", "stroke-width": 2 }));
    return drawing;
  }

  // Rows are views; the pixel wanders along the line that its disparity draws. Vertical ones are laid on their side.
  function epi(evidence, image, start, at, steps, label) {
    const { width, height } = image, w = 330, row = Math.min(10, 90 / height), h = height * row, cell = w / width;
    const drawing = svg("svg", { viewBox: `0 0 ${w} ${h}`, role: "img", "aria-label": label });
    drawing.append(svg("image", { href: pictureUrl(image), width: w, height: h, preserveAspectRatio: "none", "image-rendering": "pixelated" }));
    const line = (disparity, stroke, dashes) => {
      const points = steps.map((step, k) => `${(at - start + 0.5 - disparity * step) * cell},${(k + 0.5) * row}`);
      for (const [colour, wide] of [["#000", 3.4], [stroke, 1.7]]) drawing.append(svg("polyline", { fill: "none",
        points: points.join(" "), stroke: colour, "stroke-width": wide, "stroke-dasharray": dashes }));
    };
    if (evidence.truth !== null) line(evidence.truth, "#35c89a", "3 3");
    line(evidence.disparity, "#fff", "");
    return drawing;
  }

  function steps(vertical) {
    const { grid, centre, offsets } = LF.scene;
    return Array.from({ length: grid[vertical ? 0 : 1] }, (_, k) => vertical
      ? offsets[k * grid[1] + centre[1]][0] : offsets[centre[0] * grid[1] + k][1]);
  }

  function number(value, digits, unit) { return value === null ? "unknown" : `${value.toFixed(digits)}${unit}`; }

  // Fills the panel with the evidence of a pixel.
  function show(panel, evidence) {
    const bounds = (values) => { const low = Math.min(...values), high = Math.max(...values);
      return high > low ? [low, high] : [low - 0.5, high + 0.5]; };
    const truth = evidence.truth === null ? [] : [["truth", "truth"]];
    const sigma = evidence.sigma === null ? "" : ` ± ${evidence.sigma.toFixed(4)}`;
    const rows = evidence.stages.map(({ name, disparity }) => {
      const row = element("tr", {}, element("td", { textContent: name }), element("td", { textContent: disparity.toFixed(3) }));
      if (evidence.decided_by === name) row.className = "decided";
      return row;
    });
    panel.replaceChildren(
      element("p", { className: "hint", textContent: `Pixel (${evidence.x}, ${evidence.y}): disparity ` +
        `${evidence.disparity.toFixed(4)}${sigma} px per view step` +
        (evidence.depth === null ? "" : `, ${evidence.depth.toFixed(3)} m`) +
        (evidence.truth === null ? "." : `; truth ${evidence.truth.toFixed(4)}.`) }),
      element("p", {}, element("b", { textContent: "Decided by: " }), evidence.decision),
      ...evidence.remarks.map((remark) => element("p", { className: "hint", textContent: remark })),
      ...(evidence.glossy ? [element("p", { className: "hint", textContent: "Glossy: high-passed views voted here." })] : []),
      element("h3", { textContent: "Votes along the planes" }),
      chart(evidence, [{ values: evidence.signs, colour: "var(--signs)" },
        { values: evidence.photo_visible, colour: "var(--seen)" },
        { values: evidence.photo, colour: "var(--photo)", dashes: "5 3" }], [-1, 1], "Votes along the planes"),
      legend(["signs", "signs (+ nearer than the plane, − farther)"], ["photo", "share of all views that agree"],
        ["seen", "of those that see the pixel"], ["chosen", "chosen"], ...truth),
      element("h3", { textContent: "Energy (least is best)" }),
      chart(evidence, [{ values: evidence.sign_energy, colour: "var(--signs)", dashes: "5 3" },
        { values: evidence.energy, colour: "var(--energy)" }], bounds([...evidence.energy, ...evidence.sign_energy]), "Energy along the planes"),
      legend(["signs dashed", "signs alone"], ["energy", "signs and photo votes"], ["chosen", "chosen"], ...truth),
      element("h3", { textContent: "What each view shows of it" }), patch(evidence),
      element("p", { className: "hint", textContent: "Hatched: hidden by something nearer. Dot: another colour. Crossed: outside, or no view." }),
      element("h3", { textContent: "Along the row of views" }),
      epi(evidence, evidence.epi_horizontal, evidence.epi_start[0], evidence.x, steps(false), "Horizontal epipolar-plane image"),
      element("h3", { textContent: "Along the column of views" }),
      epi(evidence, evidence.epi_vertical, evidence.epi_start[1], evidence.y, steps(true), "Vertical epipolar-plane image"),
      element("p", { className: "hint", textContent: "White: the slope of the chosen disparity" +
        (truth.length ? "; dashed: of the truth." : ".") }),
      element("h3", { textContent: "What each block leaves (px per view step)" }), element("table", {}, element("tbody", {}, ...rows)),
      element("p", { className: "hint", textContent: `Computed again on a window of ${evidence.window[2]}×${evidence.window[3]} px around the pixel.` }));
  }

  Object.assign(LF, { showWhy: show, element, svg });
})();
