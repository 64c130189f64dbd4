#!/usr/bin/env python3
"""Effects of the optics, hidden in a camera of camrig's own, looked for by `camrig diagnose`.

The generator beside this file knows no lens; here `camrig capture` takes the frames, of another physical sensor (its seed is
drawn) behind a lens with one effect that the fitted camera file has not, or none, or the four gaps of Chen et al. 2009 with two
effects of the sensor. What was hidden never reaches the fitted camera.

    tests/hidden/optics.py --camrig target/release/camrig --draws 3 --null 20
"""

import argparse
import json
import random
import re
import subprocess
import tempfile
from pathlib import Path

WIDTH, HEIGHT = 256, 192
# Each kind with amounts as drawn: key and range; the sign is drawn where it may be either.
ALONE = {
    "defocus": {"shift_um": (5, 12)},
    "distortion": {"k1": (-0.03, -0.005)},
    "lens-transmittance": {"factor": (0.8, 0.97)},
    "veiling-glare": {"fraction": (0.01, 0.05)},
    "lateral-colour": {"blue_px": (0.3, 1.0), "red_px": (-1.0, -0.3)},
    "relative-illumination": {"corner": (-0.2, -0.05)},
    "colour-shading": {"channel_0": (-0.1, -0.03)},
}
PAPER = {
    "defocus": {"shift_um": (7, 9)},
    "lens-transmittance": {"factor": (0.8, 0.9)},
    "distortion": {"k1": (-0.02, -0.01), "size": (0.99, 0.996)},
    "hot-pixels": {"fraction": (0.015, 0.025), "mean_e_per_s": (90, 120)},
    "row-temporal-noise": {"sigma_e": (1.0, 2.0)},
    "defective-pixels": {"fraction": (4e-4, 8e-4)},
}


class Bench:
    def __init__(self, camrig, folder):
        self.camrig, self.folder = camrig, Path(folder)
        text = self.run("presets", "mt9t012").stdout
        for name in re.findall(r'"([\w.-]+\.csv)"', text):
            (self.folder / name).write_text(self.run("presets", name).stdout)
        text = re.sub(r"(?m)^width = .*", f"width = {WIDTH}", text)
        self.base = re.sub(r"(?m)^height = .*", f"height = {HEIGHT}", text)
        (self.folder / "base.toml").write_text(self.base)

    def run(self, *words, may_disagree=False):
        done = subprocess.run([self.camrig, *words], cwd=self.folder, capture_output=True, text=True)
        if done.returncode not in ((0, 1) if may_disagree else (0,)):
            raise SystemExit(f"camrig {' '.join(words)}: {done.stderr}")
        return done

    def draw(self, kinds, rng):
        """Captures of a sensor with these effects; what `camrig diagnose` says."""
        seed = rng.randrange(2, 1 << 30)
        text = re.sub(r"(?m)^seed = .*", f"seed = {seed}", self.base)
        for kind, keys in kinds.items():
            text += f'\n[[effect]]\nkind = "{kind}"\n'
            text += "".join(f"{key} = {rng.uniform(*span):.6g}\n" for key, span in keys.items())
        (self.folder / "hidden.toml").write_text(text)
        frames = str(rng.randrange(1, 1 << 20))
        self.run("capture", "--camera", "hidden.toml", "--plan", "optics", "--frame-seed", frames, "-o", "set", "--force")
        (self.folder / "hidden.toml").unlink()
        self.run("diagnose", "base.toml", "set", "-o", "found", "--force", may_disagree=True)
        return json.loads((self.folder / "found/diagnosis.json").read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--camrig", required=True)
    parser.add_argument("--draws", type=int, default=3, help="of each effect alone")
    parser.add_argument("--null", type=int, default=20, help="of nothing hidden")
    parser.add_argument("--paper", type=int, default=1, help="of the paper's gaps together")
    parser.add_argument("--seed", type=int, default=None)
    arguments = parser.parse_args()
    seed = arguments.seed if arguments.seed is not None else random.SystemRandom().randrange(1 << 30)
    rng = random.Random(seed)
    print(f"seed {seed}")
    camrig = str(Path(arguments.camrig).resolve())
    cases = [("nothing", {}, arguments.null)]
    cases += [(kind, {kind: keys}, arguments.draws) for kind, keys in ALONE.items()]
    cases += [("the paper's gaps", PAPER, arguments.paper)]
    print("| hidden | draws | exact set named | named of it | wrong names | gap before | after | confirmed |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(camrig, folder)
        for name, kinds, draws in cases:
            exact = named = wrong = confirmed = 0
            before, after, others = [], [], set()
            for _ in range(draws):
                found = bench.draw(kinds, rng)
                names = {step["effect"] for step in found["steps"]}
                exact += names == set(kinds)
                named += len(names & set(kinds))
                wrong += len(names - set(kinds))
                others |= names - set(kinds)
                confirmed += found["verdict"] in ("explained", "agrees")
                before.append(found["gap_before"])
                after.append(found["gap_after"])
            if draws:
                middle = [sorted(v)[len(v) // 2] for v in (before, after)]
                total = draws * len(kinds)
                print(
                    f"| {name} | {draws} | {exact} | {named} of {total} | {wrong} {' '.join(sorted(others))} "
                    f"| {middle[0]:.2f} | {middle[1]:.2f} | {confirmed} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
