// Charts of the server's sheets: stacked axes over one x, with their levels and marks.
export const styleOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
export const suffix = (number) => (number ? number + 1 : "");
export const PLAIN = { responsive: false, displaylogo: false, displayModeBar: false };

export function layoutOf(sheet, { together }) {
  const size = parseFloat(getComputedStyle(document.documentElement).fontSize), ink = styleOf("--ink"), grid = styleOf("--grid");
  const layout = { paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: 0.8 * size, family: "system-ui, DejaVu Sans, sans-serif" }, margin: { l: 4.6 * size, r: size, t: 0.6 * size, b: 2.6 * size }, hovermode: "x", legend: { orientation: "h", y: 1.16 }, shapes: [], annotations: [], showlegend: true };
  const count = sheet.rows.length, gap = 0.09;
  sheet.rows.forEach((row, number) => {
    const s = suffix(number), high = (1 - gap * (count - 1)) / count, top = 1 - number * (high + gap), last = number === count - 1;
    layout[`xaxis${s}`] = { anchor: `y${s}`, matches: number ? "x" : undefined, gridcolor: grid, zeroline: false, showticklabels: last, title: last ? { text: sheet.x_label, standoff: 2 } : undefined };
    if (together) Object.assign(layout[`xaxis${s}`], { dtick: sheet.rows[0].lines[0].x.length < 20 ? 1 : undefined });
    layout[`yaxis${s}`] = { anchor: `x${s}`, domain: [Math.max(top - high, 0), top], gridcolor: grid, zerolinecolor: grid, title: { text: row.label.replaceAll("\n", "<br>"), standoff: 3 } };
    for (const level of row.levels) layout.shapes.push({ type: "line", xref: `x${s} domain`, yref: `y${s}`, x0: 0, x1: 1, y0: level.at, y1: level.at, line: { color: styleOf("--bad"), width: 1, dash: "dash" } });
  });
  for (const moment of sheet.moments ?? []) {
    layout.shapes.push({ type: "line", xref: "x", yref: "paper", x0: moment.at, x1: moment.at, y0: 0, y1: 1, line: { color: styleOf("--soft"), width: 1 } });
    layout.annotations.push({ x: moment.at, xref: "x", y: 0, yref: "paper", yanchor: "bottom", xanchor: "left", text: moment.text, showarrow: false });
  }
  return layout;
}
