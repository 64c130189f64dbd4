"""Catalogued effects of real sensors: what single frames, places, sites and transfers do, each with its equation and
detection limit."""
import numpy as np

from limits import FIVE, normal_tail, rare_pixels
from readout import Component, MeanShift
from sensor import F, Effect


class ParticleHits(Effect):
    """Particles cross a layer one pixel deep and leave charge q for each pixel of their way, in one frame each.

    Directions by cos^2 of the zenith angle; what crosses a plane has the density cos^3 sin. Nothing else makes such
    samples: five hits stand out.
    """
    kind, parameter = "particle-hits", "rate_per_mpx_s"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.charge_e = rng.uniform(300, 1200)

    def limit(self):
        i = self.w.info
        return FIVE / (1e-6 * i.pixels * np.sum(i.n * i.t))

    def charge(self, q, shot):
        rng, (h, w) = shot.rng(self.kind), q.shape
        q = q.copy()
        for _ in range(rng.poisson(self.amount * 1e-6 * q.size * shot.stack.exposure_s)):
            cos = max(rng.beta(4, 1), 0.01)  # density 4 c^3
            turn, steps = rng.uniform(0, 2 * np.pi), int(np.ceil(100 / cos))
            along = (np.arange(steps) + 0.5) / steps * np.sqrt(1 - cos * cos) / cos
            x = np.floor(rng.uniform(0, w) + along * np.cos(turn)).astype(int)
            y = np.floor(rng.uniform(0, h) + along * np.sin(turn)).astype(int)
            on = (x >= 0) & (x < w) & (y >= 0) & (y < h)
            np.add.at(q, (y[on], x[on]), F(self.charge_e / cos / steps))
        return q

    def details(self):
        return {"charge_e_per_px": self.charge_e}


class DarkTelegraph(Effect):
    """Dark current of a fraction of the pixels is higher by A in some frames: A exponential; a state lasts from frame to
    frame with a chance.

    Limit from outliers of the variance over frames in the longest dark stack, as of `random-telegraph-noise`.
    """
    kind, parameter = "dark-current-telegraph-noise", "fraction"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.mean, self.duty, self.stays = rng.uniform(150, 500), 0.5, rng.uniform(0, 0.5)
        self.order = rng.permutation(world.info.pixels)
        self.jump = rng.exponential(self.mean, world.info.pixels).astype(F)

    def limit(self):
        i = self.w.info
        longest = np.argmax(np.where(i.dark, i.t, 0))
        nu, var = i.nu[longest], i.var[longest].mean()
        sd = np.sqrt(2 / (9 * nu))

        def above(x):  # of jumps by their quantiles
            jumps = -self.mean * np.log((np.arange(50) + 0.5) / 50) * i.t[longest]
            grown = (1 + (jumps**2 / 4 + jumps / 2) / var) ** (1 / 3)
            return np.mean([normal_tail((1 + x - g) / (g * sd)) for g in grown])
        return rare_pixels(i.pixels, sd, above)

    def charge(self, q, shot):
        rng, where = shot.rng(self.kind), self.order[: max(1, round(self.amount * q.size))]
        fresh = rng.random(where.size) < self.duty
        self.on = fresh if shot.n == 0 else np.where(rng.random(where.size) < self.stays, self.on, fresh)
        q = q.copy()
        warm = 2.0 ** ((shot.stack.temperature_c - self.w.camera.reference_c) / self.w.camera.doubling_c)
        q.reshape(-1)[where] += rng.poisson(self.jump[where] * warm * shot.stack.exposure_s * self.on).astype(F)
        return q

    def details(self):
        return {"mean_e_per_s": self.mean, "renewal": 1 - self.stays}


class DefectiveColumns(Effect):
    """A fraction of the columns gives a share of its light."""
    kind, parameter = "defective-columns", "fraction"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.share = rng.uniform(0, 0.6)
        self.order = rng.permutation(world.width)

    def limit(self):
        sd = np.sqrt(self.w.info.gain_map()[1] / self.w.height)
        return rare_pixels(self.w.width, sd, lambda x: float(x < 1 - self.share))

    @property
    def columns(self):
        return self.order[: max(1, round(self.amount * self.w.width))]

    def fixed(self, maps):
        gain = np.ones((1, self.w.width), F)
        gain[0, self.columns] = self.share
        maps.light = maps.light * gain

    def details(self):
        return {"gain": self.share}


class DefectiveAreas(Effect):
    """Rectangles of a share of the light, or of more dark current: whole rows, parts of rows, or clusters. One is seen."""
    kind, parameter = "defective-areas", "count"

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.hot, self.size = rng.random() < 0.5, [(0, 1), (world.width // 4, 1), (5, 5)][rng.integers(3)]
        self.share, self.rate = (1.0, rng.uniform(100, 300)) if self.hot else (rng.uniform(0, 0.5), 0.0)
        self.corners = rng.random((1000, 2))

    def limit(self):
        return 0.3

    @property
    def mask(self):
        mask = np.zeros((self.w.height, self.w.width), bool)
        w, h = self.size[0] or self.w.width, self.size[1]
        for x, y in self.corners[: max(1, round(self.amount))]:
            x, y = int(x * (self.w.width - w + 1)), int(y * (self.w.height - h + 1))
            mask[y:y + h, x:x + w] = True
        return mask

    def fixed(self, maps):
        maps.light = maps.light * np.where(self.mask, F(self.share), F(1))
        maps.dark = maps.dark + F(self.rate) * self.mask

    def details(self):
        return {"width_px": self.size[0], "height_px": self.size[1], "gain": self.share, "rate_e_per_s": self.rate}


class DarkBySite(MeanShift):
    """One place of the 2x2 pattern has more dark current than the others."""
    kind, needs_cfa = "dark-current-by-site", True

    def __init__(self, world, rng):
        super().__init__(world, rng)
        self.site = int(rng.integers(4))
        self.parameter = f"plane_{self.site}_e_per_s"
        self.cell = np.eye(4)[self.site]

    def shift(self):
        return self.w.info.warm_t[:, None] * self.cell

    def open_to(self):
        return [self.w.info.warm_t[:, None] * np.ones(4)]

    def fixed(self, maps):
        maps.dark = maps.dark + F(self.amount) * self.w.camera.spread(self.cell)


class FrameOffsetBySite(Component):
    """An offset of each place of the 2x2 pattern in each frame, N(0, s^2); three contrasts of a quarter of the pixels."""
    kind, needs_cfa = "frame-offset-by-site", True

    def information(self, s2):
        return self.w.info.temporal(self.w.info.pixels / 4, 3, s2)

    def signal(self, v, shot):
        return v + F(self.amount) * self.w.camera.spread(shot.rng(self.kind).standard_normal(4))


class ChargeTransfer(Effect):
    """At each transfer along its row, every packet leaves a share e for the next one: a packet of column x is
    transferred x + 1 times.

    The noise of light of neighbours has a correlation that grows by e from column to column, known to sqrt(1 / N).
    """
    kind, parameter = "charge-transfer-inefficiency", "serial"

    def limit(self):
        i = self.w.info
        return FIVE / np.sqrt(np.sum(i.samples() * i.shot_share() ** 2) * self.w.width**2 / 12)

    def sd(self):
        return self.limit() / FIVE

    def charge(self, q, shot):
        e, q = F(self.amount), q.copy()
        for first in range(self.w.width):  # the packets still on their way
            left = e * q[:, first:]
            q[:, first:] -= left
            q[:, first + 1:] += left[:, :-1]
        return q


EFFECTS = [ParticleHits, DarkTelegraph, DefectiveColumns, DefectiveAreas, DarkBySite, FrameOffsetBySite, ChargeTransfer]
