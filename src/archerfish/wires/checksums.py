"""Cyclic redundancy checks of frames, without a final inversion; docs/deployment.md has a table of them."""

import binascii
from functools import cache
from typing import NamedTuple


class Checksum(NamedTuple):
    """A cyclic redundancy check."""

    size: int  # bytes
    polynomial: int  # as printed, or reflected
    begin: int  # the register before the first byte
    is_reflected: bool = True  # bits in the order of the line, the lowest one first


CHECKSUMS = {
    "mcrf4xx": Checksum(2, 0x8408, 0xFFFF),
    "rm8": Checksum(1, 0x8C, 0xFF),
    "roborts16": Checksum(2, 0xA001, 0x3AA3),
    "roborts32": Checksum(4, 0xEDB88320, 0x3AA3),
    "ep8": Checksum(1, 0x8C, 0x77),
    "ep16": Checksum(2, 0x8408, 0x3692),
    "modbus": Checksum(2, 0xA001, 0xFFFF),
    "ccitt": Checksum(2, 0x1021, 0xFFFF, is_reflected=False),
    "xmodem": Checksum(2, 0x1021, 0x0000, is_reflected=False),
}
"""By the names that tables of frames have for them."""


def checksum(name: str, data: bytes) -> bytes:
    """Return the checksum of some bytes, least significant byte first.

    Args:
      name: one of `CHECKSUMS`, with " big" behind it for the most significant byte first.
      data: bytes before the checksum.
    """
    name, _, order = name.partition(" ")
    check = CHECKSUMS[name]
    value = check.begin
    if check.is_reflected:
        table = _table(check.polynomial)
        for byte in data:
            value = value >> 8 ^ table[(value ^ byte) & 0xFF]
    else:
        value = binascii.crc_hqx(data, value)  # of the polynomial 0x1021
    return value.to_bytes(check.size, "big" if order == "big" else "little")


@cache
def _table(polynomial: int) -> tuple[int, ...]:
    """Return what each byte makes of a value of zero."""
    table = list(range(256))
    for _ in range(8):
        table = [value >> 1 ^ (polynomial if value & 1 else 0) for value in table]
    return tuple(table)
