// Samples to pixels: bilinear demosaicing where a sample has a pixel or more, means of whole cells of the
// pattern where it has less; white balance, colour matrix and levels come with the frame.

const LEVELS = 4096;
/** sRGB transfer function, IEC 61966-2-1. */
const GAMMA = Uint8Array.from({ length: LEVELS }, (_, i) => {
  const v = i / (LEVELS - 1);
  return Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
});
/** Pixels, little-endian ABGR. */
const AT_WHITE = 0xff7a00e6, AT_ZERO = 0xffff7800;
/** White of the noise map, in root mean squares. */
const NOISE_WHITE = 3;
/** Share of the pixels that the preview lets be white, and the most it brightens. */
const WHITE_SHARE = 0.01, MOST_BRIGHTENING = 16;

const kernels = new Map();

/** Places and weights of the neighbours from which each cell of a pattern takes R, G and B. */
function kernelOf(frame, stride) {
  const key = [frame.cfa.letters, frame.columns, stride].join();
  if (!kernels.has(key)) kernels.set(key, makeKernel(frame, stride));
  return kernels.get(key);
}

function makeKernel(frame, stride) {
  const reach = reachOf(frame), places = [], weights = [], starts = [0];
  for (let cell = 0; cell < frame.cellRgb.length; cell++) {
    for (let c = 0; c < 3; c++) {
      const own = [];
      for (let v = -reach; v <= reach; v++) {
        for (let u = -reach; u <= reach; u++) {
          const x = cell % frame.columns + u + 2 * reach * frame.columns;
          const y = Math.floor(cell / frame.columns) + v + 2 * reach * frame.rows;
          const rgb = frame.cellRgb[frame.cell(x, y)];
          if (rgb < 0 || rgb === c) own.push([v * stride + u, (reach + 1 - Math.abs(u)) * (reach + 1 - Math.abs(v))]);
        }
      }
      const sum = own.reduce((s, [, weight]) => s + weight, 0);
      own.forEach(([place, weight]) => { places.push(place); weights.push(weight / sum); });
      starts.push(places.length);
    }
  }
  return { places: Int32Array.from(places), weights: Float32Array.from(weights), starts: Int32Array.from(starts) };
}

/** Distance within which every pixel has neighbours of every channel. */
const reachOf = frame => Math.max(1, Math.max(frame.columns, frame.rows) >> 1);

let signals = new Float32Array(0);

/** White-balanced signals of a rectangle with a border; beyond the frame's edges the pattern's last period goes on. */
function signalsOf(frame, rect, border) {
  const stride = rect.width + 2 * border, rows = rect.height + 2 * border;
  if (signals.length < stride * rows) signals = new Float32Array(stride * rows);
  const continued = (k, period, n) => Math.max(0, Math.min(k < 0 ? k + period : k >= n ? k - period : k, n - 1));
  const columns = Int32Array.from({ length: stride }, (_, i) => continued(rect.x + i - border, frame.columns, frame.width));
  for (let j = 0, out = 0; j < rows; j++) {
    const y = continued(rect.y + j - border, frame.rows, frame.height), base = y * frame.width, cells = (y % frame.rows) * frame.columns;
    for (let i = 0; i < stride; i++, out++) {
      const x = columns[i], cell = cells + x % frame.columns;
      const v = (frame.samples[base + x] - frame.black_dn[cell]) * frame.scale_per_dn[cell];
      signals[out] = v < 1 ? v : 1;
    }
  }
  return stride;
}

/** One pixel for each sample of a rectangle. */
function developFine(frame, rect, factor, clipping, out) {
  const stride = signalsOf(frame, rect, reachOf(frame));
  (frame.bayer ? developBayer : developPattern)(frame, rect, stride, factor, out);
  if (clipping) markClipped(frame, rect, out);
}

/** Any pattern of colour filters, by its kernel. */
function developPattern(frame, rect, stride, factor, out) {
  const pixel = toPixel(frame, factor);
  const border = reachOf(frame), { places, weights, starts } = kernelOf(frame, stride), s = signals;
  for (let j = 0, o = 0; j < rect.height; j++) {
    const cells = ((rect.y + j) % frame.rows) * frame.columns;
    for (let x = rect.x, i = (j + border) * stride + border; x < rect.x + rect.width; x++, o++, i++) {
      let k = 3 * (cells + x % frame.columns), r = 0, g = 0, b = 0, t = starts[k];
      for (const end = starts[k + 1]; t < end; t++) r += s[i + places[t]] * weights[t];
      for (const end = starts[k + 2]; t < end; t++) g += s[i + places[t]] * weights[t];
      for (const end = starts[k + 3]; t < end; t++) b += s[i + places[t]] * weights[t];
      out[o] = pixel(r, g, b);
    }
  }
}

/** The same kernels for the patterns of Bayer, written out with the colour matrix: some times as fast. */
function developBayer(frame, rect, stride, factor, out) {
  const s = signals, gamma = GAMMA, most = LEVELS - 1;
  const matrix = frame.srgb_from_camera.map(row => row.map(v => v * factor * most));
  for (let j = 0, o = 0; j < rect.height; j++) {
    const cells = ((rect.y + j) % 2) * 2, [first, second] = [frame.cellRgb[cells], frame.cellRgb[cells + 1]];
    // The row's own colour beside green, and the one of the rows above and below.
    const mine = first === 1 ? second : first, theirs = 2 - mine;
    const [[rm, rg, rt], [gm, gg, gt], [bm, bg, bt]] = matrix.map(row => [row[mine], row[1], row[theirs]]);
    let green = (rect.x % 2 ? second : first) === 1;
    let up = j * stride, at = up + stride, down = at + stride;
    let nw = s[up], n = s[up + 1], w = s[at], c = s[at + 1], sw = s[down], so = s[down + 1];
    up += 2; at += 2; down += 2;
    for (const end = at + rect.width; at < end; at++, up++, down++, o++) {
      const ne = s[up], e = s[at], se = s[down];
      let m, g, t;
      if (green) {
        m = (w + e) * 0.5; g = c * 0.5 + (nw + ne + sw + se) * 0.125; t = (n + so) * 0.5;
      } else {
        m = c; g = (w + e + n + so) * 0.25; t = (nw + ne + sw + se) * 0.25;
      }
      const red = rm * m + rg * g + rt * t, grn = gm * m + gg * g + gt * t, blu = bm * m + bg * g + bt * t;
      out[o] = 0xff000000 | gamma[blu <= 0 ? 0 : blu >= most ? most : blu + 0.5 | 0] << 16
        | gamma[grn <= 0 ? 0 : grn >= most ? most : grn + 0.5 | 0] << 8 | gamma[red <= 0 ? 0 : red >= most ? most : red + 0.5 | 0];
      green = !green;
      nw = n; n = ne; w = c; c = e; sw = so; so = se;
    }
  }
}

/** Marks samples at white and at zero. */
function markClipped(frame, rect, out) {
  const white = frame.white_level_dn, { samples } = frame;
  for (let j = 0, o = 0; j < rect.height; j++) {
    for (let i = (rect.y + j) * frame.width + rect.x, end = i + rect.width; i < end; i++, o++) {
      if (samples[i] >= white) out[o] = AT_WHITE;
      else if (samples[i] === 0) out[o] = AT_ZERO;
    }
  }
}

/** White-balanced camera colour to a pixel. */
function toPixel(frame, factor) {
  const most = LEVELS - 1;
  const [[a, b, c], [d, e, f], [g, h, k]] = frame.srgb_from_camera.map(row => row.map(v => v * factor * most));
  return (x, y, z) => {
    const red = a * x + b * y + c * z, green = d * x + e * y + f * z, blue = g * x + h * y + k * z;
    return 0xff000000 | GAMMA[blue <= 0 ? 0 : blue >= most ? most : blue + 0.5 | 0] << 16
      | GAMMA[green <= 0 ? 0 : green >= most ? most : green + 0.5 | 0] << 8
      | GAMMA[red <= 0 ? 0 : red >= most ? most : red + 0.5 | 0];
  };
}

/** Means of R, G and B of the square of samples that `blockAt` looked at last. */
const block = new Float64Array(3);

/** Finds the mean camera colour of a square of samples; a pixel's mark where samples are clipped in it, else 0. */
function blockAt(frame, x0, y0, step) {
  const { samples, width, columns, rows, cellRgb, black_dn: black, scale_per_dn: scale, white_level_dn: white } = frame;
  const right = Math.min(x0 + step, width), bottom = Math.min(y0 + step, frame.height);
  let clipped = 0, r = 0, g = 0, b = 0, reds = 0, greens = 0, blues = 0;
  for (let y = y0; y < bottom; y++) {
    const cells = (y % rows) * columns;
    for (let x = x0, i = y * width + x0; x < right; x++, i++) {
      const cell = cells + x % columns, dn = samples[i], rgb = cellRgb[cell];
      const v = Math.min(1, (dn - black[cell]) * scale[cell]);
      if (dn >= white) clipped = AT_WHITE;
      else if (dn === 0 && clipped === 0) clipped = AT_ZERO;
      // A sample without colour counts for all three.
      if (rgb === 0 || rgb < 0) { r += v; reds++; }
      if (rgb === 1 || rgb < 0) { g += v; greens++; }
      if (rgb === 2 || rgb < 0) { b += v; blues++; }
    }
  }
  block[0] = r / Math.max(1, reds);
  block[1] = g / Math.max(1, greens);
  block[2] = b / Math.max(1, blues);
  return clipped;
}

/** One pixel for each square of `step` samples of a rectangle. */
function developCoarse(frame, rect, step, factor, clipping, out) {
  const pixel = toPixel(frame, factor);
  let o = 0;
  for (let y = rect.y; y < rect.y + rect.height; y += step) {
    for (let x = rect.x; x < rect.x + rect.width; x += step) {
      const clipped = blockAt(frame, x, y, step);
      out[o++] = clipping && clipped ? clipped : pixel(block[0], block[1], block[2]);
    }
  }
}

/** Temporal noise in grey, from 0 to three times its root mean square: one pixel for each square of samples. */
function drawNoise(frame, rect, step, top, out) {
  let o = 0;
  for (let y = rect.y; y < rect.y + rect.height; y += step) {
    for (let x = rect.x; x < rect.x + rect.width; x += step) {
      let sum = 0, n = 0;
      for (let v = y; v < Math.min(y + step, frame.height); v++) {
        for (let u = x; u < Math.min(x + step, frame.width); u++) { sum += noise.squares[v * frame.width + u]; n++; }
      }
      const sigma = Math.sqrt(sum / n / Math.max(1, noise.frames - 1));
      const grey = Math.min(255, Math.round(255 * sigma / top)) || 0;
      out[o++] = (0xff000000 | grey << 16 | grey << 8 | grey) >>> 0;
    }
  }
}

/** DN of the noise map's white. */
function noiseWhite(frame) {
  const of = noiseOf(frame);
  return of[0] === null ? null : NOISE_WHITE * Math.sqrt(of.reduce((s, v) => s + v * v, 0) / of.length);
}

/** The factor by which the preview is brighter than the capture: its brightest hundredth is white. */
function brightening(frame) {
  const period = Math.max(frame.columns, frame.rows), blocks = frame.width * frame.height / period ** 2;
  const stride = period * Math.max(1, Math.round(Math.sqrt(blocks / 2000)));
  const levels = [[], [], []];
  for (let y = 0; y + period <= frame.height; y += stride) {
    for (let x = 0; x + period <= frame.width; x += stride) {
      blockAt(frame, x, y, period);
      frame.srgb_from_camera.forEach((row, c) => levels[c].push(row[0] * block[0] + row[1] * block[1] + row[2] * block[2]));
    }
  }
  const high = Math.max(0, ...levels.map(of => of.sort((a, b) => b - a)[Math.floor(WHITE_SHARE * of.length)] || 0));
  return Math.max(1, Math.min(MOST_BRIGHTENING, 1 / Math.max(high, 1e-9)));
}
