"""A depth camera that nobody lists: it tells its intrinsics in a line, then sends 16-bit pictures.

armsight doctor --driver tcp_camera:Camera --kind camera --option port=7001
"""

import json
import socket
import struct

import numpy as np

from armsight.devices.data import DepthNoise
from armsight.devices.port import CameraReport, CameraSettings, DepthReading
from armsight.geometry.camera import PinholeCamera


class Camera:
    def __init__(self, settings: CameraSettings) -> None:
        address = (settings.connection.get("host", "127.0.0.1"), settings.connection["port"])
        self.stream = socket.create_connection(address, timeout=2.0).makefile("rb")
        told = json.loads(self.stream.readline())
        self.lens = PinholeCamera(*(told[k] for k in ("width", "height", "fx", "fy", "cx", "cy")))
        noise = DepthNoise(
            0.001, 0.0, 0.002
        )  # sigma(z) = 1 mm + 2 mm/m^2 z^2, by the maker's sheet
        self.report = CameraReport(told["serial"], self.lens, told["rate"], (0.3, 4.0), noise)

    def read(self) -> DepthReading:
        count, microseconds = struct.unpack("<IQ", self.stream.read(12))
        pixels = self.stream.read(2 * self.lens.width * self.lens.height)
        depth = np.frombuffer(pixels, "<u2").reshape(self.lens.height, self.lens.width)
        return DepthReading(1e-6 * microseconds, depth.astype(np.float32) * 1e-3, sequence=count)

    def want_color(self, wanted: bool) -> None:
        pass  # it has none

    def close(self) -> None:
        self.stream.close()
