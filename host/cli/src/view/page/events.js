// Errors as banners until they are dismissed, and the log of everything.

const events = { newest: 0, lines: [], shown: 0 };
/** Banners at a time; the log has all. */
const MOST_BANNERS = 4;
const MOST_LINES = 200;

function takeEvents(fresh) {
  if (!fresh.length) return;
  for (const event of fresh) {
    // A server that was started again counts from 1.
    events.newest = event.number;
    const again = events.lines.findLast(line => line.text === event.text && line.source === event.source);
    if (again && event.count > 1) Object.assign(again, event);
    else events.lines.push(event);
    if (event.error) showBanner(event);
  }
  events.lines.splice(0, events.lines.length - MOST_LINES);
}

/** Writes the log, the newest line first; events that come with every frame are counted meanwhile. */
function showLog() {
  if (events.shown === events.newest) return;
  events.shown = events.newest;
  const line = ({ frame, source, text, count }) =>
    element("span", {}, `${String(frame).padStart(6)} ${source.padEnd(6)} ${text}${repeated(count)}`);
  document.querySelector("#log pre").replaceChildren(...events.lines.map(line).reverse());
  say("log-lines", events.lines.length === 1 ? "1 line" : `${events.lines.length} lines`);
}

const repeated = count => count > 1 ? ` (${count} times)` : "";

function showBanner(event) {
  const place = at("banners");
  const text = `Frame ${whole(event.frame)}, ${event.source}: ${event.text}${repeated(event.count)}`;
  const same = [...place.children].find(banner => banner.dataset.text === event.text);
  if (same) return say(same.firstChild, text);
  const button = element("button", {}, "Dismiss");
  const banner = element("div", { class: "banner", role: "alert" }, element("span", {}, text), button);
  banner.dataset.text = event.text;
  button.addEventListener("click", () => banner.remove());
  place.append(banner);
  while (place.children.length > MOST_BANNERS) place.firstChild.remove();
}
