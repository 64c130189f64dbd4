"""Plain measurements of each hidden effect in frames: (estimate, true value, standard deviation).

Closed forms and sampling errors only; nothing is shared with the simulation but the truth itself. Electrons, by the
gain of the camera file.
"""
import numpy as np


class Frames:
    """The set and simple statistics of its stacks."""

    def __init__(self, world, effect, sensor):
        self.w, self.effect, self.sensor = world, effect, sensor
        self.c = world.camera
        self.a = effect.amount if effect else 0.0
        self.taken = {}

    def __getitem__(self, name):
        """Signal above black of a stack, electrons, N x H x W."""
        if name not in self.taken:
            stack = next(s for s in self.w.stacks if s.id == name)
            self.taken[name] = (self.sensor.frames(stack) - self.c.black_dn) / self.c.gain
        return self.taken[name]

    def residual(self, name):
        """Frames minus the mean frame; the mean square is the variance times (n - 1) / n."""
        return self[name] - self[name].mean(0)

    def pixel_variance(self, name):
        return self[name].var(0, ddof=1)

    def mean(self, name):
        return self[name].mean()

    def mean_sd(self, name):
        """Standard deviation of the mean of a stack, from its temporal variance."""
        return np.sqrt(self.pixel_variance(name).mean() / self[name].size)

    def dark_slope(self):
        """Map of dark current, e-/s, and its pixel variance without that of the sensor's own spread."""
        noise = self.pixel_variance("dark-long").mean() / 16 + self.pixel_variance("dark-short").mean() / 32
        return (self["dark-long"].mean(0) - self["dark-short"].mean(0)) / 0.99, noise / 0.99**2

    def gain(self, name="flat-level-7"):
        """Map of relative gain and its expected pixel variance."""
        m = self[name].mean(0) - self["dark-short"].mean(0)
        noise = self.pixel_variance(name).mean() / len(self[name]) / m.mean() ** 2
        return m / m.mean() - 1, noise + self.c.prnu**2

    def light(self, name):
        """Mean photo-electrons of a flat, with its standard deviation, by its dark (dark charge is proportional)."""
        stack = next(s for s in self.w.stacks if s.id == name)
        dark = self.mean("dark-short") + self.c.dark_e_per_s * (stack.exposure_s - 0.01)
        return self.mean(name) - dark, np.hypot(self.mean_sd(name), self.mean_sd("dark-short"))

    def expected(self, name):
        return np.mean(next(s for s in self.w.stacks if s.id == name).electrons)


def component(groups, white, s2, dof):
    """Variance of `groups` (zero mean) minus that of white noise, against s^2."""
    total = np.sum(groups**2) / dof
    return total - white, s2, np.sqrt(2 / dof) * total


def rows(f):
    r = f.residual("dark-short").mean(2)
    r -= r.mean(1, keepdims=True)
    n, h = r.shape
    return component(r, f.pixel_variance("dark-short").mean() / f.w.width, f.a**2, (n - 1) * (h - 1))


def columns(f):
    r = f.residual("dark-short").mean(1)
    r -= r.mean(1, keepdims=True)
    n, w = r.shape
    return component(r, f.pixel_variance("dark-short").mean() / f.w.height, f.a**2, (n - 1) * (w - 1))


def coloured_rows(f):
    r = f.residual("dark-short").mean(2)
    n, h = r.shape
    v = f.pixel_variance("dark-short").mean() / f.w.width
    spectrum = f.a**2 * f.effect.power + v
    estimate = np.sum(r**2) / ((n - 1) * (h - 1)) * (h - 1) / h - v * (h - 1) / h
    return estimate, f.a**2, np.sqrt(2 / (n - 1) * np.sum(spectrum[1:] ** 2)) / h


def line(f):
    x = f.residual("dark-short")
    n = len(x)
    wave = np.exp(-2j * np.pi * (f.effect.fx * f.w.x + f.effect.fy * f.w.y))
    power = np.abs(2 * (x * wave).mean((1, 2))) ** 2 * n / (n - 1)
    q = 4 * f.c.read_e**2 / f.w.info.pixels
    return power.mean() - q, f.a**2, np.sqrt((q * q + 2 * f.a**2 * q) / n) + 0.5 * f.a**2 / n  # line in the mean frame


def spread(f):
    s2 = f.pixel_variance("dark-short")
    nu = 31
    estimate = (s2.var() - 2 / nu * s2.mean() ** 2) / (1 + 2 / nu)
    x = np.exp(4 * f.a**2)
    return estimate, f.c.read_e**4 * x * (x - 1), np.sqrt(np.var((s2 - s2.mean()) ** 2) / s2.size)


def telegraph(f):
    where = f.effect.order[: max(1, round(f.a * f.w.info.pixels))]
    s2 = f.pixel_variance("dark-short").ravel()
    rho, k, n = np.exp(-2 / f.effect.dwell), np.arange(1, 32), 32
    left = 1 - np.sum((n - k) * rho**k) * 2 / (n * (n - 1))
    return s2[where].mean() - np.median(s2) * (1 + 2 / 9 / 31 * 3), f.effect.step**2 / 4 * left, s2[where].std() / np.sqrt(len(where))


def tails(f):
    x = f["dark-short"]
    d = (x[::2] - x[1::2]).ravel()
    v = d.var()
    read = (f.c.read_e**2 / (v / 2)) ** 2
    return np.mean(d**4) / v**2 - 3, f.a * read / 2, np.std(d**4) / v**2 / np.sqrt(d.size)


def drift(f):
    m, n = f["dark-short"].mean((1, 2)), 32
    k = np.arange(1, n)
    rho = f.effect.correlation
    left = 1 - np.sum((n - k) * rho**k) * 2 / (n * (n - 1))
    dof = (n - 1) * (1 - rho) / (1 + rho)
    return m.var(ddof=1), f.a**2 * left + f.mean_sd("dark-short") ** 2 * n, np.sqrt(2 / dof) * f.a**2


def projected(f, map_variance, pattern):
    """Amount of a known pattern of unit rms in a map."""
    m, v = map_variance
    pattern = np.broadcast_to(pattern, m.shape)
    return np.mean(m * pattern), f.a, np.sqrt(v / m.size)


def offset(f):
    m = f["dark-short"].mean(0)
    return m - m.mean(1, keepdims=True), f.pixel_variance("dark-short").mean() / 32 + (0.01 * f.c.dsnu_e_per_s) ** 2


def channels(f):
    return projected(f, f.gain() if f.effect.parameter == "gain" else offset(f), f.effect.pattern)


def column_map(f, map_variance, s2):
    m, v = map_variance
    c = m.mean(0) - m.mean()
    return component(c, v / f.w.height, s2, f.w.width - 1)


def row_offsets(f):
    m = f["dark-short"].mean((0, 2))
    white = f.pixel_variance("dark-short").mean() / 32 / f.w.width
    return component(m - m.mean(), white, f.c.row_fpn_e**2 * f.effect.factor**2, f.w.height - 1)


def pixel_offsets(f):
    m, v = offset(f)
    return component(m, v, f.a**2, m.size - f.w.height)


def count(seen, number, share):
    """Number of pixels found against the binomial expectation (one is added to the variance for small numbers)."""
    return seen, number * share, np.sqrt(number * share * (1 - share) + 1)


def hot(f):
    slope, noise = f.dark_slope()
    above = 8 * np.sqrt(noise + f.c.dsnu_e_per_s**2)
    number = max(1, round(f.a * slope.size))
    return count(np.sum(slope - np.median(slope) > above), number, np.exp(-above / f.effect.scale))


def glow(f):
    slope, noise = f.dark_slope()
    shape = f.effect.shape - f.effect.shape.mean()
    return np.sum(slope * shape) / np.sum(shape**2), f.a, np.sqrt((noise + f.c.dsnu_e_per_s**2) / np.sum(shape**2))


def read_noise(f):
    v = f.pixel_variance("dark-short").mean()
    other = 1 / 12 / f.c.gain**2 + 0.01 * f.c.dark_e_per_s
    return v, (f.c.read_e * f.effect.factor) ** 2 + other, v * np.sqrt(2 / 31 / f.w.info.pixels)


def dark_current(f):
    slope, noise = f.dark_slope()
    return slope.mean(), f.c.dark_e_per_s * f.effect.factor, np.sqrt((noise + f.c.dsnu_e_per_s**2) / slope.size)


def floored(mean, sd):
    """Mean and standard deviation of a Gaussian floored at zero."""
    z = np.linspace(-9, 9, 20001)
    weight = np.exp(-z * z / 2) / np.exp(-z * z / 2).sum()
    value = np.maximum(mean + sd * z, 0)
    average = np.sum(weight * value)
    return average, np.sqrt(np.sum(weight * (value - average) ** 2))


def dsnu(f):
    slope, noise = f.dark_slope()
    current = floored(f.c.dark_e_per_s, f.c.dsnu_e_per_s * f.effect.factor)
    return component(slope - slope.mean(), noise, current[1] ** 2, slope.size - 1)


def dark_warm(f):
    doubling = f.c.doubling_c * f.effect.factor
    slope, noise = f.dark_slope()
    warm = 0.5 * 2 ** (15 / doubling)
    sd = np.sqrt(f.mean_sd("dark-warm") ** 2 + f.mean_sd("dark-short") ** 2 + noise / slope.size * warm**2)
    return f.mean("dark-warm") - f.mean("dark-short"), slope.mean() * (warm - 0.01), sd


def black(f):
    x = f["dark-short"].mean(0)
    cell = np.broadcast_to(f.c.spread(f.effect.cell), x.shape) > 0
    shift = f.effect.sign * f.a / f.c.gain
    part = cell.any(1).mean()
    return x[cell].mean(), shift + 0.01 * f.c.dark_e_per_s, f.c.row_fpn_e / np.sqrt(part * f.w.height) + f.mean_sd("dark-short")


def variance_over_mean(f):
    x, d = f["flat-level-6"], f["dark-short"]
    v = f.pixel_variance("flat-level-6").mean()
    read = f.pixel_variance("dark-short").mean()
    return (v - read) / (x.mean() - d.mean()), f.effect.factor * (1 + f.c.prnu**2), v / x.mean() * np.sqrt(2 / 7 / f.w.info.pixels)


def prnu(f):
    m, v = f.gain()
    noise = v - f.c.prnu**2
    return component(m, noise, (f.c.prnu * f.effect.factor) ** 2, m.size - 1)


def shared_prnu(f):
    """Covariance of pixels side by side."""
    m, v = f.gain()
    products = m[:, 1:] * m[:, :-1]
    return products.mean(), f.a**2 / 2, np.sqrt((v + f.a**2) ** 2 * 2.25 / m.size)


def ratio(f, high, low, shift):
    """Light of two flats, each divided by its expectation; `shift(name)` is the relative change hidden in it."""
    (a, sa), (b, sb) = f.light(high), f.light(low)
    ea, eb = f.expected(high), f.expected(low)
    return a / ea / (b / eb) - 1, (1 + shift(high)) / (1 + shift(low)) - 1, np.hypot(sa / ea, sb / eb)


def nonlinear(f):
    n, full = f.effect.exponent, f.c.full_well_e
    return ratio(f, "flat-level-8", "flat-level-4", lambda s: -f.a * (f.expected(s) / full) ** n)


def full_well(f):
    return ratio(f, "flat-level-8", "flat-level-5", lambda s: -f.a / f.expected(s) if s.endswith("8") else 0)


def efficiency(f):
    (light, sd), e = f.light("flat-level-6"), f.expected("flat-level-6")
    return light / e, f.effect.factor, np.hypot(sd / e, f.c.prnu / np.sqrt(f.w.info.pixels))


def exposure(f):
    at = {"flat-00200us": 200, "flat-12000us": 12000}
    return ratio(f, "flat-00200us", "flat-12000us", lambda s: f.effect.sign * f.a / at[s])


def lag_covariance(f, expected):
    x = f.residual("flat-level-7")
    along = np.concatenate([(x[:, :, 1:] * x[:, :, :-1]).ravel(), (x[:, 1:] * x[:, :-1]).ravel()])
    v = f.pixel_variance("flat-level-7").mean()
    return along.mean() * 8 / 7, expected(f.expected("flat-level-7")), v / np.sqrt(along.size * 7 / 8)


def plane_means(f, name, i, j):
    m = f[name].mean(0) - f["dark-short"].mean(0)
    sd = np.sqrt(f.c.prnu**2 * 4 / m.size + f.pixel_variance(name).mean() * 4 / f[name].size / m[i::2, j::2].mean() ** 2)
    return m[i::2, j::2].mean(), sd


def crosstalk(f):
    """Red over green (GRBG) in the flat at 460 nm, where red itself receives nearly nothing."""
    gr, r, b, gb = next(s for s in f.w.stacks if s.id == "flat-460nm").electrons
    k = f.a
    (red, sr), (green, sg) = plane_means(f, "flat-460nm", 0, 1), plane_means(f, "flat-460nm", 0, 0)
    true_red, true_green = r + k * (2 * gr + 2 * gb - 4 * r), gr + k * (2 * r + 2 * b - 4 * gr)
    return red / green, true_red / true_green, red / green * np.hypot(sr, sg)


def fall_off(f):
    """k of the first plane that has one, by least squares of a (1 + k r^2)."""
    p = int(np.flatnonzero(f.effect.of_plane)[0])
    cut = np.s_[p // 2::2, p % 2::2] if f.w.info.planes > 1 else np.s_[:, :]
    m = (f["flat-level-7"].mean(0) - f["dark-short"].mean(0))[cut]
    t = f.effect.r2[cut]
    b, a = np.polyfit(t.ravel(), m.ravel(), 1)
    return b / a, f.a * f.effect.of_plane[p], (m - a - b * t).std() / a / np.sqrt(t.size * t.var())


def greens(f):
    (a, sa), (b, sb) = plane_means(f, "flat-level-7", 0, 0), plane_means(f, "flat-level-7", 1, 1)
    g = f.effect.sign * f.a / 2
    return a / b, (1 + g) / (1 - g), np.hypot(sa, sb)


def codes(f):
    x = np.concatenate([f[f"flat-level-{i}"].ravel() for i in range(3, 9)])
    c = np.rint(x * f.c.gain + f.c.black_dn).astype(int)
    period = 2 ** (f.effect.bit + 1)
    counts = np.bincount(c % period, minlength=period) / c.size
    difference = counts[period // 2 - 1] - counts[period - 1]
    return difference, 2 * f.effect.sign * f.a / period, np.sqrt(2 / period / c.size)


def lag(f):
    bright, sd = f.light("flat-level-8")
    return f.mean("dark-after-bright") - f.mean("dark-short"), f.a * bright, np.hypot(
        f.mean_sd("dark-after-bright"), f.mean_sd("dark-short"))


def flicker(f):
    """Sine, cosine and constant fitted to the row means of each frame."""
    mu = f.expected("flat-level-7")
    x = f.residual("flat-level-7").mean(2) / mu
    n, h = x.shape
    turn = 2 * np.pi * f.effect.hertz * f.effect.line_s * np.arange(h)
    basis = np.column_stack([np.ones(h), np.cos(turn), np.sin(turn)])
    fit = np.linalg.lstsq(basis, x.T, rcond=None)[0]
    noise = f.pixel_variance("flat-level-7").mean() / mu**2 / f.w.width * np.linalg.inv(basis.T @ basis)[1:, 1:]
    q = np.trace(noise)
    seen = (f.a * np.sinc(f.effect.hertz * 0.005)) ** 2
    power = np.mean(np.sum(fit[1:] ** 2, 0)) * n / (n - 1)
    return power - q, seen, np.sqrt((q * q + 2 * seen * q) / n + (seen / n) ** 2)


def frame_gain(f, contrast=lambda x: x.mean((1, 2))):
    total, white, dof = 0.0, 0.0, 0
    for s in f.w.stacks:
        if s.role == "flat":
            m = contrast(f[s.id]) / f.expected(s.id)
            w = f.expected(s.id) ** 2
            white += 7 * f.pixel_variance(s.id).mean() / f.w.info.pixels
            total += np.sum((m - m.mean()) ** 2) * w
            dof += 7 * w
    return total / dof - white / dof, f.a**2, f.a**2 * np.sqrt(2 / 20) + white / dof  # bright stacks only count


def dead(f):
    m, v = f.gain()
    below = 8 * np.sqrt(v)
    number = max(1, round(f.a * m.size))
    return count(np.sum(m < -below), number, min(1, (1 - below) / 0.9))


def diagonals(f):
    x = f.residual("dark-short")
    lag1 = (x[:, 1:, :-1] * x[:, :-1, 1:]).mean() * 32 / 31
    groups = 31 * (f.w.width + f.w.height)
    return lag1, f.a**2, np.sqrt(2 / groups) * f.a**2 * 1.3 + f.c.read_e**2 / np.sqrt(x.size)


def placed_variance(f, share):
    s2 = f.pixel_variance("dark-short")
    w = np.broadcast_to(share, s2.shape)
    w = w - w.mean()
    sd = np.sqrt(np.sum(w**2 * 2 / 31 * (f.c.read_e**2 + f.a**2 * (w + share.mean())) ** 2)) / np.sum(w**2)
    return np.sum(s2 * w) / np.sum(w**2), f.a**2, 1.1 * sd


def skewness(f):
    x, n = f.residual("dark-short"), 32
    third = np.mean(x**3) * n * n / ((n - 1) * (n - 2))
    v = f.pixel_variance("dark-short").mean()
    return third / v**1.5, f.a * (f.c.read_e**2 / v) ** 1.5, np.sqrt(6 / x.size) * 1.2


def blocks(f):
    x = f.residual("dark-short")
    n, h, w = x.shape
    b = x.reshape(n, h // 16, 16, w // 16, 16).mean((2, 4))
    return component(b, f.pixel_variance("dark-short").mean() / 256, f.a**2, (n - 1) * h * w / 256)


def checker(f):
    sign = 1 - 2 * ((f.w.x + f.w.y) % 2)
    return frame_gain(f, lambda x: (x * sign).mean((1, 2)))


def bar(f):
    """Frames minus the mean frame, fitted by the bar's positions minus their mean."""
    x = f.residual("dark-short")
    start = f.sensor.seed % 97
    at = np.array([(f.w.x[0] - f.effect.step * n - start) % f.w.width < f.w.width / 8 for n in range(32)], float)
    at -= at.mean(0)
    weight = np.sum(at**2) * f.w.height
    return np.sum(x * at[:, None, :]) / weight, f.a, f.c.read_e * 1.05 / np.sqrt(weight)


def hits(f):
    stacks = [s for s in f.w.stacks if s.role == "dark" and s.exposure_s < 0.4]
    seen = sum(np.sum(f.residual(s.id) > 12 * f.c.read_e) for s in stacks)
    number = f.a * f.w.info.pixels * sum(s.frames for s in stacks)
    return count(seen, number, np.exp(-12 * f.c.read_e / 60 / 0.9))


def tracks(f):
    """Charge of samples that stand out of the noise, in a mean charge of 4/3 of that of a pixel's way."""
    stacks = [s for s in f.w.stacks if s.role == "dark" and s.exposure_s > 0.2]
    seen = [f.residual(s.id) * s.frames / (s.frames - 1) for s in stacks]
    charge = sum(np.sum(x[x > 8 * np.sqrt(np.median(x**2) / 0.455)]) for x in seen)
    number = f.a * 1e-6 * f.w.info.pixels * sum(s.frames * s.exposure_s for s in stacks)
    mean = 4 / 3 * f.effect.charge_e  # and a mean square of 2 q^2
    return charge / mean, number, np.sqrt(number * 9 / 8) + 0.05 * number


def dark_telegraph(f):
    where = f.effect.order[: max(1, round(f.a * f.w.info.pixels))]
    s2, n, k = f.pixel_variance("dark-long").ravel(), 16, np.arange(1, 16)
    left = 1 - np.sum((n - k) * f.effect.stays**k) * 2 / (n * (n - 1))
    jump = f.effect.jump[where]  # in one second
    expected = np.mean(jump**2) / 4 * left + np.mean(jump) / 2
    return s2[where].mean() - np.delete(s2, where).mean(), expected, s2[where].std() / np.sqrt(len(where))


def dead_columns(f):
    return count(np.sum(f.gain()[0].mean(0) < -0.2), max(1, round(f.a * f.w.width)), 1.0)


def areas(f):
    mask = f.effect.mask
    m, v = f.dark_slope() if f.effect.hot else f.gain()
    v = v + f.c.dsnu_e_per_s**2 if f.effect.hot else v
    expected = f.effect.rate if f.effect.hot else f.effect.share - 1
    scale = 1 if f.effect.hot else 1 + m[~mask].mean()
    noise = v + (f.effect.rate / 16 if f.effect.hot else 0)
    return (m[mask].mean() - m[~mask].mean()) / scale, expected, np.sqrt(noise / mask.sum())


def dark_site(f):
    slope, noise = f.dark_slope()
    cell = np.broadcast_to(f.c.spread(f.effect.cell), slope.shape) > 0
    sd = np.sqrt((noise + f.c.dsnu_e_per_s**2) * (1 / cell.sum() + 1 / (~cell).sum()))
    return slope[cell].mean() - slope[~cell].mean(), f.a, sd


def site_offsets(f):
    x = f.residual("dark-short")
    m = np.stack([x[:, i::2, j::2].mean((1, 2)) for i in (0, 1) for j in (0, 1)])
    m -= m.mean(0)
    white = f.pixel_variance("dark-short").mean() * 4 / f.w.info.pixels
    return component(m, white, f.a**2, 3 * 31)


def transfer(f):
    """Slope over columns of l, from the correlation l (1 - l) / (1 - 2 l (1 - l)) of neighbours in the noise of light."""
    x = f.residual("flat-level-7")
    read = f.pixel_variance("dark-short").mean() * 7 / 8
    products = (x[:, :, 1:] * x[:, :, :-1]).mean((0, 1))
    squares = (x[:, :, 1:] ** 2 + x[:, :, :-1] ** 2).mean((0, 1)) / 2 - read
    place, bins = np.arange(products.size), 16
    cut = np.array_split(place, bins)
    r = np.array([products[c].sum() / squares[c].sum() for c in cut])
    both = r / (1 + 2 * r)
    lost = (1 - np.sqrt(1 - 4 * both)) / 2
    at = np.array([c.mean() for c in cut])
    slope = np.polyfit(at, lost, 1)[0]
    middle = 1 - (1 - f.a) ** (at + 1)
    sd = 1 / np.sqrt(x.shape[0] * x.shape[1] * 7 / 8 * np.sum((place - place.mean()) ** 2)) / (1 - 2 * middle.max())
    return slope, np.polyfit(at, middle, 1)[0], 1.2 * sd


ESTIMATES = {
    "row-temporal-noise": rows, "column-temporal-noise": columns, "row-correlated-noise": coloured_rows,
    "periodic-pattern-noise": line, "read-noise-spread": spread, "random-telegraph-noise": telegraph,
    "heavy-tailed-read-noise": tails, "frame-offset-noise": drift, "readout-channel-mismatch": channels,
    "column-offset-fpn": lambda f: column_map(f, offset(f), f.a**2), "pixel-offset-fpn": pixel_offsets,
    "hot-pixels": hot, "amp-glow": glow, "row-offset-fpn": row_offsets, "read-noise": read_noise,
    "dark-current": dark_current, "dsnu": dsnu, "dark-current-temperature": dark_warm, "black-level-offset": black,
    "system-gain": variance_over_mean, "quantum-efficiency": efficiency, "prnu": prnu, "column-gain-fpn": lambda f: column_map(f, f.gain(), f.a**2),
    "prnu-low-frequency": lambda f: projected(f, f.gain(), f.effect.pattern), "nonlinearity": nonlinear,
    "full-well": full_well, "brighter-fatter": lambda f: lag_covariance(f, lambda mu: 2 * f.a * mu**2 * (1 - 4 * f.a * mu)),
    "charge-coupling": lambda f: lag_covariance(f, lambda mu: 2 * f.a * (1 - 4 * f.a) * mu),
    "optical-crosstalk": crosstalk, "adc-nonlinearity": codes, "image-lag": lag, "exposure-offset": exposure,
    "prnu-correlated": shared_prnu, "relative-illumination": fall_off, "colour-shading": fall_off, "green-imbalance": greens, "flicker-banding": flicker, "light-flicker": frame_gain, "defective-pixels": dead,
    "outside-diagonal-noise": diagonals, "outside-ring-noise": lambda f: placed_variance(f, f.effect.ring),
    "outside-column-squared-noise": lambda f: placed_variance(f, f.effect.ring**2), "outside-skewed-noise": skewness,
    "outside-block-noise": blocks, "outside-checker-drift": checker,
    "outside-spokes": lambda f: projected(f, f.gain(), f.effect.pattern),
    "outside-gain-rectangle": lambda f: projected(f, f.gain(), f.effect.pattern), "outside-moving-bar": bar,
    "outside-hits": hits, "particle-hits": tracks, "dark-current-telegraph-noise": dark_telegraph,
    "defective-columns": dead_columns, "defective-areas": areas, "dark-current-by-site": dark_site,
    "frame-offset-by-site": site_offsets, "charge-transfer-inefficiency": transfer,
}
