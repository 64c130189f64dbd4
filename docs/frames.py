#!/usr/bin/env python3
"""Sends frames to camrig as camrig-frames/1: radiance, interleaved floats, of linear Rec. 709 or of bands.

    frames.py tcp://127.0.0.1:7500 | unix:PATH | -     three frames of a grey that gets brighter
"""
import socket
import struct
import sys


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def message(number, time_ns, width, height, payload, scale=0.0, flags=0, bands=None):
    """One frame; `bands` are the number of wavelengths, the first and their step, nm."""
    channels, first_nm, step_nm = bands or (3, 0.0, 0.0)
    head = bytearray(256)
    struct.pack_into("<8sIIQq", head, 0, b"CRFRAME1", 256, flags, number, time_ns)
    # f32, interleaved, radiance; wavelengths or primaries of Rec. 709; linear.
    struct.pack_into("<3I6H", head, 40, width, height, channels, 4, 1, 2, 0 if bands else 1, 0, 0)
    struct.pack_into("<QQQd", head, 64, 4 * channels * width, 0, len(payload), scale)
    struct.pack_into("<2d", head, 192, first_nm, step_nm)
    struct.pack_into("<I", head, 252, crc32c(head[:252]))
    return bytes(head) + payload


def end(number, time_ns):
    return message(number, time_ns, 0, 0, b"", flags=2)


def output(address):
    if address == "-":
        return sys.stdout.buffer.write
    if address.startswith("unix:"):
        link, place = socket.socket(socket.AF_UNIX), address[5:]
    else:
        link, (host, port) = socket.socket(), address[6:].split(":")
        place = (host, int(port))
    link.connect(place)
    return link.sendall


if __name__ == "__main__":
    send = output(sys.argv[1])
    width, height = 8, 6
    for number, value in enumerate([0.25, 0.5, 1.0]):
        pixels = struct.pack("<3f", value, value, value) * (width * height)
        send(message(number, number * 40_000_000, width, height, pixels, scale=100.0))
    send(end(3, 120_000_000))
