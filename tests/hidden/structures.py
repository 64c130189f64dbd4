#!/usr/bin/env python3
"""Ten structures that the catalogue lacks, hidden one at a time: what `camrig diagnose` proposes for each.

    structures.py --camrig target/release/camrig                      # 40 draws of each of ten: 400 sets
    structures.py --camrig target/release/camrig --draws 4            # 40 draws in all
    structures.py --camrig target/release/camrig --kinds none --draws 100    # nothing hidden: any proposal is a false one
    structures.py --camrig target/release/camrig --beside             # row noise of 3.5 e- beside each, which has a name

A plain sensor of its own, in numpy: e = Poisson(light x gain map + dark rate x t), v = respond(e) + read noise + row noise,
DN = rint(B + K v), 112 x 80 pixels, 2 dark stacks of 20 frames, 7 flats of 16. The base is drawn at random, the structure on
top of it at `--times` a nominal amount at which it stands out. Domain and shape must be those hidden, with its place; exponents
on signal and exposure, where it has any, within 0.15. Seeds come from the base seed (default: from the operating system). A
results file is continued where it ends.
"""
import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import resource
import secrets
import subprocess
import sys
import tempfile

import numpy as np

from camera import stream
from tally import share, table

W, H = 112, 80
QE, WAVELENGTH = 0.55, 530.0
ROW_NOISE_E = 3.5
GAP = 1.5
EXPONENT = 0.15
# Catalogue entries of the same structure, left out.
OWN = {"glow": ["amp-glow"]}
y, x = np.mgrid[:H, :W]


class Base:
    """A sensor without anything hidden: hooks are identities. `truth` tells the place of what is hidden."""
    domain, shape, exponents = None, None, {}

    def __init__(self, rng, times):
        self.rng, self.normal = rng, rng.normal
        u = rng.uniform
        self.k, self.read, self.prnu, self.dark = u(0.3, 0.6), u(3.5, 7), u(0.005, 0.011), u(6, 20)
        self.top = 3900 / self.k
        self.gain_map = 1 + self.prnu * self.normal(size=(H, W))
        levels = np.array([0.035, 0.11, 0.23, 0.39, 0.56, 0.74, 0.88]) * u(0.94, 1.06, 7) * self.top
        self.plan = [("dark", 0.02, 0.0, 20), ("dark", u(2, 4), 0.0, 20)] + [("flat", 0.02, e, 16) for e in levels]
        self.rate = np.full((H, W), self.dark)
        self.truth = {}
        self.hide(times)

    def hide(self, times):
        pass

    def respond(self, e):
        return e

    def noise(self):
        return self.read * self.normal(size=(H, W))

    def volts(self, v, electrons, exposure_s, i):
        return v

    def frame(self, stack, i, row_noise_e):
        _, exposure_s, electrons, _ = stack
        e = self.rng.poisson(electrons * self.gain_map + self.rate * exposure_s).astype(float)
        v = self.volts(self.respond(e) + self.noise(), electrons, exposure_s, i)
        v = v + row_noise_e * self.normal(size=(H, 1))
        return np.clip(np.rint(100 + self.k * v), 0, 4095).astype("<u2")

    def placed(self, step):
        """Whether a step of the right domain and shape is where it was hidden."""
        return True


class Seam(Base):
    shape = "seam"

    def hide(self, times):
        rng = self.rng
        self.along = int(rng.integers(2))
        self.first = int((W, H)[self.along] * rng.choice([0.25, 0.5, 0.75]))
        part = (x, y)[self.along] >= self.first
        of_gain = rng.random() < 0.5
        self.domain = "gain" if of_gain else "offset"
        self.exponents = {"signal": float(of_gain)}
        self.factor = 1 + 0.004 * times * part * of_gain
        self.offset = 1.5 * times * part * (not of_gain)
        self.truth = {"axis": "xy"[self.along], "first": self.first}

    def volts(self, v, electrons, exposure_s, i):
        return v * self.factor + self.offset

    def placed(self, step):
        key = ("first_column", "first_row")[self.along]
        return abs(value(step, key) - self.first) <= 1


class Wave(Base):
    domain, shape, exponents = "offset", "wave", {"signal": 0.0, "exposure": 0.0}

    def hide(self, times):
        u = self.rng.uniform
        self.truth = {"cycles_per_column": u(0.03, 0.47), "cycles_per_row": u(-0.45, 0.45)}
        turns = x * self.truth["cycles_per_column"] + y * self.truth["cycles_per_row"] + u()
        self.offset = times * np.sin(2 * np.pi * turns)

    def volts(self, v, electrons, exposure_s, i):
        return v + self.offset

    def placed(self, step):
        """A wave and the one with both frequencies turned are the same."""
        return any(all(abs(sign * value(step, k) - f) < 0.003 for k, f in self.truth.items()) for sign in (1, -1))


class RowDroop(Base):
    domain, shape, exponents = "temporal", "row-profile", {"signal": 0.0}

    def hide(self, times):
        self.length, self.sigma = self.rng.uniform(8, 30), 3.0 * times
        self.truth = {"length_columns": self.length, "sigma_e": self.sigma}

    def volts(self, v, electrons, exposure_s, i):
        return v + self.sigma * np.exp(-np.arange(W) / self.length) * self.normal(size=(H, 1))


class StartUp(Base):
    domain, shape = "offset", "frame-curve"

    def hide(self, times):
        self.truth = {"amplitude_e": 1.0 * times, "frames": self.rng.uniform(1.5, 4)}

    def volts(self, v, electrons, exposure_s, i):
        return v + self.truth["amplitude_e"] * np.exp(-i / self.truth["frames"])


class RowNoiseOfSignal(Base):
    domain, shape, exponents = "temporal", "row-flat", {"signal": 1.0}

    def hide(self, times):
        self.truth = {"part_of_signal": 0.0009 * times}

    def volts(self, v, electrons, exposure_s, i):
        return v + self.truth["part_of_signal"] * electrons * self.normal(size=(H, 1))


class Stitch(Base):
    domain, shape = "response", "signal-step"

    def hide(self, times):
        self.truth = {"at_e": self.rng.uniform(0.15, 0.7) * self.top}
        self.more, self.factor = 12 * times, 1 + 0.002 * times

    def respond(self, e):
        return np.where(e > self.truth["at_e"], e * self.factor + self.more * self.normal(size=e.shape), e)

    def placed(self, step):
        """Known between two levels only."""
        return value(step, "above_e") - 300 <= self.truth["at_e"] <= value(step, "below_e") + 300


class LogNormal(Base):
    domain, shape, exponents = "dark", "distribution", {"exposure": 1.0}

    def hide(self, times):
        spread = 0.25 * times
        self.rate = self.dark * np.exp(spread * self.normal(size=(H, W)) - spread**2 / 2)
        self.truth = {"ln_spread": spread}


class Glow(Base):
    """On all four edges."""
    domain, exponents = "dark", {"exposure": 1.0}
    shape = ("map", "row-profile", "column-profile", "profile")

    def hide(self, times):
        left, right, top, bottom = 1.5 * times * self.rng.uniform(0.6, 1.6, 4)
        length = self.rng.uniform(4, 12)
        edges = [(left, x), (right, W - 1 - x), (top, y), (bottom, H - 1 - y)]
        self.rate = self.dark + sum(a * np.exp(-d / length) for a, d in edges)
        self.truth = {"length": length}


class Hits(Base):
    """Particles: 1.2 a frame and 1.5 a second, exponential charge over one to four pixels."""
    domain, shape = "nuisance", "particle-hits"

    def hide(self, times):
        self.charge = 300.0 * times
        self.truth = {"charge_e": self.charge}

    def volts(self, v, electrons, exposure_s, i):
        rng = self.rng
        for _ in range(rng.poisson(1.2 + 1.5 * exposure_s)):
            row, column, n = rng.integers(0, H), rng.integers(0, W - 4), rng.integers(1, 5)
            v[row, column : column + n] += rng.exponential(self.charge) * rng.dirichlet(np.ones(n))
        return v


class Serial(Base):
    domain, shape, exponents = "temporal", "correlation", {"signal": 0.0}

    def hide(self, times):
        self.truth = {"correlation": min(0.15 * times, 0.7)}

    def noise(self):
        r, z = self.truth["correlation"], self.normal(size=(H, W))
        for column in range(1, W):
            z[:, column] = r * z[:, column - 1] + np.sqrt(1 - r * r) * z[:, column]
        return self.read * z


KINDS = {"seam": Seam, "wave": Wave, "row-droop": RowDroop, "start-up": StartUp, "row-noise-of-signal": RowNoiseOfSignal,
         "stitch": Stitch, "log-normal": LogNormal, "glow": Glow, "hits": Hits, "serial": Serial, "none": Base}


def value(step, key):
    return step["parameters"].get(key, {"value": np.nan})["value"]


def lines(pairs):
    return "".join(f"{k} = {json.dumps(v)}\n" for k, v in pairs.items())


def write(folder, base, row_noise_e):
    """The set and the model without what is hidden."""
    folder.mkdir(parents=True)
    text = 'format = "captures/1"\n[sensor]\n' + lines(dict(
        width=W, height=H, bits=12, cfa="mono", black_level_dn=100, white_level_dn=4095, pitch_um=5.0))
    for n, stack in enumerate(base.plan):
        role, exposure_s, electrons, frames = stack
        np.save(folder / f"s{n}.npy", np.stack([base.frame(stack, i, row_noise_e) for i in range(frames)]))
        text += "[[capture]]\n" + lines(dict(
            id=f"{role}-{n}", role=role, files=f"s{n}.npy", exposure_s=exposure_s, analog_gain=1.0, temperature_c=20.0))
        if role == "flat":
            text += "[capture.light]\n" + lines(dict(
                photons_per_pixel_per_s=electrons / QE / exposure_s, wavelength_nm=WAVELENGTH, uniformity="flat"))
    (folder / "captures.toml").write_text(text)
    (folder / "camera.toml").write_text(
        'name = "structures"\n[lens]\nkind = "diffraction-limited"\nf_number = 2.8\nfocal_length_mm = 8.0\n[sensor]\n'
        + lines(dict(width=W, height=H, pitch_um=5.0, fill_factor=1.0, cfa="mono", qe=QE, conversion_gain_uv_per_e=50.0,
                     full_well_e=4095 / base.k, bits=12, black_level_dn=100, temperature_c=20.0, seed=1))
        + "[sensor.noise]\n" + lines(dict(
            read_e=base.read, dark_current_e_per_s=base.dark, dark_doubling_c=7.0, temperature_ref_c=20.0, dsnu_e_per_s=0.0,
            prnu=base.prnu, row_fpn_e=0.0)))


def right(base, kind, found):
    """What of an answer is right."""
    proposed = [s for s in found["steps"] if s["status"] == "proposed"]
    named = {s["effect"]: s for s in found["steps"] if s["status"] != "proposed"}
    out = {"proposed": [f"{s['domain']}/{s['shape']}" for s in proposed], "named": {k: s["status"] for k, s in named.items()},
           "nuisances": sorted({n["kind"] for n in found["nuisances"]}), "verdict": found["verdict"],
           "gap_before": found["gap_before"], "gap_after": found["gap_after"]}
    if kind == "none":
        return out
    if base.domain == "nuisance":
        return out | {"domain": base.shape in out["nuisances"], "shape": base.shape in out["nuisances"]}
    shapes = base.shape if isinstance(base.shape, tuple) else (base.shape,)
    of_domain = [s for s in proposed if s["domain"] == base.domain]
    good = [s for s in of_domain if s["shape"] in shapes and base.placed(s)]
    errors = [abs(s["dependence"][k] - e) for s in good[:1] for k, e in base.exponents.items()]
    return out | {"domain": bool(of_domain), "shape": bool(good), "exponents": max(errors) if errors else None,
                  "besides": len(proposed) - len(good)}


def judge(kind, draw, a):
    key = f"{kind}/{draw}"
    base = KINDS[kind](stream(a.seed, key), a.times)
    row_noise_e = ROW_NOISE_E if a.beside else 0.0
    with tempfile.TemporaryDirectory(dir=a.folder, prefix="camrig-structures-") as folder:
        folder = pathlib.Path(folder)
        write(folder / "set", base, row_noise_e)
        command = [a.camrig, "diagnose", folder / "set" / "camera.toml", folder / "set", "-o", folder / "out"]
        command += [word for own in OWN.get(kind, []) for word in ("--without", own)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run = subprocess.run(command, capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        line = {"key": key, "truth": base.truth,
                "processor_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime}
        if run.returncode not in (0, 1):
            return line | {"failure": run.stderr.strip()[-400:]}
        return line | right(base, kind, json.loads((folder / "out" / "diagnosis.json").read_text()))


def report(results, beside):
    """A row for each kind, and one for all."""
    kinds = [k for k in KINDS if any(r["key"].startswith(k + "/") for r in results)]
    rows = []
    for kind in [*kinds, "all"]:
        of = [r for r in results if kind == "all" or r["key"].startswith(kind + "/")]
        done = [r for r in of if "failure" not in r]
        over = lambda test, among=of: share(sum(bool(test(r)) for r in among), len(among))
        both = lambda r: r.get("domain") and r.get("shape")
        measured = [r for r in done if r.get("exponents") is not None]
        rows.append([
            kind, over(both), over(lambda r: r["exponents"] <= EXPONENT, measured),
            over(lambda r: r.get("gap_after", np.inf) is not None and r.get("gap_after", np.inf) <= GAP),
            over(lambda r: r.get("besides", len(r.get("proposed", []))) > 0),
            over(lambda r: set(r.get("named", {})) - ({"row-temporal-noise"} if beside else set())),
            over(lambda r: "row-temporal-noise" in r.get("named", {})) if beside else "-",
            f"{np.mean([r['processor_s'] for r in of]):.0f}"])
    head = ["hidden", "domain, shape and place", f"exponents within {EXPONENT}", f"held-out gap <= {GAP}", "other proposals",
            "names of the catalogue", "row noise beside it named", "processor s a set"]
    return table(head, rows)


def arguments():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--camrig", default="target/release/camrig", help="the program")
    p.add_argument("--kinds", type=lambda s: s.split(","), default=[k for k in KINDS if k != "none"], help="only these")
    p.add_argument("--draws", type=int, default=40, help="draws of each kind")
    p.add_argument("--times", type=float, default=1.0, help="multiple of the nominal amounts")
    p.add_argument("--beside", action="store_true", help=f"row noise of {ROW_NOISE_E} e- beside each")
    p.add_argument("--jobs", type=int, default=2)
    p.add_argument("--seed", type=int, help="base seed; default: from the operating system")
    p.add_argument("--results", type=pathlib.Path, default=pathlib.Path("structures.jsonl"))
    p.add_argument("--folder", help="where sets are made (default: the system's temporary folder)")
    p.add_argument("--only-report", action="store_true", help="no new sets")
    a = p.parse_args()
    unknown = set(a.kinds) - set(KINDS)
    if unknown:
        p.error(f"unknown kinds {', '.join(sorted(unknown))}; known: {', '.join(KINDS)}")
    return a


def main():
    a = arguments()
    head, *results = [json.loads(s) for s in a.results.read_text().splitlines()] if a.results.exists() else [None]
    if head is None:
        a.seed = secrets.randbits(32) if a.seed is None else a.seed
        head = {"base_seed": a.seed, "times": a.times, "beside": a.beside}
        a.results.write_text(json.dumps(head) + "\n")
    elif (head["times"], head["beside"]) != (a.times, a.beside) or a.seed not in (None, head["base_seed"]):
        sys.exit(f"{a.results} holds results of {head}: give another --results")
    a.seed = head["base_seed"]
    done = {r["key"] for r in results}
    # Kind by kind within a draw, so that a part of the run says something of all.
    wanted = [(k, d) for d in range(a.draws) for k in a.kinds if f"{k}/{d}" not in done and not a.only_report]
    print(f"base seed {a.seed}, {len(results)} results in {a.results}", flush=True)
    for threads in ("OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"):  # the jobs fill the cores
        os.environ.setdefault(threads, "1")
    with concurrent.futures.ProcessPoolExecutor(a.jobs) as pool, a.results.open("a") as out:
        for future in concurrent.futures.as_completed([pool.submit(judge, k, d, a) for k, d in wanted]):
            line = future.result()
            results.append(line)
            out.write(json.dumps(line) + "\n")
            out.flush()
            told = line.get("failure") or re.sub(r'["{}]', "", json.dumps({k: line.get(k) for k in (
                "domain", "shape", "exponents", "proposed", "named", "nuisances", "gap_after")}))
            print(f"{line['key']}: {told}", flush=True)
    print(report(results, a.beside))


if __name__ == "__main__":
    main()
