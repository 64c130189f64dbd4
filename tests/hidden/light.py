"""Catalogued effects of light, charge and conversion, each with its equation and detection limit."""
from dataclasses import replace

import numpy as np

from limits import FIVE, normal_tail, rare_pixels
from readout import Component, MeanShift, MisSet
from sensor import F, Effect, Shot


def neighbours(a):
    """Sum over the four nearest pixels; beyond the edge it is mirrored, which keeps the colour."""
    p = np.pad(a, 1, mode="reflect")
    return p[:-2, 1:-1] + p[2:, 1:-1] + p[1:-1, :-2] + p[1:-1, 2:]


class SystemGain(MisSet):
    """Another gain, DN/e-. Limit from variance over mean of the flats, which does not depend on the scale of the light:
    the variance of N samples is known to sqrt(2 / N), of which shot noise is a share."""
    kind, parameter = "system-gain", "gain_dn_per_e"

    def limit(self):
        i = self.w.info
        return FIVE / np.sqrt(np.sum(i.samples() * i.shot_share() ** 2) / 2)

    def sd(self):
        return self.limit() / FIVE * self.w.camera.gain

    @property
    def factor(self):
        """True over stated gain; a gain that would saturate the brightest flat is made too low instead."""
        return 1 + self.amount * (self.sign if self.amount < 0.05 else -1)

    def camera(self, c):
        return replace(c, gain_error=self.factor - 1)

    def details(self):
        return {self.parameter: self.w.camera.gain * self.factor}


class QuantumEfficiency(MeanShift):
    """All light counts r times; seen in the means of flats."""
    kind, parameter = "quantum-efficiency", "ratio"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.sign = rng.choice([-1, 1])

    factor = SystemGain.factor  # r

    def shift(self):
        return self.w.info.mu

    def sd(self):
        return self.limit() / FIVE

    def fixed(self, maps):
        maps.light = maps.light * F(self.factor)

    def details(self):
        return {self.parameter: self.factor}


class Prnu(MisSet):
    """Another spread of the pixels' gain: the variance of A gains is known to sqrt(2 / A)."""
    kind, parameter, field = "prnu", "sigma", "prnu"

    def limit(self):
        i, s2 = self.w.info, self.w.camera.prnu**2
        return np.sqrt(1 + FIVE * np.sqrt(2 / i.pixels) * i.gain_map()[1] / s2) - 1


class ColumnGain(Component):
    """A factor 1 + g(x), g ~ N(0, s^2), of each column's read-out."""
    kind, parameter = "column-gain-fpn", "sigma"

    def information(self, s2):
        return self.w.info.fixed(self.w.info.gain_map()[1], self.w.height, self.w.width, s2)

    def fixed(self, maps):
        maps.gain = maps.gain * (1 + F(self.amount) * self.rng.standard_normal((1, self.w.width), dtype=F))


class PrnuCorrelated(Component):
    """White noise at the corners of pixels: a pixel's gain differs by s times half the sum of its four corners.

    Power (1 + cos kx)(1 + cos ky) beside the white map of variance g.
    """
    kind, parameter = "prnu-correlated", "sigma"

    def information(self, s2):
        along = [1 + np.cos(2 * np.pi * np.arange(n) / n) for n in (self.w.height, self.w.width)]
        power = np.multiply.outer(*along)
        return np.sum((power / (self.w.info.gain_map()[1] + s2 * power)) ** 2) / 2

    def fixed(self, maps):
        z = self.rng.standard_normal((self.w.height + 1, self.w.width + 1), dtype=F)
        maps.light = maps.light * (1 + F(self.amount / 2) * (z[1:, 1:] + z[1:, :-1] + z[:-1, 1:] + z[:-1, :-1]))


class PrnuLowFrequency(Effect):
    """A smooth factor 1 + m(x, y) on light, rms the amount: cosines of up to 1.5 cycles per frame, or a tilted bowl.

    A pattern of rms m over A pixels of relative map variance v: m sqrt(A / v) = 5.
    """
    kind, parameter = "prnu-low-frequency", "sigma"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.shape = str(rng.choice(["cosines", "bowl"]))
        u, v = 2 * (world.x + 0.5) / world.width - 1, 2 * (world.y + 0.5) / world.height - 1
        if self.shape == "cosines":
            weight = rng.standard_normal((4, 4)) / (1 + np.add.outer(np.arange(4), np.arange(4)))
            rows, columns = (np.cos(np.pi / 2 * np.outer(p.ravel() + 1, np.arange(4))) for p in (v, u))
            pattern = rows @ weight @ columns.T
        else:
            a, b, c = rng.standard_normal(3)
            pattern = u * u + v * v + 0.5 * (a * u + b * v + c * u * v)
        self.pattern = ((pattern - pattern.mean()) / pattern.std()).astype(F)

    def limit(self):
        return FIVE * np.sqrt(self.w.info.gain_map()[1] / self.w.info.pixels)

    def fixed(self, maps):
        maps.light = maps.light * (1 + F(self.amount) * self.pattern)

    def details(self):
        return {"shape": self.shape}


class Shading(Effect):
    """Light of each plane falls off by 1 + k r^2, r = 1 in the corners; the amount is the largest k.

    In the map of gain of a plane, pixel variance g, over the A pixels of all planes: k^2 sum (r^2 - mean)^2 / g = 25.
    """

    def __init__(self, world, rng):
        super().__init__(world, rng)
        w, h = world.width, world.height
        self.r2 = 4 * ((world.x + 0.5 - w / 2) ** 2 + (world.y + 0.5 - h / 2) ** 2) / (w * w + h * h)
        self.of_plane = self.draw()

    def draw(self):
        """k of each plane for an amount of 1."""
        raise NotImplementedError

    def limit(self):
        i = self.w.info
        of_planes = np.square(self.of_plane) / i.gain_maps()[1]
        return FIVE / np.sqrt(of_planes.mean() * i.pixels * self.r2.var())

    def sd(self):
        return self.limit() / FIVE

    def fixed(self, maps):
        maps.light = maps.light * (1 + F(self.amount) * self.w.camera.spread(self.of_plane) * self.r2.astype(F))

    def details(self):
        return {self.parameter: self.amount * max(self.of_plane, key=abs)}


class RelativeIllumination(Shading):
    """Fall-off of the lens, the same in all planes."""
    kind, parameter = "relative-illumination", "corner"

    def draw(self):
        return [-1.0 for _ in self.w.camera.planes]


class ColourShading(Shading):
    """Fall-off of filters and microlenses, in one of red, green, blue."""
    kind, needs_cfa = "colour-shading", True

    def draw(self):
        colour, sign = int(self.rng.integers(3)), float(self.rng.choice([-1, 1]))
        self.parameter = f"channel_{colour}"
        return [sign if p == "rgb"[colour] else 0.0 for p in self.w.camera.planes]


class LightShift(MeanShift):
    """Effects seen in the means of flats, with the scale of the light left free."""

    def open_to(self):
        return [self.w.info.mu]


class Nonlinearity(LightShift):
    """e (1 - a (e / full well)^n)."""
    kind, parameter = "nonlinearity", "loss"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.exponent = rng.uniform(1, 3)

    def shift(self):
        return self.w.info.mu * (self.w.info.mu / self.w.camera.full_well_e) ** self.exponent

    def charge(self, q, shot):
        return q * (1 - F(self.amount) * (q / F(self.w.camera.full_well_e)) ** F(self.exponent))

    def details(self):
        return {"exponent": self.exponent}


class FullWell(LightShift):
    """Charge stops at a full well below the converter's range.

    The amount is the mean charge lost in the brightest flat, E[(q - well)+] = tau L(u), u = (well - mu) / tau, with
    L(u) = phi(u) - u Q(u): the mean of that flat shows it.
    """
    kind, parameter = "full-well", "loss_e"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        i = world.info
        self.top = i.mu == i.mu.max()
        self.mean = i.mu.max()
        self.tau = np.sqrt(self.mean + (world.camera.prnu * self.mean) ** 2)

    def shift(self):
        return self.top * 1.0

    @property
    def well(self):
        u = np.linspace(8, -40, 4801)  # falling, so that the loss rises
        loss = [np.exp(-x * x / 2) / np.sqrt(2 * np.pi) - x * normal_tail(x) for x in u]
        return self.mean + self.tau * np.interp(self.amount / self.tau, loss, u)

    def camera(self, c):
        self._well = F(self.well)
        return c

    def charge(self, q, shot):
        return np.minimum(q, self._well)

    def details(self):
        return {"full_well_e": self.well}


class BrighterFatter(Effect):
    """Boundaries move away from the fuller pixel: charge a (q1^2 - q2^2) / 2 crosses each.

    About a flat of mean mu this is a covariance 2 a mu^2 with each neighbour and a variance mu (1 - 8 a mu): in
    Astier's terms a_01 = a_10 = 2 a, a_00 = -8 a per e-. Limit: two correlations (sqrt(1 / N) each) and the variance
    (sqrt(2 / N)), the latter whatever the gain.
    """
    kind, parameter = "brighter-fatter", "coefficient"

    def limit(self):
        i = self.w.info
        share, n = i.shot_share(), i.samples()
        correlation = 2 * np.sum(n * (2 * i.mu * share) ** 2)
        curve, weight = 8 * i.mu * share, n / 2
        variance = np.sum(weight * curve**2) - np.sum(weight * curve * share) ** 2 / np.sum(weight * share**2)
        return FIVE / np.sqrt(correlation + variance)

    def sd(self):
        return self.limit() / FIVE

    def charge(self, q, shot):
        half = F(self.amount / 2) * q * q
        across, down = half[:, :-1] - half[:, 1:], half[:-1] - half[1:]
        q = q.copy()
        q[:, :-1] -= across
        q[:, 1:] += across
        q[:-1] -= down
        q[1:] += down
        return q

    def details(self):
        return {"a_00_per_e": -8 * self.amount, "a_01_per_e": 2 * self.amount}


class ChargeCoupling(Effect):
    """A share k of the charge of each pixel appears in each of its four neighbours, after shot noise.

    Correlation 2 k with two neighbours, each known to sqrt(1 / N); the variance tells nothing where the gain is open.
    """
    kind, parameter = "charge-coupling", "side"

    def limit(self):
        i = self.w.info
        return FIVE / np.sqrt(8 * np.sum(i.samples() * i.shot_share() ** 2))

    def sd(self):
        return self.limit() / FIVE

    def charge(self, q, shot):
        return q + F(self.amount) * (neighbours(q) - 4 * q)


class OpticalCrosstalk(MeanShift):
    """A share k of the light of each pixel ends in each of its four neighbours, before shot noise.

    On flats only the ratios of the colour planes over wavelength show it, whatever the scale of each plane.
    """
    kind, parameter, needs_cfa = "optical-crosstalk", "side", True

    def shift(self):
        mu = self.w.info.mu
        beside, below = mu[:, [1, 0, 3, 2]], mu[:, [2, 3, 0, 1]]
        return 2 * beside + 2 * below - 4 * mu

    def open_to(self):
        return [self.w.info.mu * plane for plane in np.eye(4)]

    def light(self, rate, shot):
        return rate + F(self.amount) * (neighbours(rate) - 4 * rate)


class ConverterBit(Effect):
    """The weight of bit b of the converter is off by eps LSB: codes with that bit begin eps later.

    Of 2^b codes one is wider or narrower by eps: over N samples of a smooth histogram (the flats)
    eps^2 N / 2^b = 25.
    """
    kind, parameter = "adc-nonlinearity", "bit_error_lsb"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.bit, self.sign = int(rng.integers(4)), rng.choice([-1, 1])

    def limit(self):
        i = self.w.info
        return FIVE * np.sqrt(2**self.bit / np.sum(i.n[~i.dark] * i.pixels))

    def convert(self, y, code):
        error = self.sign * self.amount

        def has(c):
            return (c.astype(np.int32) >> self.bit) & 1 == 1

        if error > 0:
            return code - (has(code) & (y < code + F(error - 0.5)))
        return code + (has(code + 1) & (y >= code + F(0.5 + error)))

    def details(self):
        return {"bit": self.bit, "sign": int(self.sign)}


class ImageLag(LightShift):
    """A share of the electrons of the previous frame arrives late, each at random (Poisson for a small share). Seen in
    the dark after a bright flat; every other frame follows one of its own kind, so the scale of the light absorbs it."""
    kind, parameter = "image-lag", "fraction"

    def before(self, stack):
        return next((s for s in self.w.stacks if s.id == stack.preceded_by), stack)

    def shift(self):
        return np.array([self.before(s).electrons for s in self.w.stacks])

    def charge(self, q, shot):
        if shot.n == 0 or shot.stack.preceded_by:
            self.last = shot.sensor.collect(Shot(shot.sensor, self.before(shot.stack), f"before {shot.n}"))
        self.last = q + shot.rng(self.kind).poisson(F(self.amount) * np.maximum(self.last, 0)).astype(F)
        return self.last


class ExposureOffset(LightShift):
    """Light is collected for t + dt (the dark charge of dt is negligible)."""
    kind, parameter = "exposure-offset", "offset_us"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.sign = rng.choice([-1, 1])

    def shift(self):
        return self.w.info.mu / self.w.info.t[:, None] * 1e-6

    def sd(self):
        return self.limit() / FIVE

    def light(self, rate, shot):
        return rate * F(1 + self.sign * self.amount * 1e-6 / shot.stack.exposure_s)

    def details(self):
        return {self.parameter: self.sign * self.amount}


class GreenImbalance(LightShift):
    """Greens in red rows see 1 + g/2, those in blue rows 1 - g/2."""
    kind, parameter, needs_cfa = "green-imbalance", "centre", True

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.sign, planes = rng.choice([-1, 1]), world.camera.planes
        red_row = planes.index("r") // 2
        self.cell = [0.0 if f != "g" else 0.5 if p // 2 == red_row else -0.5 for p, f in enumerate(planes)]

    def shift(self):
        return self.w.info.mu * self.cell

    def light(self, rate, shot):
        return rate * (1 + F(self.sign * self.amount) * self.w.camera.spread(self.cell))

    def details(self):
        return {self.parameter: self.sign * self.amount}


class FlickerBanding(Effect):
    """Light 1 + A sin(2 pi f t) under a rolling shutter: exposure averages it to A sinc(f t_exp), rows start one
    line time apart, frames at any phase.

    Power of the line in the row means, A^2 sinc^2 mu^2 H W / 4 v per frame, over n frames: known to 1 / sqrt(n).
    """
    kind, parameter = "flicker-banding", "depth"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.hertz = float(rng.choice([100, 120]))
        self.line_s = 1 / (self.hertz * rng.uniform(30, 180))
        i = world.info
        seen = np.sinc(self.hertz * i.t)
        self.power = seen**2 * (i.mu**2 / i.var).mean(1) * i.pixels / 4

    def limit(self):
        return np.sqrt(FIVE / np.sqrt(np.sum(self.w.info.n * self.power**2)))

    def sd(self):
        return 1 / np.sqrt(2 * np.sum(self.w.info.n * self.power))

    def light(self, rate, shot):
        t = self.w.y * self.line_s
        phase = shot.rng(self.kind).uniform(0, 2 * np.pi)
        seen = self.amount * np.sinc(self.hertz * shot.stack.exposure_s)
        return rate * (1 + F(seen) * np.sin(2 * np.pi * self.hertz * t + phase).astype(F))

    def details(self):
        return {"frequency_hz": self.hertz, "row_time_us": self.line_s * 1e6}


class LightFlicker(Component):
    """The light of each frame is off by a factor 1 + N(0, s^2); a frame's light is known to 1 / sqrt(sum mu^2 / v)."""
    kind, parameter = "light-flicker", "sigma"

    def information(self, s2):
        i = self.w.info
        known = (i.mu**2 / i.var).mean(1) * i.pixels
        return np.sum(i.nu / 2 * (known / (1 + s2 * known)) ** 2)

    def light(self, rate, shot):
        return rate * F(1 + self.amount * shot.rng(self.kind).standard_normal())


class DefectivePixels(Effect):
    """A fraction of the pixels gives only 0 to 0.9 of its light, evenly spread."""
    kind, parameter = "defective-pixels", "fraction"

    def limit(self):
        i = self.w.info
        return rare_pixels(i.pixels, np.sqrt(i.gain_map()[1]), lambda x: np.clip((1 - x) / 0.9, 0, 1))

    def fixed(self, maps):
        gain = np.ones(self.w.info.pixels, F)
        count = max(1, round(self.amount * gain.size))
        gain[self.rng.permutation(gain.size)[:count]] = self.rng.uniform(0, 0.9, count)
        maps.light = maps.light * gain.reshape(self.w.height, self.w.width)


EFFECTS = [SystemGain, QuantumEfficiency, Prnu, PrnuCorrelated, ColumnGain, PrnuLowFrequency, RelativeIllumination,
           ColourShading, Nonlinearity, FullWell, BrighterFatter, ChargeCoupling, OpticalCrosstalk, ConverterBit, ImageLag,
           ExposureOffset, GreenImbalance, FlickerBanding, LightFlicker, DefectivePixels]
