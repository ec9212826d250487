"""Cyclic redundancy checks of frames: reflected polynomials, no final inversion, least significant byte first."""

from functools import cache
from typing import NamedTuple


class Checksum(NamedTuple):
    """A cyclic redundancy check."""

    size: int  # bytes
    polynomial: int  # reflected
    begin: int  # value before the first byte


CHECKSUMS = {
    "mcrf4xx": Checksum(2, 0x8408, 0xFFFF),
    "rm8": Checksum(1, 0x8C, 0xFF),
    "roborts16": Checksum(2, 0xA001, 0x3AA3),
    "roborts32": Checksum(4, 0xEDB88320, 0x3AA3),
    "ep8": Checksum(1, 0x8C, 0x77),
    "ep16": Checksum(2, 0x8408, 0x3692),
}
"""By the names that tables of frames have for them."""


def checksum(name: str, data: bytes) -> bytes:
    """Return the checksum of some bytes.

    Args:
      name: one of `CHECKSUMS`.
      data: bytes before the checksum.
    """
    check = CHECKSUMS[name]
    table, value = _table(check.polynomial), check.begin
    for byte in data:
        value = value >> 8 ^ table[(value ^ byte) & 0xFF]
    return value.to_bytes(check.size, "little")


@cache
def _table(polynomial: int) -> tuple[int, ...]:
    """Return what each byte makes of a value of zero."""
    table = list(range(256))
    for _ in range(8):
        table = [value >> 1 ^ (polynomial if value & 1 else 0) for value in table]
    return tuple(table)
