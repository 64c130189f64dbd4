"""Catalogued effects of read-out and dark charge, each with its equation and detection limit."""
from dataclasses import replace
from math import lgamma

import numpy as np

from limits import FIVE, normal_tail, rare_pixels
from sensor import F, Effect


class Component(Effect):
    """An effect whose amount is a standard deviation; `information(s2)` is that on its square."""
    parameter = "sigma_e"

    def limit(self):
        return np.sqrt(FIVE / np.sqrt(self.information(0.0)))

    def sd(self):
        return 1 / (2 * self.amount * np.sqrt(self.information(self.amount**2)))


class RowTemporal(Component):
    """n(y, frame) ~ N(0, s^2) added to each row."""
    kind = "row-temporal-noise"

    def information(self, s2):
        return self.w.info.temporal(self.w.width, self.w.height, s2)

    def signal(self, v, shot):
        return v + F(self.amount) * shot.rng(self.kind).standard_normal((self.w.height, 1), dtype=F)


class ColumnTemporal(Component):
    """n(x, frame) ~ N(0, s^2) added to each column."""
    kind = "column-temporal-noise"

    def information(self, s2):
        return self.w.info.temporal(self.w.height, self.w.width, s2)

    def signal(self, v, shot):
        return v + F(self.amount) * shot.rng(self.kind).standard_normal((1, self.w.width), dtype=F)


class RowCorrelated(Component):
    """Row noise with power ~ 1/f^a over the rows of a frame, f in cycles per row, total variance s^2.

    Ordinates k of the row means' periodogram are exponential about S_k + v/W: they add (S_k / (v/W))^2 each.
    """
    kind = "row-correlated-noise"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.exponent = rng.uniform(0.7, 2)
        k = np.abs(np.fft.fftfreq(world.height, 1 / world.height))
        self.power = np.where(k > 0, np.maximum(k, 1) ** -self.exponent, 0)
        self.power *= world.height / self.power.sum()

    def information(self, s2):
        i = self.w.info
        v = i.var.mean(1)[:, None] / self.w.width
        return np.sum(i.nu[:, None] / 2 * (self.power / (v + s2 * self.power)) ** 2)  # both signs of k: halved

    def signal(self, v, shot):
        white = shot.rng(self.kind).standard_normal(self.w.height)
        rows = np.fft.ifft(np.fft.fft(white) * np.sqrt(self.power)).real
        return v + (self.amount * rows[:, None]).astype(F)

    def details(self):
        return {"exponent": self.exponent}


class PeriodicPattern(Effect):
    """A sin(2 pi (fx x + fy y) + phase of the frame).

    Limit: the line must stand out of the H W ordinates of the periodogram averaged over the frames,
    A^2 H W / 4 v sqrt(n) = 2 ln(H W) (the catalogue's figure). With the line known, sd(A) = sqrt(2 v / H W n).
    """
    kind = "periodic-pattern-noise"
    parameter = "amplitude_e"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.fx, self.fy = rng.uniform(0.03, 0.47), rng.uniform(-0.47, 0.47)

    def limit(self):
        i = self.w.info
        n_over_v2 = np.sum(i.n * (1 / i.var).mean(1) ** 2)
        return np.sqrt(8 * np.log(i.pixels) / i.pixels / np.sqrt(n_over_v2))

    def sd(self):
        i = self.w.info
        return np.sqrt(2 / np.sum(i.n * i.pixels * (1 / i.var).mean(1)))

    def signal(self, v, shot):
        phase = shot.rng(self.kind).uniform(0, 2 * np.pi)
        return v + (self.amount * np.sin(2 * np.pi * (self.fx * self.w.x + self.fy * self.w.y) + phase)).astype(F)

    def details(self):
        return {"cycles_per_column": self.fx, "cycles_per_row": self.fy}


class ReadNoiseSpread(Effect):
    """Read noise of each pixel: sigma exp(s z).

    A pixel's variance over nu frames scatters by 2 / nu; the spread adds 4 s^2 share^2. The scatter of A such
    variances is known to sqrt((2 + 12 / nu) / A) (the kurtosis of chi^2 is 12 / nu).
    """
    kind = "read-noise-spread"
    parameter = "spread"

    def limit(self):
        i = self.w.info
        nu, matched = i.nu.sum(), np.sum(i.nu * (i.read_share() ** 2).mean(1))
        return np.sqrt(FIVE * np.sqrt((2 + 12 / nu) / i.pixels) / (2 * matched))

    def fixed(self, maps):
        z = self.rng.standard_normal((self.w.height, self.w.width), dtype=F)
        maps.read = maps.read * np.exp(F(self.amount) * z)


class RandomTelegraph(Effect):
    """A fraction of the pixels carries a b(t), b in {0, 1}, exponential dwell times in each state.

    Limit from the temporal variance alone (that mean offsets shift too says nothing of telegraph noise): a pixel's
    variance over nu frames grows by a^2 / 4; its cube root is nearly normal (Wilson-Hilferty), so outliers of a
    normal map are counted.
    """
    kind = "random-telegraph-noise"
    parameter = "fraction"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.step = rng.uniform(2, 5) * world.camera.read_e
        self.dwell = rng.uniform(0.5, 3)
        self.order = rng.permutation(world.info.pixels)

    def limit(self):
        i = self.w.info
        nu = i.nu[i.dark].sum()
        grown = (1 + self.step**2 / (4 * i.var[i.dark].mean())) ** (1 / 3)
        sd = np.sqrt(2 / (9 * nu))
        return rare_pixels(i.pixels, sd, lambda x: normal_tail((1 + x - grown) / (grown * sd)))

    def signal(self, v, shot):
        rng = shot.rng(self.kind)
        where = self.order[: max(1, round(self.amount * v.size))]
        if shot.n == 0:
            self.high = rng.random(where.size) < 0.5
        else:  # odd number of flips in one frame time
            self.high = self.high ^ (rng.random(where.size) < (1 - np.exp(-2 / self.dwell)) / 2)
        v = v.copy()
        v.reshape(-1)[where] += F(self.step) * self.high
        return v

    def details(self):
        return {"amplitude_e": self.step, "dwell_frames": self.dwell}


def tukey_moments(a):
    """Second and fourth moment of (u^a - (1 - u)^a) / a, u uniform."""
    def beta(p, q):
        return np.exp(lgamma(p) + lgamma(q) - lgamma(p + q))
    second = 2 / a**2 * (1 / (2 * a + 1) - beta(a + 1, a + 1))
    fourth = 2 / a**4 * (1 / (4 * a + 1) - 4 * beta(3 * a + 1, a + 1) + 3 * beta(2 * a + 1, 2 * a + 1))
    return second, fourth


class HeavyTails(Effect):
    """Read noise of unchanged variance and heavier tails, Student's t or Tukey's lambda distribution; the amount is
    its excess kurtosis, for t 6 / (dof - 4).

    The fourth cumulant of N samples is known to sqrt(24 / N); other noise dilutes it by share^2.
    """
    kind = "heavy-tailed-read-noise"
    parameter = "excess_kurtosis"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.family = str(rng.choice(["student-t", "tukey-lambda"]))

    def limit(self):
        i = self.w.info
        return FIVE / np.sqrt(np.sum(i.samples() * i.read_share() ** 4) / 24)

    @property
    def shape(self):
        """Degrees of freedom, or lambda by bisection: kurtosis falls from lambda = -0.2 to that of a normal variable."""
        if self.family == "student-t":
            return 4 + 6 / self.amount
        low, high = -0.2, 0.1349
        for _ in range(40):
            middle = (low + high) / 2
            second, fourth = tukey_moments(middle)
            low, high = (middle, high) if fourth / second**2 - 3 > self.amount else (low, middle)
        return low

    def noise(self, z, shot):
        rng, shape = shot.rng(self.kind), self.shape
        if self.family == "student-t":
            return z * np.sqrt(F(shape - 2) / (2 * rng.standard_gamma(shape / 2, z.shape, dtype=F)))
        u = 1 - rng.random(z.shape)
        return ((u**shape - (1 - u) ** shape) / (shape * np.sqrt(tukey_moments(shape)[0]))).astype(F)

    def details(self):
        return {"family": self.family, ("dof" if self.family == "student-t" else "lambda"): self.shape}


class FrameOffset(Component):
    """An offset per frame, AR(1) of variance s^2 along the frames of a stack.

    Within a stack of n frames the correlated offsets leave s^2 (1 - mean correlation) of their variance.
    """
    kind = "frame-offset-noise"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.correlation = rng.uniform(0, 0.7)

    def information(self, s2):
        i = self.w.info
        k = np.arange(1, i.n.max())
        mean = [np.sum((n - k[k < n]) * self.correlation ** k[k < n]) * 2 / (n * (n - 1)) for n in i.n]
        return i.temporal(i.pixels, 1, s2, 1 - np.array(mean)[:, None])

    def signal(self, v, shot):
        step = shot.rng(self.kind).standard_normal()
        if shot.n == 0:
            self.state = step
        else:
            self.state = self.correlation * self.state + np.sqrt(1 - self.correlation**2) * step
        return v + F(self.amount * self.state)

    def details(self):
        return {"correlation": self.correlation}


class ReadoutChannels(Effect):
    """Column x is read by channel x mod n, each with its own offset (e-) or gain; the amount is their rms, the truth
    file gives the standard deviation of n channels (n - 1 degrees of freedom).

    A pattern of rms o over A pixels of map variance v: o sqrt(A / v) = 5.
    """
    kind = "readout-channel-mismatch"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.parameter = "gain" if rng.random() < 0.5 else "offset_e"
        self.channels = int(rng.choice([2, 4, 8]))
        o = rng.standard_normal(self.channels)
        o -= o.mean()
        self.pattern = np.tile(o / o.std(), world.width // self.channels + 1)[: world.width].astype(F)

    def limit(self):
        i = self.w.info
        v = i.gain_map()[1] if self.parameter == "gain" else i.offset_map()
        return FIVE * np.sqrt(v / i.pixels)

    def fixed(self, maps):
        if self.parameter == "gain":
            maps.gain = maps.gain * (1 + F(self.amount) * self.pattern)
        else:
            maps.offset = maps.offset + F(self.amount) * self.pattern

    def details(self):
        return {"channels": self.channels, self.parameter: self.amount * np.sqrt(self.channels / (self.channels - 1))}


class ColumnOffset(Component):
    """An offset o(x) ~ N(0, s^2) of each column."""
    kind = "column-offset-fpn"

    def information(self, s2):
        return self.w.info.fixed(self.w.info.offset_map(), self.w.height, self.w.width, s2)

    def fixed(self, maps):
        maps.offset = maps.offset + F(self.amount) * self.rng.standard_normal((1, self.w.width), dtype=F)


class PixelOffset(Component):
    """An offset o(x, y) ~ N(0, s^2) of each pixel."""
    kind = "pixel-offset-fpn"

    def information(self, s2):
        return self.w.info.fixed(self.w.info.offset_map(), 1, self.w.info.pixels, s2)

    def fixed(self, maps):
        maps.offset = maps.offset + F(self.amount) * self.rng.standard_normal(maps.offset.shape, dtype=F)


class HotPixels(Effect):
    """A fraction of the pixels has more dark current, exponential about a mean drawn between 30 and 300 e-/s."""
    kind = "hot-pixels"
    parameter = "fraction"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.scale = np.exp(rng.uniform(np.log(30), np.log(300)))

    def limit(self):
        i = self.w.info
        return rare_pixels(i.pixels, np.sqrt(i.dark_map()[1]), lambda x: np.exp(-x / self.scale))

    def fixed(self, maps):
        count = max(1, round(self.amount * maps.dark.size))
        where = self.rng.permutation(maps.dark.size)[:count]
        maps.dark.reshape(-1)[where] += self.rng.exponential(self.scale, count).astype(F)

    def details(self):
        return {"mean_e_per_s": self.scale}


class AmpGlow(Effect):
    """Glow I exp(-r^2 / 2 w^2) e-/s about a point at the edge; matched in the map of dark-current slopes."""
    kind = "amp-glow"
    parameter = "rate_e_per_s"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.width = rng.uniform(0.08, 0.25) * world.width
        along, side = rng.choice([0.0, 0.5, 1.0]), rng.integers(4)
        self.x0, self.y0 = [(along, 0.0), (along, 1.0), (0.0, along), (1.0, along)][side]
        r2 = (world.x - self.x0 * world.width) ** 2 + (world.y - self.y0 * world.height) ** 2
        self.shape = np.exp(-r2 / (2 * self.width**2)).astype(F)

    def limit(self):
        contrast = np.sum((self.shape - self.shape.mean()) ** 2)
        return FIVE * np.sqrt(self.w.info.dark_map()[1] / contrast)

    def sd(self):
        return self.limit() / FIVE

    def fixed(self, maps):
        maps.glow = maps.glow + F(self.amount) * self.shape

    def details(self):
        # In half widths and half heights from the middle, as in camera files.
        return {"x": 2 * self.x0 - 1, "y": 2 * self.y0 - 1, "width_pixels": self.width}


class MeanShift(Effect):
    """An effect seen in the means of stacks and planes."""

    def shift(self):
        """Electrons per unit of the amount, stacks x planes."""
        raise NotImplementedError

    def open_to(self):
        """Shifts of unknown size."""
        return []

    def limit(self):
        return FIVE / self.w.info.means(self.shift(), self.open_to())


class MisSet(Effect):
    """A value in the camera file is wrong; the amount is its relative error."""
    field = ""

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.sign = rng.choice([-1, 1])

    @property
    def factor(self):
        """True over stated value; errors too large to be subtracted are added."""
        return 1 + self.amount * (self.sign if self.amount < 0.5 else 1)

    def camera(self, c):
        return replace(c, **{self.field: getattr(c, self.field) * self.factor})

    def details(self):
        return {self.parameter: getattr(self.w.camera, self.field) * self.factor}


class RowOffset(MisSet):
    """Row FPN of another size: the variance of H row offsets is known to sqrt(2 / H)."""
    kind, parameter, field = "row-offset-fpn", "sigma_e", "row_fpn_e"

    def limit(self):
        i, s2 = self.w.info, self.w.camera.row_fpn_e**2
        excess = FIVE * np.sqrt(2 / self.w.height) * (s2 + i.offset_map() / self.w.width)
        return np.sqrt(1 + excess / s2) - 1


class ReadNoise(MisSet):
    """Read noise of another size: variance of the stacks, 2 share / sqrt(2 / N) per unit of relative error."""
    kind, parameter, field = "read-noise", "read_e", "read_e"

    def limit(self):
        i = self.w.info
        return FIVE / np.sqrt(2 * np.sum(i.samples() * i.read_share() ** 2))

    def sd(self):
        return self.limit() / FIVE * self.w.camera.read_e


class DarkCurrent(MeanShift, MisSet):
    """Mean dark current of another size; its spread over the pixels as stated."""
    kind, parameter, field = "dark-current", "mean_e_per_s", "dark_e_per_s"

    def shift(self):
        return self.w.info.warm_t[:, None] * self.w.camera.dark_e_per_s


class Dsnu(MisSet):
    """Spread of dark current of another size: the variance of A slopes is known to sqrt(2 / A)."""
    kind, parameter, field = "dsnu", "dsnu_e_per_s", "dsnu_e_per_s"

    def limit(self):
        i, s2 = self.w.info, self.w.camera.dsnu_e_per_s**2
        return np.sqrt(1 + FIVE * np.sqrt(2 / i.pixels) * i.dark_map()[1] / s2) - 1


class DarkTemperature(MeanShift, MisSet):
    """Another doubling interval of dark current; seen in the means of the cold and the warm stack."""
    kind, parameter, field = "dark-current-temperature", "doubling_c", "doubling_c"

    def shift(self):
        i, c = self.w.info, self.w.camera
        octaves = np.array([s.temperature_c - c.reference_c for s in i.stacks]) / c.doubling_c
        return (-np.log(2) * octaves * i.warm_t * c.dark_e_per_s)[:, None]


class BlackLevel(MeanShift):
    """Black level of another size (DN), of all pixels or, under a filter array, of one plane."""
    kind = "black-level-offset"
    parameter = "offset_dn"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.sign = rng.choice([-1, 1])
        self.cell = np.ones(world.info.planes)
        if world.info.planes > 1 and rng.random() < 0.5:
            plane = int(rng.integers(4))
            self.parameter = f"channel_{plane}_dn"
            self.cell = np.eye(4)[plane]

    def shift(self):
        return self.cell[None, :] / self.w.camera.gain

    def fixed(self, maps):
        shift = self.sign * self.amount / self.w.camera.gain
        maps.offset = maps.offset + F(shift) * self.w.camera.spread(self.cell)

    def details(self):
        return {self.parameter: self.sign * self.amount}


EFFECTS = [RowTemporal, ColumnTemporal, RowCorrelated, PeriodicPattern, ReadNoiseSpread, RandomTelegraph, HeavyTails,
           FrameOffset, ReadoutChannels, ColumnOffset, PixelOffset, HotPixels, AmpGlow, RowOffset, ReadNoise,
           DarkCurrent, Dsnu, DarkTemperature, BlackLevel]
