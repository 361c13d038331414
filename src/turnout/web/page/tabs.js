// Views, one at a time; arrow keys go from tab to tab.
import { notify } from "./state.js";

const tabs = () => [...document.querySelectorAll('[role="tab"]')];

export function openTab(name) {
  for (const tab of tabs()) {
    const mine = tab.id === `tab-${name}`;
    tab.setAttribute("aria-selected", String(mine));
    tab.tabIndex = mine ? 0 : -1;
    document.getElementById(tab.getAttribute("aria-controls")).hidden = !mine;
  }
  notify("view");
}

export const shownTab = () => tabs().find((tab) => tab.getAttribute("aria-selected") === "true").id.slice(4);

export const isOpen = (name) => !document.getElementById(`view-${name}`).hidden;

export function startTabs() {
  for (const tab of tabs()) {
    tab.addEventListener("click", () => openTab(tab.id.slice(4)));
    tab.addEventListener("keydown", (event) => {
      const all = tabs(), number = all.indexOf(tab);
      const next = { ArrowRight: number + 1, ArrowLeft: number - 1, Home: 0, End: all.length - 1 }[event.key];
      if (next === undefined) return;
      const chosen = all[(next + all.length) % all.length];
      openTab(chosen.id.slice(4));
      chosen.focus();
    });
  }
}
