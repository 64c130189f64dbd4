// The plots: histogram, profile, frame times (uPlot).

const plots = { histogram: null, profile: null, time: null, along: "row" };
const times = [];
/** What the time plot spans, s. */
const TIME_SPAN = 10;
const superscript = n => String(n).replace(/\d/g, digit => "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit]);
const plain = (_, values) => values.map(v => v === null ? "" : String(+v.toPrecision(6)).replace("-", "−"));

function axis(more = {}) {
  const font = '12px "Helvetica Neue", Arial, "Liberation Sans", sans-serif';
  return {
    stroke: css("--soft"), grid: { stroke: css("--grid"), width: 1 },
    ticks: { stroke: css("--line"), width: 1, size: 4 }, font, labelFont: font, values: plain, ...more,
  };
}
const below = label => axis({ label, labelSize: 15, size: 26 });
const beside = label => axis({ label, labelSize: 16, size: 44 });

/** Makes a plot in an element, in its size. */
function makePlot(id, scales, axes, series, data) {
  const place = at(id);
  const options = {
    width: place.clientWidth, height: place.clientHeight, scales, axes, series,
    cursor: { drag: { x: true, y: false } }, legend: { show: false }, padding: [8, 10, 0, 0],
  };
  place.replaceChildren();
  return new uPlot(options, data, place);
}

/** One line per channel, Gb dashed. */
const channelSeries = (frame, more) => frame.channels.map(name => ({
  label: name, stroke: colourOf(name), width: 1.2, points: { show: false },
  dash: name === "Gb" ? [4, 3] : undefined, ...more,
}));

function plotHistogram(frame) {
  const { step, counts } = histogram(frame);
  const full = 2 ** frame.bits;
  const data = [counts[0].map((_, i) => i * step), ...counts.map(of => of.map(n => n || null))];
  say("histogram-bin", step === 1 ? "samples per DN" : `samples per ${step} DN`);
  if (plots.histogram) return plots.histogram.setData(data);
  const decades = (_, splits) => splits.map(v => Math.abs(Math.log10(v) % 1) < 1e-6 ? v : null);
  const top = 10 ** Math.ceil(Math.log10(frame.width * frame.height / frame.channels.length));
  const power = v => v === null ? "" : v < 1000 ? String(v) : "10" + superscript(Math.round(Math.log10(v)));
  const counted = {
    label: "samples", labelSize: 16, size: 44, filter: decades, values: (_, values) => values.map(power),
    grid: { stroke: css("--grid"), width: 1, filter: decades },
  };
  plots.histogram = makePlot("histogram", { x: { time: false, range: [0, full] }, y: { distr: 3, range: [0.8, top] } },
    [below("DN"), axis(counted)], [{}, ...channelSeries(frame, { paths: uPlot.paths.stepped({ align: 1 }) })], data);
}

/** The top of the profile: the power of two above its largest sample, so that noise does not move it. */
function profileTop(series, bits) {
  const most = series.reduce((most, of) => of.reduce((m, dn) => Math.max(m, dn || 0), most), 16);
  return 2 ** Math.min(bits, Math.ceil(Math.log2(most * 1.05)));
}

function plotProfile(frame) {
  const row = plots.along === "row";
  const { first, last, series, length } = profile(frame, row ? picture.row : picture.column, plots.along);
  const what = row ? "Row" : "Column";
  say("profile-title", first === last ? `${what} ${first}` : `${what}s ${first} and ${last}`);
  const data = [Array.from({ length }, (_, i) => i), ...series];
  if (plots.profile) {
    plots.profile.setData(data, false);
    plots.profile.setScale("y", { min: 0, max: profileTop(series, frame.bits) });
    return;
  }
  plots.profile = makePlot("profile", { x: { time: false }, y: { auto: false } },
    [below(row ? "column" : "row"), beside("DN")], [{}, ...channelSeries(frame, { spanGaps: true })], data);
  plots.profile.setScale("y", { min: 0, max: profileTop(series, frame.bits) });
}

const lateSeries = () => ({
  label: "late", stroke: css("--bad"), paths: () => null, points: { show: true, size: 7, fill: css("--bad") },
});

function plotTimes(fps) {
  const newest = times.length ? times[times.length - 1].at_s : 0;
  while (times.length && times[0].at_s < newest - TIME_SPAN) times.shift();
  const shown = times.filter(t => t.period_ms > 0);
  const periods = shown.map(t => t.period_ms), late = shown.map(t => t.late ? t.period_ms : null);
  const data = [shown.map(t => t.at_s - newest), periods, late], asked = 1000 / fps;
  say("time-asked", `target ${+asked.toPrecision(4)} ms · ● late`);
  if (plots.time) return plots.time.setData(data);
  const range = (_, low, high) =>
    [Math.min(0.9 * asked, 0.98 * (low ?? asked)), Math.max(1.1 * asked, 1.02 * (high ?? asked))];
  plots.time = makePlot("time", { x: { time: false, range: [-TIME_SPAN, 0] }, y: { range } },
    [below("seconds"), beside("ms")],
    [{}, { label: "period", stroke: css("--soft"), width: 1, points: { show: false } }, lateSeries()], data);
}

/** Draws all plots anew, in other colours, of another sensor or another size. */
function resetPlots(which = ["histogram", "profile", "time"]) {
  for (const name of which) {
    if (plots[name]) plots[name].destroy();
    plots[name] = null;
  }
}

/** Draws the plots of a frame. */
function drawPlots(frame, fps) {
  if (at("histogram").clientWidth === 0) return;
  plotHistogram(frame);
  plotProfile(frame);
  plotTimes(fps);
}

function setUpPlots(redraw) {
  choice("profile-way", value => { plots.along = value; resetPlots(["profile"]); redraw(); });
  new ResizeObserver(() => { resetPlots(); redraw(); }).observe(document.querySelector("main"));
}
