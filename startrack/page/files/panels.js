"use strict";
// What a design is drawn as. Each function takes the section of a side and what the server said.

const VIRIDIS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962",
  "#addc30", "#fde725"].map(rgb);
const BLUE = "#0072b2", ORANGE = "#e69f00", RED = "#d55e00", GREY = "#8a94a0", SKY = "#56b4e9";

function element(name, text, parent, kind) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  if (parent) parent.append(made);
  return made;
}

function digits(value, count = 4) {
  if (value === null || value === undefined || !isFinite(value)) return "none";
  const size = Math.abs(value);
  return size !== 0 && (size < 1e-3 || size >= 1e6)
    ? value.toExponential(count - 1) : String(+value.toPrecision(count));
}

function colour(part) {
  const at = Math.min(Math.max(part, 0), 1) * (VIRIDIS.length - 1), low = Math.floor(at);
  const high = Math.min(low + 1, VIRIDIS.length - 1);
  return VIRIDIS[low].map((value, k) => value + (at - low) * (VIRIDIS[high][k] - value));
}

// --- images --------------------------------------------------------------------------------------

const CLASSES = ["#0072b2", "#e69f00", "#009e73", "#f0e442", "#cc79a7", "#d55e00", "#56b4e9", "#000000"];
const MARKS = [["○", SKY], ["□", ORANGE], ["△", RED], ["◇", "#fff"]]; // a shape and a colour each
const NOTHING = 0xffc8c8c8; // pixel without a value

function rgb(text) {
  return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16));
}

function packed([r, g, b]) {
  return 0xff000000 | (b << 16) | (g << 8) | r;
}

function drawPictures(panel, view, trial) {
  const words = panel.querySelector("p");
  words.textContent = view.refused || `Trial ${trial}: ${view.text}.`;
  if (view.refused) return;
  const marks = view.images[0].marks
    .map((mark, n) => `${MARKS[kindOf(mark, n)][0]} ${mark.name}: ${mark.x.length}`);
  if (marks.length) words.textContent += ` ${marks.join(", ")}.`;
  panel.querySelector(".pictures").replaceChildren(
    ...view.images.map((image) => drawPicture(image, view.images.length > 1 ? 320 : 640)));
}

function drawPicture(image, wide) {
  const box = element("figure"), canvas = element("canvas", undefined, box);
  const bytes = atob(image.levels), [rows, columns] = image.shape, named = image.classes || [];
  const shade = (level) => named.length ? rgb(CLASSES[level % CLASSES.length])
    : image.grey ? [level, level, level] : colour(level / 254);
  const shades = Uint32Array.from({ length: 256 }, (_, level) => packed(shade(level)));
  shades[255] = NOTHING;
  const plain = document.createElement("canvas"), data = new ImageData(columns, rows);
  const pixels = new Uint32Array(data.data.buffer);
  for (let n = 0; n < pixels.length; n++) pixels[n] = shades[bytes.charCodeAt(n)];
  Object.assign(plain, { width: columns, height: rows });
  plain.getContext("2d").putImageData(data, 0, 0);
  const scale = wide / image.size[1], high = Math.round(scale * image.size[0]);
  Object.assign(canvas, { width: wide, height: high + (named.length ? 0 : 42) });
  const pen = canvas.getContext("2d"), block = (image.block || image.size[1] / columns) * scale;
  pen.imageSmoothingEnabled = false;
  pen.drawImage(plain, 0, 0, columns * block, rows * block);
  image.marks.forEach((mark, n) => mark.x.forEach((x, k) => {
    drawMark(pen, kindOf(mark, n), (x + 0.5) * scale, (mark.y[k] + 0.5) * scale, 4 + wide / 128);
  }));
  const caption = element("figcaption", `${image.name}${image.unit ? ` (${image.unit})` : ""}`, box);
  named.forEach((name, n) => {
    element("span", "■", caption).style.color = CLASSES[n % CLASSES.length];
    caption.append(`${name} `);
  });
  if (!named.length) drawScale(pen, wide, high, shade, `≤ ${digits(image.low, 3)}`, "", `≥ ${digits(image.high, 3)}`);
  return box;
}

const kindOf = (mark, n) => mark.name.endsWith("this trial") ? MARKS.length - 1 : n;

function drawMark(pen, kind, u, v, size) {
  pen.beginPath();
  if (kind === 0) pen.arc(u, v, size, 0, 2 * Math.PI);
  else if (kind === 1) pen.rect(u - size, v - size, 2 * size, 2 * size);
  else {
    const corners = kind === 2 ? [[0, -1.3], [1.2, 0.8], [-1.2, 0.8]] : [[0, -2], [2, 0], [0, 2], [-2, 0]];
    corners.forEach(([x, y]) => pen.lineTo(u + x * size, v + y * size));
    pen.closePath();
  }
  for (const [wide, shade] of [[4, "#000"], [2, MARKS[kind][1]]]) {
    Object.assign(pen, { lineWidth: wide, strokeStyle: shade });
    pen.stroke();
  }
}

// The scale of colours below an image, with both ends.
function drawScale(pen, wide, high, shade, low, title, top) {
  for (let u = 0; u < wide; u++) {
    pen.fillStyle = `rgb(${shade(254 * u / wide).join(",")})`;
    pen.fillRect(u, high + 6, 1, 12);
  }
  pen.fillStyle = "#1c2530";
  pen.font = "16px system-ui, sans-serif";
  [[low, "left", 0], [title, "center", wide / 2], [top, "right", wide]].forEach(([text, side, u]) => {
    pen.textAlign = side;
    pen.fillText(text, u, high + 35);
  });
}

// --- budget --------------------------------------------------------------------------------------

function drawBars(box, rows, before, most) {
  box.replaceChildren();
  const old = new Map((before || []).map((row) => [row.name, row.value]));
  for (const row of rows) {
    const line = element("div", undefined, box, row.sum ? "bar sum" : "bar");
    line.title = row.note || "";
    element("span", row.name, line);
    const track = element("div", undefined, line, "track");
    element("i", undefined, track).style.width = `${100 * Math.min(row.value / most, 1)}%`;
    const ghost = old.get(row.name);
    if (ghost !== undefined && ghost !== row.value) {
      element("b", undefined, track).style.width = `${100 * Math.min(ghost / most, 1)}%`;
      line.title += ` before: ${digits(ghost)}`;
    }
    element("span", digits(row.value, 3), line);
  }
}

function budgetRows(shown, axis) {
  if (!shown || !shown.causes) return [];
  const rows = shown.causes.map((cause) => (
    { name: cause.name, value: cause[axis], note: `${cause.term}. ${cause.advice}` }));
  return [...rows, { name: "all, arcsec rms", value: shown[axis], sum: true }];
}

function drawBudget(panel, shown, before, other) {
  const axis = panel.querySelector("input:checked").value;
  const rows = budgetRows(shown, axis), old = budgetRows(before, axis);
  const every = [...rows, ...old, ...budgetRows(other, axis)].map((row) => row.value);
  drawBars(panel.querySelector(".bars"), rows, old, Math.max(...every, 1e-9));
  panel.querySelector(".left-out").textContent = [
    shown.causes ? `attitude in ${(100 * shown.availability).toFixed(2)} % of the sky, ` +
      `${digits(shown.matched, 3)} stars on average` : "",
    ...(shown.advice || []).map((text) => `Most: ${text}`),
    notCounted(shown),
  ].filter(Boolean).join(". ");
}

// A table. A value before the last change, where it differs, stands small in a row's last cell.
function fillTable(table, head, rows) {
  table.replaceChildren();
  const titles = element("tr", undefined, element("thead", undefined, table));
  head.forEach((title) => element("th", title, titles));
  const body = element("tbody", undefined, table);
  for (const { cells, missed, before } of rows) {
    const line = element("tr", undefined, body);
    cells.forEach((text) => element("td", text, line));
    if (missed) line.lastChild.className = "missed";
    if (before && before !== cells.at(-1)) element("small", `before ${before}`, line.lastChild);
  }
}

function drawParts(panel, shown, before) {
  const text = ({ value, unit }) => `${digits(value)} ${unit}`;
  const old = new Map(((before && before.parts) || []).map((part) => [part.name, text(part)]));
  fillTable(panel.querySelector("table"), [], (shown.parts || []).map((part) => (
    { cells: [part.name, text(part)], before: old.get(part.name) })));
  panel.querySelector(".left-out").textContent = notCounted(shown);
}

function notCounted(shown) {
  return shown.left_out && shown.left_out.length ? `Not counted: ${shown.left_out.join("; ")}` : "";
}

// --- requirements --------------------------------------------------------------------------------

function drawRequirements(panel, rows, before, state) {
  const text = (row) => row.margin === undefined ? ""
    : `${isMet(row) ? "✓" : "✗ NOT MET"} ${signed(row.margin)}`;
  const old = new Map((before || []).map((row) => [row.name, text(row)]));
  panel.querySelector(".state").textContent = rows.length
    ? state : "The design has no campaign with requirements.";
  const head = rows.length ? ["", "value", "limit", "margin"] : [];
  fillTable(panel.querySelector("table"), head, rows.map((row) => {
    const limit = row.limit || (row.margin === undefined ? "no limit" : "");
    const missed = row.margin !== undefined && !isMet(row);
    return { cells: [row.name, row.value, limit, text(row)], missed, before: old.get(row.name) };
  }));
}

function isMet(row) {
  return row.margin !== null && row.margin >= 0;
}

function signed(margin) {
  return margin === null ? "none" : (margin < 0 ? "" : "+") + margin.toFixed(3);
}

// --- sky -----------------------------------------------------------------------------------------

const SKY_WIDE = 480, SKY_HIGH = 240;
let nearest = null; // direction of each pixel of a Mollweide map; -1 outside of it

function nearestOf(sky) {
  if (nearest && nearest.count === sky.ra.length) return nearest.index;
  const index = new Int16Array(SKY_WIDE * SKY_HIGH).fill(-1);
  const vectors = sky.ra.map((ra, n) => unit(ra * Math.PI / 180, sky.dec[n] * Math.PI / 180));
  for (let v = 0; v < SKY_HIGH; v++) {
    for (let u = 0; u < SKY_WIDE; u++) {
      const x = 2 * (u + 0.5) / SKY_WIDE - 1, y = 1 - 2 * (v + 0.5) / SKY_HIGH;
      if (x * x + y * y > 1) continue;
      const turn = Math.asin(y);
      const dec = Math.asin((2 * turn + Math.sin(2 * turn)) / Math.PI);
      const [a, b, c] = unit(-Math.PI * x / Math.cos(turn), dec); // east to the left
      let best = -2, at = 0;
      for (let n = 0; n < vectors.length; n++) {
        const cosine = a * vectors[n][0] + b * vectors[n][1] + c * vectors[n][2];
        if (cosine > best) [best, at] = [cosine, n];
      }
      index[v * SKY_WIDE + u] = at;
    }
  }
  nearest = { count: sky.ra.length, index };
  return index;
}

function unit(ra, dec) {
  return [Math.cos(dec) * Math.cos(ra), Math.cos(dec) * Math.sin(ra), Math.sin(dec)];
}

function drawSky(panel, sky, other) {
  const canvas = panel.querySelector("canvas"), words = panel.querySelector("p");
  const select = panel.querySelector("select"), name = select.value;
  const finite = (values) => values.filter((value) => value !== null && isFinite(value));
  const values = sky[name], inside = finite([...values, ...(other ? other[name] : [])]);
  const low = Math.min(...inside), high = Math.max(...inside), index = nearestOf(sky);
  canvas.width = SKY_WIDE;
  canvas.height = SKY_HIGH + 40;
  const pen = canvas.getContext("2d"), image = pen.createImageData(SKY_WIDE, SKY_HIGH);
  const shade = Uint32Array.from(values, (value) => value === null ? NOTHING
    : packed(colour(high > low ? (value - low) / (high - low) : 0.5)));
  const pixels = new Uint32Array(image.data.buffer);
  for (let n = 0; n < index.length; n++) if (index[n] >= 0) pixels[n] = shade[index[n]];
  pen.putImageData(image, 0, 0);
  drawScale(pen, SKY_WIDE, SKY_HIGH, (level) => colour(level / 254), digits(low, 3),
    select.selectedOptions[0].textContent, digits(high, 3));
  const own = finite(values), worst = name === "stars" ? Math.min(...own) : Math.max(...own);
  const at = values.indexOf(name === "faintest" ? Math.min(...own) : worst);
  const blind = 100 * (1 - own.length / values.length);
  words.textContent = (high - low < 0.05 && name === "stars"
    ? `${digits(high, 3)} stars everywhere: as many as the tracker keeps`
    : `Worst: ${digits(values[at], 3)} at RA ${((sky.ra[at] + 360) % 360).toFixed(0)}°, Dec ` +
      `${sky.dec[at].toFixed(0)}°`) + (blind ? `; grey: no attitude, ${blind.toFixed(1)} %` : "") +
    `. ${values.length} directions; the middle is RA 0°, Dec 0°, east is left.`;
}

// --- curves --------------------------------------------------------------------------------------

function chart(box, data, names, titles, logarithmic) {
  const wide = Math.max(box.clientWidth, 200);
  if (box.uplot) box.uplot.destroy();
  const axis = (label) => ({ label, size: 54, font: "12px system-ui", labelFont: "12px system-ui" });
  const series = names.map((label) => ({
    label, stroke: label.endsWith("before") ? GREY : label === "about" ? RED : BLUE,
    dash: label.startsWith("about") ? [7, 4] : [], width: label.endsWith("before") ? 1.3 : 2,
    spanGaps: true,
    value: (plot, value) => value === null ? "" : digits(value, 3),
    points: { show: data[0].length < 12, size: 6 },
  }));
  const first = { label: titles[0], value: (plot, value) => digits(value, 4) };
  box.uplot = new uPlot({
    width: wide, height: 220, series: [first, ...series],
    scales: { x: { time: false }, y: { distr: logarithmic ? 3 : 1 } },
    axes: [{ ...axis(titles[0]), size: 42 }, axis(titles[1])],
  }, data, box);
}

function drawMagnitude(panel, stars, before) {
  const tables = [[stars.magnitude, stars.error]], names = ["by formula"];
  if (before) {
    tables.push([before.magnitude, before.error]);
    names.push("by formula, before");
  }
  chart(panel.querySelector(".chart"), uPlot.join(tables), names,
    ["G of a star like the Sun", "pixel per axis"], true);
}

function drawSlew(panel, points, before, waiting) {
  const columns = (rows) => [rows.map((row) => row.rate), rows.map((row) => row.across),
    rows.map((row) => row.about)];
  const tables = [columns(points)], names = ["across", "about"];
  if (before && before.length) {
    tables.push(columns(before));
    names.push("across, before", "about, before");
  }
  panel.querySelector("p").textContent = waiting;
  if (points.length) {
    chart(panel.querySelector(".chart"), uPlot.join(tables), names,
      ["rate about x (deg/s)", "arcsec rms"], true);
  }
}
