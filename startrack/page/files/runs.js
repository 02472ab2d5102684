"use strict";
// A search and trials: started, watched, stopped, looked into.

const EVERY = 400; // ms between two looks

const SVG = "http://www.w3.org/2000/svg";

function shape(svg, name, values, text) {
  const made = document.createElementNS(SVG, name);
  Object.entries(values).forEach(([key, value]) => made.setAttribute(key, value));
  if (text !== undefined) made.textContent = text;
  svg.append(made);
  return made;
}

// Points over their number, with a logarithmic height; `look` of each: [symbol, colour, filled].
function scatter(svg, values, look, title, hover, click) {
  const wide = svg.clientWidth || 400, high = svg.clientHeight || 240;
  const [left, right, top, bottom] = [58, wide - 10, 30, high - 34];
  svg.setAttribute("viewBox", `0 0 ${wide} ${high}`);
  svg.replaceChildren();
  const good = values.filter((value) => value > 0);
  if (!good.length) return;
  const low = Math.log(Math.min(...good)) - 0.05, top10 = Math.log(Math.max(...good)) + 0.05;
  const x = (n) => left + (right - left) * (n + 0.5) / Math.max(values.length, 10);
  const y = (value) => bottom - (bottom - top) * (Math.log(value) - low) / (top10 - low);
  for (const part of [0, 0.5, 1]) {
    const value = Math.exp(low + part * (top10 - low));
    shape(svg, "line", { x1: left, x2: right, y1: y(value), y2: y(value), stroke: "#dde3ea" });
    shape(svg, "text", { x: left - 5, y: y(value) + 4, "text-anchor": "end" }, digits(value, 3));
  }
  shape(svg, "text", { x: 2, y: 12 }, title[1]);
  shape(svg, "text", { x: right, y: high - 4, "text-anchor": "end" }, title[0]);
  shape(svg, "text", { x: left, y: bottom + 15 }, "0");
  shape(svg, "text", { x: right, y: bottom + 15, "text-anchor": "end" }, Math.max(values.length, 10));
  values.forEach((value, n) => {
    const [symbol, colour, filled] = look(n);
    const at = [x(n), value > 0 ? y(value) : value === 0 ? bottom : top];
    const style = { stroke: colour, fill: filled ? colour : "white", "data-n": n };
    const made = symbol === "circle"
      ? shape(svg, "circle", { cx: at[0], cy: at[1], r: 4, ...style })
      : shape(svg, "path", { d: `M${at[0]} ${at[1] - 6}l6 10h-12z`, ...style });
    made.addEventListener("pointerenter", () => hover(n));
    made.addEventListener("click", () => click(n));
  });
}

class Run {
  constructor(name) {
    this.name = name;
    this.box = byId(name);
    this.svg = this.box.querySelector("svg");
    this.buttons = Object.fromEntries([...this.box.querySelectorAll("[data-do]")]
      .map((button) => [button.dataset.do, button]));
    this.buttons.start.addEventListener("click", () => this.start());
    this.buttons.stop.addEventListener("click", async () => {
      this.tell("Stopping.");
      await ask(`${name}/stop`);
      this.look();
    });
  }

  tell(text, where = "line") {
    this.box.querySelector(`.${where}`).textContent = text;
  }

  async begin(body) {
    const reply = await ask(`${this.name}/start`, { changes: sides[active].list, ...body });
    if (reply && reply.refused) {
      this.tell(reply.refused);
      return;
    }
    this.look();
  }

  async look() {
    clearTimeout(this.timer);
    const state = await ask(`${this.name}/state`, this.asked());
    if (!state) return;
    this.show(state);
    this.buttons.stop.disabled = !state.running;
    this.buttons.start.disabled = state.running;
    if (state.running) this.timer = setTimeout(() => this.look(), EVERY);
  }
}

class Search extends Run {
  constructor() {
    super("search");
    this.forget();
    this.buttons.take.addEventListener("click", () => this.take(this.bestOf()));
  }

  forget() {
    this.first = 0;
    this.designs = [];
    this.stage = "";
  }

  asked() {
    return { first: this.first };
  }

  start() {
    this.forget();
    this.begin({});
  }

  show(state) {
    if (state.count < this.first) this.forget();
    for (const line of state.lines) {
      if (line.stage) this.stage = `${line.stage}, ${Math.round(100 * line.part)} %`;
      else this.designs.push(line);
    }
    this.first = state.count;
    const count = `${this.designs.length} results`;
    const stage = this.stage || (this.designs.length ? "forecasts" : "the processes start");
    if (state.running) this.tell(`Searching: ${stage}; ${count}.`);
    else if (state.stopped) this.tell(`Stopped after ${count}; Start continues.`);
    else if (state.result) {
      const kept = state.result.start_stays ? " No better design was found: the start stays." : "";
      this.tell(`Ended: ${state.result.ending}.${kept} best.toml is in ${about.folder}/search.`);
    } else if (state.status) this.tell(`The search failed: ${state.message}`);
    this.buttons.start.textContent = state.stopped ? "Continue" : "Start";
    const best = this.bestOf();
    this.buttons.take.disabled = !best;
    this.box.querySelector(".best").textContent = best
      ? `Best that meets all limits: ${digits(best.value, 3)}, by ${best.by}. ${this.limits(best)}`
      : this.designs.length ? `No design meets all limits yet. ${this.missed()}` : "";
    if (!state.lines.length && this.drawn === this.designs.length) return;
    this.drawn = this.designs.length;
    scatter(this.svg, this.designs.map((design) => design.value),
      (n) => {
        const { by, met } = this.designs[n];
        return [by === "formula" ? "circle" : "triangle", met ? BLUE : RED, met];
      },
      ["results: ○ formula, △ trials; filled: all limits met", "error, or what is made small; at the top: no forecast"],
      (n) => this.tell(this.words(this.designs[n]), "hover"), (n) => this.take(this.designs[n]));
  }

  bestOf() {
    const met = this.designs.filter((design) => design.met && design.value > 0);
    const tried = met.filter((design) => design.by !== "formula");
    return (tried.length ? tried : met).reduce(
      (best, design) => !best || design.value < best.value ? design : best, null);
  }

  limits(design) {
    // Of chances, which end at a small margin, only those that are missed.
    const close = Object.entries(design.margins).sort((a, b) => a[1] - b[1])
      .filter(([name, margin]) => margin < 0 || !/^(availability|false)/.test(name)).slice(0, 2);
    return close.length
      ? `Nearest limits: ${close.map(([name, margin]) => `${name} (${signed(margin)})`).join(", ")}.` : "";
  }

  missed() {
    const names = new Map();
    this.designs.forEach((design) => Object.entries(design.margins).forEach(([name, margin]) => {
      if (margin < 0) names.set(name, (names.get(name) || 0) + 1);
    }));
    const most = [...names].sort((a, b) => b[1] - a[1])[0];
    return most ? `${most[0]} is missed by ${most[1]} of ${this.designs.length}.` : "";
  }

  words(design) {
    const values = this.texts(design).map(([key, text]) => `${key.split(".").pop()} ${text}`);
    return `${digits(design.value)} by ${design.by}: ${values.join(", ")}. ${this.limits(design)}`;
  }

  texts(design) {
    const known = new Map(sides.A.shown.sliders.map((slider) => [slider.key, slider]));
    return Object.entries(design.values).map(([key, value]) => {
      const slider = known.get(key);
      const size = slider ? slider.si : 1;
      return [key, `${+(value / size).toPrecision(12)} ${slider ? slider.unit : ""}`.trim()];
    });
  }

  async take(design) {
    if (!design) return;
    const side = sides[active];
    side.begin();
    this.texts(design).forEach(([key, text]) => side.changes.set(key, text));
    await side.paint();
    side.end();
  }
}

class Trials extends Run {
  constructor() {
    super("trials");
    this.state = null;
    this.buttons.worst.addEventListener("click", () => this.image(this.worst()));
    byId("trials-fidelity").replaceChildren(...about.fidelities.map((name) => element("option", name)));
    byId("trials-fidelity").hidden = about.fidelities.length < 2;
  }

  asked() {
    return {};
  }

  start() {
    this.begin({ trials: byId("trials-count").valueAsNumber || 0,
      fidelity: byId("trials-fidelity").value });
  }

  show(state) {
    this.state = state;
    if (state.message) this.tell(state.message);
    else if (state.count) {
      const lost = state.good.filter((good) => !good).length;
      this.tell(`${state.running ? "Running" : "Ended"}: ${state.count} trials, ${lost} failed` +
        `${state.running ? "" : "; Start continues to the number above"}.`);
    } else this.tell(state.running ? "The first trials run." : "No trial was done.");
    this.buttons.worst.disabled = !state.count;
    if (!state.count) return;
    this.box.querySelector(".summary").textContent = state.lines.join("\n");
    [[this.title, this.values]] = Object.entries(state.columns);
    scatter(this.svg, this.values, (n) => ["circle", state.good[n] ? BLUE : RED, state.good[n]],
      ["trial; hollow: failed", this.title],
      (n) => this.tell(this.words(n), "hover"), (n) => this.image(n));
  }

  words(n) {
    const values = Object.entries(this.state.columns)
      .map(([name, column]) => `${name} ${digits(column[n], 3)}`);
    return `Trial ${n}${this.state.good[n] ? "" : ", failed"}: ${values.join("; ")}. Click for its image.`;
  }

  worst() {
    const size = (n) => this.state.good[n] ? this.values[n] : Infinity;
    return this.values.reduce((worst, value, n) => size(n) > size(worst) ? n : worst, 0);
  }

  image(n) {
    byId("trial").value = n;
    byId("trial").dispatchEvent(new Event("change"));
    this.tell(`${this.words(n)} It is above, with the values that are shown now.`, "hover");
    sides[active].panel("images").scrollIntoView({ block: "nearest" });
  }
}

begun.then(() => {
  if (!about) return;
  new Search().look();
  new Trials().look();
});
