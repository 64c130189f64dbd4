#!/usr/bin/env python3
"""Bytes that a rig must survive: packets of the exchange that are damaged, cut, out of order or of unknown kinds, and noise.

    noise.py tcp://HOST:PORT     sends them, link after link; the rig must go on listening
"""
import json
import random
import socket
import sys

from client import VECTORS, crc32c


def sealed(body):
    return body + crc32c(body).to_bytes(4, "little")


def damaged(rng, packets):
    """A packet of the exchange with other bytes and a right CRC, or just bytes."""
    kind = rng.randrange(4)
    packet = bytearray(rng.choice(packets))
    if kind == 0:
        return bytes(rng.randrange(256) for _ in range(rng.randrange(60)))
    for _ in range(rng.randrange(1, 6)):
        # The session stays, so that what follows it is looked at.
        packet[rng.choice([0, 1] + list(range(4, len(packet) - 4)))] = rng.choice([0, 1, 127, 128, 255, rng.randrange(256)])
    if kind == 1:
        return bytes(packet)
    packet = packet[:-4] if kind == 2 else packet[: rng.randrange(8, len(packet) - 3)]
    return sealed(bytes(packet))


def main(address):
    host, port = address.removeprefix("tcp://").rsplit(":", 1)
    exchange = json.loads(VECTORS.read_text())["exchange"]
    packets = [bytes.fromhex(entry["packet"]) for entry in exchange if entry["from"] == "host"]
    rng = random.Random(1)
    for _ in range(150):
        link = socket.create_connection((host, int(port)), timeout=20)
        begin = rng.randrange(1, len(packets) + 1)
        sent = packets[:begin] + [damaged(rng, packets) for _ in range(rng.randrange(40))]
        try:
            for packet in sent:
                link.sendall(len(packet).to_bytes(4, "little") + packet)
            if rng.randrange(3) == 0:
                link.sendall(bytes(rng.randrange(256) for _ in range(50)))
            link.shutdown(socket.SHUT_WR)
            while link.recv(65536):
                pass
        except OSError:
            pass  # It has closed the link, as it may.
        link.close()
    print("the rig outlived 150 links of damaged packets")


main(sys.argv[1])
