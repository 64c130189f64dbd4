/* A rig in C, written from docs/protocol.md alone: a sensor without noise behind TCP. A pattern for a
 * device of your own: replace `expose` by your sensor and `link_read`, `link_write` by your line.
 *
 *     cc -std=c99 -Wall -Wextra -O2 device.c -lm -o device && ./device 7422
 *
 * It serves one host after another, keeps its camera between them and one row at a time, and has no
 * heap. Bytes from outside are checked before they are used. */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { HELLO = 1, CONTROL, CAMERA, PART, RAW, ACK, PING };
enum { JUMP = 1, GAP = 1, PENDING = 2 };
enum { NO_CAMERA, BAD_CAMERA, CAMERA_TOO_LONG, EFFECTS, TOO_WIDE, TOO_MANY_BANDS, WRONG_SHAPE,
       ARITHMETIC, CODEC, PACKING, EXPOSURE };

/* Versions of the protocol. It takes no camera of several captures, which version 2 adds. */
#define OLDEST 1
#define NEWEST 2
#define PACKET 4400         /* longest packet, bytes */
#define CREDIT 16           /* packets that the host may have under way */
#define WIDTH 4096          /* longest row, pixels */
#define BANDS 64
#define CHANNELS 4
#define CAMERA_BYTES 2048
#define GROUP 16            /* pixels of a unit */
#define UNIT 33             /* its bytes */
#define LINE_S 1e-5f        /* line time, s */
#define UNITY_GAIN 256      /* gain code of 1 */

/* ---- numbers ------------------------------------------------------------------------------- */

static uint32_t crc32c(const uint8_t *bytes, size_t n) {
    uint32_t crc = ~0u;
    for (size_t i = 0; i < n; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) crc = crc >> 1 ^ (crc & 1 ? 0x82f63b78u : 0);
    }
    return ~crc;
}

static uint64_t low_first(const uint8_t *bytes, int n) {
    uint64_t value = 0;
    while (n-- > 0) value = value << 8 | bytes[n];
    return value;
}

/* A message that is read. After its end, and for what it cannot hold, `bad` is set and 0 comes. */
typedef struct { const uint8_t *at, *end; bool bad; } reader;

static uint8_t get_u8(reader *r) {
    if (r->at == r->end) return r->bad = true, 0;
    return *r->at++;
}

static uint64_t get_varint(reader *r, uint64_t most) {
    uint64_t value = 0;
    for (int shift = 0; shift < 70; shift += 7) {
        uint8_t byte = get_u8(r);
        if (shift == 63 && byte > 1) break;
        value |= (uint64_t)(byte & 0x7f) << shift;
        if (byte < 0x80) {
            if (value > most) break;
            return value;
        }
    }
    return r->bad = true, 0;
}

static float get_f32(reader *r) {
    uint8_t bytes[4];
    for (int i = 0; i < 4; i++) bytes[i] = get_u8(r);
    uint32_t word = (uint32_t)low_first(bytes, 4);
    float value;
    memcpy(&value, &word, sizeof value);
    return value;
}

/* A message that is written; the longest has 120 bytes. */
typedef struct { uint8_t bytes[128]; size_t n; } writer;

static void put_u8(writer *w, uint8_t value) { w->bytes[w->n++] = value; }

static void put_low_first(writer *w, uint64_t value, int n) {
    for (; n > 0; n--, value >>= 8) put_u8(w, (uint8_t)value);
}

static void put_varint(writer *w, uint64_t value) {
    for (; value > 0x7f; value >>= 7) put_u8(w, (uint8_t)(value | 0x80));
    put_u8(w, (uint8_t)value);
}

static void put_f32(writer *w, float value) {
    uint32_t word;
    memcpy(&word, &value, sizeof word);
    put_low_first(w, word, 4);
}

/* ---- state --------------------------------------------------------------------------------- */

typedef struct {
    uint32_t width, height;
    uint8_t across, down, pattern[64], channels, bands, bits;
    float response[CHANNELS * BANDS], full_well_e, black_dn;
    uint64_t seed;
} sensor;

/* What the host announced. */
typedef struct {
    uint16_t transfer, rows, width, bands;
    uint32_t frame;
    uint8_t codec, raw_bits;
    bool timed;
    float exposure_s, gain;
} announcement;

static int link_fd;
static struct { /* the session */
    bool open;
    uint16_t id, seq, heard, told, acknowledged, packet, credit;
    uint8_t hello[32];
    size_t hello_bytes;
} host;
static struct { uint16_t lines, gain, counter; uint32_t count[7]; } rig = { 500, UNITY_GAIN, 0, { 0 } };
enum { PACKETS, DAMAGED, STALE, GAPS, ROWS_IN, ROWS_OUT, FRAMES };
static struct {
    uint64_t id;
    uint32_t received;
    bool ready;
    uint8_t bytes[CAMERA_BYTES];
    sensor is;
} camera;
static struct {
    bool open, gap, waiting;       /* `waiting`: a whole row whose raw row is not computed yet */
    announcement begun;
    float exposure_s, gain;
    uint16_t units, raw_bytes, row, unit, out;
    float sums[WIDTH];
    uint8_t raw[2 * WIDTH];
    bool sending;
    uint16_t sending_row, sent;
    uint32_t raw_crc;
} frame;

static bool after(uint16_t a, uint16_t b) { return (int16_t)(uint16_t)(a - b) > 0; }

/* ---- the link: a length of 4 bytes before each packet ----------------------------------------- */

static bool link_write(const uint8_t *bytes, size_t n) {
    while (n > 0) {
        ssize_t done = write(link_fd, bytes, n);
        if (done <= 0) return false;
        bytes += done, n -= (size_t)done;
    }
    return true;
}

static bool link_read(uint8_t *bytes, size_t n) {
    while (n > 0) {
        ssize_t done = read(link_fd, bytes, n);
        if (done <= 0) return false;
        bytes += done, n -= (size_t)done;
    }
    return true;
}

/* Sends a packet of two pieces of body. */
static void send_packet(uint8_t kind, uint8_t flags, const writer *head, const uint8_t *rest, size_t n) {
    static uint8_t out[4 + PACKET];
    uint8_t *packet = out + 4;
    size_t body = head->n + n, end = 8 + body;
    const uint16_t fields[3] = { host.id, host.seq++, host.heard };
    packet[0] = kind, packet[1] = flags;
    for (int i = 0; i < 3; i++) packet[2 + 2 * i] = (uint8_t)fields[i], packet[3 + 2 * i] = fields[i] >> 8;
    memcpy(packet + 8, head->bytes, head->n);
    if (n > 0) memcpy(packet + 8 + head->n, rest, n);
    host.told = host.heard;
    writer crc = { .n = 0 }, length = { .n = 0 };
    put_low_first(&crc, crc32c(packet, end), 4);
    memcpy(packet + end, crc.bytes, 4);
    put_low_first(&length, end + 4, 4);
    memcpy(out, length.bytes, 4);
    if (!link_write(out, 4 + end + 4)) host.open = false;
}

static void answer(const writer *w) { send_packet(CONTROL, 0, w, NULL, 0); }

static void nack(uint8_t number, uint64_t value, bool has_value) {
    writer w = { .n = 0 };
    put_u8(&w, 5), put_u8(&w, number);
    if (has_value) put_varint(&w, value);
    answer(&w);
}

static void refuse(uint8_t why, uint64_t most) {
    writer w = { .n = 0 };
    put_u8(&w, 5), put_u8(&w, 4), put_u8(&w, why);
    if (why == CAMERA_TOO_LONG || why == TOO_WIDE || why == TOO_MANY_BANDS) put_varint(&w, most);
    answer(&w);
}

static void send_ack(void) {
    writer w = { .n = 0 };
    bool pending = frame.open && (frame.sending || frame.waiting);
    put_low_first(&w, frame.open ? frame.begun.transfer : 0, 2);
    put_low_first(&w, frame.open ? frame.row : 0, 2);
    put_low_first(&w, frame.open ? frame.unit : 0, 2);
    send_packet(ACK, (frame.open && frame.gap ? GAP : 0) | (pending ? PENDING : 0), &w, NULL, 0);
}

/* ---- camera -------------------------------------------------------------------------------- */

static bool decode_camera(uint32_t total) {
    sensor s;
    memset(&s, 0, sizeof s);
    if (total < 8) return false;
    size_t config = (size_t)low_first(camera.bytes, 2);
    if (low_first(camera.bytes + 2, 6) != 0 || config > total - 8) return false; /* no crosstalk here */
    reader r = { camera.bytes + 8, camera.bytes + 8 + config, false };
    s.width = (uint32_t)get_varint(&r, 32768), s.height = (uint32_t)get_varint(&r, 32768);
    s.across = get_u8(&r), s.down = get_u8(&r);
    size_t cells = (size_t)get_varint(&r, sizeof s.pattern);
    for (size_t i = 0; i < cells; i++) s.pattern[i] = get_u8(&r);
    s.channels = get_u8(&r), s.bands = get_u8(&r);
    get_f32(&r), get_f32(&r); /* wavelengths, which a sensor without crosstalk need not know */
    size_t responses = (size_t)get_varint(&r, CHANNELS * BANDS);
    for (size_t i = 0; i < responses; i++) s.response[i] = get_f32(&r);
    s.full_well_e = get_f32(&r), s.bits = get_u8(&r), s.black_dn = get_f32(&r);
    s.seed = get_varint(&r, UINT64_MAX);
    size_t effects = (size_t)get_varint(&r, 32);
    bool sound = !r.bad && effects == 0 && s.width > 0 && s.height > 0 && s.across > 0 && s.down > 0
        && (size_t)s.across * s.down == cells && s.channels > 0 && s.channels <= CHANNELS && s.bands > 0
        && s.bands <= BANDS && responses == (size_t)s.channels * s.bands && s.bits >= 8 && s.bits <= 16
        && s.full_well_e >= 1.0f && isfinite(s.full_well_e) && isfinite(s.black_dn);
    for (size_t i = 0; i < cells; i++) sound = sound && s.pattern[i] < s.channels;
    if (sound) camera.is = s;
    return sound;
}

static uint64_t identity(const uint8_t *bytes, size_t n) {
    uint64_t hash = 0xcbf29ce484222325u;
    for (size_t i = 0; i < n; i++) hash = (hash ^ bytes[i]) * 0x100000001b3u;
    return hash;
}

static void camera_packet(const uint8_t *body, size_t n) {
    if (n < 16) return;
    uint64_t id = low_first(body, 8);
    uint32_t total = (uint32_t)low_first(body + 8, 4), offset = (uint32_t)low_first(body + 12, 4);
    size_t piece = n - 16;
    if (id != camera.id || (offset == 0 && !camera.ready)) {
        camera.id = id, camera.received = 0, camera.ready = false, frame.open = false;
    }
    if (!camera.ready && offset == camera.received && offset + (uint64_t)piece <= total) {
        if (offset + piece > CAMERA_BYTES) return camera.received = 0, refuse(CAMERA_TOO_LONG, CAMERA_BYTES);
        memcpy(camera.bytes + offset, body + 16, piece);
        camera.received += (uint32_t)piece;
        if (camera.received == total) {
            if (identity(camera.bytes, total) != id || !decode_camera(total)) {
                return camera.received = 0, refuse(BAD_CAMERA, 0);
            }
            if (camera.is.width > WIDTH) return camera.received = 0, refuse(TOO_WIDE, WIDTH);
            camera.ready = true;
        }
    }
    writer w = { .n = 0 };
    put_u8(&w, 4), put_varint(&w, camera.id), put_varint(&w, camera.received), put_u8(&w, camera.ready);
    answer(&w);
}

/* ---- a frame --------------------------------------------------------------------------------- */

static size_t packed_bytes(uint8_t bits, size_t width) {
    switch (bits) {
    case 8: return width;
    case 10: return (width + 3) / 4 * 5;
    case 12: return (width + 1) / 2 * 3;
    case 14: return (width + 3) / 4 * 7;
    default: return 2 * width;
    }
}

/* Packs as MIPI CSI-2 does: the high 8 bits of a group's samples, then their low bits. */
static void pack(uint8_t bits, const uint16_t *dn, size_t width, uint8_t *out) {
    int group = bits == 8 || bits == 16 ? 1 : bits == 12 ? 2 : 4, low_bits = bits - 8;
    for (size_t x = 0; x < width; x += (size_t)group) {
        uint32_t low = 0;
        for (int i = 0; i < group; i++) {
            uint16_t sample = x + (size_t)i < width ? dn[x + (size_t)i] : 0;
            *out++ = (uint8_t)(sample >> low_bits);
            low |= (uint32_t)(sample & ((1u << low_bits) - 1)) << (low_bits * i);
        }
        for (int left = low_bits * group; left > 0; left -= 8, low >>= 8) *out++ = (uint8_t)low;
    }
}

/* The sensor: a row of electrons to digital numbers. */
static void expose(const float *electrons, uint16_t *dn) {
    float top = (float)((1 << camera.is.bits) - 1);
    float dn_per_e = frame.gain * top / camera.is.full_well_e;
    for (uint32_t x = 0; x < camera.is.width; x++) {
        float value = rintf(electrons[x] * dn_per_e + camera.is.black_dn);
        dn[x] = (uint16_t)(value > 0 ? (value < top ? value : top) : 0);
    }
}

/* Adds units of the row at the cursor. */
static void add_units(const uint8_t *units, size_t count) {
    size_t groups = (camera.is.width + GROUP - 1) / GROUP;
    if (frame.unit == 0) memset(frame.sums, 0, sizeof frame.sums);
    for (size_t u = 0; u < count; u++, units += UNIT) {
        size_t band = (frame.unit + u) / groups, first = (frame.unit + u) % groups * GROUP;
        float scale = ldexpf(frame.exposure_s, (int8_t)units[0]);
        for (size_t i = 0; i < GROUP && first + i < camera.is.width; i++) {
            size_t x = first + i;
            size_t cell = frame.row % camera.is.down * camera.is.across + x % camera.is.across;
            size_t response = camera.is.pattern[cell] * (size_t)camera.is.bands + band;
            float per_unit = frame.begun.codec == 1 ? 1.0f : camera.is.response[response];
            frame.sums[x] += (float)low_first(units + 1 + 2 * i, 2) * scale * per_unit;
        }
    }
}

/* Computes the row that waits, and sends what the host's credit allows. */
static void send_rows(void) {
    static uint16_t dn[WIDTH];
    while (host.open && frame.open && (uint16_t)(host.seq - host.acknowledged) <= host.credit) {
        if (!frame.sending) {
            if (!frame.waiting) return;
            expose(frame.sums, dn);
            pack(frame.begun.raw_bits, dn, camera.is.width, frame.raw);
            frame.raw_crc = crc32c(frame.raw, frame.raw_bytes);
            frame.sending_row = frame.out++, frame.sent = 0;
            frame.waiting = false, frame.sending = true;
            rig.count[ROWS_OUT]++;
        }
        writer w = { .n = 0 };
        put_low_first(&w, frame.begun.transfer, 2), put_low_first(&w, frame.sending_row, 2);
        put_low_first(&w, frame.sent, 2), put_low_first(&w, frame.raw_crc, 4);
        size_t room = host.packet > 8 + 10 + 4 ? host.packet - 22u : 1, left = frame.raw_bytes - frame.sent;
        if (room > left) room = left;
        const uint8_t *piece = frame.raw + frame.sent;
        frame.sent += (uint16_t)room, frame.sending = frame.sent < frame.raw_bytes;
        send_packet(RAW, 0, &w, piece, room);
    }
}

static void part_packet(uint8_t flags, const uint8_t *body, size_t n) {
    if (n < 6) return;
    uint16_t transfer = (uint16_t)low_first(body, 2), row = (uint16_t)low_first(body + 2, 2);
    uint16_t unit = (uint16_t)low_first(body + 4, 2);
    if (!frame.open || transfer != frame.begun.transfer) return nack(1, transfer, true);
    size_t count = (n - 6) / UNIT;
    bool sound = count > 0 && (n - 6) % UNIT == 0 && unit + count <= frame.units && row < frame.begun.rows;
    bool here = row == frame.row && unit == frame.unit;
    if (sound && !here && unit == 0 && flags & JUMP && !frame.waiting) {
        frame.row = frame.out = row, frame.unit = 0, here = true;
    }
    if (!sound || !here || (unit == 0 && frame.waiting)) {
        if (!frame.gap) frame.gap = true, rig.count[GAPS]++, send_ack();
        return;
    }
    frame.gap = false;
    add_units(body + 6, count);
    frame.unit += (uint16_t)count;
    if (frame.unit == frame.units) frame.unit = 0, frame.row++, frame.waiting = true, rig.count[ROWS_IN]++;
}

static void send_frame_start(void) {
    writer w = { .n = 0 };
    put_u8(&w, 0), put_varint(&w, frame.begun.transfer);
    put_varint(&w, frame.begun.rows), put_varint(&w, frame.units), put_varint(&w, UNIT);
    put_varint(&w, frame.raw_bytes), put_u8(&w, 0);
    put_f32(&w, frame.exposure_s), put_f32(&w, frame.gain);
    put_varint(&w, rig.counter), put_varint(&w, frame.begun.frame), put_varint(&w, camera.is.seed);
    put_varint(&w, 0), put_u8(&w, 0); /* neither test pattern nor fault */
    answer(&w);
}

static void frame_begin(reader *r) {
    announcement a;
    memset(&a, 0, sizeof a); /* two are compared byte by byte */
    a.transfer = (uint16_t)get_varint(r, UINT16_MAX), a.frame = (uint32_t)get_varint(r, UINT32_MAX);
    a.rows = (uint16_t)get_varint(r, UINT16_MAX), a.width = (uint16_t)get_varint(r, UINT16_MAX);
    a.bands = (uint16_t)get_varint(r, UINT16_MAX), a.codec = get_u8(r);
    uint8_t arithmetic = get_u8(r);
    a.raw_bits = get_u8(r);
    get_f32(r), get_u8(r); /* temperature and the light before, of which this sensor knows nothing */
    a.timed = get_u8(r) != 0;
    if (a.timed) a.exposure_s = get_f32(r), a.gain = get_f32(r);
    if (r->bad || a.codec > 1 || arithmetic > 1) return nack(2, CONTROL, true);
    if (frame.open && memcmp(&a, &frame.begun, sizeof a) == 0) return send_frame_start();
    frame.open = false;
    if (!camera.ready) return refuse(NO_CAMERA, 0);
    const sensor *s = &camera.is;
    if (arithmetic != 0) return refuse(ARITHMETIC, 0);
    if (a.rows != s->height || a.width != s->width || (a.codec == 0 && a.bands != s->bands)) return refuse(WRONG_SHAPE, 0);
    if (a.raw_bits < s->bits || a.raw_bits > 16 || a.raw_bits % 2) return refuse(PACKING, 0);
    float exposure_s = a.timed ? a.exposure_s : (float)rig.lines * LINE_S;
    float gain = a.timed ? a.gain : (float)rig.gain / UNITY_GAIN;
    if (!(exposure_s > 0 && exposure_s < 1e6f && gain > 0 && gain < 1e6f)) return refuse(EXPOSURE, 0);
    memset(&frame, 0, sizeof frame);
    frame.open = true, frame.begun = a, frame.exposure_s = exposure_s, frame.gain = gain;
    frame.units = (uint16_t)((s->width + GROUP - 1) / GROUP * (a.codec == 1 ? 1 : s->bands));
    frame.raw_bytes = (uint16_t)packed_bytes(a.raw_bits, s->width);
    rig.counter++, rig.count[FRAMES]++;
    send_frame_start();
}

/* ---- registers ------------------------------------------------------------------------------- */

/* The register of 16 bits that has an address, and whether it is written; NULL for none. */
static uint16_t *register_at(uint16_t address, bool *writable) {
    static uint16_t model = 0xca39;
    *writable = address >= 0x0202;
    switch (address) {
    case 0x0000: model = 0xca39; return &model;
    case 0x0202: return &rig.lines;
    case 0x0204: return &rig.gain;
    default: return NULL;
    }
}

/* Reads or writes a register (`width` 2) or one of its bytes (1), high byte first. */
static void access_register(uint16_t address, int width, bool write, uint32_t value) {
    bool writable;
    uint16_t *whole = register_at(width == 1 ? address & 0xfffe : address, &writable);
    int shift = width == 1 && !(address & 1) ? 8 : 0;
    uint16_t mask = width == 1 ? (uint16_t)(0xff << shift) : 0xffff;
    if (!whole || (write && (!writable || value > (uint32_t)(mask >> shift)))) return nack(3, address, true);
    if (write) {
        uint16_t changed = (uint16_t)((*whole & ~mask) | value << shift);
        if (width == 2 && changed == 0) return nack(3, address, true);
        *whole = changed;
    }
    writer w = { .n = 0 };
    put_u8(&w, 2), put_varint(&w, address), put_varint(&w, (uint32_t)(*whole & mask) >> shift);
    answer(&w);
}

/* ---- packets ----------------------------------------------------------------------------------- */

static void control_packet(const uint8_t *body, size_t n) {
    reader r = { body, body + n, false };
    uint8_t number = get_u8(&r);
    writer w = { .n = 0 };
    uint16_t address = 0;
    uint32_t value = 0;
    if (number == 2 || number == 3 || number == 5 || number == 6) address = (uint16_t)get_varint(&r, UINT16_MAX);
    if (number == 3) value = (uint32_t)get_varint(&r, UINT32_MAX);
    if (number == 6) value = get_u8(&r);
    if (r.bad || number > 6) return nack(2, CONTROL, true);
    switch (number) {
    case 0: return frame_begin(&r);
    case 1: frame.open = false; put_u8(&w, 1); return answer(&w);
    case 4:
        put_u8(&w, 3);
        for (int i = 0; i < 7; i++) put_varint(&w, rig.count[i]);
        return answer(&w);
    default: access_register(address, number < 5 ? 2 : 1, number == 3 || number == 6, value);
    }
}

static void hello_packet(uint16_t session, uint16_t seq, const uint8_t *body, size_t n) {
    reader r = { body, body + n, false };
    if (n < 6 || n > sizeof host.hello || memcmp(body, "camrig", 6) != 0) return;
    r.at += 6;
    uint8_t oldest = get_u8(&r), newest = get_u8(&r);
    uint16_t packet = (uint16_t)get_varint(&r, UINT16_MAX), credit = (uint16_t)get_varint(&r, UINT16_MAX);
    if (r.bad) return;
    bool again = host.open && host.id == session && host.hello_bytes == n && memcmp(host.hello, body, n) == 0;
    if (!again) {
        host.open = true, host.id = session, host.seq = 1, host.acknowledged = 0;
        host.heard = host.told = seq;
        host.packet = packet < PACKET ? packet : PACKET, host.credit = credit, host.hello_bytes = n;
        memcpy(host.hello, body, n);
        frame.open = false;
    } else if (after(seq, host.heard)) {
        host.heard = seq;
    }
    bool common = oldest <= NEWEST && newest >= OLDEST;
    uint8_t version = !common ? 0 : newest < NEWEST ? newest : NEWEST;
    static const char name[] = "rig in C 1.0";
    writer w = { .n = 0 };
    put_u8(&w, version), put_u8(&w, OLDEST), put_u8(&w, NEWEST), put_u8(&w, common);
    if (common) {
        put_varint(&w, sizeof name - 1);
        for (size_t i = 0; i < sizeof name - 1; i++) put_u8(&w, (uint8_t)name[i]);
        put_varint(&w, PACKET), put_varint(&w, CREDIT), put_varint(&w, WIDTH), put_varint(&w, BANDS);
        put_varint(&w, CAMERA_BYTES), put_u8(&w, 1), put_u8(&w, 3);
        put_varint(&w, sizeof frame + sizeof camera), put_varint(&w, 0); /* memory; no effects */
        put_varint(&w, camera.ready ? camera.id : 0);
    }
    send_packet(HELLO, 0, &w, NULL, 0);
    host.open = common;
}

static void take(const uint8_t *packet, size_t n) {
    if (n < 12 || crc32c(packet, n - 4) != low_first(packet + n - 4, 4)) {
        rig.count[DAMAGED]++;
        return;
    }
    const uint8_t kind = packet[0], *body = packet + 8;
    size_t body_bytes = n - 12;
    uint16_t session = (uint16_t)low_first(packet + 2, 2), seq = (uint16_t)low_first(packet + 4, 2);
    uint16_t ack = (uint16_t)low_first(packet + 6, 2);
    rig.count[PACKETS]++;
    if (kind == HELLO) return hello_packet(session, seq, body, body_bytes);
    if (!host.open) {
        host.id = session;
        return nack(0, 0, false);
    }
    if (session != host.id) return;
    if (!after(seq, host.heard)) {
        rig.count[STALE]++;
        return;
    }
    host.heard = seq;
    if (after(ack, host.acknowledged)) host.acknowledged = ack;
    switch (kind) {
    case CONTROL: control_packet(body, body_bytes); break;
    case CAMERA: camera_packet(body, body_bytes); break;
    case PART: part_packet(packet[1], body, body_bytes); break;
    case PING: send_ack(); break;
    case ACK: break;
    default: nack(2, kind, true);
    }
    if ((uint16_t)(host.heard - host.told) >= CREDIT / 4) send_ack();
    send_rows();
}

/* Serves one host until it goes, or is out of step. */
static void serve(void) {
    static uint8_t packet[PACKET];
    uint8_t head[4];
    host.open = frame.open = false;
    while (link_read(head, 4)) {
        uint64_t n = low_first(head, 4);
        if (n > PACKET || !link_read(packet, (size_t)n)) return;
        if (n > 0) take(packet, (size_t)n);
    }
}

int main(int argc, char **argv) {
    struct sockaddr_in at = { .sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK) };
    socklen_t length = sizeof at;
    at.sin_port = htons((uint16_t)(argc > 1 ? atoi(argv[1]) : 0));
    int listener = socket(AF_INET, SOCK_STREAM, 0), on = 1;
    setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (bind(listener, (struct sockaddr *)&at, length) || listen(listener, 4)
        || getsockname(listener, (struct sockaddr *)&at, &length)) return perror("device"), 2;
    printf("tcp://127.0.0.1:%d\n", ntohs(at.sin_port));
    fflush(stdout);
    while ((link_fd = accept(listener, NULL, NULL)) >= 0) serve(), close(link_fd);
    return 1;
}
