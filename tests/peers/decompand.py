"""Receivers of companded frames, as published: what each makes of the codes, against the linear frame itself.

    python3 decompand.py CURVE.json COMPANDED.npy LINEAR.npy

CURVE.json: {"knees": [[linear, code], ...] from (0, 0) on, "bits": of a code, "linear_bits": .., "rounding": "floor" or
"nearest"}. Prints a line per receiver, and ends with status 1 where one is off by more than the curve allows.
"""
import ast
import bisect
import json
import struct
import sys


def samples(path):
    """The samples of an NPY file of unsigned integers in C order."""
    data = open(path, "rb").read()
    length = struct.unpack_from("<H", data, 8)[0]
    header = ast.literal_eval(data[10:10 + length].decode())
    kind = {"<u2": "H", "<u4": "I"}[header["descr"]]
    body = data[10 + length:]
    return struct.unpack(f"<{len(body) // struct.calcsize(kind)}{kind}", body)


curve = json.load(open(sys.argv[1]))
knees = [(0, 0)] + [tuple(knee) for knee in curve["knees"]]
codes_of_knees = [y for _, y in knees]
NEAREST = curve["rounding"] == "nearest"


def segment(code):
    i = min(bisect.bisect_right(codes_of_knees, code), len(knees) - 1)
    (x0, y0), (x1, y1) = knees[i - 1], knees[i]
    return x0, y0, x1 - x0, y1 - y0


def segments(code):
    """Integers of automotive ISPs: the lowest linear number of a code of a curve that rounds down."""
    x0, y0, dx, dy = segment(code)
    return x0 - (-(code - y0) * dx // dy)


def knee_list(code):
    """A list of knees with straight lines between them, in floating point."""
    x0, y0, dx, dy = segment(code)
    return x0 + (code - y0) * dx / dy


# libcamera's table for Raspberry Pi's ISP: 65 nodes, every 1024 of the code of 16 bits, straight lines between them;
# numbers of 16 bits.
SHIFT = 16 - curve["bits"]
TOP = (1 << 16) - 1
TO_16 = 2.0 ** (16 - curve["linear_bits"])
NODES = [min(knee_list(node * 1024 / (1 << SHIFT)) * TO_16, TOP) for node in range(65)]


def table(code):
    node, part = divmod(code << SHIFT, 1024)
    return (NODES[node] + (NODES[node + 1] - NODES[node]) * part / 1024) / TO_16


def step(code):
    _, _, dx, dy = segment(code)
    return dx / dy


codes, linear = samples(sys.argv[2]), samples(sys.argv[3])
assert len(codes) == len(linear)
last = codes_of_knees[-1]
used = [(code, x) for code, x in zip(codes, linear) if code < min(last, (1 << curve["bits"]) - 1)]
failed = len(set(codes)) < 200
print(f"{len(set(codes))} codes, {min(linear)} to {max(linear)} linear DN")
receivers = {"segments": segments, "knees": knee_list}
if all(y % 64 == 0 for y in codes_of_knees):
    receivers["table"] = table
for name, receiver in receivers.items():
    # A code stands for a step of linear numbers from the number given on, or around it.
    off = [(x - receiver(code)) / step(code) for code, x in used]
    low, high = (-0.5, 0.5) if NEAREST else (0.0, 1.0)
    # Of integers, and of a table that ends at a number of 16 bits.
    slack = {"table": 1 / TO_16}.get(name, 1)
    wrong = [(code, x) for code, x in used
             if not low * step(code) - slack <= x - receiver(code) <= high * step(code) + slack]
    print(f"{name}: {min(off):.3f} to {max(off):.3f} steps, {len(wrong)} of {len(used)} wrong, {wrong[:1]}")
    failed |= bool(wrong)
sys.exit(failed)
