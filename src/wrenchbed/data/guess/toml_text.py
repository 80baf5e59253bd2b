"""A raw column map as TOML text."""

import json
from collections.abc import Mapping
from typing import Any


def toml(raw: Mapping[str, Any], comments: tuple[str, ...] = ()) -> str:
    """TOML of a raw map, with lines of comment before it."""
    lines = [f"# {line}" for line in comments]
    recording = dict(raw["recording"])
    inner = {k: recording.pop(k) for k in ("tool", "sensor", "tolerance") if k in recording}
    lines += ["", "[recording]", *_entries(recording)]
    for name, fields in inner.items():
        lines += ["", f"[recording.{name}]", *_entries(fields)]
    for name in ("wrench", "orientation"):
        if name in raw:
            lines += ["", f"[{name}]", *_entries(raw[name])]
    for entry in raw["file"]:
        plain = {k: v for k, v in entry.items() if k != "columns"}
        lines += ["", "[[file]]", *_entries(plain), "[file.columns]", *_entries(entry["columns"])]
    return "\n".join(lines).lstrip("\n") + "\n"


def _entries(fields: Mapping[str, Any]) -> list[str]:
    return [f"{_key(k)} = {_value(v)}" for k, v in fields.items()]


def _key(key: str) -> str:
    return key if key.replace("_", "").isalnum() and key.isascii() else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_entries(value)) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return str(value).lower() if isinstance(value, bool) else repr(value)
