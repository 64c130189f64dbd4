"""Hidden effects that no catalogue entry describes: the diagnosis must report them as unexplained, never by a name."""
import numpy as np

from limits import FIVE, rare_pixels
from readout import Component
from sensor import F, Effect


class Outside(Effect):
    """`says`: words of which a useful description contains at least one."""
    catalogued = False
    says = ()


class OutsideComponent(Component):
    catalogued = False
    says = ()


def extra_noise(info, share2):
    """Information on s^2 where pixels have extra white noise of variance share2 s^2."""
    per_pixel = info.nu[:, None] / 2 * (1 / info.var**2)
    return np.sum(per_pixel.mean(1)) * np.sum(share2**2)


class DiagonalNoise(OutsideComponent):
    """n(x + y, frame): diagonals of m pixels add (m s^2 / v)^2 / 2 each."""
    kind, says = "outside-diagonal-noise", ("diagonal", "oblique", "lag", "correlat", "spectr")

    def information(self, s2):
        i = self.w.info
        length = np.bincount((self.w.x + self.w.y).astype(int).ravel()).astype(float)
        v = i.var.mean(1)[:, None]
        return np.sum(i.nu[:, None] / 2 * (length / (v + length * s2)) ** 2)

    def signal(self, v, shot):
        h, w = v.shape
        n = shot.rng(self.kind).standard_normal(h + w, dtype=F)
        return v + F(self.amount) * n[(self.w.x + self.w.y).astype(int)]


class RingNoise(OutsideComponent):
    """Extra white noise in a ring about the centre."""
    kind, says = "outside-ring-noise", ("region", "block", "ring", "radi", "part", "local", "position", "where", "variance")

    def __init__(self, world, rng):
        super().__init__(world, rng)
        r = np.hypot(world.x / world.width - 0.5, world.y / world.height - 0.5)
        self.ring = (np.abs(r - rng.uniform(0.2, 0.4)) < 0.05).astype(F)

    def information(self, s2):
        return extra_noise(self.w.info, self.ring)

    def signal(self, v, shot):
        return v + F(self.amount) * self.ring * shot.rng(self.kind).standard_normal(v.shape, dtype=F)


class ColumnSquaredNoise(RingNoise):
    """Extra white noise whose standard deviation grows as the square of the column."""
    kind, says = "outside-column-squared-noise", ("region", "block", "column", "part", "local", "position", "variance")

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.ring = ((world.x / world.width) ** 2).astype(F) + 0 * world.y

    def information(self, s2):
        return extra_noise(self.w.info, self.ring.astype(float) ** 2)


class SkewedNoise(Outside):
    """Read noise of a shifted gamma distribution at unchanged variance: the amount is its skewness.

    The third cumulant of N samples is known to sqrt(6 / N), diluted by the share of read noise to the 3/2.
    """
    kind, parameter, says = "outside-skewed-noise", "skewness", ("skew", "asymmetr", "histogram", "shape")

    def limit(self):
        i = self.w.info
        return FIVE / np.sqrt(np.sum(i.samples() * i.read_share() ** 3) / 6)

    def noise(self, z, shot):
        shape = 4 / self.amount**2
        g = shot.rng(self.kind).standard_gamma(shape, z.shape)
        return ((g - shape) / np.sqrt(shape)).astype(F)


class BlockNoise(OutsideComponent):
    """n(block of 16 x 16 pixels, frame)."""
    kind, says = "outside-block-noise", ("block", "low-frequency", "low frequency", "patch", "lag", "correlat", "region")

    def information(self, s2):
        return self.w.info.temporal(256, self.w.info.pixels / 256, s2)

    def signal(self, v, shot):
        h, w = v.shape
        n = shot.rng(self.kind).standard_normal((h // 16 + 1, w // 16 + 1), dtype=F)
        return v + F(self.amount) * np.kron(n, np.ones((16, 16), F))[:h, :w]


class CheckerDrift(OutsideComponent):
    """The gain of a checkerboard of pixels against the rest drifts from frame to frame."""
    kind, parameter, says = "outside-checker-drift", "sigma", ("checker", "phase", "2x2", "2 x 2", "nyquist", "pattern", "period", "lag", "correlat")

    def information(self, s2):
        i = self.w.info
        known = (i.mu**2 / i.var).mean(1) * i.pixels
        return np.sum(i.nu / 2 * (known / (1 + s2 * known)) ** 2)

    def light(self, rate, shot):
        sign = 1 - 2 * ((self.w.x + self.w.y) % 2)
        return rate * (1 + F(self.amount * shot.rng(self.kind).standard_normal()) * sign.astype(F))


class Spokes(Outside):
    """A fixed gain pattern of radial spokes; the amount is its rms."""
    kind, parameter, says = "outside-spokes", "sigma", ("gain", "flat", "pattern", "prnu", "shading", "block", "low-frequency", "polynomial")

    def __init__(self, world, rng):
        super().__init__(world, rng)
        angle = np.arctan2(world.y - world.height / 2, world.x - world.width / 2)
        pattern = np.cos(int(rng.integers(5, 12)) * angle)
        self.pattern = ((pattern - pattern.mean()) / pattern.std()).astype(F)

    def limit(self):
        i = self.w.info
        return FIVE * np.sqrt(i.gain_map()[1] / i.pixels)

    def fixed(self, maps):
        maps.light = maps.light * (1 + F(self.amount) * self.pattern)


class GainRectangle(Spokes):
    """A rectangle of another gain; the amount is the rms of the pattern over the frame, without its mean."""
    kind, says = "outside-gain-rectangle", ("gain", "flat", "rectang", "region", "block", "local", "pattern", "low-frequency", "polynomial")

    def __init__(self, world, rng):
        super().__init__(world, rng)
        h, w = world.height, world.width
        x0, y0 = rng.uniform(0.1, 0.6) * w, rng.uniform(0.1, 0.6) * h
        inside = (np.abs(world.x - x0 - w * 0.15) < w * 0.15) & (np.abs(world.y - y0 - h * 0.1) < h * 0.1)
        self.pattern = ((inside - inside.mean()) / inside.std()).astype(F)


class MovingBar(Outside):
    """A bar an eighth of the frame wide, brighter by the amount, moves from frame to frame.

    Known where: n frames of m pixels, amount sqrt(n m / v) = 5 (an eighth less for the mean taken out).
    """
    kind, parameter, says = "outside-moving-bar", "amplitude_e", ("column", "bar", "frame", "moving", "block", "band")

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.step = rng.uniform(0.07, 0.4) * world.width

    def limit(self):
        i = self.w.info
        return FIVE / np.sqrt(np.sum(i.n * (1 / i.var).mean(1)) * i.pixels * 7 / 64)

    def signal(self, v, shot):
        start = self.step * shot.n + shot.sensor.seed % 97
        return v + F(self.amount) * ((self.w.x - start) % self.w.width < self.w.width / 8)


class Hits(Outside):
    """Pixels hit in single frames (cosmic rays): exponential charge of mean 60 e-; the amount is the rate per pixel."""
    kind, parameter, says = "outside-hits", "fraction", ("outlier", "tail", "kurt", "spike", "hit", "single", "transient", "skew")

    def limit(self):
        i = self.w.info
        samples = i.pixels * i.n[i.dark].sum()
        return rare_pixels(samples, np.sqrt(i.var[i.dark].mean()), lambda x: np.exp(-x / 60))

    def charge(self, q, shot):
        rng = shot.rng(self.kind)
        count = rng.poisson(self.amount * q.size)
        q = q.copy()
        np.add.at(q.reshape(-1), rng.integers(0, q.size, count), rng.exponential(60, count).astype(F))
        return q


EFFECTS = [DiagonalNoise, RingNoise, ColumnSquaredNoise, SkewedNoise, BlockNoise, CheckerDrift, Spokes, GainRectangle,
           MovingBar, Hits]
