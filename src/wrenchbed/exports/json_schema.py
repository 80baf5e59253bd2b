"""All numbers as JSON, with the JSON Schema that describes them beside it."""

import json
from collections.abc import Sequence
from typing import Any

from wrenchbed.exports.base import CARRIES, Export, ExportOptions
from wrenchbed.exports.load_numbers import FLANGE, SENSOR, LoadNumbers, Origin, Quantity

FORMAT = 1
_TEXT = {"type": "string"}


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
            "format": FORMAT, "frame": numbers.frame,
            "numbers": {name: _entry(getattr(numbers, name)) for name in CARRIES},
            "source": {
                "file": numbers.source, "sha256": numbers.digest, "robot": numbers.robot,
                "recording": numbers.recording,
            },
            "left_out": list(numbers.left),
        }  # fmt: skip
        return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def beside(self, numbers: LoadNumbers) -> tuple[str, ...]:
        sizes = {name: len(getattr(numbers, name).value) for name in CARRIES}
        fields = {
            "format": {"const": FORMAT},
            "frame": {"enum": [FLANGE, SENSOR]},
            "numbers": _object({name: _entry_schema(size) for name, size in sizes.items()}),
            "source": _object(dict.fromkeys(("file", "sha256", "robot", "recording"), _TEXT)),
            "left_out": {"type": "array", "items": _TEXT},
        }
        title = "Load, sensor zero, mount and gravity of a calibration by wrenchbed"
        schema = {"$schema": self.source, "title": title, **_object(fields)}
        return (json.dumps(schema, indent=1, ensure_ascii=False) + "\n",)


def _entry(quantity: Quantity) -> dict[str, Any]:
    determined = quantity.origin is not Origin.UNDETERMINED
    return {
        "value": quantity.value.tolist() if determined else None,
        "std": None if quantity.std is None else quantity.std.tolist(),
        "unit": quantity.unit, "origin": quantity.origin.name.lower(),
    }  # fmt: skip


def _entry_schema(size: int) -> dict[str, Any]:
    vector = {"type": ["array", "null"], "items": {"type": "number"}, "minItems": size,
              "maxItems": size}  # fmt: skip
    origins = [o.name.lower() for o in Origin]
    return _object({"value": vector, "std": vector, "unit": _TEXT, "origin": {"enum": origins}})


def _object(fields: dict[str, Any]) -> dict[str, Any]:
    closed = {"required": list(fields), "additionalProperties": False}
    return {"type": "object", "properties": fields, **closed}


EXPORT = JsonSchema()
