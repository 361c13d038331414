// Values at places along the blade: a bar each, and hatched where nothing can be seen.
const SVG = "http://www.w3.org/2000/svg";
const HEIGHT = 9.5, TOP = 1.6, FOOT = 2.5, SIDE = 3.4; // in text heights

function add(parent, tag, attributes, text = "") {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  if (text) node.textContent = text;
  parent.append(node);
  return node;
}

const short = (name) => name.replace("sleeper ", "").replace("drive ", "D").replace("sensor ", "");

// `places`: {name, x, value and mark (0 to 1, or null), text, title, hatched, look}
export function drawBlade(svg, places) {
  const size = parseFloat(getComputedStyle(document.documentElement).fontSize), width = svg.clientWidth || svg.parentElement.clientWidth;
  const height = HEIGHT * size, top = TOP * size, base = height - FOOT * size, side = SIDE * size;
  svg.replaceChildren();
  svg.setAttribute("height", height);
  const defs = add(svg, "defs", {}), pattern = add(defs, "pattern", { id: `${svg.id}-hatch`, width: 7, height: 7, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" });
  add(pattern, "line", { class: "hatch", x1: 0, y1: 0, x2: 0, y2: 7 });
  const start = places[0].x, end = places[places.length - 1].x, at = (x) => side + (x - start) / Math.max(end - start, 1e-9) * (width - 2 * side);
  const gaps = places.slice(1).map((place, number) => at(place.x) - at(places[number].x)).filter((gap) => gap > 1);
  const wide = Math.max(8, Math.min(2.6 * size, 0.8 * Math.min(...gaps, width)));
  for (const share of [0.5, 0.9]) {
    const y = base - share * (base - top);
    add(svg, "line", { class: "guide", x1: side - wide / 2, x2: width - side + wide / 2, y1: y, y2: y });
    add(svg, "text", { class: "soft", x: 2, y: y + 4 }, String(share));
  }
  for (const place of places) {
    const x = at(place.x) - wide / 2, share = place.value ?? 0, y = base - share * (base - top), group = add(svg, "g", {});
    add(group, "title", {}, place.title ?? `${place.name}: ${place.text}`);
    if (place.hatched) add(group, "rect", { x, y: top, width: wide, height: base - top, fill: `url(#${svg.id}-hatch)` });
    add(group, "rect", { class: `bar ${place.look ?? ""}`, x, y, width: wide, height: Math.max(base - y, 0) });
    if (place.mark !== null && place.mark !== undefined) {
      const level = base - place.mark * (base - top);
      add(group, "line", { class: "mark", x1: x, x2: x + wide, y1: level, y2: level });
    }
    add(group, "text", { x: x + wide / 2, y: Math.max(y - 4, 0.8 * size), "text-anchor": "middle" }, place.text);
    add(group, "text", { class: "soft", x: x + wide / 2, y: base + 1.1 * size, "text-anchor": "middle" }, short(place.name));
  }
  add(svg, "line", { class: "base", x1: side - wide / 2, x2: width - side + wide / 2, y1: base, y2: base });
  add(svg, "text", { class: "soft", x: side - wide / 2, y: base + 2.2 * size }, "sleepers and drives (D), from the toe");
}
