// Long requests: how much is done in percent, and a way to stop them.
import { get, post } from "./api.js";

const EVERY = 400; // between two looks at the progress [ms]
let count = 0;

// Post a request as a job; `bar` is a progress element, `said` takes the share in words. Null when it was stopped.
export async function runJob(address, body, { bar, said, started = () => {} }) {
  const job = `job-${Date.now()}-${++count}`;
  started(() => post(`/api/job/${job}/stop`, {}));
  bar.hidden = false;
  bar.removeAttribute("value");
  const looking = setInterval(async () => {
    try {
      const { share } = await get(`/api/job/${job}`);
      if (share === null || bar.hidden) return;
      bar.value = share;
      said(`${Math.round(100 * share)} %`);
    } catch { /* the request itself reports what is wrong */ }
  }, EVERY);
  try {
    const found = await post(`${address}?job=${job}`, body);
    return found.superseded ? null : found;
  } finally {
    clearInterval(looking);
    bar.hidden = true;
  }
}
