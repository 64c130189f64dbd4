"""A frame of the base camera, with hooks for hidden effects. Signals are in electrons up to the converter.

    light rate -> Poisson -> x PRNU -> + dark charge (Poisson) -> full well -> + read noise + row pattern
               -> x gain + black level -> rounding, clip

Each effect may override one of the hooks of `Effect`; the base model is the hooks' identity.
"""
import numpy as np

from camera import WHITE, stream

F = np.float32


class Effect:
    """A hidden effect: its equation as hooks, its amount, and the smallest amount that can be detected."""
    kind = ""
    parameter = ""      # name of the amount
    needs_cfa = False
    catalogued = True

    def __init__(self, world, rng):
        """Draws its other parameters (shape, frequency, place); the amount is set afterwards."""
        self.w, self.rng, self.amount = world, rng, 0.0

    def limit(self):
        """Smallest amount at which the ideal matched statistic is five of its standard deviations."""
        raise NotImplementedError

    def sd(self):
        """Cramer-Rao bound of the amount's standard deviation at this amount, where it is comparable; or None."""
        return None

    def details(self):
        """Further parameters, for the truth file."""
        return {}

    def camera(self, c):
        """The true camera, if the hidden effect is a wrong value in the camera file."""
        return c

    def fixed(self, maps):
        """Changes the fixed patterns of this sensor."""

    def light(self, rate, shot):
        """Mean photo-electrons per pixel of this frame."""
        return rate

    def charge(self, q, shot):
        """Electrons collected."""
        return q

    def noise(self, z, shot):
        """Read noise of unit variance."""
        return z

    def signal(self, v, shot):
        """Electrons at the converter's input, with read noise."""
        return v

    def convert(self, y, code):
        """Codes, from the converter's input in DN and the ideal converter's codes."""
        return code


class Maps:
    """Fixed patterns of one sensor. `light`, `gain` are factors on light and on charge read out."""

    def __init__(self, c, seed):
        shape = (c.height, c.width)

        def normal(name, size=shape):
            return stream(seed, "fixed", name).standard_normal(size, dtype=F)

        self.prnu = 1 + F(c.prnu) * normal("prnu")
        self.dark = np.maximum(F(c.dark_e_per_s) + F(c.dsnu_e_per_s) * normal("dsnu"), 0)
        self.offset = F(c.row_fpn_e) * normal("row", (c.height, 1)) + np.zeros(shape, F)
        self.read = F(c.read_e)
        self.light = F(1)
        self.gain = F(1)
        self.glow = F(0)    # e-/s, not of thermal origin


class Shot:
    """A frame being made: its stack, its number, the sensor, and random streams by name."""

    def __init__(self, sensor, stack, n):
        self.sensor, self.stack, self.n = sensor, stack, n

    def rng(self, name):
        return stream(self.sensor.seed, self.stack.id, self.n, name)


class Sensor:
    """The true sensor: camera, fixed patterns, hidden effects. `images`: mean photo-electrons of scenes by their name,
    per lux and second."""

    def __init__(self, camera, effects, seed, images=None):
        self.effects, self.seed, self.images = effects, seed, images or {}
        for e in effects:
            camera = e.camera(camera)
        self.camera = camera
        self.maps = Maps(camera, seed)
        for e in effects:
            e.fixed(self.maps)

    def collect(self, shot):
        """Charge of a frame before the effects that act on charge."""
        c, m, stack = self.camera, self.maps, shot.stack
        mean = self.images.get(stack.scene)
        mean = c.spread(stack.electrons) if mean is None else mean * F(stack.lux * stack.exposure_s)
        rate = mean * m.light + np.zeros((c.height, c.width), F)
        for e in self.effects:
            rate = e.light(rate, shot)
        warm = 2.0 ** ((stack.temperature_c - c.reference_c) / c.doubling_c)
        thermal = (m.dark * F(warm) + m.glow) * F(stack.exposure_s)
        q = shot.rng("dark").poisson(thermal).astype(F)
        if stack.role != "dark":
            q += shot.rng("photo").poisson(np.maximum(rate, 0)) * m.prnu
        return q

    def frame(self, stack, n):
        """One raw frame, uint16."""
        c, m, shot = self.camera, self.maps, Shot(self, stack, n)
        q = self.collect(shot)
        for e in self.effects:
            q = e.charge(q, shot)
        q = np.minimum(q, F(c.full_well_e)) * m.gain
        z = shot.rng("read").standard_normal(q.shape, dtype=F)
        for e in self.effects:
            z = e.noise(z, shot)
        v = q + m.read * z + m.offset
        for e in self.effects:
            v = e.signal(v, shot)
        y = F(c.gain * stack.analog_gain) * v + F(c.black_dn)
        code = np.floor(y + F(0.5))
        for e in self.effects:
            code = e.convert(y, code)
        return np.clip(code, 0, WHITE).astype(np.uint16)

    def frames(self, stack):
        """All frames of a stack, N x H x W."""
        return np.stack([self.frame(stack, n) for n in range(stack.frames)])
