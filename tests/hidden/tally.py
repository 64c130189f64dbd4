"""Figures from the results of score.py: hidden effects against the answers."""
import collections

import numpy as np

import generate

# Other names that count as right for a hidden effect.
ALSO = {"dsnu": {"dark-current"}}
PASSES = 1.27   # gap of a model that agrees, 99.5 %
NO_ANSWER = {"verdict": None, "gap_after": np.inf, "steps": [], "ambiguous": [], "unexplained": []}
BEGIN, END = "<!-- score: begin -->", "<!-- score: end -->"


def essence(d):
    """The part of a diagnosis.json that is kept."""
    # Particles are left out of the frames: a finding names them, no step of the search.
    hits = [{"effect": "particle-hits", "status": "confirmed", "parameters": {}}
            for e in d.get("evidence", []) if e["effect"] == "particle-hits" and e["status"] == "named"]
    return {
        "verdict": d["verdict"], "gap_before": d["gap_before"], "gap_after": d["gap_after"],
        "steps": [{"effect": s["effect"], "status": s["status"], "parameters": {
            k: [p["value"], p.get("std_error")] for k, p in s.get("parameters", {}).items()}} for s in d["steps"]] + hits,
        "ambiguous": [c["effects"] for c in d.get("ambiguous", [])],
        "unexplained": [{k: u.get(k) for k in ("statistic", "where", "z", "description")} for u in d["unexplained"][:3]]}


class Case:
    """One result: hidden kinds, names given, and whether they are right. A run without an answer named nothing."""

    def __init__(self, line):
        self.group, _, rest = line["key"].partition("/")
        self.line, self.answered, self.answer = line, "answer" in line, line.get("answer", NO_ANSWER)
        self.effects = line["truth"]["effects"]
        self.hidden = {e["kind"] for e in self.effects}
        self.times = self.effects[0]["times"] if self.effects else 0
        if self.group == "single":
            self.times = float(rest.split("/")[1])
        steps = self.answer["steps"]
        self.names = [n for s in steps for n in self.meant(s)]
        self.confirmed = [n for s in steps if s["status"] == "confirmed" for n in self.meant(s)]
        self.tentative = [n for n in self.names if n not in self.confirmed]
        self.in_class = any(self.own(e) in self.hidden for c in self.answer["ambiguous"] for e in c)

    def own(self, name):
        """The hidden kind that `name` stands for, or the name."""
        return next((k for k in self.hidden if name in ALSO.get(k, ())), name)

    def meant(self, step):
        """The hidden kinds that a step stands for: where those are several, the ones whose parameter it gives."""
        name = step["effect"]
        meant = [e for e in self.effects if e["kind"] == name or name in ALSO.get(e["kind"], ())]
        given = [e["kind"] for e in meant if e["parameter"] in step["parameters"]]
        return (given if len(meant) > 1 else []) or [self.own(name)]

    def described(self):
        """Whether the first unexplained statistic mentions the hidden property."""
        top = (self.answer["unexplained"] or [{}])[0]
        said = " ".join(str(top.get(k, "")) for k in ("statistic", "where", "description")).lower()
        return any(word in said for k in self.hidden for word in generate.KINDS[k].says)

    def parameters(self):
        """(kind, key, value, standard error, truth, Cramer-Rao sd or None) of every right name."""
        for e in self.effects:
            for step in self.answer["steps"]:
                if e["kind"] in self.meant(step):
                    for key, (value, error) in step["parameters"].items():
                        if key in e["parameters"] and error:
                            true = e["parameters"][key]
                            yield e["kind"], key, value, error, true, e["sd"] if key == e["parameter"] else None


def share(right, of):
    """`38/40 = 95 % (83-99)`: with the 95 % Wilson interval."""
    if not of:
        return "-"
    z2, p = 1.96**2, right / of
    middle = (p + z2 / (2 * of)) / (1 + z2 / of)
    half = np.sqrt(z2 * (p * (1 - p) / of + z2 / (4 * of * of))) / (1 + z2 / of)
    return f"{right}/{of} = {100 * p:.1f} % ({100 * max(middle - half, 0):.0f}-{100 * min(middle + half, 1):.0f})"


def over(cases, test):
    return share(sum(bool(test(c)) for c in cases), len(cases))


def own_limit(by_times):
    """Multiple of the analytic limit at which half are named, between the amounts tried (logarithmically)."""
    points = sorted((t, np.mean([c.hidden <= set(c.names) for c in cases])) for t, cases in by_times.items())
    if points[0][1] >= 0.5:
        return f"<= {points[0][0]:g}", points[0][0]
    for (t0, r0), (t1, r1) in zip(points, points[1:]):
        if r1 >= 0.5:
            t = np.exp(np.interp(0.5, [r0, r1], np.log([t0, t1])))
            return f"{t:.1f}", t
    return f"> {points[-1][0]:g}", np.inf


def figures(cases):
    """Rows of the goal table: figure, measured, goal."""
    of = lambda *groups: [c for c in cases if c.group in groups]
    null, single, outside = of("null"), of("single"), of("outside")
    catalogued = of("single", "pair", "triple")
    found = lambda c: c.hidden <= set(c.confirmed)
    confirmed = [(n, c) for c in cases if c.group != "without" for n in c.confirmed]
    rows = [("false alarms where nothing is hidden (not `agrees`)", over(null, lambda c: c.answer["verdict"] != "agrees"),
             "1 %"),
            ("confirmed names where nothing is hidden", over(null, lambda c: c.confirmed), "1 %")]
    for t, goal in ((1, "-"), (3, "95 %"), (10, "99 %"), (30, "-")):
        at = [c for c in single if c.times == t]
        rows.append((f"named at {t} x the limit, confirmed or tentative", over(at, lambda c: c.hidden <= set(c.names)), "-"))
        rows.append((f"named and confirmed at {t} x the limit", over(at, found), goal))
    right = sum(n in c.hidden for n, c in confirmed)
    rows.append(("confirmed names that are right", share(right, len(confirmed)), "99 %"))
    limits = [own_limit(by)[1] for by in by_kind(single).values()]
    if limits:
        rows.append(("own detection limit (half named) over the analytic one, median and worst effect",
                     f"{np.median(limits):.1f}, {max(limits):.1f}", "1.5"))
    for group, goal in (("pair", "90 %"), ("triple", "80 %")):
        rows.append((f"{group}: exact set", over(of(group), lambda c: set(c.names) == c.hidden), goal))
    several = of("pair", "triple")
    rows.append(("pair or triple: first name right", over(several, lambda c: c.names and c.names[0] in c.hidden), "98 %"))
    rows.append(("outside the catalogue: no confirmed name", over(outside, lambda c: c.answered and not c.confirmed), "95 %"))
    rows.append(("outside: not called `agrees`", over(outside, lambda c: c.answer["verdict"] not in (None, "agrees")), "-"))
    rows.append(("outside: right property on top", over(outside, Case.described), "90 %"))
    rows.append(("outside: draws with wrong tentative names", over(outside, lambda c: c.tentative), "< 10 %"))
    rows.append(("own entry left out: no confirmed name", over(of("without"), lambda c: c.answered and not c.confirmed), "-"))
    rows.append((f"held-out gap at most {PASSES} after repair", over(catalogued, lambda c: c.answer["gap_after"] <= PASSES),
                 "95 %"))
    known = [p for c in catalogued for p in c.parameters()]
    bounded = [(value - true) / sd for _, _, value, _, true, sd in known if sd]
    if bounded:
        # median absolute deviation over that of a normal variable, which a few outliers hardly change
        rows.append(("parameter error over the Cramér-Rao bound (1.48 x median magnitude)",
                     f"{1.4826 * np.median(np.abs(bounded)):.2f} over {len(bounded)}", "1.5"))
    within = sum(abs(value - true) <= 1.645 * error for _, _, value, error, true, _ in known)
    rows.append(("coverage of 90 % intervals", share(within, len(known)), "85-95 %"))
    seconds = [c.line["seconds"] for c in cases if c.answered]
    if seconds:
        rows.append(("seconds per set, median and longest", f"{np.median(seconds):.1f}, {max(seconds):.1f}", "-"))
    return rows


def by_kind(single):
    """kind -> times -> cases."""
    out = collections.defaultdict(lambda: collections.defaultdict(list))
    for c in single:
        out[next(iter(c.hidden))][c.times].append(c)
    return out


def table(head, rows):
    return "\n".join(["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
                     + ["| " + " | ".join(map(str, r)) + " |" for r in rows])


def summary(lines):
    """Goal table as plain text, with the failures."""
    failures = [f"  {line['key']}: {line['failure']}\n    {line['repeat']}" for line in lines if "failure" in line]
    text = "\n".join(f"  {name:80} {value:28} goal {goal}" for name, value, goal in figures([Case(line) for line in lines]))
    return "\n".join([f"{len(lines)} sets, {len(failures)} failed runs", *failures[-10:], text])


def one_line(line):
    """A result in one line."""
    if "failure" in line:
        return f"{line['key']}: FAILED {line['failure'][:200]}"
    c = Case(line)
    names = [n + ("" if n in c.confirmed else "?") for n in c.names]
    wrong = "" if c.group in ("outside", "without") or set(c.names) == c.hidden else "  <-"
    return f"{line['key']}: {c.answer['verdict']}, gap {c.answer['gap_after']:.2f}, {' '.join(names) or '-'}{wrong}"


def report(lines, seed):
    """The Markdown part."""
    cases = [Case(line) for line in lines]
    failed = [line for line in lines if "failure" in line]
    single = [c for c in cases if c.group == "single"]
    amounts = sorted({c.times for c in single})
    curve, parameters = [], collections.defaultdict(list)
    for kind, by_times in sorted(by_kind(single).items()):
        shares = [np.mean([kind in c.confirmed for c in by_times[t]]) if by_times[t] else np.nan for t in amounts]
        classes = sum(c.in_class for at in by_times.values() for c in at)
        by_times = {t: v for t, v in by_times.items() if v}
        curve.append([kind, *("-" if np.isnan(s) else f"{100 * s:.0f} %" for s in shares), own_limit(by_times)[0], classes or ""])
    for c in single:
        for kind, key, value, error, true, sd in c.parameters():
            relative = abs(value / true - 1) if true else np.nan
            parameters[kind, key].append(((value - true) / error, (value - true) / sd if sd else np.nan, relative))
    known = [[kind, key, len(p), "-" if np.isnan(r := np.median([r for _, _, r in p])) else f"{100 * r:.1f} %",
              f"{100 * np.mean([abs(z) <= 1.645 for z, _, _ in p]):.0f} %",
              "" if np.isnan(p[0][1]) else f"{1.4826 * np.median(np.abs([b for _, b, _ in p])):.2f}"]
             for (kind, key), p in sorted(parameters.items())]
    relatives = collections.defaultdict(collections.Counter)
    for c in cases:
        if c.group == "without":
            named = " + ".join(n + ("" if n in c.confirmed else " (tentative)") for n in c.names)
            relatives[next(iter(c.hidden))][named or c.answer["verdict"]] += 1
    relatives = [[kind, "; ".join(f"{named}: {n}" for named, n in said.most_common())]
                 for kind, said in sorted(relatives.items())]
    confusion = collections.Counter()
    for c in cases:
        if c.group in ("single", "outside", "null"):
            for n in c.names:
                if n not in c.hidden:
                    status = "confirmed" if n in c.confirmed else "tentative"
                    beside = "beside it" if c.hidden & set(c.names) else "instead"
                    confusion[next(iter(c.hidden), "(nothing)"), n, status, beside if c.hidden else ""] += 1
            if c.group == "single" and not c.names and c.times >= 3:
                confusion[next(iter(c.hidden)), "(no name)", f"at {c.times:g} x", ""] += 1
    parts = [
        f"{len(lines)} hidden sets, base seed {seed}; {len(failed)} runs without an answer (they count as wrong). Shares with 95 % intervals.",
        table(["figure", "measured", "goal"], figures(cases)),
        "### Confirmed by amount\n\nIn multiples of the analytic 5-sigma limit; the amount at which half are named; draws "
        "in which an ambiguous class held the effect.",
        table(["effect", *(f"{t:g} x" for t in amounts), "half named at", "in class"], curve),
        "### Parameters", table(["effect", "parameter", "draws", "median error", "in 90 % interval", "error / bound"], known),
        "### Wrong or missing names",
        table(["hidden", "named", "status", "", "draws"], [[*k, n] for k, n in confusion.most_common()]),
        "### Own entry left out of the catalogue\n\nAt 10 x the limit: what is said of an effect that has no name.",
        table(["hidden", "said"], relatives)]
    if failed:
        parts += ["### Runs without an answer", table(["set", "what happened"], [
            [line["key"], line["failure"].replace("\n", " ").replace("|", "/")[:200]] for line in failed])]
    return "\n\n".join(parts) + "\n"


def place(path, text):
    """Replaces the marked part of a document, or starts one."""
    old = path.read_text() if path.exists() else f"# Diagnosis: hidden data\n\n{BEGIN}\n{END}\n"
    before, mark, rest = old.partition(BEGIN)
    inside, end, after = rest.partition(END)
    if not mark or not end:
        raise SystemExit(f"{path} has no part between {BEGIN} and {END}")
    path.write_text(f"{before}{BEGIN}\n{text}{END}{after}")
