"use strict";
// The token is in the address's fragment, which the browser keeps to itself.
const token = location.hash.slice(1);
const at = id => document.getElementById(id);
const ask = (path, more = {}) => fetch(path, { ...more, headers: { "X-Camrig-Token": token } });
const colours = { r: "#d55e00", g: "#009e73", b: "#0072b2" };
const colour = name => colours[name] || "#7f7f7f";
const chosen = { row: null, column: null };
let shown = 0;
let size = null;

function draw(canvas, series, top) {
  const g = canvas.getContext("2d");
  g.clearRect(0, 0, canvas.width, canvas.height);
  for (const [name, points] of series) {
    g.strokeStyle = colour(name);
    g.beginPath();
    for (const [x, y] of points) g.lineTo(x * canvas.width, (1 - y / top) * (canvas.height - 2) + 1);
    g.stroke();
  }
}

function histogram(state) {
  const most = Math.max(...state.histogram.flatMap(([, counts]) => counts));
  const series = state.histogram.map(([name, counts]) =>
    [name, counts.map((n, i) => [i / (counts.length - 1), Math.log1p(n)])]);
  draw(at("histogram"), series, Math.log1p(most) || 1);
}

function profile(canvas, samples, state) {
  const series = {};
  samples.forEach(([name, dn], i) => (series[name] ||= []).push([i / samples.length, dn]));
  draw(canvas, Object.entries(series), 2 ** state.bits - 1);
}

async function picture(id, path) {
  const answer = await ask(path);
  if (!answer.ok) return;
  const old = at(id).src;
  at(id).src = URL.createObjectURL(await answer.blob());
  if (old.startsWith("blob:")) URL.revokeObjectURL(old);
}

const seconds = s => (s < 1e-3 ? `${(s * 1e6).toFixed(0)} µs` : s < 1 ? `${(s * 1e3).toFixed(2)} ms` : `${s.toFixed(2)} s`);

async function update() {
  const where = Object.entries(chosen).filter(([, v]) => v !== null).map(([k, v]) => `${k}=${v}`).join("&");
  const answer = await ask(`/api/state?${where}`);
  if (!answer.ok) throw new Error(await answer.text());
  const state = await answer.json();
  if (state.ended) at("told").textContent = `the stream ended: ${state.ended}`;
  if (!state.frames || state.frames === shown) return;
  if (!shown) {
    at("exposure").value = Math.log10(state.exposure_s);
    at("gain").value = Math.log2(state.analog_gain);
  }
  shown = state.frames;
  size = [state.width, state.height];
  const means = state.channels.map(([name, mean, full]) => `${name} ${mean.toFixed(1)}` + (full > 0.001 ? ` (${(100 * full).toFixed(1)} % full)` : ""));
  at("told").textContent = `frame ${state.frames}, counter ${state.counter}, ${state.frames_per_s.toFixed(1)} frames/s` +
    (state.dropped ? `, ${state.dropped} dropped` : "") + (state.injected ? `, ${state.injected}` : "") +
    `; mean DN ${means.join(", ")}` + (state.refused ? `; ${state.refused}` : "") +
    (state.ended ? `; the stream ended: ${state.ended}` : "");
  at("exposure-now").textContent = seconds(state.exposure_s);
  at("gain-now").textContent = state.analog_gain.toFixed(2);
  at("noise-now").textContent = state.noise_dn === null ? "" : `${state.noise_dn.toFixed(2)} DN rms over ${state.noise_frames} frames`;
  at("row").textContent = state.row;
  at("column").textContent = state.column;
  histogram(state);
  profile(at("row-profile"), state.row_profile, state);
  profile(at("column-profile"), state.column_profile, state);
  await Promise.all([picture("frame", "/api/frame.png"), picture("noise", "/api/noise.png")]);
}

async function loop() {
  try {
    await update();
    setTimeout(loop, 150);
  } catch (error) {
    at("told").textContent = `${error.message}`;
    setTimeout(loop, 2000);
  }
}

const control = what => ask("/api/control", { method: "POST", body: JSON.stringify(what) });
at("exposure").addEventListener("change", e => control({ exposure_s: 10 ** e.target.value }));
at("gain").addEventListener("change", e => control({ analog_gain: 2 ** e.target.value }));
at("frame").addEventListener("click", e => {
  if (!size) return;
  const box = e.target.getBoundingClientRect();
  chosen.column = Math.floor(((e.clientX - box.left) / box.width) * size[0]);
  chosen.row = Math.floor(((e.clientY - box.top) / box.height) * size[1]);
});
loop();
