"""Analytic detection limits: the smallest amounts that the frames of a design can show.

All limits are 5 standard deviations of the statistic that is matched to the effect, over all stacks of the set,
base parameters known as in camera.toml but for what a sensor of that description leaves open (the mean over its
own fixed patterns) and, where said, the scale of the light. Signals in electrons.

Three forms cover nearly everything:
- a temporal variance component s^2 shared by m pixels, G groups per frame: an estimate from one stack of n frames
  has standard deviation sqrt(2 / ((n - 1) G)) (v / m + s^2), v the variance of a pixel. For one dark stack this is
  sigma sqrt(5 / W sqrt(2 / (N H))) for rows, the catalogue's figure.
- a fixed component: the same with the variance of the pixel in the mean map, once (n - 1 -> 1).
- a shift d of mean signals with covariance C: d' C^-1 d = 25.
"""
from math import erfc, sqrt

import numpy as np

FIVE = 5.0


class Information:
    """Sizes and variances in a design, for each stack (rows of the arrays) and colour plane (columns)."""

    def __init__(self, camera, stacks):
        c = self.camera = camera
        self.stacks = stacks
        self.pixels = c.width * c.height
        self.n = np.array([s.frames for s in stacks], float)
        self.t = np.array([s.exposure_s for s in stacks])
        warm = 2.0 ** (np.array([s.temperature_c - c.reference_c for s in stacks]) / c.doubling_c)
        self.warm_t = self.t * warm
        self.mu = np.array([s.electrons for s in stacks])
        self.dark = np.array([s.role == "dark" for s in stacks])
        self.floor = c.read_e**2 + 1 / (12 * c.gain**2)   # rounding adds 1/12 DN^2
        self.var = self.floor + c.dark_e_per_s * self.warm_t[:, None] + self.mu
        self.nu = self.n - 1
        self.planes = self.mu.shape[1]

    def temporal(self, m, groups, s2=0.0, weight=1.0):
        """Fisher information on s^2: weight s^2 shared by `m` pixels, `groups` per frame."""
        weight = np.broadcast_to(weight, self.var.shape)
        v = self.var.mean(1) / m
        w = weight.mean(1)
        return np.sum(self.nu * groups / 2 * (w / (v + w * s2)) ** 2)

    def fixed(self, map_var, m, groups, s2=0.0):
        """Fisher information on the variance s^2 of a fixed component of a map with pixel variance `map_var`."""
        return groups / 2 / (map_var / m + s2) ** 2

    def offset_weights(self):
        """Weights of the dark stacks' mean maps in the best offset map, and its pixel variance: each stack has
        temporal noise of its own, and all have the same map of dark current."""
        t = self.warm_t[self.dark]
        cov = np.diag((self.var[:, 0] / self.n)[self.dark]) + self.camera.dsnu_e_per_s**2 * np.outer(t, t)
        weights = np.linalg.solve(cov, np.ones(t.size))
        return weights / weights.sum(), 1 / weights.sum()

    def offset_map(self):
        """Pixel variance of the best offset map."""
        return self.offset_weights()[1]

    def dark_map(self):
        """Pixel variance of the map of dark-current slopes (e-/s)^2, without and with the sensor's own DSNU."""
        w, t = (self.n / self.var[:, 0])[self.dark], self.warm_t[self.dark]
        slope = 1 / np.sum(w * (t - np.sum(w * t) / w.sum()) ** 2)
        return slope, slope + self.camera.dsnu_e_per_s**2

    def gain_maps(self):
        """Pixel variances of each plane's map of relative gain, without and with the sensor's own PRNU."""
        shot = 1 / np.sum(self.n[:, None] * self.mu**2 / self.var, 0)
        return shot, shot + self.camera.prnu**2

    def gain_map(self):
        """Their mean over the planes."""
        return tuple(v.mean() for v in self.gain_maps())

    def covariance(self):
        """Of stack and plane means: temporal noise, and what the sensor's patterns average to: offsets of even and
        of odd rows, dark current and PRNU of each plane."""
        c, per_plane = self.camera, self.pixels / self.planes
        cov = np.diag((self.var / (self.n[:, None] * per_plane)).ravel())
        parities = [[0]] if self.planes == 1 else [[0, 1], [2, 3]]
        for rows in parities:
            offset = np.zeros(self.var.shape)
            offset[:, rows] = 1
            cov += c.row_fpn_e**2 * len(parities) / c.height * np.outer(offset, offset)
        for p in range(self.planes):
            for pattern, sd in ((self.warm_t, c.dsnu_e_per_s), (self.mu[:, p], c.prnu)):
                of_plane = np.zeros(self.var.shape)
                of_plane[:, p] = pattern
                cov += sd**2 / per_plane * np.outer(of_plane, of_plane)
        return cov

    def means(self, shift, open_to=(), off=None):
        """Deviation (in standard deviations) of stack and plane means shifted by `shift`, electrons; with `off`, the
        matched statistic of means that are off by that much.

        `open_to`: further shifts of which nothing is known, such as `self.mu` for the scale of the light.
        """
        whiten = np.linalg.inv(np.linalg.cholesky(self.covariance()))
        d = whiten @ np.broadcast_to(shift, self.var.shape).ravel()
        if len(open_to):
            free = whiten @ np.column_stack([np.ravel(f) for f in open_to])
            d = d - free @ np.linalg.lstsq(free, d, rcond=None)[0]
        return np.linalg.norm(d) if off is None else d @ whiten @ np.ravel(off) / np.linalg.norm(d)

    def shot_share(self):
        """Share of photo-electron shot noise in the variance."""
        return self.mu / self.var

    def read_share(self):
        """Share of read noise in the variance."""
        return self.camera.read_e**2 / self.var

    def samples(self):
        """Independent pixel samples per stack and plane once the pixel means are removed."""
        return np.broadcast_to(self.nu[:, None] * self.pixels / self.planes, self.var.shape)


def normal_tail(u):
    """P(z > u)."""
    return 0.5 * erfc(u / sqrt(2))


def rare_pixels(pixels, sd, excess_above):
    """Smallest fraction of outliers whose count stands out by 5 sd of the background's count.

    `excess_above(x)`: probability that an outlier deviates by more than x. The best threshold is taken; one count
    is added to the background's variance, as nothing can be seen with less than a few pixels.
    """
    best = np.inf
    for u in np.arange(3, 8, 0.1):
        background = pixels * normal_tail(u)
        best = min(best, FIVE * np.sqrt(background + 1) / (pixels * max(excess_above(u * sd), 1e-12)))
    return best
