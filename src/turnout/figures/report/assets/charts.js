"use strict";
// Turns each sheet that the page carries as data into a chart; asks nobody for anything.
(function () {
  // Okabe and Ito; the last one is the ink of the page. Dark pages get lighter blues and greens.
  const LIGHT = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", null];
  const DARK = ["#4BA3DB", "#F08A3C", "#35C79B", "#DE9BC1", "#8CCDF2", "#F3BC4A", null];
  const DASHES = ["solid", "10px,3px", "6px,2px,2px,2px", "3px,2px", "16px,4px", "6px,2px,2px,2px,2px,2px", "solid"];
  const SYMBOLS = { circle: "circle", square: "square", "triangle up": "triangle-up", "triangle down": "triangle-down", cross: "x" };
  const ROW = 165, ALONE = 360, TOP = 34, BOTTOM = 52, SPACE = 0.055;

  function theme() {
    const style = getComputedStyle(document.documentElement);
    const value = (name) => style.getPropertyValue(name).trim();
    const dark = matchMedia("(prefers-color-scheme: dark)").matches
      && !document.documentElement.classList.contains("on-paper");
    return { ink: value("--ink"), soft: value("--soft"), grid: value("--grid"), line: value("--line"),
             shade: value("--shade"), card: value("--card"), palette: dark ? DARK : LIGHT, dark: dark };
  }

  function colour(which, look) {
    if (typeof which === "string") return look.dark ? lighter(which) : which;
    return look.palette[which % look.palette.length] || look.ink;
  }

  function lighter(hex) {
    const parts = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
    return "rgb(" + parts.map((part) => Math.round(part + 0.38 * (255 - part))).join(",") + ")";
  }

  function named(text) { return text.replace(/\n/g, "<br>"); }

  function trace(line, number, look, once) {
    const suffix = number ? String(number + 1) : "";
    const tone = colour(line.colour, look);
    const shared = { name: named(line.label), x: line.x, y: line.y, yaxis: "y" + suffix, xaxis: "x",
                     legend: once === null ? "legend" + suffix : "legend", hovertemplate: "%{y:.4~g}" };
    if (once !== null) Object.assign(shared, { legendgroup: line.label, showlegend: number === once });
    if (line.style === "bars") {
      return Object.assign(shared, { type: "bar", width: line.width, marker: { color: tone } });
    }
    const marks = line.style !== "line";
    return Object.assign(shared, {
      type: "scatter",
      mode: line.style === "marks" ? "markers" : marks ? "lines+markers" : "lines",
      line: { color: tone, width: 1.25 * line.width, dash: DASHES[line.dash % DASHES.length] },
      marker: { color: tone, symbol: SYMBOLS[line.symbol], size: line.style === "marks" ? 10 : 6,
                line: { color: look.ink, width: line.style === "marks" ? 1 : 0 } },
    });
  }

  function layout(sheet, look, width) {
    const count = sheet.rows.length;
    const each = (1 - SPACE * (count - 1)) / count;
    const narrow = width < 700;
    const made = {
      height: TOP + BOTTOM + (count === 1 ? ALONE : ROW * count), width: width, autosize: false,
      margin: { l: 72, r: narrow ? 12 : 190, t: TOP, b: BOTTOM },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif", size: 12.5, color: look.ink },
      hovermode: "x unified", hoverlabel: { bgcolor: look.card, bordercolor: look.line, font: { color: look.ink } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: look.soft, activecolor: look.ink },
      showlegend: !narrow, shapes: [], annotations: [], dragmode: "zoom",
      xaxis: { title: { text: sheet.x_label }, gridcolor: look.grid, zeroline: false, linecolor: look.line,
               anchor: count > 1 ? "y" + count : "y", showspikes: false, hoverformat: ".3~f",
               dtick: sheet.counted ? 1 : undefined },
    };
    sheet.rows.forEach((row, number) => {
      const suffix = number ? String(number + 1) : "";
      const top = 1 - number * (each + SPACE);
      made["yaxis" + suffix] = {
        title: { text: named(row.label), font: { size: 12 } }, domain: [Math.max(0, top - each), top],
        gridcolor: look.grid, zerolinecolor: look.line, linecolor: look.line, automargin: false };
      made["legend" + suffix] = { x: 1.01, y: top, xanchor: "left", yanchor: "top",
                                  font: { size: 11.5 }, bgcolor: "rgba(0,0,0,0)" };
      row.levels.forEach((level) => {
        made.shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, yref: "y" + suffix, y0: level.at, y1: level.at,
                           line: { color: look.soft, width: 1, dash: "6px,4px" }, layer: "below" });
        if (level.text) {
          made.annotations.push({ xref: "paper", x: 0.003, yref: "y" + suffix, y: level.at, text: level.text, showarrow: false,
                                  xanchor: "left", yanchor: "bottom", font: { size: 11, color: look.soft } });
        }
      });
    });
    sheet.bands.forEach((band) => {
      made.shapes.push({ type: "rect", xref: "x", x0: band.start, x1: band.end, yref: "paper", y0: 0, y1: 1,
                         fillcolor: look.shade, line: { width: 0 }, layer: "below" });
      label(made, (band.start + band.end) / 2, band.text, look, "center", 20);
    });
    sheet.moments.forEach((moment) => {
      made.shapes.push({ type: "line", xref: "x", x0: moment.at, x1: moment.at, yref: "paper", y0: 0, y1: 1,
                         line: { color: look.soft, width: 1, dash: "2px,2px" } });
      label(made, moment.at, moment.text, look, sheet.bands.length ? "right" : "center", sheet.bands.length ? -2 : 20);
    });
    return made;
  }

  function label(made, at, text, look, anchor, shift) {
    made.annotations.push({ xref: "x", x: at, yref: "paper", y: 1, text: text, showarrow: false, xanchor: anchor,
                            yanchor: "top", yshift: shift, font: { size: 11, color: look.soft } });
  }

  function draw(chart) {
    const sheet = chart.sheet;
    const look = theme();
    const once = sheet.one_legend ? fullest(sheet) : null;
    const traces = sheet.rows.flatMap((row, number) => row.lines.map((line) => trace(line, number, look, once)));
    const width = Math.max(320, chart.clientWidth);
    const config = { displaylogo: false, responsive: false, showSendToCloud: false, showEditInChartStudio: false,
                     modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d", "toImage"] };
    Plotly.react(chart, traces, layout(sheet, look, width), config);
  }

  // The row with the most lines names them for all.
  function fullest(sheet) {
    const counts = sheet.rows.map((row) => row.lines.length);
    return counts.indexOf(Math.max(...counts));
  }

  function shown(chart) { return chart.clientWidth > 0; }

  const charts = Array.from(document.querySelectorAll(".chart"));
  charts.forEach((chart) => {
    chart.sheet = JSON.parse(chart.querySelector("script").textContent);
    chart.textContent = "";
    if (shown(chart)) draw(chart);
  });
  function again() { charts.filter(shown).forEach(draw); }
  let waiting = 0;
  addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(again, 120); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  addEventListener("beforeprint", () => { document.documentElement.classList.add("on-paper"); again(); });
  addEventListener("afterprint", () => { document.documentElement.classList.remove("on-paper"); again(); });
  document.querySelectorAll("details").forEach((part) => part.addEventListener("toggle", again));
})();
