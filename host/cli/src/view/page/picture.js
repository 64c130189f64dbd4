// The picture: zoom, pan, what is shown, clipping, region, readout.

const picture = {
  frame: null, zoom: "fit", mode: "preview", clipping: true, lines: true, selecting: false,
  centre: null, cursor: null, row: 0, column: 0, region: null, factor: 1, factored: -Infinity, noiseWhite: null,
};
const stage = at("stage");
const developed = document.createElement("canvas");
/** Pixels of the developed picture, kept while its size is the same. */
let pixelsOf = null;

/** The scale (canvas pixels per sample) and the place of sample 0, 0 on the canvas. */
function placement() {
  const { frame, zoom } = picture, ratio = devicePixelRatio || 1;
  const scale = zoom === "fit" ? Math.min(stage.width / frame.width, stage.height / frame.height) : zoom * ratio;
  const place = (size, length, centre) => {
    if (size <= length) return Math.round((length - size) / 2);
    return Math.round(Math.min(0, Math.max(length - size, length / 2 - centre * scale)));
  };
  const centre = picture.centre || { x: frame.width / 2, y: frame.height / 2 };
  return {
    scale,
    x: place(frame.width * scale, stage.width, centre.x),
    y: place(frame.height * scale, stage.height, centre.y),
  };
}

/** What of the frame lies on the canvas, in whole periods of the pattern and whole steps. */
function visible({ scale, x, y }, step) {
  const { frame } = picture;
  const cut = (offset, length, size, period) => {
    const unit = Math.max(step, period);
    const first = Math.max(0, Math.floor(-offset / scale / unit) * unit);
    const end = Math.min(size, Math.ceil((length - offset) / scale / unit) * unit);
    return [first, Math.max(1, end - first)];
  };
  const [left, width] = cut(x, stage.width, frame.width, frame.columns);
  const [top, height] = cut(y, stage.height, frame.height, frame.rows);
  return { x: left, y: top, width, height };
}

function resizeStage() {
  const ratio = devicePixelRatio || 1, box = stage.getBoundingClientRect();
  const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
  if (width && (stage.width !== width || stage.height !== height)) Object.assign(stage, { width, height });
}

/** Draws the frame as it is asked for. */
function drawPicture() {
  const { frame, mode } = picture;
  if (!frame) return;
  resizeStage();
  const place = placement();
  const period = Math.max(frame.columns, frame.rows);
  const step = place.scale >= 0.5 ? 1 : period * Math.ceil(1 / place.scale / period);
  const rect = visible(place, step);
  const [width, height] = [Math.ceil(rect.width / step), Math.ceil(rect.height / step)];
  if (developed.width !== width || developed.height !== height) Object.assign(developed, { width, height });
  const small = developed.getContext("2d");
  if (!pixelsOf || pixelsOf.width !== width || pixelsOf.height !== height) pixelsOf = small.createImageData(width, height);
  const pixels = new Uint32Array(pixelsOf.data.buffer);
  if (mode === "noise") {
    drawNoise(frame, rect, step, picture.noiseWhite || Infinity, pixels);
  } else {
    const factor = mode === "preview" ? picture.factor : 1;
    if (step === 1) developFine(frame, rect, factor, picture.clipping, pixels);
    else developCoarse(frame, rect, step, factor, picture.clipping, pixels);
  }
  small.putImageData(pixelsOf, 0, 0);
  const g = stage.getContext("2d");
  g.fillStyle = "#000";
  g.fillRect(0, 0, stage.width, stage.height);
  g.imageSmoothingEnabled = place.scale < 1 && step === 1;
  const { x, y, scale } = place;
  g.drawImage(developed, x + rect.x * scale, y + rect.y * scale, width * step * scale, height * step * scale);
  drawMarks(g, place);
}

/** Lines of the profiles, the region, the sample under the cursor. */
function drawMarks(g, { x, y, scale }) {
  const { frame, row, column, region, cursor } = picture;
  g.lineWidth = devicePixelRatio || 1;
  if (picture.lines) {
    g.fillStyle = "rgba(255, 255, 255, .5)";
    g.fillRect(x, Math.round(y + (row + 0.5) * scale), frame.width * scale, g.lineWidth);
    g.fillRect(Math.round(x + (column + 0.5) * scale), y, g.lineWidth, frame.height * scale);
  }
  const outline = (colour, left, top, width, height) => {
    g.strokeStyle = colour;
    g.strokeRect(x + left * scale, y + top * scale, width * scale, height * scale);
  };
  if (region) {
    outline("#000", region.x - 1 / scale, region.y - 1 / scale, region.width + 2 / scale, region.height + 2 / scale);
    outline("#fff", region.x, region.y, region.width, region.height);
  }
  if (cursor && scale >= 3) outline("#fff", cursor.x, cursor.y, 1, 1);
}

/** The sample under a pointer, or null beside the frame. */
function sampleAt(event) {
  const { frame } = picture;
  if (!frame) return null;
  const box = stage.getBoundingClientRect(), { scale, x, y } = placement();
  const column = Math.floor(((event.clientX - box.left) * stage.width / box.width - x) / scale);
  const row = Math.floor(((event.clientY - box.top) * stage.height / box.height - y) / scale);
  return column >= 0 && row >= 0 && column < frame.width && row < frame.height ? { x: column, y: row } : null;
}

/** Says position, filter and DN of the sample under the cursor. */
function readOut() {
  const { frame, cursor } = picture;
  if (!frame || !cursor) return;
  const { x, y } = cursor, name = frame.channels[frame.channelAt(x, y)];
  say("pixel", `x ${x} · y ${y} · ${name} ${frame.at(x, y)} DN`);
}

/** A region between two samples, in whole periods of the pattern so that each channel has its share. */
function regionBetween(a, b) {
  const { frame } = picture;
  const span = (p, q, period, size) => {
    const first = Math.min(p, q), from = first - first % period;
    const to = Math.min(size, Math.ceil((Math.max(p, q) + 1) / period) * period);
    return [from, to - from];
  };
  const [x, width] = span(a.x, b.x, frame.columns, frame.width), [y, height] = span(a.y, b.y, frame.rows, frame.height);
  return { x, y, width, height };
}

/** A new frame is there; the preview's brightness is found twice a second, so that it does not flicker. */
function showFrame(frame, now) {
  if (!picture.frame || picture.frame.width !== frame.width || picture.frame.height !== frame.height) {
    Object.assign(picture, { row: frame.height >> 1, column: frame.width >> 1, centre: null, region: null });
    stage.style.aspectRatio = `${frame.width} / ${frame.height}`;
  }
  picture.frame = frame;
  if (now - picture.factored > 500) {
    picture.factored = now;
    picture.factor = brightening(frame);
    say(document.querySelector("#mode [data-value=preview]"), `Preview × ${picture.factor.toFixed(2)}`);
  }
  drawPicture();
  readOut();
}

/** Buttons of which one is pressed. */
function choice(id, chosen) {
  at(id).addEventListener("click", event => {
    const button = event.target.closest("button");
    if (!button) return;
    for (const other of at(id).children) other.setAttribute("aria-pressed", String(other === button));
    chosen(button.dataset.value);
  });
}

function setUpPicture(measured) {
  const redraw = () => { drawPicture(); measured(); };
  choice("zoom", value => {
    picture.zoom = value === "fit" ? value : Number(value);
    stage.classList.toggle("zoomed", value !== "fit");
    picture.centre = picture.cursor && { ...picture.cursor };
    redraw();
  });
  choice("mode", value => { picture.mode = value; redraw(); });
  for (const [id, key] of [["clipping", "clipping"], ["lines", "lines"], ["region", "selecting"]]) {
    at(id).addEventListener("change", event => {
      picture[key] = event.target.checked;
      if (key === "selecting" && !picture.selecting) picture.region = null;
      redraw();
    });
  }
  let from = null, moved = false;
  stage.addEventListener("pointerdown", event => {
    const sample = sampleAt(event);
    from = sample && { sample, x: event.clientX, y: event.clientY, centre: picture.centre };
    moved = false;
    if (sample) stage.setPointerCapture(event.pointerId);
  });
  stage.addEventListener("pointermove", event => {
    const sample = sampleAt(event);
    if (sample) picture.cursor = sample;
    if (from && Math.hypot(event.clientX - from.x, event.clientY - from.y) > 3) moved = true;
    if (from && moved && picture.selecting && sample) {
      picture.region = regionBetween(from.sample, sample);
      redraw();
    } else if (from && moved && picture.zoom !== "fit") {
      const centre = from.centre || { x: picture.frame.width / 2, y: picture.frame.height / 2 };
      picture.centre = {
        x: Math.min(picture.frame.width, Math.max(0, centre.x - (event.clientX - from.x) / picture.zoom)),
        y: Math.min(picture.frame.height, Math.max(0, centre.y - (event.clientY - from.y) / picture.zoom)),
      };
      redraw();
    }
    readOut();
  });
  stage.addEventListener("pointerup", event => {
    const sample = sampleAt(event);
    if (from && !moved && sample) Object.assign(picture, { row: sample.y, column: sample.x });
    from = null;
    redraw();
  });
  stage.addEventListener("keydown", event => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const { frame } = picture;
    if (event.key === "Escape") stage.blur();
    if (!frame || !(step || event.key === "Enter")) return;
    event.preventDefault();
    const { x, y } = picture.cursor || { x: picture.column, y: picture.row };
    const within = (v, size) => Math.min(size - 1, Math.max(0, v));
    const [u, v] = step || [0, 0];
    picture.cursor = { x: within(x + u, frame.width), y: within(y + v, frame.height) };
    if (!step) Object.assign(picture, { row: y, column: x });
    if (picture.zoom !== "fit") picture.centre = { ...picture.cursor };
    redraw();
    readOut();
  });
  new ResizeObserver(redraw).observe(stage);
}
