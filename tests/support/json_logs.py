"""MCAP files of JSON messages."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mcap.writer import Writer


def json_log(path: Path, messages: Iterable[tuple[str, Any, int]], **options: Any) -> Path:
    """Write (topic, message, time of writing [ns]); a message in bytes is taken as it is."""
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        channels: dict[str, int] = {}
        for topic, message, at in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", schema)
            content = message if isinstance(message, bytes) else json.dumps(message).encode()
            writer.add_message(channels[topic], at, content, at)
        writer.finish()
    return path
