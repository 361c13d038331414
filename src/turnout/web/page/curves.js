// Channels over time: sheets of the server, pinned throws in grey behind, a measured throw wide and pale.
import { hiddenRow } from "./channels.js";
import { showFrame } from "./player.js";
import { on, state } from "./state.js";

const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000"];
const DASHES = ["solid", "dash", "dashdot", "dot", "longdash", "longdashdot", "solid"];
const STROKES = { dash: "6 3", dashdot: "6 2 1 2", dot: "1.5 2", longdash: "9 3", longdashdot: "9 2 1 2" };
const SYMBOLS = { circle: "circle", square: "square", "triangle up": "triangle-up", "triangle down": "triangle-down", cross: "x" };
const SIGNS = { circle: "●", square: "■", "triangle up": "▲", "triangle down": "▼", cross: "✕" };
const DARK = { "#0072B2": "#5ab0ff", "#D55E00": "#ff8f45", "#009E73": "#35cf9c", "#CC79A7": "#e8a0c8" };
// Room between rows for labels, in text heights; of the height they take no more than this share.
const GAP_X = 5.6, GAP_Y = 3.7, MOST_GAP = 0.3, NARROW = 560;

let listening = false, hovered = null;
let drawn = []; // rows on the screen, which follow an answer a moment later than its numbers

const byId = (id) => document.getElementById(id);
const styleOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function inkOf(colour) {
  const chosen = typeof colour === "number" ? COLOURS[colour % COLOURS.length] : colour;
  if (chosen === "#000000") return styleOf("--ink");
  return styleOf("--dark") ? DARK[chosen] ?? chosen : chosen;
}

const suffix = (number) => (number ? number + 1 : "");
const nameOf = (line) => line.label.replace(" (closing rail)", "");

// Rows that are shown: those of the throw, and where a measurement is laid over what it differs by.
const rows = () => [...state.answer.sheet.rows, ...(state.overlay?.differences ?? [])].filter((row) => !hiddenRow(row));

function trace(line, row, more) {
  const marks = line.style === "marks";
  return {
    type: "scatter", name: nameOf(line), x: line.x, y: line.y, mode: marks ? "markers" : "lines",
    xaxis: `x${suffix(row)}`, yaxis: `y${suffix(row)}`, showlegend: false, hoverinfo: "skip",
    line: { color: inkOf(line.colour), dash: DASHES[line.dash % DASHES.length], width: 1.6 },
    marker: { color: inkOf(line.colour), symbol: SYMBOLS[line.symbol], size: 9, line: { width: 1, color: styleOf("--ink") } }, ...more,
  };
}

const pinned = () => state.pins.map((pin, number) => ({ ...pin, mark: `P${number + 1}` })).filter((pin) => pin.shown);

function tracesOf(shown) {
  const labels = shown.map((row) => row.label), behind = [];
  const laid = (other, more) => {
    for (const row of other.rows) {
      const number = labels.indexOf(row.label);
      if (number >= 0) behind.push(...row.lines.filter((line) => line.style === "line").map((line) => trace(line, number, more(line))));
    }
  };
  for (const pin of pinned()) laid(pin.answer.sheet, () => ({ line: { color: styleOf("--off"), width: 1 } }));
  if (state.overlay) laid(state.overlay, (line) => ({ opacity: 0.4, line: { color: inkOf(line.colour), width: 5 } }));
  return [...behind, ...shown.flatMap((row, number) => row.lines.map((line) => trace(line, number)))];
}

// Each pinned line carries its mark near its end, marks of several throws beside one another.
function pinMarks(shown, size) {
  const labels = shown.map((row) => row.label);
  return pinned().flatMap((pin, order) => pin.answer.sheet.rows.flatMap((row) => {
    const number = labels.indexOf(row.label);
    if (number < 0) return [];
    return row.lines.filter((line) => line.style === "line").map((line) => {
      const at = Math.max(0, Math.floor((line.x.length - 1) * (0.985 - 0.04 * order)));
      return { text: pin.mark, x: line.x[at], y: line.y[at], xref: `x${suffix(number)}`, yref: `y${suffix(number)}`, showarrow: false, yshift: 0.55 * size, font: { size: 0.72 * size, color: styleOf("--soft") } };
    });
  }));
}

// Two columns where there are more than two rows, one on a phone: each gets room enough to be read.
function places(count, { width, height, size }) {
  const columns = width < NARROW ? 1 : count === 4 ? 2 : Math.min(count, 3), lines = Math.ceil(count / columns);
  const beside = GAP_X * size / width, gap = Math.min(GAP_Y * size / height, MOST_GAP, 0.6 / lines);
  const wide = (1 - beside * (columns - 1)) / columns;
  const high = (1 - gap * (lines - 1)) / lines;
  return Array.from({ length: count }, (_, number) => {
    const column = number % columns, row = Math.floor(number / columns);
    const left = column * (wide + beside), top = 1 - row * (high + gap);
    return { x: [left, left + wide], y: [Math.max(top - high, 0), top], last: number + columns >= count };
  });
}

function layoutOf(sheet, shown, box) {
  const size = parseFloat(getComputedStyle(document.documentElement).fontSize);
  const ink = styleOf("--ink"), grid = styleOf("--grid"), soft = styleOf("--soft");
  const layout = {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: size * 0.8, family: "system-ui, DejaVu Sans, sans-serif" },
    margin: { l: size * 4.4, r: size * 0.8, t: size * 1.4, b: size * 2.4 }, hovermode: false, shapes: [], annotations: pinMarks(shown, size),
    uirevision: state.panel.mark,
  };
  const { l, r, t, b } = layout.margin, inside = { width: box.clientWidth - l - r, height: box.clientHeight - t - b, size };
  places(shown.length, inside).forEach((place, number) => {
    const row = shown[number], s = suffix(number);
    layout[`xaxis${s}`] = { domain: place.x, anchor: `y${s}`, matches: number ? "x" : undefined, gridcolor: grid, zeroline: false, linecolor: soft,
      title: place.last ? { text: sheet.x_label, standoff: 2 } : undefined, tickfont: { size: size * 0.75 } };
    layout[`yaxis${s}`] = { domain: place.y, anchor: `x${s}`, gridcolor: grid, zerolinecolor: soft, linecolor: soft, automargin: false, tickfont: { size: size * 0.75 },
      title: { text: row.label.replaceAll("\n", "<br>"), standoff: 3 } };
    for (const band of sheet.bands) {
      layout.shapes.push({ type: "rect", xref: `x${s}`, yref: `y${s} domain`, x0: band.start, x1: band.end, y0: 0, y1: 1, fillcolor: grid, opacity: 0.45, line: { width: 0 }, layer: "below" });
    }
    for (const level of row.levels) {
      layout.shapes.push({ type: "line", xref: `x${s} domain`, yref: `y${s}`, x0: 0, x1: 1, y0: level.at, y1: level.at, line: { color: soft, width: 1, dash: "dash" } });
    }
    for (const moment of sheet.moments) {
      layout.shapes.push({ type: "line", xref: `x${s}`, yref: `y${s} domain`, x0: moment.at, x1: moment.at, y0: 0, y1: 1, line: { color: ink, width: 1, dash: "dot" } });
    }
  });
  return layout;
}

export function drawCurves() {
  const box = byId("curves");
  if (!state.answer || !box.clientWidth) return;
  const { sheet } = state.answer, shown = rows();
  drawn = shown;
  legends(shown);
  notes();
  Plotly.react(box, tracesOf(shown), layoutOf(sheet, shown, box), { responsive: false, displaylogo: false, displayModeBar: false, scrollZoom: true });
  if (!listening) box.on("plotly_afterplot", cursors);
  listening = true;
}

function swatch(line) {
  if (line.style === "marks") {
    return Object.assign(document.createElement("i"), { textContent: SIGNS[line.symbol] ?? "●" });
  }
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), stroke = document.createElementNS(svg.namespaceURI, "line");
  svg.setAttribute("class", "swatch");
  const given = { x1: 0, x2: 20, y1: 5, y2: 5, stroke: "currentColor", "stroke-width": 2, "stroke-dasharray": STROKES[DASHES[line.dash % DASHES.length]] ?? "" };
  for (const [name, value] of Object.entries(given)) stroke.setAttribute(name, value);
  svg.append(stroke);
  return svg;
}

// A line across each row at the shown instant, and above it each channel with its value there.
function legends(shown) {
  byId("cursors").replaceChildren(...shown.flatMap((row) => {
    const line = document.createElement("div"), key = document.createElement("p");
    line.className = "cursor";
    key.className = "key";
    key.append(...row.lines.map((item) => {
      const one = document.createElement("span"), mark = swatch(item), value = document.createElement("b");
      mark.style.color = inkOf(item.colour);
      one.append(mark, `${nameOf(item)} `, value);
      return one;
    }));
    return [line, key];
  }));
}

function notes() {
  const parts = pinned().map((pin) => `${pin.mark}: ${pin.name}`);
  if (state.overlay) parts.push("wide and pale: measured");
  byId("curves-note").textContent = parts.join("; ");
}

function valueAt(line, time) {
  if (line.style !== "line" || !line.x.length || time < line.x[0] || time > line.x.at(-1)) return null;
  let low = 0, high = line.x.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (line.x[middle] <= time) low = middle; else high = middle;
  }
  if (line.y[low] === null || line.y[high] === null) return null;
  const share = (time - line.x[low]) / (line.x[high] - line.x[low] || 1);
  return line.y[low] + Math.min(1, share) * (line.y[high] - line.y[low]);
}

const axesOf = (full, number) => [full[`xaxis${suffix(number)}`], full[`yaxis${suffix(number)}`]];

// The shown instant, or the one under the mouse, in every row, placed by Plotly's axes.
function cursors() {
  const full = byId("curves")._fullLayout, layer = byId("cursors");
  if (!full || !state.answer) return;
  const now = hovered ?? state.answer.motion.time[state.frame];
  drawn.forEach((row, number) => {
    const [x, y] = axesOf(full, number), line = layer.children[2 * number], key = layer.children[2 * number + 1];
    if (!x || !line) return;
    const left = x._offset + x.l2p(now), inside = left >= x._offset - 1 && left <= x._offset + x._length + 1;
    Object.assign(line.style, { left: `${left}px`, top: `${y._offset}px`, height: `${y._length}px`, display: inside ? "" : "none" });
    Object.assign(key.style, { right: `${layer.clientWidth - x._offset - x._length}px`, top: `${y._offset}px`, maxWidth: `${x._length}px` });
    row.lines.forEach((item, at) => {
      const value = valueAt(item, now);
      key.children[at].lastChild.textContent = value === null ? "" : value.toFixed(2);
    });
  });
  byId("cursor-time").textContent = `values at ${now.toFixed(2)} s`;
}

// The instant under the mouse; null outside the rows.
function instantAt(event) {
  const box = byId("curves"), full = box._fullLayout, edge = box.getBoundingClientRect();
  if (!full || !state.answer) return null;
  const px = event.clientX - edge.left, py = event.clientY - edge.top;
  for (let number = 0; number < drawn.length; number++) {
    const [x, y] = axesOf(full, number);
    if (x && px >= x._offset && px <= x._offset + x._length && py >= y._offset && py <= y._offset + y._length) return x.p2l(px - x._offset);
  }
  return null;
}

function listen(box) {
  let pressed = null;
  box.addEventListener("pointermove", (event) => { hovered = instantAt(event); cursors(); });
  box.addEventListener("pointerleave", () => { hovered = null; cursors(); });
  box.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; }, true);
  addEventListener("pointerup", (event) => {
    const still = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4;
    pressed = null;
    const instant = still ? instantAt(event) : null;
    if (instant === null) return;
    const { time } = state.answer.motion;
    showFrame(time.reduce((best, item, number) => Math.abs(item - instant) < Math.abs(time[best] - instant) ? number : best, 0));
  }, true);
}

export function startCurves() {
  for (const what of ["painted", "pins", "overlay", "theme", "view", "channels"]) on(what, drawCurves);
  on("frame", cursors);
  const box = byId("curves");
  listen(box);
  new ResizeObserver(() => { if (box.data) { Plotly.Plots.resize(box); } drawCurves(); }).observe(box);
}
