"""A loop of exposure against V4L2 alone, with Python's standard library.

exposure.py DEVICE BLACK: takes frames of 16-bit samples, and sets the exposure time so that their mean above BLACK is
TARGET. After each change it waits for the frames that were under way. Prints how many frames after a step of the light
the mean is right again.
"""

import array
import fcntl
import mmap
import os
import struct
import sys

WIDTH, HEIGHT = 200, 40
TARGET = 300 * 64  # of 10 bits in 16
CLOSE = 0.03
# Frames from a write to the first that shows it: the one being read out, and the sensor's delay of two.
UNDER_WAY = 3
FRAMES = 70
CAPTURE, MEMORY_MAP = 1, 1
EXPOSURE_TIME_ABSOLUTE = 0x009A0902  # units of 100 us
SET_FORMAT, REQUEST, QUERY = 0xC0D05605, 0xC0145608, 0xC0585609
QUEUE, DEQUEUE, STREAM_ON, SET_CONTROL = 0xC058560F, 0xC0585611, 0x40045612, 0xC008561C


def main():
    device, black = os.open(sys.argv[1], os.O_RDWR), 64 * float(sys.argv[2])
    form = struct.pack("<I4xIII", CAPTURE, WIDTH, HEIGHT, int.from_bytes(b"RG16", "little"))
    fcntl.ioctl(device, SET_FORMAT, bytearray(form.ljust(208, b"\0")))
    buffers = []
    fcntl.ioctl(device, REQUEST, bytearray(struct.pack("<III8x", 2, CAPTURE, MEMORY_MAP)))

    def buffer(index):
        return bytearray(struct.pack("<II52xI24x", index, CAPTURE, MEMORY_MAP))

    for index in range(2):
        asked = buffer(index)
        fcntl.ioctl(device, QUERY, asked)
        offset, _, length = struct.unpack_from("<III", asked, 64)
        buffers.append(mmap.mmap(device, length, offset=offset))
        fcntl.ioctl(device, QUEUE, buffer(index))

    exposure = 100
    set_exposure = lambda value: fcntl.ioctl(device, SET_CONTROL, bytearray(struct.pack("<Ii", EXPOSURE_TIME_ABSOLUTE, value)))
    set_exposure(exposure)
    fcntl.ioctl(device, STREAM_ON, struct.pack("<I", CAPTURE))
    settled, step, wait = False, None, UNDER_WAY
    for frame in range(FRAMES):
        taken = buffer(0)
        fcntl.ioctl(device, DEQUEUE, taken)
        index = struct.unpack_from("<I", taken)[0]
        samples = array.array("H", buffers[index][: 2 * WIDTH * HEIGHT])
        fcntl.ioctl(device, QUEUE, buffer(index))
        ratio = (sum(samples) / len(samples) - black) / TARGET
        is_right = abs(ratio - 1) < CLOSE
        print(f"frame {frame}: {ratio:.3f} of the target at {exposure / 10} ms", flush=True)
        if is_right and step is not None:
            print(f"right {frame - step} frames after the step")
            return
        if settled and not is_right:
            settled, step = False, frame
        settled |= is_right
        wait -= 1
        if wait <= 0 and not is_right:
            exposure = max(1, round(exposure / max(ratio, 0.05)))
            set_exposure(exposure)
            wait = UNDER_WAY + 1


main()
