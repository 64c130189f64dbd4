// Temporal noise: the scatter of each sample over frames of the same settings and light (Welford).
const noise = { frames: 0, of: "", mean: new Float32Array(0), squares: new Float32Array(0) };

function addToNoise(frame) {
  const of = [frame.width, frame.height, frame.exposure_s, frame.analog_gain, frame.light, frame.injected].join();
  if (of !== noise.of) {
    const size = frame.samples.length;
    Object.assign(noise, { of, frames: 0, mean: new Float32Array(size), squares: new Float32Array(size) });
  }
  const { mean, squares } = noise, samples = frame.samples, share = 1 / ++noise.frames;
  for (let i = 0; i < samples.length; i++) {
    const difference = samples[i] - mean[i];
    mean[i] += difference * share;
    squares[i] += difference * (samples[i] - mean[i]);
  }
}

/** Root of the mean variance of each channel, DN; null before two frames. */
function noiseOf(frame) {
  if (noise.frames < 2) return frame.channels.map(() => null);
  const { squares } = noise, sums = frame.channels.map(() => 0), counts = frame.channels.map(() => 0);
  eachRun(frame, wholeFrame(frame), (channel, first, end) => {
    let sum = 0, n = 0;
    for (let i = first; i < end; i += frame.columns) { sum += squares[i]; n++; }
    sums[channel] += sum;
    counts[channel] += n;
  });
  return sums.map((sum, channel) => Math.sqrt(sum / counts[channel] / (noise.frames - 1)));
}
