"""Public GigE Vision clients against a camera at ADDRESS, each a run of this program: frames as
SHA-256 of their bytes in `frames`, one line each, in the order of the sensor.

python3 clients.py aravis|refused|telegenic|viva|genapi ADDRESS frames
"""

import hashlib
import sys
import time

FORMAT = "BayerRG12p"
WORDS = "BayerRG12"
WAIT_S = 5.0


def consecutive(found, what):
    """Frames that follow one another, by their place among those of `camrig expose`."""
    expected = range(found[0], found[0] + len(found))
    assert found == list(expected), f"{what}: frames {found}"
    print(f"{what}: {len(found)} frames from frame {found[0]} on are those of camrig expose")


def sha(data):
    return hashlib.sha256(bytes(data)).hexdigest()


def aravis_camera(address):
    import gi

    gi.require_version("Aravis", "0.8")
    from gi.repository import Aravis

    camera = Aravis.Camera.new(address)
    camera.set_pixel_format_from_string(FORMAT)
    return Aravis, camera


def aravis_frames(Aravis, camera, count, trigger=False):
    """Buffers of an acquisition, and how many packets were asked for again."""
    stream = camera.create_stream(None, None)
    stream.props.socket_buffer = Aravis.GvStreamSocketBuffer.FIXED
    stream.props.socket_buffer_size = 4 << 20
    for _ in range(10):
        stream.push_buffer(Aravis.Buffer.new_allocate(camera.get_payload()))
    camera.start_acquisition()
    taken = []
    for _ in range(count):
        if trigger:
            began = time.time()
            camera.software_trigger()
        buffer = stream.timeout_pop_buffer(int(WAIT_S * 1e6))
        assert buffer is not None, "no frame"
        if trigger:
            print(f"Aravis: software trigger to frame {1e3 * (time.time() - began):.0f} ms")
        assert buffer.get_status() == Aravis.BufferStatus.SUCCESS, buffer.get_status()
        taken.append((buffer.get_frame_id(), sha(buffer.get_data())))
        stream.push_buffer(buffer)
    camera.stop_acquisition()
    return taken, stream.get_info_uint64_by_name("n_resent_packets")


def aravis(address, expected):
    Aravis, camera = aravis_camera(address)
    camera.set_frame_rate(30.0)
    camera.gv_auto_packet_size()
    frames, _ = aravis_frames(Aravis, camera, 20)
    consecutive([expected.index(bytes_) for _, bytes_ in frames], "Aravis")
    device = camera.get_device()
    device.set_float_feature_value("FaultPacketLoss", 1.0)
    camera.gv_set_packet_size(1500)
    frames, repeated = aravis_frames(Aravis, camera, 100)
    numbers = [number for number, _ in frames]
    assert numbers == list(range(numbers[0], numbers[0] + 100)), numbers
    assert repeated > 100, repeated
    print(f"Aravis: with 1 % of the packets lost, 100 of 100 frames whole, {repeated} repeated")
    device.set_float_feature_value("FaultPacketLoss", 0.0)
    camera.set_string("TriggerMode", "On")
    frames, _ = aravis_frames(Aravis, camera, 2, trigger=True)
    assert frames[1][0] == frames[0][0] + 1, frames


def refused(address, _):
    """Aravis holds the camera; telegenic, in another process, is told so."""
    import subprocess

    _aravis, camera = aravis_camera(address)
    tried = subprocess.run([sys.argv[4], __file__, "second", address], capture_output=True, text=True)
    assert "held by another" in tried.stdout, tried.stdout + tried.stderr
    print(f"a second controller: {tried.stdout.strip()}")
    del camera


def second(address):
    import telegenic

    try:
        telegenic.Camera(address).connect()
    except telegenic.CameraError as error:
        print(error)


def telegenic(address, expected):
    import telegenic

    assert address in [found.ip for found in telegenic.discover()], "not found by broadcast"
    camera = telegenic.Camera(address)
    camera.connect()
    for name in ("ExposureTime", "Gain", "AcquisitionFrameRate", "FaultPacketLoss"):
        assert name in camera.feature_names(), name
    camera.set_enum("PixelFormat", FORMAT)
    with camera.start_acquisition() as acquisition:
        # Its buffers are few: a frame that is kept is one less.
        taken = [sha(acquisition.wait_for(timeout=WAIT_S).data()) for _ in range(10)]
    consecutive([expected.index(bytes_) for bytes_ in taken], "telegenic")


def viva(address, expected):
    import viva_genicam

    found = [device for device in viva_genicam.discover(timeout_ms=700) if address in str(device)]
    assert found, "not found by broadcast"
    with viva_genicam.connect_gige(found[0]) as camera:
        camera.set("PixelFormat", FORMAT)
        taken = []
        with camera.stream() as frames:
            for frame in frames:
                taken.append(sha(frame.to_numpy().astype("<u2").tobytes()))
                if len(taken) == 10:
                    break
    # While the first frame is turned into an array, the client drops some that follow.
    found = [expected.index(bytes_) for bytes_ in taken]
    assert found == sorted(set(found)), found
    print(f"viva-genicam: 10 frames from frame {found[0]} on are those of camrig expose")


def genapi(address, _):
    """EMVA's own reader of the XML, the strictest, on memory that holds what it writes."""
    import genicam.genapi as genapi
    import viva_genicam

    found = [device for device in viva_genicam.discover(timeout_ms=700) if address in str(device)]
    with viva_genicam.connect_gige(found[0]) as camera:
        xml = camera.xml if isinstance(camera.xml, str) else camera.xml()

    class Port(genapi.AbstractPort):
        def __init__(self):
            super().__init__()
            self.memory = {}

        def is_open(self):
            return True

        def read(self, address, length):
            return bytes(self.memory.get(address + i, 0) for i in range(length))

        def write(self, address, value):
            self.memory.update({address + i: byte for i, byte in enumerate(value)})

        def get_access_mode(self):
            return genapi.EAccessMode.RW

    nodes = genapi.NodeMap()
    nodes.load_xml_from_string(xml)
    port = Port()
    assert nodes.connect(port, "Device")
    nodes.get_node("Width").value = 640
    assert nodes.get_node("OffsetX").max == 752 - 640
    nodes.get_node("PixelFormat").value = FORMAT
    nodes.get_node("ExposureTime").value = 1234.5
    nodes.get_node("AcquisitionStart").execute()
    assert nodes.get_node("PixelFormat").value == FORMAT
    assert nodes.get_node("ExposureTime").unit == "us"
    print(f"GenApi: {len(xml)} bytes of XML are right, and {len(port.memory)} bytes were written")


def main():
    what, address = sys.argv[1:3]
    if what == "second":
        return second(address)
    with open(sys.argv[3], encoding="utf-8") as lines:
        expected = lines.read().split()
    return {f.__name__: f for f in (aravis, refused, telegenic, viva, genapi)}[what](address, expected)


main()
