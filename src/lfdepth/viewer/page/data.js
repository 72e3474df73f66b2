"use strict";
// Facts and data of the page: from the server behind it, or from the page itself where it was exported.
const LF = {};

(() => {
  const facts = JSON.parse(document.getElementById("page-facts").textContent);
  const held = new Map();
  for (const element of document.querySelectorAll("script[data-name]")) held.set(element.dataset.name, element);

  function bytesOf(base64) {
    const text = atob(base64), bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    return bytes;
  }

  class Gone extends Error {}

  async function ask(path, options) {
    let answer;
    try {
      answer = await fetch(path, { cache: "no-store", ...options });
    } catch {
      throw new Gone("The server has gone: it was stopped, or this machine lost it. What is on the page stays; " +
        "start lfdepth view again for more.");
    }
    if (!answer.ok) {
      const told = await answer.json().catch(() => ({}));
      throw new Error(told.error || `${path}: the server answers ${answer.status}; reload the page`);
    }
    return answer;
  }

  async function bytes(name) {
    if (facts.served) return new Uint8Array(await (await ask(name)).arrayBuffer());
    const element = held.get(name);
    if (!element) throw new Error(`${name}: is not in this page`);
    return bytesOf(element.textContent);
  }

  // A map (H, W) of float32.
  async function floats(name) {
    let data = await bytes(name);
    if (!facts.served) {
      const stream = new Blob([data]).stream().pipeThrough(new DecompressionStream("deflate"));
      data = new Uint8Array(await new Response(stream).arrayBuffer());
    }
    return new Float32Array(data.buffer);
  }

  // What texSubImage3D takes: samples (H, W, 3) as they are, or a decoded picture.
  async function view(row, column) {
    const data = await bytes(`view/${row}/${column}`);
    if (facts.served) return data;
    const options = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
    return createImageBitmap(new Blob([data], { type: "image/jpeg" }), options);
  }

  Object.assign(LF, { facts, scene: facts.scene, ask, floats, view, bytesOf, Gone });
})();
