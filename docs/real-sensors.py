#!/usr/bin/env python3
"""Diagnoses real sensors, starting from base models measured by `camrig measure emva`: the tables of docs/diagnosis.md.

    real-sensors.py target/release/camrig OUT CAPTURES...

OUT gets a camera file and a diagnosis for each capture set. Nothing is tuned: gain, read noise, PRNU and black level are those
of the measurement, everything else is omitted. If rounding hides the read noise (8 bits), its upper limit is used, with a note.
A set that cannot be measured this way (darks alone) is diagnosed from the camera file in its folder.

The second table is the distance of the models' noise from that of the held-out frames: see `noise.py` in this folder, which
needs numpy. Without numpy it is skipped, with a note.
"""
import json
import pathlib
import re
import shutil
import subprocess
import sys

try:
    import noise
except ModuleNotFoundError:
    noise = None

CAMERA = """name = "{name}"

[lens]
kind = "diffraction-limited"
f_number = 2.8
focal_length_mm = 8.0

[sensor]
width = {width}
height = {height}
pitch_um = 5.0
fill_factor = 1.0
cfa = "mono"
qe = "qe.csv"
conversion_gain_uv_per_e = 50.0
full_well_e = {full_well}
bits = {bits}
black_level_dn = {black}
temperature_c = 25.0
seed = 1

[sensor.noise]
read_e = {read}
dark_current_e_per_s = 0.0
dsnu_e_per_s = 0.0
prnu = {prnu}
row_fpn_e = 0.0
"""


def base_model(run, captures, folder):
    """Writes the base model of a capture set into a folder; gives its path, gain, black level, read noise and quantum
    efficiency; `None` where there is none."""
    camera = folder / "camera.toml"
    told = run("measure", "emva", str(captures), "--json")
    beside = captures / "camera.toml"
    if told.returncode and beside.exists():
        print(f"    {captures.name}: {told.stderr.strip().splitlines()[0]}; the camera file beside the set is taken")
        for table in captures.glob("*.csv"):
            shutil.copy(table, folder)
        text = beside.read_text()
        camera.write_text(text)
        of = lambda key: float(re.search(rf"^{key} = (\S+)", text, re.M)[1])
        curve = [line.split(",") for line in (folder / "qe.csv").read_text().splitlines()[1:]]
        qe = min((abs(float(nm) - 550), float(q)) for nm, q in curve)[1]
        return camera, (2 ** of("bits") - 1) / of("full_well_e"), of("black_level_dn"), of("read_e"), qe
    if told.returncode:
        return None
    m = json.loads(told.stdout)
    sensor = {}  # the few keys wanted, whatever else the manifest has
    for line in (captures / "captures.toml").read_text().splitlines():
        key, _, value = line.partition(" = ")
        sensor.setdefault(key, value)
    bits = int(sensor["bits"])
    value = lambda name: (m[name] or {}).get("value")
    gain = value("overall_system_gain")
    read = value("temporal_dark_noise_e")
    if read is None:  # below 0.24 DN² the quantisation decides: EMVA 1288
        read = 0.24**0.5 / gain
        print(f"    {captures.name}: rounding hides the read noise; its upper limit is taken, {read:.2f} electrons")
    black = next(iter(m["channels"].values()))["darks"][0]["mean_dn"]
    # DN per electron is full scale over full well.
    camera.write_text(CAMERA.format(
        name=captures.name, width=sensor["width"], height=sensor["height"], bits=bits, full_well=(2**bits - 1) / gain,
        black=black, read=read, prnu=(value("prnu_1288_percent") or 0) / 100))
    qe = value("quantum_efficiency") or 0.5  # where light was not measured it takes no part
    (folder / "qe.csv").write_text("wavelength_nm,qe\n" + "".join(f"{nm},{qe}\n" for nm in range(300, 1101, 20)))
    return camera, gain, black, read, qe


def main(camrig, out, *sets):
    run = lambda *words: subprocess.run([camrig, *words], capture_output=True, text=True)
    distances = []
    for captures in map(pathlib.Path, sets):
        folder = pathlib.Path(out) / captures.name
        folder.mkdir(parents=True)
        base = base_model(run, captures, folder)
        if base is None:
            print(f"    {captures.name}: no base model can be measured, and none lies beside it; left out")
            continue
        camera = base[0]
        told = run("diagnose", str(camera), str(captures), "-o", str(folder / "diagnosis"), "--json")
        if told.returncode not in (0, 1):
            sys.exit(told.stderr)
        d = json.loads(told.stdout)
        names = ", ".join(s["effect"] + ("" if s["status"] == "confirmed" else " (tentative)") for s in d["steps"])
        print(f"| {captures.name} | {d['gap_before']:.0f} | {d['gap_after']:.1f} | {names} |", flush=True)
        for left in d["unexplained"][:5]:
            print("    left:", left["description"])
        if noise:
            distances += noise.table(camrig, captures, folder, base)
    print("\n".join(distances) if noise else "numpy is missing: no distances between noises")


main(*sys.argv[1:])
