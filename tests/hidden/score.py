#!/usr/bin/env python3
"""Hides effects in many sets, runs `camrig diagnose` on each, and fills the table of docs/diagnosis.md.

    score.py --camrig target/release/camrig --draws 20 --results scores.jsonl -o docs/diagnosis.md

Seeds come from the base seed (default: drawn by the operating system and printed). Sets live in a temporary folder
until they are judged; what is hidden never touches the disk. Each result is a line of the results file, so a run
that was interrupted goes on where it stopped. Run again with `--only-report` for the table alone.
"""
import argparse
import concurrent.futures
import json
import os
import pathlib
import secrets
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np

import generate
import tally
from camera import stream


def jobs(a):
    """All sets to be made: key, kinds, multiples of the limit. Random choices depend on seed and key alone."""
    kinds = a.kinds or list(generate.CATALOGUED)
    singles = [k for k in kinds if k in generate.CATALOGUED]
    for d in range(a.draws):
        for kind in singles:
            for times in a.times:
                yield f"single/{kind}/{times:g}/{d}", [kind], [times]
    for d in range(a.null):
        yield f"null/{d}", [], []
    for group, size, number in (("pair", 2, a.pairs), ("triple", 3, a.triples)):
        for d in range(number):
            rng = stream(a.seed, group, d)
            chosen = [str(k) for k in rng.choice(singles, size, replace=False)] if len(singles) >= size else []
            if chosen:
                yield f"{group}/{d}", chosen, np.exp(rng.uniform(np.log(3), np.log(30), size)).tolist()
    for d in range(a.leave_out):
        for kind in singles:
            yield f"without/{kind}/{d}", [kind], [10.0]
    strange = [k for k in a.kinds or generate.OUTSIDE if k in generate.OUTSIDE]
    for d in range(a.outside):
        for kind in strange:
            rng = stream(a.seed, kind, d)
            yield f"outside/{kind}/{d}", [kind], [float(np.exp(rng.uniform(np.log(10), np.log(30))))]


def judge(key, kinds, times, seed, a):
    """Makes the set, runs the program, and returns the line of the results file."""
    draw = int(stream(seed, key).integers(2**32))
    colour = any(generate.KINDS[k].needs_cfa for k in kinds) or (key.startswith("null") and draw % 4 == 0)
    cfa = a.cfa or ("GRBG" if colour else "mono")
    world, hidden, sensor = generate.build(
        draw, [(k, None) for k in kinds], times, generate.SIZES[a.design], a.design, cfa)
    truth = generate.truth(draw, hidden)
    amounts = ",".join(f"{e.kind}={e.amount!r}" for e in hidden) or "none"
    line = {"key": key, "truth": truth,
            "repeat": f"generate.py SET --draw {draw} --design {a.design} --cfa {cfa} --effects {amounts}"}
    with tempfile.TemporaryDirectory(dir=a.folder, prefix="camrig-hidden-") as folder:
        out = f"{folder}/set"
        generate.write(out, world, sensor)
        command = [a.camrig, "diagnose", f"{out}/camera.toml", out, "-o", f"{folder}/result", "--json"]
        if key.startswith("without"):
            command += [word for k in kinds for name in tally.ALSO.get(k, {k}) for word in ("--without", name)]
        start = time.monotonic()
        try:
            run = subprocess.run(command, capture_output=True, text=True, timeout=a.timeout)
        except subprocess.TimeoutExpired:
            return line | {"failure": f"no answer within {a.timeout} s"}
        line["seconds"] = time.monotonic() - start
        if run.returncode not in (0, 1):  # 0 and 1 are answers; 2 is bad input, which these sets are not
            return line | {"failure": f"exit status {run.returncode}: {run.stderr.strip()[-600:]}"}
        try:
            with open(f"{folder}/result/diagnosis.json") as f:
                line["answer"] = tally.essence(json.load(f))
        except (OSError, ValueError, KeyError, TypeError) as e:
            return line | {"failure": f"diagnosis.json: {e!r}; {run.stderr.strip()[-600:]}"}
    return line


def read(path):
    """Base seed and results so far; a line cut short by an interruption is dropped."""
    seed, lines = None, {}
    for text in path.read_text().splitlines() if path.exists() else []:
        try:
            line = json.loads(text)
        except ValueError:
            continue
        seed = line.get("base_seed", seed)
        if "key" in line:
            lines[line["key"]] = line
    return seed, lines


def arguments():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--camrig", default="target/release/camrig", help="the program")
    p.add_argument("--draws", type=int, default=20, help="draws of each effect and amount")
    p.add_argument("--times", type=lambda s: [float(x) for x in s.split(",")], default=[1, 3, 10, 30],
                   help="amounts in detection limits (default 1,3,10,30)")
    p.add_argument("--kinds", type=lambda s: s.split(","), help="only these")
    p.add_argument("--null", type=int, default=300, help="sets with nothing hidden")
    p.add_argument("--pairs", type=int, default=60)
    p.add_argument("--triples", type=int, default=40)
    p.add_argument("--outside", type=int, default=10, help="draws of each effect outside the catalogue")
    p.add_argument("--leave-out", type=int, default=3, help="draws of each effect at 10 limits, its own entry left out")
    p.add_argument("--cfa", choices=["GRBG"], help="every set under this filter array (default: those that need one)")
    p.add_argument("--design", choices=generate.SIZES, default="small")
    p.add_argument("--jobs", type=int, default=2)
    p.add_argument("--timeout", type=float, default=600, help="seconds per set")
    p.add_argument("--seed", type=int, help="base seed; default: from the operating system")
    p.add_argument("--results", type=pathlib.Path, default=pathlib.Path("hidden-scores.jsonl"))
    p.add_argument("--folder", help="where sets are made (default: the system's temporary folder)")
    p.add_argument("--only-report", action="store_true", help="no new sets")
    p.add_argument("-o", "--output", type=pathlib.Path, help="Markdown file whose marked part is replaced")
    a = p.parse_args()
    unknown = set(a.kinds or []) - set(generate.KINDS)
    if unknown:
        p.error(f"unknown kinds {', '.join(sorted(unknown))}; known: {', '.join(generate.KINDS)}")
    return a


def main():
    a = arguments()
    stored, lines = read(a.results)
    if stored is not None and a.seed not in (None, stored):
        sys.exit(f"{a.results} holds results of base seed {stored}: give another --results")
    a.seed = stored if stored is not None else secrets.randbits(32) if a.seed is None else a.seed
    print(f"base seed {a.seed}, {len(lines)} results in {a.results}", flush=True)
    if not a.only_report:
        if stored is None:
            a.results.write_text(json.dumps({"base_seed": a.seed, "design": a.design}) + "\n")
        wanted = [j for j in jobs(a) if "answer" not in lines.get(j[0], {})]  # runs without an answer again
        stream(a.seed, "order").shuffle(wanted)  # so that a part of the run says something of all
        for threads in ("OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"):  # the jobs fill the cores
            os.environ.setdefault(threads, "1")
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
        with concurrent.futures.ProcessPoolExecutor(a.jobs) as pool, a.results.open("a") as out:
            running = [pool.submit(judge, *job, a.seed, a) for job in wanted]
            try:
                for done, future in enumerate(concurrent.futures.as_completed(running), 1):
                    line = future.result()
                    lines[line["key"]] = line
                    out.write(json.dumps(line) + "\n")
                    out.flush()
                    print(f"[{done}/{len(wanted)}] {tally.one_line(line)}", flush=True)
                    if done % 50 == 0:
                        print(tally.summary(list(lines.values())), flush=True)
            except BaseException:  # interrupted: finish the sets in hand, which removes their files
                pool.shutdown(cancel_futures=True)
                raise
    ordered = [lines[k] for k in sorted(lines)]
    print(tally.summary(ordered))
    if a.output:
        tally.place(a.output, tally.report(ordered, a.seed))
        print(f"written: {a.output}")
    return 1 if any("failure" in line for line in ordered) else 0


if __name__ == "__main__":
    sys.exit(main())
