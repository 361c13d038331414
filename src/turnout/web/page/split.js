// Panes that can be resized: by the mouse, or by arrow keys on the bar between them.
const root = document.documentElement;

function start(id, { name, least, most, of, pixels }) {
  const bar = document.getElementById(id);
  const set = (share) => {
    const kept = Math.max(least, Math.min(most, share));
    root.style.setProperty(name, `${(100 * kept).toFixed(2)}${of}`);
    bar.setAttribute("aria-valuenow", String(Math.round(100 * kept)));
    try { localStorage.setItem(name, String(kept)); } catch { /* private window */ }
  };
  const now = () => pixels() / (of === "vh" ? innerHeight : innerWidth);
  bar.setAttribute("aria-valuemin", String(100 * least));
  bar.setAttribute("aria-valuemax", String(100 * most));
  bar.setAttribute("aria-valuenow", String(Math.round(100 * now())));
  let from = null;
  bar.addEventListener("pointerdown", (event) => {
    from = { at: of === "vh" ? event.clientY : event.clientX, share: now() };
    bar.setPointerCapture(event.pointerId);
    event.preventDefault();
  });
  bar.addEventListener("pointermove", (event) => {
    if (!from) return;
    const by = of === "vh" ? (event.clientY - from.at) / innerHeight : (event.clientX - from.at) / innerWidth;
    set(from.share + by);
  });
  for (const end of ["pointerup", "pointercancel"]) bar.addEventListener(end, () => { from = null; });
  bar.addEventListener("keydown", (event) => {
    const by = { ArrowUp: -0.02, ArrowLeft: -0.02, ArrowDown: 0.02, ArrowRight: 0.02 }[event.key];
    if (!by) return;
    set(now() + by);
    event.preventDefault();
  });
  bar.addEventListener("dblclick", () => {
    root.style.removeProperty(name);
    try { localStorage.removeItem(name); } catch { /* private window */ }
  });
  let kept = NaN;
  try { kept = Number(localStorage.getItem(name) ?? NaN); } catch { /* private window */ }
  if (Number.isFinite(kept)) set(kept);
}

export function startSplitters() {
  start("split-plan", { name: "--plan-height", least: 0.12, most: 0.6, of: "vh", pixels: () => document.querySelector(".plan").offsetHeight });
  start("split-side", { name: "--side-width", least: 0.12, most: 0.5, of: "vw", pixels: () => document.querySelector("aside").offsetWidth });
}
