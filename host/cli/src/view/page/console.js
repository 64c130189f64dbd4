// What the page does with what it is told.

let state = null;
/** A frame that came and is not drawn yet. */
let waitingFrame = null;
/** Figures and plots are drawn at most this often, ms: they take as long as a picture, and eyes read five in a second. */
const FIGURES_PAUSE = 200;
let measuredAt = -Infinity;
/** When frames were shown, for their rate. */
const shownAt = [];

const STATUS = {
  starting: ["waiting for the first frame", ""],
  streaming: ["streaming", "good"],
  reconnecting: ["reconnecting to the rig", "bad"],
};

function showStatus(words, kind) {
  say("status", words);
  at("status").className = `pill ${kind}`;
}

/** Words and kind of the status; before the first frame what is waited for. */
function statusOf({ status, busy }) {
  if (status === "starting" && busy) return [busy, ""];
  return link.frozen && status === "streaming" ? ["frozen; the rig is streaming", ""] : STATUS[status];
}

function showBar() {
  const { source, frames, frames_per_s: rate, late, dropped, recording, scene } = state;
  if (!at("source").textContent) at("source").append(`${source.camera} · `, element("code", {}, source.rig));
  showStatus(...statusOf(state));
  say("frames", whole(frames));
  say("rate", rate === null ? "–" : `${rate.toFixed(1)} /s`);
  const span = shownAt.at(-1) - shownAt[0];
  say("shown", span > 0 ? `${(1000 * (shownAt.length - 1) / span).toFixed(1)} /s` : "–");
  say("late", whole(late));
  at("late").className = late ? "hot" : "";
  at("scene-late-of").hidden = !scene;
  say("scene-late", whole(scene ? scene.late : 0));
  at("scene-late").className = scene && scene.late ? "hot" : "";
  say("dropped", whole(dropped));
  at("dropped").className = dropped ? "hot" : "";
  at("record").setAttribute("aria-pressed", String(!!recording));
  say("record", recording ? `Recording ${whole(recording.frames)}` : "Record");
}

function channelRow(name, width) {
  const swatch = element("i", { class: "swatch" });
  swatch.style.background = `var(${channelVariable(name)})`;
  const cells = Array.from({ length: width }, () => element("td"));
  return element("tr", {}, element("th", {}, swatch, name), ...cells);
}

/** Fills a table: a row per channel, with its name and its texts. Rows are made anew only for other channels. */
function fillTable(id, rows) {
  const body = document.querySelector(`${id} tbody`), names = rows.map(([name]) => name).join();
  if (body.dataset.names !== names) {
    body.dataset.names = names;
    body.replaceChildren(...rows.map(([name, ...texts]) => channelRow(name, texts.length)));
  }
  rows.forEach(([, ...texts], i) => texts.forEach((text, k) => say(body.children[i].children[k + 1], text)));
  return body;
}

/** The table per channel, the shares of clipped samples, the region's figures. */
function showFigures() {
  const { frame } = picture;
  const figures = statistics(frame), noises = noiseOf(frame);
  const body = fillTable("#channels", figures.map((of, c) => [
    of.name, (of.mean - frame.black).toFixed(1).replace("-", "−"),
    noises[c] === null ? "–" : noises[c].toFixed(2), percent(of.white)]));
  figures.forEach((of, c) => body.children[c].lastChild.classList.toggle("hot", of.white > 0.01));
  say("channels-note", `Mean above black ${+frame.black.toFixed(2)}; temporal noise over ${noise.frames} frames.`
    + (frame.injected ? ` This frame: ${frame.injected}.` : ""));
  const total = figures.reduce((s, of) => s + of.n, 0);
  const share = key => percent(figures.reduce((s, of) => s + of[key] * of.n, 0) / total);
  say("at-white", share("white"));
  say("at-zero", share("zero"));
  picture.noiseWhite = noiseWhite(frame);
  at("noise-scale").hidden = picture.mode !== "noise";
  say("noise-scale", picture.noiseWhite === null ? "noise map: needs two frames"
    : `noise map: black 0, white ${picture.noiseWhite.toFixed(2)} DN`);
  showRegion(frame);
}

function showRegion(frame) {
  const { region, selecting } = picture;
  at("region-figures").hidden = !selecting;
  if (!selecting) return;
  say("region-place", region ? `x ${region.x}, y ${region.y}, ${region.width} × ${region.height} samples`
    : "draw a rectangle on the picture");
  const figures = region ? statistics(frame, region) : [];
  fillTable("#region-figures", figures.filter(of => of.n).map(of =>
    [of.name, of.mean.toFixed(2), of.deviation.toFixed(2), whole(of.n)]));
}

/** Figures and plots of what is shown. */
function measure() {
  if (!picture.frame) return;
  showFigures();
  drawPlots(picture.frame, state.source.fps);
}

/** Takes a message: what must not be missed, and the frame to be drawn next. */
function hear(told, samples) {
  state = told;
  const newest = times.length ? times[times.length - 1].frame : 0;
  times.push(...told.times.filter(time => time.frame > newest));
  takeEvents(told.events);
  if (told.frame) waitingFrame = makeFrame(told.frame, samples);
}

/** Draws what came last. */
function draw() {
  const now = performance.now();
  if (waitingFrame) {
    const frame = waitingFrame, shown = picture.frame;
    waitingFrame = null;
    if (!shown || shown.bits !== frame.bits || shown.width !== frame.width) resetPlots();
    addToNoise(frame);
    showFrame(frame, now);
    shownAt.push(now);
    while (shownAt[0] < now - 2000) shownAt.shift();
  }
  if (now - measuredAt < FIGURES_PAUSE) return;
  measuredAt = now;
  showBar();
  showLog();
  showControls(state, picture.frame);
  showRegisters(state.registers, send);
  measure();
}

/** Says why nothing comes. */
function lost(atOnce) {
  showStatus(atOnce && !state ? "no connection: is the address complete, as camrig printed it?"
    : "camrig has ended or cannot be reached: see its terminal", "bad");
}

setUpPicture(measure);
setUpPlots(measure);
setUpControls(send);
at("freeze").addEventListener("click", () => {
  link.frozen = !link.frozen;
  at("freeze").setAttribute("aria-pressed", String(link.frozen));
});
at("save").addEventListener("click", () => send("save"));
at("record").addEventListener("click", () => send({ set: { record: !(state && state.recording) } }));
at("theme").addEventListener("click", () => {
  document.documentElement.classList.toggle("dark");
  resetPlots();
  measure();
});
openLink(hear, draw, lost);
