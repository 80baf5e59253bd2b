"""axe-core, which finds what keeps people from reading a page; fetched from npm once."""

import hashlib
import json
import shutil
import subprocess
import tarfile
from functools import cache
from pathlib import Path
from typing import Any

VERSION = "4.14.1"
SHA512 = (
    "1477dafa598d8d065f273d6af302aa203c02e83131707b7fa648cd41bd3d6b73"
    "4f8c22a0dab86ee6a6f64b8afbe804b214d36db85a2826965edfb3a0b9d546b5"
)
"""Of npm's archive of this version."""
CACHE = Path(__file__).parents[2] / ".cache" / "axe"
_FETCH_S = 60
RULES = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa")
"""WCAG 2.0 to 2.2, levels A and AA."""


@cache
def script() -> str | None:
    """axe's script; None where it is not there and npm cannot bring it."""
    archive = CACHE / f"axe-core-{VERSION}.tgz"
    if not archive.exists():
        npm = shutil.which("npm")
        if npm is None:
            return None
        CACHE.mkdir(parents=True, exist_ok=True)
        command = [npm, "pack", f"axe-core@{VERSION}", "--silent", "--pack-destination", str(CACHE)]
        try:
            subprocess.run(command, cwd=CACHE, capture_output=True, timeout=_FETCH_S, check=True)
        except (subprocess.SubprocessError, OSError):
            return None
    assert hashlib.sha512(archive.read_bytes()).hexdigest() == SHA512, archive
    with tarfile.open(archive) as tar:
        member = tar.extractfile("package/axe.min.js")
        assert member is not None
        return member.read().decode()


def violations(page: Any) -> list[str]:
    """What the rules find on the page of a tab, as far as it is shown."""
    text = script()
    assert text is not None
    page.call("Runtime.evaluate", expression=text)
    run = (
        f"axe.run(document, {{runOnly: {json.dumps(RULES)}, resultTypes: ['violations']}})"
        ".then(r => JSON.stringify(r.violations.map(v => `${v.id}: ${v.nodes[0].html}`)))"
    )
    told = page.call("Runtime.evaluate", expression=run, awaitPromise=True, returnByValue=True)
    return list(json.loads(told["result"]["value"]))
