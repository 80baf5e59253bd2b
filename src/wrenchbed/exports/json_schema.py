"""All numbers as JSON, with the JSON Schema that describes them beside it."""

import json
from collections.abc import Sequence
from typing import Any

from wrenchbed.exports.base import CARRIES, Export, ExportOptions
from wrenchbed.exports.load_numbers import LoadNumbers, Origin, Quantity

FORMAT = 1
_SIZES = {"mass": 1, "cog": 3, "inertia": 6, "rotation": 3, "position": 3, "bias": 6, "gravity": 3}
"""Length of each vector."""


class JsonSchema(Export):
    """For programs of the user's own. What the data did not determine is null."""

    name = "json-schema"
    title = "all numbers as JSON, with their JSON Schema beside them"
    source = "https://json-schema.org/draft/2020-12/schema"
    comment = ""
    carries = CARRIES
    endings = (".schema.json",)

    def text(self, numbers: LoadNumbers, options: ExportOptions, notes: Sequence[str]) -> str:
        content = {
            "format": FORMAT,
            "frame": numbers.frame,
            "numbers": {name: _entry(getattr(numbers, name)) for name in CARRIES},
            "source": {
                "file": numbers.source, "sha256": numbers.digest, "robot": numbers.robot,
                "recording": numbers.recording,
            },
            "left_out": list(numbers.left),
        }  # fmt: skip
        return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def beside(self) -> tuple[str, ...]:
        return (json.dumps(schema(), indent=1, ensure_ascii=False) + "\n",)


def _entry(quantity: Quantity) -> dict[str, Any]:
    lost = quantity.origin is Origin.UNDETERMINED
    return {
        "value": None if lost else quantity.value.tolist(),
        "std": None if quantity.std is None else quantity.std.tolist(),
        "unit": quantity.unit,
        "origin": quantity.origin.name.lower(),
    }


def schema() -> dict[str, Any]:
    """The JSON Schema of this format."""
    entries = {name: _entry_schema(size) for name, size in _SIZES.items()}
    text = {"type": "string"}
    source = dict.fromkeys(("file", "sha256", "robot", "recording"), text)
    fields = {
        "format": {"const": FORMAT},
        "frame": {"enum": ["flange axes", "sensor axes"]},
        "numbers": _object(entries),
        "source": _object(source),
        "left_out": {"type": "array", "items": text},
    }
    title = "Load, sensor zero, mount and gravity of a calibration by wrenchbed"
    return {"$schema": JsonSchema.source, "title": title, **_object(fields)}


def _entry_schema(size: int) -> dict[str, Any]:
    numbers = {"type": "array", "items": {"type": "number"}, "minItems": size, "maxItems": size}
    either = {"oneOf": [numbers, {"type": "null"}]}
    origins = [o.name.lower() for o in Origin]
    return _object(
        {"value": either, "std": either, "unit": {"type": "string"}, "origin": {"enum": origins}}
    )


def _object(fields: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object", "properties": fields, "required": list(fields),
        "additionalProperties": False,
    }  # fmt: skip


EXPORT = JsonSchema()
