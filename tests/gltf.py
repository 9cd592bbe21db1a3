"""glTF documents for tests: arrays become accessors of one buffer, which is inside the document."""

import base64
from typing import Any

import numpy as np
import pytest

Document = dict[str, Any]


class Builder:
    """Appends arrays to a document's only buffer as accessors."""

    def __init__(self) -> None:
        self.document: Document = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}
        self.blob = b""

    def view(self, values: np.ndarray) -> int:
        self.document["bufferViews"].append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": values.nbytes})
        self.blob += values.tobytes()
        return len(self.document["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, **more: Any) -> int:
        return self._described(values, bufferView=self.view(values), **more)

    def draco(self, faces: np.ndarray, **attributes: np.ndarray) -> Document:
        """Return a primitive compressed by Draco, its vertices in their order; integers are normalized, but joints."""
        draco = pytest.importorskip("DracoPy", reason="the package DracoPy is not installed")
        generic = {
            number + 10: values for number, (name, values) in enumerate(attributes.items()) if name != "POSITION"
        }
        positions = attributes["POSITION"]
        packed = draco.encode(positions, faces, quantization_bits=30, preserve_order=True, generic_attributes=generic)
        if positions.dtype == np.int16:  # DracoPy calls all integers int32
            packed = packed.replace(bytes([0, 5, 3, 0]), bytes([0, 3, 3, 0]), 1)
        found = draco.decode(packed).attributes
        numbers = {name: 10 + number for number, name in enumerate(attributes)}
        numbers["POSITION"] = next(row["unique_id"] for row in found if row["attribute_type"] == 0)
        rows = {
            name: self._described(values, normalized=values.dtype.kind in "iu" and not name.startswith("JOINTS"))
            for name, values in attributes.items()
        }
        view = self.view(np.frombuffer(packed, np.uint8))
        extension = {"bufferView": view, "attributes": numbers}
        return {"attributes": rows, "extensions": {"KHR_draco_mesh_compression": extension}}

    def _described(self, values: np.ndarray, **more: Any) -> int:
        kinds = {"float32": 5126, "uint32": 5125, "uint16": 5123, "uint8": 5121, "int16": 5122, "int8": 5120}
        shapes = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
        row = {"componentType": kinds[values.dtype.name], "type": shapes[values.shape[1:]], "count": len(values)}
        self.document["accessors"].append({**row, **more})
        return len(self.document["accessors"]) - 1

    def finished(self, **document: Any) -> Document:
        self.document |= {"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], **document}
        self.document["buffers"] = [{"byteLength": len(self.blob), "uri": data_uri(self.blob)}]
        return self.document


def data_uri(blob: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
