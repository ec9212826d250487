import html

import pytest

from archerfish.viewer.wording import plain


@pytest.mark.parametrize(
    "text",
    [
        "<iframe srcdoc='<script>'>",
        "**bold** _it_ `x`",
        "[a](javascript:alert(1))",
        "<lambda>",
        "__init__",
        "&lt;b&gt;",
    ],
)
def test_text_of_others_has_no_mark_of_html_or_markdown_and_reads_as_it_stands(text: str) -> None:
    assert html.unescape(plain(text)) == text
    assert not set(plain(text)) & set("<>*_`[]()!\"'|~\\{}")


def test_text_of_others_stays_in_one_line() -> None:
    assert plain("a\n\n# b\tc") == "a &#35; b c"
