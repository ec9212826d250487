"""Text of others on the page: names, and the errors of a user's own code."""

import re


def plain(text: object) -> str:
    """Return text that Markdown and HTML show as it stands, in one line."""
    # A character reference never begins a tag or a mark, a backslash would not do in HTML.
    return re.sub(r"[!-/:-@\[-`{-~]", lambda found: f"&#{ord(found[0])};", " ".join(str(text).split()))
