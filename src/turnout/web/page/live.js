// Requests throws while sliders move: a preview at once, the final result when they stop. The newest wins.
import { post } from "./api.js";
import { currentRequest, state, notify } from "./state.js";

const EVERY = 50; // at most 20 requests a second
const UNSEEN = 1000; // without a frame for so long nothing is painted [ms]
const REST = 220; // pause that ends a movement [ms]
export const PAINTED = "slider to painted number"; // name of the measures that benchmarks read
let number = 0, shown = 0, last = 0, waiting = null, resting = null, moved = null;
let ofThrow = false; // whether the message is why a throw failed

const note = (text) => { document.getElementById("state").textContent = text; };

// Call back when what was changed is on the screen, with the time; without one where nothing is
// painted, as in a tab that is not shown.
function painted(callback) {
  let done = false;
  const once = (now) => { if (!done) { done = true; callback(now); } };
  requestAnimationFrame(() => setTimeout(() => once(performance.now())));
  setTimeout(() => once(null), UNSEEN);
}

function show(answer, request, { latest, since }) {
  Object.assign(state, { answer, request });
  stale(false);
  if (ofThrow) message(""); // others, such as of a refused file, are not for a throw to hide
  const how = request.preview ? "preview" : `final result (${answer.seconds.toFixed(2)} s)`;
  notify("answer");
  // Numbers first: curves take longer to draw.
  painted((now) => {
    if (since !== null && now !== null) performance.measure(PAINTED, { start: since, end: now });
    if (state.answer !== answer) return;
    notify("painted");
    // An older request must not be labelled as the throw of the sliders.
    note(latest() ? how : "computing ...");
  });
}

async function requestThrow(preview, since = null) {
  last = performance.now();
  const mine = ++number;
  const request = currentRequest(preview);
  const slow = setTimeout(() => note(state.start.compiling && !state.answer
    ? "first throw: compiling, 1 to 2 minutes ..." : "computing ..."), 400);
  try {
    const answer = await post("/api/run", request);
    if (answer.superseded || mine < shown) return;
    shown = mine;
    show(answer, request, { latest: () => mine === number, since });
  } catch (error) {
    if (mine < shown) return;
    shown = mine;
    stale(true);
    note(state.answer ? "not up to date" : "");
    message(error.message);
    ofThrow = true;
  } finally {
    clearTimeout(slow);
  }
}

// After an error the page shows the previous throw: mark it, and keep it from being saved as this one.
function stale(wanted) {
  document.body.classList.toggle("stale", wanted);
  for (const id of ["save", "pin"]) document.getElementById(id).disabled = wanted;
}

export function message(text) {
  document.getElementById("message-text").textContent = text;
  document.getElementById("message").hidden = !text;
  ofThrow = false;
}

// On a change: a preview soon, the final result after a pause. `since` is when the user made it.
export function changed(since = performance.now()) {
  if (!ofThrow) message("");
  clearTimeout(resting);
  resting = setTimeout(settled, REST);
  moved ??= since;
  if (waiting !== null) return;
  waiting = setTimeout(() => {
    const first = moved;
    waiting = moved = null;
    requestThrow(true, first);
  }, Math.max(0, last + EVERY - performance.now()));
}

export function settled() {
  const first = moved;
  clearTimeout(resting);
  clearTimeout(waiting);
  waiting = moved = null;
  notify("request");
  return requestThrow(false, first);
}

export function startLive() {
  document.getElementById("message-close").addEventListener("click", () => message(""));
}
