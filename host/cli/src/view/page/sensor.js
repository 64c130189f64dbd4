// A frame: its samples, its colour filters, and figures per channel.

/** Whether a pattern is one of Bayer: two greens on a diagonal. */
const isBayer = ({ width, letters }) => width === 2 && ["RGGB", "BGGR", "GRBG", "GBRG"].includes(letters);

/** Names of the channels of a pattern's cells: Bayer has two greens, named by their rows. */
function cellNames({ width, letters }) {
  const bayer = isBayer({ width, letters });
  return [...letters].map((letter, i) => {
    if (!bayer || letter !== "G") return letters.length === 1 ? "all" : letter;
    return letters[i ^ 1] === "R" ? "Gr" : "Gb";
  });
}

const CHANNEL_ORDER = ["R", "Gr", "G", "Gb", "B"];
const CHANNEL_COLOUR = { R: "--r", Gr: "--gr", G: "--gr", Gb: "--gb", B: "--b" };

/** A frame as it came: what is known of it, and its samples. */
function makeFrame(about, samples) {
  const names = cellNames(about.cfa);
  const place = name => (CHANNEL_ORDER.indexOf(name) + 1) || CHANNEL_ORDER.length + 1;
  const channels = [...new Set(names)].sort((a, b) => place(a) - place(b));
  const { width: columns, letters } = about.cfa;
  const rows = letters.length / columns;
  const cellChannel = names.map(name => channels.indexOf(name));
  const cell = (x, y) => (y % rows) * columns + x % columns;
  return {
    ...about, samples, channels, bayer: isBayer(about.cfa), columns, rows, cell, cellChannel,
    cellRgb: [...letters].map(letter => "RGB".indexOf(letter)),
    black: about.black_dn.reduce((a, b) => a + b) / about.black_dn.length,
    channelAt: (x, y) => cellChannel[cell(x, y)],
    at: (x, y) => samples[y * about.width + x],
  };
}

const channelVariable = name => CHANNEL_COLOUR[name] || "--other";
const colourOf = name => css(channelVariable(name));

/**
 * Visits the samples of a rectangle channel by channel: `visit(channel, first, end)` is given the places of the samples
 * of one row, `columns` apart.
 */
function eachRun(frame, { x, y, width, height }, visit) {
  const { columns } = frame;
  for (let v = y; v < y + height; v++) {
    for (let phase = 0; phase < columns; phase++) {
      const first = x + (phase - x % columns + columns) % columns;
      visit(frame.channelAt(phase, v), v * frame.width + first, v * frame.width + x + width);
    }
  }
}

const wholeFrame = frame => ({ x: 0, y: 0, width: frame.width, height: frame.height });

/** Number, mean, standard deviation, and shares at white and at zero of each channel within a rectangle. */
function statistics(frame, rect = wholeFrame(frame)) {
  const { samples, columns, white_level_dn: white } = frame;
  const of = frame.channels.map(name => ({ name, n: 0, sum: 0, squares: 0, white: 0, zero: 0 }));
  eachRun(frame, rect, (channel, first, end) => {
    let n = 0, sum = 0, squares = 0, whites = 0, zeros = 0;
    for (let i = first; i < end; i += columns) {
      const dn = samples[i];
      n++; sum += dn; squares += dn * dn;
      if (dn >= white) whites++;
      if (dn === 0) zeros++;
    }
    const to = of[channel];
    to.n += n; to.sum += sum; to.squares += squares; to.white += whites; to.zero += zeros;
  });
  return of.map(({ name, n, sum, squares, white, zero }) => {
    const mean = sum / n;
    // Sums of squares of whole numbers are exact in a double for any frame; rounding must not make the rest negative.
    const deviation = Math.sqrt(Math.max(0, squares - sum * mean) / Math.max(1, n - 1));
    return { name, n, mean, deviation, white: white / n, zero: zero / n };
  });
}

/** Samples of each channel per bin; a bin is a whole number of DN. */
function histogram(frame) {
  const { samples, columns } = frame;
  const step = Math.max(1, 2 ** frame.bits / 256), shift = Math.log2(step);
  const counts = frame.channels.map(() => new Uint32Array(2 ** frame.bits / step));
  eachRun(frame, wholeFrame(frame), (channel, first, end) => {
    const of = counts[channel];
    for (let i = first; i < end; i += columns) of[samples[i] >> shift]++;
  });
  return { step, counts: counts.map(of => [...of]) };
}

/** Samples of each channel along one period of rows (or columns), null where a channel has none. */
function profile(frame, position, along) {
  const row = along === "row", period = row ? frame.rows : frame.columns;
  const [length, across] = row ? [frame.width, frame.height] : [frame.height, frame.width];
  const first = Math.min(position - position % period, Math.max(0, across - period));
  const last = Math.min(first + period, across) - 1;
  const series = frame.channels.map(() => new Array(length).fill(null));
  for (let k = first; k <= last; k++) {
    for (let i = 0; i < length; i++) {
      const [x, y] = row ? [i, k] : [k, i];
      series[frame.channelAt(x, y)][i] = frame.at(x, y);
    }
  }
  return { first, last, series, length };
}
