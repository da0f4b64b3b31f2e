"""Verdicts as JUnit XML, in the form that pytest writes."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from datetime import datetime
from xml.etree import ElementTree as ET

from swarmsim.studies.expectations.verdicts import Verdict


def junit_of(verdicts: Sequence[Verdict], begun: datetime, seconds: float, allow_undecided: bool) -> str:
    """The report of a session that began at a time and took `seconds`.

    A verdict that is undecided is a failure of this type, never skipped, unless that is allowed.
    """
    root = ET.Element("testsuites", name="swarmsim test")
    bad = [one for one in verdicts if _is_bad(one, allow_undecided)]
    suite = ET.SubElement(
        root, "testsuite", name="swarmsim", errors="0", failures=str(len(bad)), skipped="0", tests=str(len(verdicts)),
        time=f"{seconds:.3f}", timestamp=begun.isoformat(), hostname=platform.node(),
    )  # fmt: skip
    for verdict in verdicts:
        file, _, sentence = verdict.expectation.name.partition("::")
        classname = file.removesuffix(".toml").replace("/", ".").lstrip(".")
        case = ET.SubElement(suite, "testcase", classname=classname, name=sentence, time=f"{verdict.seconds:.3f}")
        if verdict in bad:
            told = ET.SubElement(case, "failure", message=_plain(verdict.words), type=verdict.answer)
            told.text = _plain("\n".join([verdict.words, *filter(None, [verdict.command])]))
        else:
            ET.SubElement(case, "system-out").text = _plain(verdict.words)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _is_bad(verdict: Verdict, allow_undecided: bool) -> bool:
    return verdict.answer == "fails" or (verdict.answer == "undecided" and not allow_undecided)


def _plain(text: str) -> str:
    """The text without the control characters that XML has no form for."""
    return "".join(letter for letter in text if letter in "\t\n" or (letter >= " " and letter not in "\ufffe\uffff"))
