"""Distance of a model's noise from that of real frames: Kullback-Leibler divergence and Kolmogorov-Smirnov distance.

Noise is the difference of a held-out frame from the mean of the held-out frames of its stack, in multiples of 1/n DN for n
frames. The model's frames are processed in the same way: the same number, with the same exposure, gain and temperature, in
light that gives the base model the measured mean. Stacks in which 1 % of the samples saturate, and whose mean is clipped
therefore, are excluded.

Divergence: the sum of p ln(p/q) over the cells of a histogram, p the measured shares, q the model's, in nats, with cells an
eighth of the measured standard deviation wide and at least 1 DN, and half a sample added to each cell of q (Krichevsky and
Trofimov 1981). With N samples in B cells, its expectation is (B - 1)/N if both distributions are equal. Distance: the largest
difference of the distribution functions. Both are means over stacks. The simplest model is Poisson and normal noise, rounded:
gain, read noise and black level.
"""
import pathlib
import re
import subprocess
import tempfile

import numpy as np

PLANCK_TIMES_LIGHT = 1.98644586e-25
NM = 550.0
MAX_FRAMES = 16
MAX_SATURATED = 0.01


def frames(camrig, files, scratch):
    """Frames of one stack, in the order of their names."""
    out = []
    for i, file in enumerate(files):
        target = file
        if file.suffix != ".npy":
            target = pathlib.Path(scratch) / f"{i}.npy"
            subprocess.run([camrig, "convert", file, target, "--force"], check=True, capture_output=True)
        data = np.load(target)
        out += list(data) if data.ndim == 3 else [data]
    return np.array(out).astype(np.int64)


def stacks(camrig, folder, scratch):
    """Dark and flat stacks of a set: what its manifest says, and the frames."""
    for block in (folder / "captures.toml").read_text().split("[[capture]]")[1:]:
        entry = dict(re.findall(r"^(\w+) = (.*)$", block, re.M))
        if entry["role"] not in ('"dark"', '"flat"'):
            continue
        files = entry["files"].strip()
        names = re.findall(r'"([^"]+)"', files)
        found = [f for n in names for f in (sorted(folder.glob(n)) if "*" in n else [folder / n])]
        yield entry, frames(camrig, found, scratch)


def noise(stack):
    """Deviations from the mean of the stack, in 1/n DN."""
    return (len(stack) * stack - stack.sum(axis=0)).ravel()


def distances(real, model, n):
    """Divergence, nats, and distance of two samples of deviations of n frames."""
    low, high = min(real.min(), model.min()), max(real.max(), model.max())
    cell = max(n, int(round(real.std() / 8)))
    p, q = (np.bincount((x - low) // cell, minlength=(high - low) // cell + 1) for x in (real, model))
    share = p / p.sum()
    other = (q + 0.5) / (q.sum() + 0.5 * len(q))
    used = share > 0
    divergence = (share[used] * np.log(share[used] / other[used])).sum()
    at = np.unique(np.concatenate([real, model]))
    below = [np.searchsorted(np.sort(x), at, side="right") / len(x) for x in (real, model)]
    return divergence, np.abs(below[0] - below[1]).max()


def plan(held_out, base):
    """The plan of as many frames in the same light."""
    _, gain, black, _, qe = base
    lines = ['format = "plan/1"']
    for i, (entry, stack) in enumerate(held_out):
        lines += ["[[stack]]", f'id = "s{i}"', f"role = {entry['role']}", f"frames = {len(stack)}",
                  "saturates = true  # where the measured light does"]
        lines += [f"{k} = {max(float(entry[k]), 1e-6) if k == 'exposure_s' else float(entry[k])}"
                  for k in ("exposure_s", "analog_gain", "temperature_c") if k in entry]
        if entry["role"] == '"flat"':
            electrons = max(stack.mean() - black, 0.0) / gain / float(entry["analog_gain"])
            watts = electrons * PLANCK_TIMES_LIGHT / (NM * 1e-9) / qe / float(entry["exposure_s"])
            lines += [f"light = {{ wavelength_nm = {NM}, irradiance_w_m2 = {watts / base_pitch(base) ** 2:e} }}"]
    return "\n".join(lines) + "\n"


def base_pitch(base):
    """Pixel pitch of the base model, m."""
    return float(re.search(r"^pitch_um = (\S+)", base[0].read_text(), re.M)[1]) * 1e-6


def plain(held_out, base, white):
    """Frames of Poisson's and a normal law."""
    _, gain, black, read, _ = base
    rng = np.random.default_rng(1)
    for entry, stack in held_out:
        k = gain * float(entry["analog_gain"])
        electrons = max(stack.mean() - black, 0.0) / k if entry["role"] == '"flat"' else 0.0
        signal = rng.poisson(electrons, stack.shape) + rng.normal(0.0, read, stack.shape)
        yield np.clip(np.rint(black + k * signal), 0, white).astype(np.int64)


def table(camrig, captures, folder, base):
    """A row of the table: divergence and distance of darks and of flats, for three models."""
    with tempfile.TemporaryDirectory() as scratch:
        whole = list(stacks(camrig, captures, scratch))
        # The second half of long stacks, every second of short ones, as the diagnosis divides them.
        held_out = [(e, s[len(s) // 2:][:MAX_FRAMES]) for e, s in whole if len(s) >= 4]
        held_out += [(e, s) for e, s in [w for w in whole if len(w[1]) in (2, 3)][1::2]]
        white = 2 ** int(re.search(r"^bits = (\d+)", base[0].read_text(), re.M)[1]) - 1
        held_out = [(e, s) for e, s in held_out if (s == white).mean() < MAX_SATURATED]
        plan_file = pathlib.Path(scratch) / "plan.toml"
        plan_file.write_text(plan(held_out, base))
        models = {"Poisson and normal": list(plain(held_out, base, white))}
        for name, camera in (("base", base[0]), ("improved", folder / "diagnosis" / "camera-improved.toml")):
            made = pathlib.Path(scratch) / name
            subprocess.run([camrig, "capture", "--camera", camera, "--plan", plan_file, "-o", made], check=True,
                           capture_output=True)
            models[name] = [s for _, s in stacks(camrig, made, scratch)]
        rows = []
        for name, model in models.items():
            figures = {'"dark"': [], '"flat"': []}
            for (entry, real), simulated in zip(held_out, model):
                figures[entry["role"]].append(distances(noise(real), noise(simulated), len(real)))
            mean = [x for f in figures.values() for x in ([f"{m:.4f}" for m in np.mean(f, axis=0)] if f else ["-", "-"])]
            rows.append(f"| {captures.name} | {name} | {' | '.join(mean)} |")
        return rows
