"""A writer of ULog files, after PX4's description of the format, for tests."""

import struct

import numpy as np

CODES = {"uint64_t": "Q", "float": "f", "uint8_t": "B"}


def message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulog(topics, parameters):
    """The bytes of a log.

    ``topics`` maps names to fields, {"float[3] position": (n, 3), …}; their "uint64_t timestamp" is in µs.
    ``parameters`` are floats by name.
    """
    out = b"\x55\x4c\x6f\x67\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", bytes(40))
    for name, fields in topics.items():
        out += message("F", f"{name}:{''.join(f'{field};' for field in fields)}".encode())
    for name, value in parameters.items():
        key = f"float {name}".encode()
        out += message("P", struct.pack("<B", len(key)) + key + struct.pack("<f", value))
    rows = []
    for number, (name, fields) in enumerate(topics.items()):
        out += message("A", struct.pack("<BH", 0, number) + name.encode())
        columns = [(CODES[field.partition(" ")[0].partition("[")[0]], np.asarray(v)) for field, v in fields.items()]
        columns = [(code, v if code == "f" else v.astype(np.int64)) for code, v in columns]
        stamps = fields["uint64_t timestamp"]
        for i, stamp in enumerate(stamps):
            parts = [struct.pack(f"<{np.size(v[i])}{code}", *np.ravel(v[i]).tolist()) for code, v in columns]
            rows.append((int(stamp), message("D", struct.pack("<H", number) + b"".join(parts))))
    return out + b"".join(row for _, row in sorted(rows, key=lambda row: row[0]))
