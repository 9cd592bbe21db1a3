"""glTF documents for tests: arrays become accessors of one buffer, which is inside the document."""

import base64
from typing import Any

import numpy as np

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
        kinds = {"float32": 5126, "uint32": 5125, "uint16": 5123, "uint8": 5121}
        shapes = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
        row = {"componentType": kinds[values.dtype.name], "type": shapes[values.shape[1:]], "count": len(values)}
        self.document["accessors"].append({"bufferView": self.view(values), **row, **more})
        return len(self.document["accessors"]) - 1

    def finished(self, **document: Any) -> Document:
        self.document |= {"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], **document}
        self.document["buffers"] = [{"byteLength": len(self.blob), "uri": data_uri(self.blob)}]
        return self.document


def data_uri(blob: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
