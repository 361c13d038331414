// Channels over time: sheets of the server, pinned throws in grey behind, a measured throw wide and pale.
import { on, state } from "./state.js";

const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000"];
const DASHES = ["solid", "dash", "dashdot", "dot", "longdash", "longdashdot", "solid"];
const SYMBOLS = { circle: "circle", square: "square", "triangle up": "triangle-up", "triangle down": "triangle-down", cross: "x" };
const DARK = { "#0072B2": "#5ab0ff", "#D55E00": "#ff8f45", "#009E73": "#35cf9c", "#CC79A7": "#e8a0c8" };
const GAP_X = 0.1, GAP_Y = 0.2;

let listening = false;

const styleOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function inkOf(colour) {
  const chosen = typeof colour === "number" ? COLOURS[colour % COLOURS.length] : colour;
  if (chosen === "#000000") return styleOf("--ink");
  return getComputedStyle(document.documentElement).colorScheme === "dark" ? DARK[chosen] ?? chosen : chosen;
}

const suffix = (number) => (number ? number + 1 : "");

function trace(line, row, more) {
  const marks = line.style === "marks";
  return {
    type: "scatter", name: line.label.replace(" (closing rail)", ""), x: line.x, y: line.y, mode: marks ? "markers" : "lines",
    xaxis: `x${suffix(row)}`, yaxis: `y${suffix(row)}`, legend: `legend${suffix(row)}`,
    line: { color: inkOf(line.colour), dash: DASHES[line.dash % DASHES.length], width: 1.6 },
    marker: { color: inkOf(line.colour), symbol: SYMBOLS[line.symbol], size: 9, line: { width: 1, color: styleOf("--ink") } },
    hovertemplate: `${line.label}: %{y:.3f} at %{x:.2f} s<extra></extra>`, ...more,
  };
}

function tracesOf(sheet) {
  const labels = sheet.rows.map((row) => row.label);
  const behind = [];
  const laid = (other, more) => {
    for (const row of other.rows) {
      const number = labels.indexOf(row.label);
      if (number >= 0) behind.push(...row.lines.filter((line) => line.style === "line").map((line) => trace(line, number, more(line))));
    }
  };
  for (const pin of state.pins.filter((item) => item.shown)) {
    laid(pin.answer.sheet, (line) => ({ showlegend: false, line: { color: styleOf("--off"), width: 1 }, hovertemplate: `${pin.name}: ${line.label} %{y:.3f}<extra></extra>` }));
  }
  if (state.overlay) {
    laid(state.overlay, (line) => ({ showlegend: false, opacity: 0.4, line: { color: inkOf(line.colour), width: 5 }, hovertemplate: `measured: ${line.label} %{y:.3f}<extra></extra>` }));
  }
  const own = sheet.rows.flatMap((row, number) => row.lines.map((line) => trace(line, number)));
  return [...behind, ...own];
}

// Two columns where there are more than two rows: each gets room enough to be read.
function places(count) {
  const columns = count === 4 ? 2 : Math.min(count, 3), rows = Math.ceil(count / columns);
  const wide = (1 - GAP_X * (columns - 1)) / columns, high = (1 - GAP_Y * (rows - 1)) / rows;
  return Array.from({ length: count }, (_, number) => {
    const column = number % columns, row = Math.floor(number / columns);
    const left = column * (wide + GAP_X), top = 1 - row * (high + GAP_Y);
    return { x: [left, left + wide], y: [Math.max(top - high, 0), top], last: number + columns >= count };
  });
}

function layoutOf(sheet) {
  const size = parseFloat(getComputedStyle(document.documentElement).fontSize);
  const ink = styleOf("--ink"), grid = styleOf("--grid"), soft = styleOf("--soft");
  const layout = {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: size * 0.8, family: "system-ui, DejaVu Sans, sans-serif" },
    margin: { l: size * 4.9, r: size * 0.8, t: size * 1.6, b: size * 2.5 }, hovermode: "x", shapes: [], annotations: [],
    hoverlabel: { bgcolor: styleOf("--card"), font: { color: ink } }, uirevision: state.panel.mark,
  };
  places(sheet.rows.length).forEach((place, number) => {
    const row = sheet.rows[number], s = suffix(number);
    layout[`xaxis${s}`] = { domain: place.x, anchor: `y${s}`, matches: number ? "x" : undefined, gridcolor: grid, zeroline: false, linecolor: soft,
      title: place.last ? { text: sheet.x_label, standoff: 2 } : undefined, tickfont: { size: size * 0.75 } };
    layout[`yaxis${s}`] = { domain: place.y, anchor: `x${s}`, gridcolor: grid, zerolinecolor: soft, linecolor: soft, automargin: false, tickfont: { size: size * 0.75 },
      title: { text: row.label.replaceAll("\n", "<br>"), standoff: 3 } };
    layout[`legend${s}`] = { x: place.x[1], y: place.y[1], xanchor: "right", yanchor: "bottom", orientation: "h", bgcolor: "rgba(0,0,0,0)", font: { size: size * 0.75 }, tracegroupgap: 0 };
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
  const box = document.getElementById("curves");
  if (!state.answer || !box.clientWidth) return;
  const { sheet } = state.answer;
  Plotly.react(box, tracesOf(sheet), layoutOf(sheet), { responsive: false, displaylogo: false, displayModeBar: false, scrollZoom: true });
  if (!listening) box.on("plotly_afterplot", cursors);
  listening = true;
}

// The shown instant as a line across each row, placed by Plotly's axes.
function cursors() {
  const box = document.getElementById("curves"), layer = document.getElementById("cursors");
  const full = box._fullLayout;
  if (!full || !state.answer) return;
  const now = state.answer.motion.time[state.frame];
  const rows = state.answer.sheet.rows.map((_, number) => [full[`xaxis${suffix(number)}`], full[`yaxis${suffix(number)}`]]);
  while (layer.children.length > rows.length) layer.lastChild.remove();
  while (layer.children.length < rows.length) layer.append(document.createElement("div"));
  rows.forEach(([x, y], number) => {
    const line = layer.children[number], left = x._offset + x.l2p(now);
    const inside = left >= x._offset - 1 && left <= x._offset + x._length + 1;
    Object.assign(line.style, { left: `${left}px`, top: `${y._offset}px`, height: `${y._length}px`, display: inside ? "" : "none" });
  });
}

export function startCurves() {
  for (const what of ["answer", "pins", "overlay", "theme", "view"]) on(what, drawCurves);
  on("frame", cursors);
  const box = document.getElementById("curves");
  new ResizeObserver(() => { if (box.data) { Plotly.Plots.resize(box); } drawCurves(); }).observe(box);
}
