"use strict";
// The values of a design, and when it is painted anew.

const byId = (id) => document.getElementById(id);
const sides = {};
let about = null, active = "A", comparing = false, extra = [];
const history = [];
const QUIET = 350; // ms without a change, until what takes longer is asked for

class Side {
  constructor(name) {
    this.name = name;
    this.changes = new Map();
    this.box = byId("side").content.firstElementChild.cloneNode(true);
    this.box.querySelectorAll(".axis input").forEach((radio) => {
      radio.name = `axis-${name}`;
      radio.addEventListener("change", () => this.draw());
    });
    this.box.querySelector(".sky select").addEventListener("change", () => this.draw());
    this.condition = this.box.querySelector(".images select");
    this.condition.addEventListener("change", () => this.askImages());
    byId("sides").append(this.box);
    this.shown = this.ghost = this.later = null;
    this.rates = [];
    this.ghostRates = [];
    this.number = 0;
  }

  get list() {
    return [...this.changes].map(([key, value]) => `${key}=${value}`);
  }

  panel(name) {
    return this.box.querySelector(`.panel.${name}`);
  }

  // One paint at a time; of changes that come meanwhile, the last one counts.
  async paint() {
    this.number += 1;
    clearTimeout(this.timer);
    if (this.painting) return;
    this.painting = true;
    let number = 0;
    while (number !== this.number) {
      number = this.number;
      const began = this.event || performance.now();
      this.event = null;
      const shown = await ask("paint", { changes: this.list });
      if (!shown) break;
      this.box.classList.toggle("old", Boolean(shown.refused));
      if (shown.refused) {
        this.box.querySelector(".answer").textContent = `${shown.refused}. Below: the design before.`;
        continue;
      }
      this.shown = shown;
      this.later = null;
      this.rates = [];
      this.draw();
      this.askImages(began);
      await new Promise(requestAnimationFrame);
      performance.measure("move", { start: began, end: performance.now() });
    }
    this.painting = false;
    this.timer = setTimeout(() => this.askLater(), QUIET);
  }

  // One request at a time; of those that come meanwhile, the last one counts.
  async askImages(began = performance.now()) {
    this.wanted = began;
    if (this.imaging) return;
    this.imaging = true;
    for (let start = began; this.wanted; start = this.wanted) {
      this.wanted = null;
      const trial = byId("trial").valueAsNumber || 0;
      const view = await ask("images", { changes: this.list, trial, condition: this.condition.value });
      if (!view) break;
      this.images = view;
      drawPictures(this.panel("images"), view, trial);
      this.shown.stars = view.stars;
      this.drawCurves();
      performance.measure("images", { start, end: performance.now() });
    }
    this.imaging = false;
  }

  async askLater() {
    const number = this.number, shown = this.shown, changes = this.list;
    if (!shown || shown.blind) return;
    if (shown.later) {
      const found = await ask("later", { changes });
      if (number !== this.number || !found) return;
      this.later = found;
      this.drawAnswer();
      this.drawRequirements();
    }
    for (const rate of shown.rates || []) {
      const point = await ask("later", { changes, rate });
      if (number !== this.number || !point) return;
      if (!point.refused) this.rates.push(point);
      this.drawSlew();
    }
  }

  draw() {
    const { shown, ghost } = this, other = comparing ? sides[this.name === "A" ? "B" : "A"] : null;
    if (!shown) return;
    const beside = other && other.shown;
    this.box.querySelector(".title").textContent = comparing ? `Design ${this.name}` : "";
    this.drawAnswer();
    this.showConditions(shown.conditions || []);
    if (about.kind === "tracker") drawBudget(this.panel("budget"), shown, ghost, beside);
    else drawParts(this.panel("parts"), shown, ghost);
    if (shown.sky) drawSky(this.panel("sky"), shown.sky, beside && beside.sky);
    this.drawRequirements();
    clearTimeout(this.curves); // which are drawn when nothing else is waited for
    this.curves = setTimeout(() => this.drawCurves(), 50);
  }

  // The design as designed is better than its units, so that their error stands first.
  drawAnswer() {
    const { shown, later } = this, beside = comparing && this.name === "B" && sides.A.shown;
    const parts = [shown.blind || shown.answer || ""];
    if (later && !later.refused) {
      const judged = later.requirements.filter((row) => row.margin !== undefined);
      parts.unshift(`${later.objective}: ${digits(later.expected)} arcsec, by formula; ` +
        `${judged.filter(isMet).length} of ${judged.length} requirements met`);
    } else if (shown.later && !later && !shown.blind) parts.push("units and conditions are being computed");
    if (beside && beside.value && shown.value) parts.push(`B over A, as designed: ${digits(shown.value / beside.value, 3)}`);
    this.box.querySelector(".answer").textContent = parts.join("; ");
  }

  showConditions(names) {
    this.condition.hidden = names.length < 2;
    if (names.join() === [...this.condition.options].map((option) => option.value).join()) return;
    this.condition.replaceChildren(...names.map((name) => element("option", name)));
  }

  drawCurves() {
    const { shown, ghost } = this;
    if (shown.stars) drawMagnitude(this.panel("magnitude"), shown.stars, ghost && ghost.stars);
    if (shown.rates) this.drawSlew();
  }

  drawSlew() {
    const all = (this.shown.rates || []).length, waiting = this.rates.length < all
      ? `${this.rates.length} of ${all} rates are computed` : "By formula; trials are in curves.png of budget";
    drawSlew(this.panel("slew"), this.rates, this.ghostRates, waiting);
  }

  drawRequirements() {
    const { shown, later } = this, ready = later && !later.refused;
    let state = "By formula, of the design as designed.";
    if (later && later.refused) state = later.refused;
    if (ready) state = "By formula, over units and conditions.";
    const rows = ready ? later.requirements : shown.requirements;
    const before = this.ghost && (ready ? this.ghost.requirementsLater : this.ghost.requirements);
    drawRequirements(this.panel("requirements"), rows, before, state);
  }

  // Before the first change of a gesture: what is shown becomes the design before.
  begin() {
    if (this.editing || !this.shown) return;
    this.editing = true;
    this.ghost = { ...this.shown, requirementsLater: this.later && this.later.requirements };
    this.ghostRates = this.rates;
    history.push([this.name, new Map(this.changes)]);
    byId("undo").disabled = false;
  }

  set(key, text, event) {
    this.begin();
    this.event ||= event ? event.timeStamp : performance.now();
    if (text === null) this.changes.delete(key);
    else this.changes.set(key, text);
    this.paint();
  }

  end() {
    this.editing = false;
    showChanges();
    showSliders();
    if (byId("form").open) loadForm();
  }
}

// --- the server ----------------------------------------------------------------------------------

async function ask(path, body = {}) {
  let reply;
  try {
    reply = await fetch(`/api/${path}`, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(body),
    });
  } catch {
    const list = sides.A ? sides.A.list.map((change) => `--set '${change}'`).join(" ") : "";
    say(`The server no longer answers. Start it again, and open the address that it prints: ` +
      `startrack page ${about ? about.file : "DESIGN"} ${list}`);
    return null;
  }
  const value = await reply.json();
  if (reply.ok) {
    say("");
    return value;
  }
  say(value.refused);
  return null;
}

function say(text, where = "message") {
  byId(where).textContent = text;
  byId(where).hidden = !text;
}

// --- sliders -------------------------------------------------------------------------------------

const STEPS = 1000;

function place(slider, value) {
  const part = slider.log ? Math.log(value / slider.low) / Math.log(slider.high / slider.low)
    : (value - slider.low) / (slider.high - slider.low);
  return Math.round(STEPS * Math.min(Math.max(part, 0), 1));
}

function valueAt(slider, step) {
  const part = step / STEPS, { low, high } = slider;
  const value = slider.log ? low * (high / low) ** part : low + part * (high - low);
  return slider.whole ? Math.round(value) : +value.toPrecision(4);
}

const written = (slider, value) => `${value} ${slider.unit}`.trim();

function showSliders() {
  const side = sides[active];
  if (!side.shown) return;
  const every = [...side.shown.sliders, ...extra];
  const box = byId("sliders");
  if (box.dataset.keys !== every.map((slider) => slider.key).join()) {
    box.replaceChildren(...every.map(makeSlider));
    box.dataset.keys = every.map((slider) => slider.key).join();
  }
  every.forEach((slider, n) => {
    const changed = side.changes.get(slider.key);
    const value = changed !== undefined && !isNaN(parseFloat(changed)) && extra.includes(slider)
      ? parseFloat(changed) : slider.value;
    const [range, text] = box.children[n].querySelectorAll("input");
    if (document.activeElement !== range) range.value = place(slider, value);
    if (document.activeElement !== text) text.value = changed ?? written(slider, digits(value, 5));
  });
}

function makeSlider(slider) {
  const box = element("div", undefined, null, "slider");
  const label = element("label", slider.key.replace(/^instrument\./, ""), box);
  label.title = slider.key;
  const range = element("input", undefined, box);
  Object.assign(range, { type: "range", min: 0, max: STEPS, step: 1 });
  range.setAttribute("aria-label", slider.key);
  const text = element("input", undefined, box, "value");
  text.setAttribute("aria-label", `value of ${slider.key}`);
  element("span", `${digits(slider.low, 3)} to ${written(slider, digits(slider.high, 3))}`, box, "ends");
  range.addEventListener("input", (event) => {
    const value = written(slider, valueAt(slider, +range.value));
    text.value = value;
    sides[active].set(slider.key, value, event);
  });
  range.addEventListener("change", () => sides[active].end());
  text.addEventListener("change", (event) => {
    sides[active].set(slider.key, text.value.trim(), event);
    sides[active].end();
  });
  return box;
}

function showChanges() {
  const lists = Object.values(sides).filter((side) => comparing || side.name === "A")
    .map((side) => (comparing ? `${side.name}:\n` : "") + (side.list.join("\n") || "none"));
  byId("changes").textContent = lists.join("\n");
}

// --- form ----------------------------------------------------------------------------------------

const MOST_ROWS = 60;
let rows = [];

async function loadForm() {
  const found = await ask("form", { changes: sides[active].list });
  if (Array.isArray(found)) rows = found;
  showForm();
}

async function showForm() {
  const words = byId("words").value.trim();
  const named = words ? await ask("keys", { words }) : null;
  const chosen = Array.isArray(named)
    ? rows.filter((row) => named.includes(row.key.split(".").filter((part) => !/^\d+$/.test(part)).join(".")))
    : rows;
  byId("found").textContent = chosen.length > MOST_ROWS
    ? `${chosen.length} keys, of which the first ${MOST_ROWS} are shown` : `${chosen.length} keys`;
  byId("keys").replaceChildren(...chosen.slice(0, MOST_ROWS).map(makeRow));
}

function makeRow(row) {
  const box = element("div", undefined, null, "key");
  element("code", row.key, box);
  element("br", undefined, box);
  const field = element("input", undefined, box);
  field.value = row.value;
  field.disabled = !row.editable;
  field.placeholder = row.default === "none" ? "none" : "";
  field.setAttribute("aria-label", row.key);
  if (row.choices.length) {
    const list = element("datalist", undefined, box);
    list.id = `choices-${row.key}`;
    field.setAttribute("list", list.id);
    row.choices.forEach((choice) => element("option", undefined, list).value = choice);
  }
  field.addEventListener("change", (event) => {
    sides[active].set(row.key, field.value.trim(), event);
    sides[active].end();
  });
  const number = parseFloat(row.value), known = document.querySelector(`[aria-label="${row.key}"][type=range]`);
  if (/number/.test(row.kind) && !/list/.test(row.kind) && number && !known) {
    const button = element("button", "slider", box);
    button.addEventListener("click", () => {
      const unit = row.value.replace(/^\S+\s*/, ""), ends = [number / 2, number * 2];
      extra.push({ key: row.key, low: Math.min(...ends), high: Math.max(...ends), value: number,
        log: number > 0, unit, whole: row.kind === "whole number" });
      button.remove();
      showSliders();
    });
  }
  const facts = [row.unit && `in ${row.unit}`, row.range, row.choices.join(", "),
    row.default && row.default !== "none" && `default ${row.default}`].filter(Boolean);
  element("small", `${row.meaning}${facts.length ? ` (${facts.join("; ")})` : ""}`, box);
  return box;
}

// --- buttons -------------------------------------------------------------------------------------

function setActive(name) {
  active = name;
  document.querySelector(`[name=side][value=${name}]`).checked = true;
  byId("sliders").dataset.keys = "";
  showSliders();
  if (byId("form").open) loadForm();
}

byId("undo").addEventListener("click", async () => {
  const [name, changes] = history.pop() || [];
  byId("undo").disabled = !history.length;
  if (!name) return;
  sides[name].ghost = sides[name].shown;
  sides[name].changes = changes;
  await sides[name].paint();
  sides[name].end();
});

byId("reset").addEventListener("click", async () => {
  const side = sides[active];
  side.begin();
  side.changes = startingChanges();
  await side.paint();
  side.end();
});

byId("compare").addEventListener("change", async (event) => {
  comparing = event.target.checked;
  byId("active").hidden = !comparing;
  byId("sides").classList.toggle("two", comparing);
  if (comparing && !sides.B) sides.B = new Side("B");
  if (comparing && !sides.B.shown) sides.B.changes = new Map(sides.A.changes);
  sides.B.box.hidden = !comparing;
  setActive(comparing ? "B" : "A");
  if (comparing) await sides.B.paint();
  Object.values(sides).forEach((side) => side.draw());
  showSliders();
  showChanges();
});

document.querySelectorAll("[name=side]").forEach((radio) => {
  radio.addEventListener("change", () => setActive(radio.value));
});

byId("save").addEventListener("submit", async (event) => {
  event.preventDefault();
  const done = await ask("save", { changes: sides[active].list, name: byId("save-name").value });
  if (done) say(done.done || done.refused, "note");
});

byId("trial").addEventListener("change", () => Object.values(sides).forEach((side) => side.askImages()));
byId("form").addEventListener("toggle", () => byId("form").open && loadForm());
byId("words").addEventListener("input", showForm);
window.addEventListener("resize", () => {
  clearTimeout(window.resized);
  window.resized = setTimeout(() => Object.values(sides).forEach((side) => side.draw()), 200);
});

function startingChanges() {
  return new Map(about.changes.map((change) => {
    const at = change.indexOf("=");
    return [change.slice(0, at), change.slice(at + 1)];
  }));
}

// Each tab has its own values; what runs and what is saved is of all tabs.
const tabs = new BroadcastChannel(`startrack-${location.port}`);
tabs.onmessage = ({ data }) => {
  say("This page is open in another tab, too: each tab has its own values; searches, trials and " +
    "saved files are the same.", "note");
  if (data === "opened") tabs.postMessage("here");
};

async function begin() {
  about = await ask("about");
  if (!about) return;
  document.title = `${about.name} – startrack`;
  document.body.classList.add(about.kind);
  byId("name").textContent = about.name;
  byId("name").title = about.file;
  byId("not-shown").textContent = `Not shown: ${about.not_shown}. Files go to ${about.folder}.`;
  sides.A = new Side("A");
  sides.A.changes = startingChanges();
  tabs.postMessage("opened");
  await sides.A.paint();
  showSliders();
  showChanges();
}

const begun = begin();
