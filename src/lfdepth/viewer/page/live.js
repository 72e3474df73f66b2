"use strict";
// A panel that runs methods: choose one, change its parameters, watch, stop, compare with the run before.
(() => {
  const { element } = LF;

  function field(parameter) {
    const { name, type, choices, default: usual, text, unit, range, without } = parameter;
    const properties = { name, title: `${text} ${range}${without ? `; empty: ${without}` : ""}` };
    let input;
    if (choices.length || type === "bool") {
      const words = choices.length ? choices : ["true", "false"];
      input = element("select", properties, ...words.map((word) => element("option", { value: word,
        textContent: { true: "yes", false: "no" }[word] || word, selected: String(usual) === word })));
    } else input = element("input", { ...properties, type: "text", inputMode: "decimal", value: usual ?? "" });
    input.dataset.usual = usual === null ? "" : String(usual);
    const label = element("label", { className: "row", title: properties.title },
      element("span", { textContent: name.replaceAll("_", " ") + (unit ? ` (${unit})` : "") }), input);
    return label;
  }

  class Live {
    constructor(form, app) {
      Object.assign(this, { form, app });
      this.method = element("select", { name: "method" }, ...LF.facts.methods.map(({ name }) => element("option", { textContent: name })));
      this.summary = element("p", { className: "hint" });
      this.fields = element("fieldset");
      this.low = element("input", { type: "text", inputMode: "decimal", ariaLabel: "Smallest disparity" });
      this.high = element("input", { type: "text", inputMode: "decimal", ariaLabel: "Largest disparity" });
      this.button = element("button", { type: "submit", className: "main", textContent: "Run" });
      this.stop = element("button", { type: "button", textContent: "Stop", hidden: true });
      this.bar = element("progress", { hidden: true, ariaLabel: "Progress" });
      this.told = element("p", { className: "hint", role: "status" });
      form.append(element("label", { className: "row" }, "Method", this.method), this.summary,
        element("div", { className: "row" }, element("span", { textContent: "Range" }), this.low, "to", this.high),
        this.fields, element("div", { className: "buttons" }, this.button, this.stop), this.bar, this.told);
      this.method.addEventListener("change", () => this.choose());
      form.addEventListener("submit", (event) => { event.preventDefault(); this.start(); });
      this.stop.addEventListener("click", () => LF.ask("cancel", { method: "POST",
        headers: { "Content-Type": "application/json" }, body: "{}" }).catch((error) => app.tell(error)));
      const first = LF.facts.maps.find((map) => map.method);
      const wanted = first ? first.method : "fbs-vis";
      if ([...this.method.options].some((option) => option.value === wanted)) this.method.value = wanted;
      if (LF.scene.range) [this.low.value, this.high.value] = LF.scene.range.map((end) => +end.toPrecision(6));
      this.choose(first ? first.parameters : {});
      this.watch();
    }

    choose(values = {}) {
      const chosen = LF.facts.methods.find(({ name }) => name === this.method.value);
      this.summary.textContent = chosen.summary;
      this.fields.replaceChildren(...chosen.parameters.map(field));
      for (const input of this.fields.querySelectorAll("input, select"))
        if (values[input.name] !== undefined) input.value = values[input.name] === null ? "" : String(values[input.name]);
    }

    wanted() {
      const options = {};
      for (const input of this.fields.querySelectorAll("input, select"))
        if (input.value !== input.dataset.usual) options[input.name] = input.value === "" ? "none" : input.value;
      const ends = [this.low.value, this.high.value];
      return { method: this.method.value, options, range: ends[0] === "" && ends[1] === "" ? null : ends };
    }

    async start() {
      this.told.className = "hint";
      try {
        await LF.ask("run", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(this.wanted()) });
        this.watch(true);
      } catch (error) { this.say(error.message, true); }
    }

    say(text, wrong = false) { this.told.textContent = text; this.told.className = wrong ? "error" : "hint"; }

    async watch(started = false) {
      let state, seen = started;
      for (;;) {
        try { state = await (await LF.ask("run")).json(); } catch (error) { this.show(false); this.app.tell(error); return; }
        this.show(state.running);
        if (!state.running) break;
        seen = true;
        this.bar.max = state.total || 1;
        if (state.total) this.bar.value = state.done; else this.bar.removeAttribute("value");
        this.say(`${state.method}: ${state.what}${state.total ? `, ${state.done} of ${state.total}` : " …"}`);
        await new Promise((done) => setTimeout(done, 300));
      }
      if (!seen) return;
      if (state.error) this.say(state.error, true);
      else if (state.cancelled) this.say("Stopped.");
      else if (state.map !== undefined) { this.say("Done; compared with the map before."); await this.app.addMap(state.map); }
    }

    show(running) { this.button.disabled = running; this.stop.hidden = this.bar.hidden = !running; }
  }

  LF.Live = Live;
})();
