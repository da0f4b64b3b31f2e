from __future__ import annotations

import hashlib
import re
from base64 import b64encode

from swarmsim.studies.report import page


def test_a_page_runs_no_script_and_wears_its_own_style_alone() -> None:
    text = page("Title", "<script>alert(1)</script>")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]+)"', text)[1]
    style = re.search(r"<style>(.*?)</style>", text, re.DOTALL)[1]
    digest = b64encode(hashlib.sha256(style.encode()).digest()).decode()
    assert policy.split("; ") == [
        "default-src 'none'", f"style-src 'sha256-{digest}'", "img-src data:", "base-uri 'none'", "form-action 'none'",
    ]  # fmt: skip
