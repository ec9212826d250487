"""Links and pictures lead somewhere: to files, to headings in them, or to an address that is one."""

import re
import unicodedata
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from .pages import PAGES, ROOT, without_blocks

LINK = re.compile(
    r"(?<!\\)\[(?:[^\]\[]|\[[^\]]*\])*\]\(\s*<?([^)\s>]*)>?(?:\s+\"[^\"]*\")?\s*\)|(?:href|src)=\"([^\"]*)\""
)


def anchors(text: str) -> set[str]:
    """Return the anchors of a page's headings, as the site makes them."""
    found: set[str] = set(re.findall(r"(?:id|name)=\"([^\"]+)\"", text))
    for title in re.findall(r"^#{1,6} +(.+?) *#*$", without_blocks(text), re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)|[`*]", r"\1", title)
        plain = unicodedata.normalize("NFKD", plain).encode("ascii", "ignore").decode()
        slug = re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())
        found.add(slug if slug not in found else f"{slug}_1")
    return found


def complaint(page: Path, link: str) -> str:
    """Return what is wrong with a link of a page; nothing if it leads somewhere."""
    address = urlsplit(link)
    if address.scheme or address.netloc:
        known = address.scheme == "mailto" or (address.scheme == "https" and "." in address.netloc)
        return "" if known else "is no https or mailto address"
    target = page if not address.path else page.parent / address.path
    if not target.exists():
        return "is not there"
    if ROOT not in target.resolve().parents:
        return "lies outside the repository"
    if address.fragment and address.fragment not in anchors(target.read_text()):
        return f"has no heading {address.fragment}"
    return ""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    links = [one or other for one, other in LINK.findall(without_blocks(page.read_text()))]
    wrong = {link: told for link in links if (told := complaint(page, link))}
    # The site holds the pages of docs alone.
    inside = ROOT / "docs"
    if page.is_relative_to(inside):
        files = [each for each in links if not urlsplit(each).scheme and urlsplit(each).path]
        wrong |= {
            each: "is not in docs/"
            for each in files
            if not (page.parent / urlsplit(each).path).resolve().is_relative_to(inside)
        }
    assert wrong == {}


@pytest.mark.parametrize(
    ("link", "told"),
    [
        ("docs/index.md", ""),
        ("docs/adding.md#a-plant", ""),
        ("#results", ""),
        ("https://keepachangelog.com", ""),
        ("docs/nowhere.md", "is not there"),
        ("docs/adding.md#nothing", "has no heading nothing"),
        ("#nothing", "has no heading nothing"),
        ("http://keepachangelog.com", "is no https or mailto address"),
        ("https://nowhere", "is no https or mailto address"),
        ("../", "lies outside the repository"),
    ],
)
def test_what_leads_nowhere_is_found(link: str, told: str) -> None:
    assert complaint(ROOT / "README.md", link) == told


def test_links_and_pictures_are_found_as_pages_write_them() -> None:
    text = 'a [b](c.md) ![d](e.png "title") [![f](g.svg)](h.md#i) <img src="j.png"> `[k](l)`\n```sh\n[m](n)\n```\n'
    found = [one or other for one, other in LINK.findall(without_blocks(text))]
    assert {"c.md", "e.png", "h.md#i", "j.png"} <= set(found)
    assert "n" not in found
