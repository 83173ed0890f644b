"""References in XML files that XML does not define: names of HTML, unknown names, a bare `&`."""

from pathlib import Path

import pytest

from conftest import names
from ecatd.base.errors import ConfigError
from ecatd.vendor.esi.findings import Findings
from ecatd.vendor.esi.xml import Element, read_xml

ALL = """<a first="&auml; &amp; &#228; &foo; &">
<b>Verst&auml;rker&nbsp;f&uuml;r &lt;R &amp; D&gt;</b>
<c>A &foo; B&C; &nbsp &#0; &#x1F600; &amp;auml;</c>
<d><![CDATA[<p>&nbsp; & &foo; <b>]]> &copy;</d><!-- &para; & -->
<left-out e="&sect;">&sect;</left-out>
</a>"""


def read(folder: Path, text: str, findings: Findings) -> Element:
    path = folder / "x.xml"
    path.write_text(text, encoding="utf-8")
    return read_xml(path, lambda element, _: element.tag != "left-out", findings)


def test_known_names_become_characters_and_others_stay(tmp_path: Path) -> None:
    root = read(tmp_path, ALL, Findings())
    assert root.attributes == {"first": "ä & ä &foo; &"}
    assert [child.text for child in root.children] == [
        "Verstärker\xa0für <R & D>",
        "A &foo; B&C; &nbsp &#0; \U0001f600 &auml;",
        "<p>&nbsp; & &foo; <b> ©",
    ]


def test_each_kind_is_told_once(tmp_path: Path) -> None:
    findings = Findings()
    read(tmp_path, ALL, findings)
    html, unknown, bare = findings.texts
    names(html, f"{tmp_path / 'x.xml'}:1: ", "'&auml;', '&copy;', '&nbsp;', '&uuml;'", "HTML")
    assert "&sect;" not in html, "it is nowhere where the file is used"
    assert "&para;" not in html, "a comment is no text"
    names(unknown, "x.xml:1: ", "'&#0;', '&C;', '&foo;'", "as it is written")
    names(bare, "x.xml:1: ", "'&'", "'&amp;'")
    with pytest.raises(ConfigError, match="&auml;"):
        read(tmp_path, ALL, Findings(strict=True))


def test_where_the_text_is_cut_changes_nothing(tmp_path: Path) -> None:
    """Files are read in parts, and a reference may lie in two of them."""
    for ahead in range((1 << 16) - 20, (1 << 16) + 2):
        text = "<a>" + "x" * (ahead - 3) + "&auml;&amp;&foo;&y</a>"
        root = read(tmp_path, text, Findings())
        assert root.text[ahead - 3 :] == "ä&&foo;&y"


def test_what_stands_for_references_within_the_reader_cannot_be_written(tmp_path: Path) -> None:
    findings = Findings()
    root = read(tmp_path, "<a>\ufdd0auml;\ufdd1 &#xFDD0;auml;&#xFDD1;</a>", findings)
    assert root.text == "auml; &#xFDD0;auml;&#xFDD1;"
    names(" ".join(findings.texts), "control characters", "'&#xFDD0;', '&#xFDD1;'")


def test_a_name_in_html_is_not_expanded_twice(tmp_path: Path) -> None:
    assert read(tmp_path, "<a>&AMP;auml; &LT;b&GT;</a>", Findings()).text == "&auml; <b>"
