"""Checksums: the values that catalogues print for nine digits, and the table in the documentation."""

from pathlib import Path

import pytest

from archerfish.wires import Layout
from archerfish.wires.checksums import CHECKSUMS, checksum

PAGE = (Path(__file__).parents[2] / "docs" / "deployment.md").read_text()
DIGITS = b"123456789"
CATALOGUE = {"mcrf4xx": 0x6F91, "modbus": 0x4B37, "ccitt": 0x29B1, "xmodem": 0x31C3}


def printed(polynomial, size, is_reflected):
    """Return a polynomial as catalogues print it, the highest power first."""
    return int(f"{polynomial:0{8 * size}b}"[::-1], 2) if is_reflected else polynomial


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_checksum_is_that_of_the_catalogue(name):
    assert checksum(name, DIGITS) == CATALOGUE[name].to_bytes(2, "little")
    assert checksum(f"{name} big", DIGITS) == CATALOGUE[name].to_bytes(2, "big")


def test_a_frame_has_its_checksum_in_the_order_of_its_field(refused):
    little, big = (Layout("a", ["= 313233343536373839", f"crc ccitt{order}"]) for order in ("", " big"))
    assert (little.encode({})[-2:], big.encode({})[-2:]) == (b"\xb1\x29", b"\x29\xb1")
    assert big.is_valid(DIGITS + b"\x29\xb1")
    assert not big.is_valid(DIGITS + b"\xb1\x29")
    refused("no such checksum; perhaps you meant ccitt", Layout, "a", ["= 01", "crc citt big"])


def test_the_page_has_all_checksums():
    begin = PAGE.index("| checksum |")
    found = {}
    for row in PAGE[begin : PAGE.index("\n\n", begin)].splitlines()[2:]:
        name, _, bits, polynomial, register, is_reflected, inversion, check = row.strip("| ").split(" | ")
        found[name.strip("`")] = (
            int(bits),
            int(polynomial, 16),
            int(register, 16),
            int(check, 16),
            is_reflected == "yes",
        )
        assert inversion == "0"
    expected = {
        name: (
            8 * check.size,
            printed(check.polynomial, check.size, check.is_reflected),
            check.begin,
            int.from_bytes(checksum(name, DIGITS), "little"),
            check.is_reflected,
        )
        for name, check in CHECKSUMS.items()
    }
    assert found == expected
