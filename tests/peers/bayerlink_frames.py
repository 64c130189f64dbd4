"""The frames of a bayerlink stream, by the protocol's own reference implementation.

Arguments: the stream, width and height of its display. Prints what each header says, its samples, and whether the
reference packs the same frame into the same bytes.
"""

import json
import sys

import numpy as np
from bayerlink import protocol

path, width, height = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
displays = np.fromfile(path, np.uint8).reshape(-1, height, 3 * width)
frames = []
for display in displays:
    header = protocol.Header.unpack(display[0].tobytes()[: protocol.HEADER_BYTES])
    protocol.check_geometry(header.width, header.height, (width, height), header.bits)
    lines = display[1 : 1 + header.height, : header.line_bytes]
    samples = protocol.unpack_samples(lines, header.bits)
    own = np.zeros_like(display)
    packed = header.pack()
    own[0, : len(packed)] = np.frombuffer(packed, np.uint8)
    own[1 : 1 + header.height, : header.line_bytes] = protocol.pack_samples(samples, header.bits)
    frames.append(
        {
            "fourcc": header.fourcc,
            "frame_seq": header.frame_seq,
            "samples": samples.ravel().tolist(),
            "equal": bool((own == display).all()),
        }
    )
print(json.dumps(frames))
