#!/usr/bin/env python3
"""A host of the rig protocol, written from docs/protocol.md with Python's standard library alone.

    client.py check                  reads and writes every vector in vectors.json
    client.py exchange HOST:PORT     the exchange of vectors.json with a rig that has just been started
    client.py rig [PORT]             is the rig of that exchange, to any host that keeps to it

Ends with status 1, and says where, if a byte differs. It shares no code with camrig."""
import json
import pathlib
import socket
import struct
import sys

VECTORS = pathlib.Path(__file__).with_name("vectors.json")


# --- Checks, numbers, framing ------------------------------------------------------------------------------------

def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def camera_id(data):
    """64-bit FNV-1a."""
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 & 2**64 - 1
    return value


def varint(number):
    out = bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes(out) + bytes([number])


def cobs(data):
    out = bytearray()
    blocks = data.split(b"\0")
    for i, block in enumerate(blocks):
        while len(block) >= 254:
            out += b"\xff" + block[:254]
            block = block[254:]
            if not block and i + 1 == len(blocks):
                return bytes(out)
        out += bytes([len(block) + 1]) + block
    return bytes(out)


def uncobs(data):
    out, at = bytearray(), 0
    while at < len(data):
        code = data[at]
        if code == 0 or at + code > len(data):
            raise ValueError("not COBS")
        out += data[at + 1 : at + code]
        at += code
        if code < 255 and at < len(data):
            out.append(0)
    return bytes(out)


class Reader:
    """Fields off the front of a body."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, count):
        piece = self.data[self.at : self.at + count]
        if len(piece) != count:
            raise ValueError("the body ends early")
        self.at += count
        return piece

    def u8(self):
        return self.take(1)[0]

    def varint(self):
        number = shift = 0
        while True:
            byte = self.u8()
            number |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return number

    def f32(self):
        return struct.unpack("<f", self.take(4))[0]


# --- Bodies: each as a list of (name, type) ------------------------------------------------------------------------

BEFORE = ["Dark", "Lit", ("LitFor", [("exposure_s", "f32")])]
EXPOSURE = [("exposure_s", "f32"), ("analog_gain", "f32")]
SHAPE = [("rows", "varint"), ("units", "varint"), ("unit_bytes", "varint"), ("raw_bytes", "varint"), ("halo", "u8")]
DEVICE = [("firmware", "text"), ("packet_bytes", "varint"), ("credit", "varint"), ("max_width", "varint"),
          ("max_bands", "varint"), ("max_camera", "varint"), ("arithmetics", "u8"), ("codecs", "u8"),
          ("memory_bytes", "varint"), ("effects", "set"), ("camera", "varint")]
FAULT = ["None", "DropFrame", ("CorruptRow", [("row", "varint")]), "StuckCounter", ("LateFrame", [("ms", "varint")])]
REFUSAL = ["NoCamera", "BadCamera", ("CameraTooLong", [("max", "varint")]), "Effects", ("TooWide", [("max", "varint")]),
           ("TooManyBands", [("max", "varint")]), "WrongShape", "Arithmetic", "Codec", "Packing", "Exposure",
           ("Captures", [("max", "u8")])]
NACK = ["NoSession", ("NoTransfer", [("transfer", "varint")]), ("Unsupported", [("kind", "u8")]),
        ("Register", [("address", "varint")]), ("Refused", [("refusal", REFUSAL)])]
TO_DEVICE = [
    ("FrameBegin", [("transfer", "varint"), ("frame", "varint"), ("rows", "varint"), ("width", "varint"), ("bands", "varint"),
                    ("codec", ["Bfp16", "Electrons16"]), ("arithmetic", ["F32", "Fixed"]), ("raw_bits", "u8"),
                    ("temperature_c", "f32"), ("before", BEFORE), ("exposure", ("option", EXPOSURE))]),
    "Abort", ("RegRead", [("address", "varint")]), ("RegWrite", [("address", "varint"), ("value", "varint")]), "Statistics",
    ("ByteRead", [("address", "varint")]), ("ByteWrite", [("address", "varint"), ("byte", "u8")])]
TO_HOST = [
    ("FrameStart", [("transfer", "varint"), ("shape", ("fields", SHAPE)), ("exposure", ("fields", EXPOSURE)), ("counter", "varint"),
                    ("frame", "varint"), ("seed", "varint"), ("test_pattern", "varint"), ("fault", FAULT)]),
    "Aborted", ("Register", [("address", "varint"), ("value", "varint")]),
    ("Statistics", [(name, "varint") for name in "packets damaged stale gaps rows_in rows_out frames".split()]),
    ("Camera", [("id", "varint"), ("received", "varint"), ("ready", "bool")]), ("Nack", [("nack", NACK)])]
HELLO = [("magic", "magic"), ("oldest", "u8"), ("newest", "u8"), ("packet_bytes", "varint"), ("credit", "varint")]
REPLY = [("version", "u8"), ("oldest", "u8"), ("newest", "u8"), ("device", ("option", DEVICE))]
PART = [("transfer", "<H"), ("row", "<H"), ("unit", "<H"), ("units", "rest")]
RAW = [("transfer", "<H"), ("row", "<H"), ("offset", "<H"), ("row_crc", "<I"), ("bytes", "rest")]
CAMERA = [("id", "<Q"), ("total", "<I"), ("offset", "<I"), ("bytes", "rest")]
ACK = [("transfer", "<H"), ("row", "<H"), ("unit", "<H")]
# Kinds by number: name, body from the host, body from the device.
KINDS = {1: ("Hello", ("fields", HELLO), ("fields", REPLY)), 2: ("Control", TO_DEVICE, TO_HOST), 3: ("Camera", ("fields", CAMERA), None),
         4: ("Part", ("fields", PART), None), 5: ("Raw", None, ("fields", RAW)), 6: ("Ack", ("fields", []), ("fields", ACK)),
         7: ("Ping", ("fields", []), None)}
# The camera that a host sends: the configuration behind four lengths, then the crosstalk table.
EFFECT = [("id", "u8"), ("values", ("list", "f32"))]
SENSOR = [("width", "varint"), ("height", "varint"), ("pattern_width", "u8"), ("pattern_height", "u8"), ("pattern", ("list", "u8")),
          ("channels", "u8"), ("bands", "u8"), ("first_band_nm", "f32"), ("band_step_nm", "f32"), ("response", ("list", "f32")),
          ("full_well_e", "f32"), ("bits", "u8"), ("black_level_dn", "f32"), ("seed", "varint"),
          ("effects", ("list", ("fields", EFFECT)))]


def write(kind, value):
    """A value as bytes."""
    if kind == "u8":
        return bytes([value])
    if kind == "bool":
        return bytes([bool(value)])
    if kind == "varint":
        return varint(value)
    if kind == "set":
        return varint(sum(1 << number for number in value))
    if kind == "f32":
        return struct.pack("<f", value)
    if kind == "text":
        return varint(len(value.encode())) + value.encode()
    if kind == "magic":
        return value.encode()
    if kind == "rest":
        return bytes.fromhex(value)
    if isinstance(kind, str):
        return struct.pack(kind, value)
    if isinstance(kind, list):  # one of several: its number, then its fields
        name, fields = value if isinstance(value, list) else (value, {})
        for number, variant in enumerate(kind):
            its_name, its_fields = variant if isinstance(variant, tuple) else (variant, [])
            if its_name == name:
                return varint(number) + write(("fields", its_fields), fields)
        raise ValueError(f"no variant {name}")
    how, inner = kind
    if how == "option":
        return b"\0" if value is None else b"\1" + write(("fields", inner), value)
    if how == "list":
        return varint(len(value)) + b"".join(write(inner, item) for item in value)
    return b"".join(write(its_kind, value[name]) for name, its_kind in inner)


def read(kind, r):
    """A value from bytes."""
    if kind == "u8":
        return r.u8()
    if kind == "bool":
        return bool(r.u8())
    if kind == "varint":
        return r.varint()
    if kind == "set":
        bits = r.varint()
        return [number for number in range(256) if bits >> number & 1]
    if kind == "f32":
        return r.f32()
    if kind == "text":
        return r.take(r.varint()).decode()
    if kind == "magic":
        return r.take(6).decode()
    if kind == "rest":
        return r.take(len(r.data) - r.at).hex()
    if isinstance(kind, str):
        return struct.unpack(kind, r.take(struct.calcsize(kind)))[0]
    if isinstance(kind, list):
        variant = kind[r.varint()]
        if isinstance(variant, str):
            return variant
        return [variant[0], read(("fields", variant[1]), r)]
    how, inner = kind
    if how == "option":
        return read(("fields", inner), r) if r.u8() else None
    if how == "list":
        return [read(inner, r) for _ in range(r.varint())]
    return {name: read(its_kind, r) for name, its_kind in inner}


def body_kind(name, from_host):
    for number, (its_name, host, device) in KINDS.items():
        if its_name == name:
            return number, host if from_host else device
    raise ValueError(f"no kind {name}")


def packet(entry):
    """The bytes of a packet from its fields."""
    number, kind = body_kind(entry["kind"], entry["from"] == "host")
    head = struct.pack("<BBHHH", number, entry["flags"], entry["session"], entry["seq"], entry["ack"])
    data = head + write(kind, entry["body"])
    return data + struct.pack("<I", crc32c(data))


def parse(data, sender):
    """The fields of a packet from its bytes."""
    if len(data) < 12 or crc32c(data[:-4]) != struct.unpack("<I", data[-4:])[0]:
        raise ValueError("too short, or the CRC is wrong")
    number, flags, session, seq, ack = struct.unpack("<BBHHH", data[:8])
    name, host, device = KINDS[number]
    r = Reader(data[8:-4])
    body = read(host if sender == "host" else device, r)
    if r.at != len(r.data):
        raise ValueError("bytes are left over")
    return {"from": sender, "kind": name, "flags": flags, "session": session, "seq": seq, "ack": ack, "body": body}


def camera(fields):
    """The bytes of a camera without a crosstalk table."""
    config = write(("fields", SENSOR), fields)
    return struct.pack("<HHHH", len(config), 0, 0, 0) + config


# --- The vectors ---------------------------------------------------------------------------------------------------

def same(what, found, expected):
    if found != expected:
        sys.exit(f"{what}:\n  found    {found}\n  expected {expected}")


def check(vectors):
    for entry in vectors["crc32c"]:
        same("crc32c", f"{crc32c(bytes.fromhex(entry['bytes'])):08x}", entry["crc"])
    for entry in vectors["camera_id"]:
        same("camera_id", f"{camera_id(bytes.fromhex(entry['bytes'])):016x}", entry["id"])
    for entry in vectors["varint"]:
        same("varint", varint(entry["number"]).hex(), entry["bytes"])
        same("varint", Reader(bytes.fromhex(entry["bytes"])).varint(), entry["number"])
    for entry in vectors["cobs"]:
        same("cobs", (cobs(bytes.fromhex(entry["packet"])) + b"\0").hex(), entry["link"])
        same("cobs", uncobs(bytes.fromhex(entry["link"])[:-1]).hex(), entry["packet"])
    same("camera", camera(vectors["camera"]["sensor"]).hex(), vectors["camera"]["bytes"])
    same("camera", f"{camera_id(bytes.fromhex(vectors['camera']['bytes'])):016x}", vectors["camera"]["id"])
    for entry in vectors["messages"] + vectors["exchange"]:
        fields = {key: value for key, value in entry.items() if key not in ("packet", "says")}
        same(entry["says"], packet(entry).hex(), entry["packet"])
        same(entry["says"], parse(bytes.fromhex(entry["packet"]), entry["from"]), fields)
    print(f"{len(vectors['messages'])} messages, an exchange of {len(vectors['exchange'])} packets: read and written")


class Link:
    """Packets with a length before each, over TCP."""

    def __init__(self, stream):
        self.stream, self.buffer = stream, b""
        stream.settimeout(20)

    def send(self, data):
        self.stream.sendall(struct.pack("<I", len(data)) + data)

    def receive(self):
        """The next packet; None at the end of the link."""
        while True:
            if len(self.buffer) >= 4:
                length = struct.unpack("<I", self.buffer[:4])[0]
                if len(self.buffer) >= 4 + length:
                    data, self.buffer = self.buffer[4 : 4 + length], self.buffer[4 + length :]
                    if data:
                        return data
                    continue
            got = self.stream.recv(1 << 16)
            if not got:
                return None
            self.buffer += got


def exchange(vectors, address):
    """As the host. What a device says of itself in HelloReply is its own."""
    host, port = address.removeprefix("tcp://").rsplit(":", 1)
    link = Link(socket.create_connection((host, int(port)), timeout=20))
    for entry in vectors["exchange"]:
        if entry["from"] == "host":
            link.send(packet(entry))
            continue
        answer = link.receive()
        if answer is None:
            sys.exit(f"{entry['says']}: the rig closed the link")
        if entry["kind"] == "Hello":
            same(entry["says"], parse(answer, "device")["body"]["version"], entry["body"]["version"])
        else:
            same(entry["says"], answer.hex(), entry["packet"])
    print(f"the rig at {address} answers to the byte")


def rig(vectors, port):
    """As the device: answers what the vectors have, to one host; its session is the host's."""
    listener = socket.create_server(("127.0.0.1", port))
    print("tcp://127.0.0.1:%d" % listener.getsockname()[1], flush=True)
    link = Link(listener.accept()[0])
    session = None
    for entry in vectors["exchange"]:
        if entry["from"] == "device":
            link.send(packet(entry | {"session": session}))
            continue
        asked = link.receive()
        if asked is None:
            sys.exit(f"{entry['says']}: the host closed the link")
        found = parse(asked, "host")
        session = found["session"]
        expected = {key: value for key, value in entry.items() if key not in ("packet", "says")}
        same(entry["says"], found, expected | {"session": session})
    print("the host keeps to the exchange")


if __name__ == "__main__":
    command, *more = sys.argv[1:] or [""]
    known = json.loads(VECTORS.read_text())
    if command == "check":
        check(known)
    elif command == "exchange" and len(more) == 1:
        exchange(known, more[0])
    elif command == "rig":
        rig(known, int(more[0]) if more else 0)
    else:
        sys.exit(__doc__)
