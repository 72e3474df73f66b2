"""Damage to files: bits, lengths, texts, pieces; and to folders: files that are missing, empty or swapped."""

from __future__ import annotations

import re
import struct
import zlib
from random import Random

_NUMBERS = [0, 1, 2, 127, 128, 255, 256, 32767, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1]
_LONG_NUMBERS = [*_NUMBERS, 2**32, 2**40, 2**53, 2**63 - 1, 2**64 - 1]
_TEXTS = [
    b"", b"0", b"-1", b"1", b"9999999999", b"1e999", b"-1e999", b"nan", b"inf", b"null", b"{}", b"[]", b'"',
    b"[" * 3000, b"'", b"\\", b"\0", b"\xff\xfe", b"../../x", b"/etc/hostname", b"%s%n", b"1" * 5000, b"true",
    b"object", b"|O", b"<U99999999", b"(1,", b"0x10", b"1_000", "٣".encode(),
]  # fmt: skip
_HEADER = 600


def damage(files: dict[str, bytes], random: Random) -> dict[str, bytes]:
    """A damaged copy of the files of a seed."""
    found = dict(files)
    for _ in range(1 + int(random.expovariate(1))):
        if not found:
            break
        name = random.choice(sorted(found))
        if len(files) > 1 and random.random() < 0.15:
            _damage_folder(found, name, random)
        else:
            found[name] = _damage_file(found[name], random)
    return found


def _damage_folder(files: dict[str, bytes], name: str, random: Random) -> None:
    other = random.choice(sorted(files))
    act = random.randrange(4)
    if act == 0:
        del files[name]
    elif act == 1:
        files[name] = b""
    elif act == 2:
        files[name], files[other] = files[other], files[name]
    else:
        digits = re.sub(r"\d+", lambda _: str(random.choice([0, 1, 7, 99, 10**6, 10**12])), name)
        files[digits] = files[name]


def _damage_file(data: bytes, random: Random) -> bytes:
    if random.random() < 0.15 and (inner := _repacked(data, random)) is not None:
        return inner
    act = random.choice(
        [_cut, _flip, _flip, _insert, _remove, _swap, _number, _number, _text, _text, _repeat]
    )
    return act(data, random)


def _place(data: bytes, random: Random) -> int:
    """Half of the time in the header, where lengths are."""
    most = min(len(data), _HEADER) if random.random() < 0.5 else len(data)
    return random.randrange(most) if most else 0


def _cut(data: bytes, random: Random) -> bytes:
    return data[: _place(data, random)]


def _flip(data: bytes, random: Random) -> bytes:
    found = bytearray(data)
    for _ in range(random.choice([1, 1, 1, 2, 8, 64])):
        if found:
            found[_place(data, random)] ^= 1 << random.randrange(8)
    return bytes(found)


def _insert(data: bytes, random: Random) -> bytes:
    at = _place(data, random)
    return data[:at] + random.randbytes(random.choice([1, 2, 4, 8, 100])) + data[at:]


def _remove(data: bytes, random: Random) -> bytes:
    at = _place(data, random)
    return data[:at] + data[at + random.choice([1, 2, 4, 8, 100]) :]


def _swap(data: bytes, random: Random) -> bytes:
    length = random.choice([1, 4, 16, 64])
    first, second = sorted((_place(data, random), _place(data, random)))
    if second < first + length:
        return data
    parts = data[:first], data[second : second + length], data[first + length : second]
    return b"".join(parts) + data[first : first + length] + data[second + length :]


def _repeat(data: bytes, random: Random) -> bytes:
    at = _place(data, random)
    return data[:at] + data[at : at + 64] * random.choice([2, 10, 100]) + data[at + 64 :]


def _number(data: bytes, random: Random) -> bytes:
    """A length, or whatever else is there, becomes an extreme one."""
    code = random.choice("BHIQ") if random.random() < 0.8 else random.choice("fd")
    order, size = random.choice("<>"), struct.calcsize(code)
    at = _place(data, random) // random.choice([1, 2, 4]) * random.choice([1, 2, 4])
    if code in "fd":
        value: float = random.choice([0.0, -1.0, 1e30, float("inf"), float("nan")])
        return data[:at] + struct.pack(order + code, value) + data[at + size :]
    number = random.choice(_LONG_NUMBERS) % 256**size
    return data[:at] + struct.pack(order + code, number) + data[at + size :]


def _text(data: bytes, random: Random) -> bytes:
    """A word or number of a text becomes another; in binary files, wherever something looks like one."""
    words = [match.span() for match in re.finditer(rb"[\w.+-]{1,40}", data[:20000])]
    if not words:
        return data
    start, end = random.choice(words[:60] if random.random() < 0.7 else words)
    return data[:start] + random.choice(_TEXTS) + data[end:]


def _repacked(data: bytes, random: Random) -> bytes | None:
    """Damage inside of a piece that is packed by zlib, with the checksums of a PNG put right again."""
    if data.startswith(b"\x89PNG"):
        return _png(data, random)
    starts = [match.start() for match in re.finditer(rb"\x78[\x01\x5e\x9c\xda]", data)]
    random.shuffle(starts)
    for start in starts[:20]:
        unpacking = zlib.decompressobj()
        try:
            inner = unpacking.decompress(data[start:], 1 << 20)
        except zlib.error:
            continue
        if len(inner) > 16 and unpacking.eof:
            packed = zlib.compress(_damage_file(inner, random))
            return data[:start] + packed + unpacking.unused_data
    return None


def _png(data: bytes, random: Random) -> bytes:
    chunks, at = [], 8
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    if not chunks:
        return data
    which = random.randrange(len(chunks))
    kind, content = chunks[which]
    chunks[which] = kind, _flip(content, random) if random.random() < 0.5 else _number(content, random)
    return data[:8] + b"".join(
        len(content).to_bytes(4, "big") + kind + content + zlib.crc32(kind + content).to_bytes(4, "big")
        for kind, content in chunks
    )
