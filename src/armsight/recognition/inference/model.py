"""A network in an ONNX file, opened with suspicion and run by onnxruntime."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import ColorImage, Floats, Floats32
from armsight.errors import RecognitionError
from armsight.recognition.inference.no_robot import share_of
from armsight.recognition.networks.architecture import Architecture, read_description

FORMAT = "armsight-network-1"
WEIGHTS = Path(__file__).resolve().parents[1] / "weights"
_LARGEST_FILE = 2**31

_METADATA = 14
_EXTERNAL = (13, 14)
_WITHIN: dict[str, dict[int, str]] = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "graph": {1: "node", 5: "tensor", 15: "sparse tensor"},
    "node": {5: "attribute"},
    "attribute": {
        5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse tensor", 23: "sparse tensor"
    },
    "sparse tensor": {1: "tensor", 2: "tensor"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node", 11: "attribute"},
}  # fmt: skip
"""Fields of onnx.proto3 that this file looks at: the last are the way to each tensor."""
_DEEPEST = 100
"""Messages within each other, as protocol buffers have it."""


@dataclass(frozen=True)
class Answer:
    """What a network says of one image at its own size.

    Attributes:
        mask: (h, w) probability of robot.
        joints: (j, 3) joint origins in the camera's frame [m].
        base: (3,) origin of the base in the camera's frame [m].
        type: (r,) probability of each robot; 1 of a network that knows one only.
    """

    mask: Floats32
    joints: Floats32
    base: Floats32
    type: Floats32


class Model:
    """A network ready to run.

    Attributes:
        name: of the file, without its ending.
        architecture: robots, sizes.
        card: what it was trained on and how good it is.
        K: (3, 3) camera of its input, which it silently learned [px].
        no_robot_share: share of a picture that must look like a robot, else none is found.
    """

    def __init__(self, file: Path, threads: int = 0) -> None:
        """Open a file.

        Args:
            file: ONNX, as ``armsight train`` writes it.
            threads: of the CPU; 0 for onnxruntime's own choice.

        Raises:
            RecognitionError: it is missing, damaged, or no network of armsight's.
        """
        data, words = read_network(file)
        if words.get("format") != FORMAT:
            raise RecognitionError(
                f"{file}: is no network of armsight's; 'armsight train' and 'armsight transfer' "
                "write network.onnx"
            )
        self.name = file.stem
        self.architecture, self.card = read_description(file, words, "take the original")
        self.K = _camera(file, self.card)
        self.no_robot_share = _no_robot_share(file, self.card)
        self._session = open_session(file, data, threads)
        _check_shapes(file, self._session, self.architecture)
        self._names = [o.name for o in self._session.get_outputs()]

    def run(self, image: ColorImage) -> Answer:
        """The answer for an (h, w, 3) image of the network's own size.

        Raises:
            RecognitionError: the network answers with something that is no number.
        """
        answers = run_session(self.name, self._session, self._names, image)
        found = dict(zip(self._names, answers, strict=True))
        if not all(np.isfinite(v).all() for v in found.values()):
            raise RecognitionError(f"{self.name}: answers with something that is no number")
        kind = found["type"][0] if "type" in found else np.ones(1, np.float32)
        return Answer(found["mask"][0], found["joints"][0], found["base"][0], kind)


def network_file(name: str) -> Path:
    """The file of a network: shipped ones by their name, others by their path.

    Raises:
        RecognitionError: neither is there; names those that are shipped.
    """
    shipped = WEIGHTS / f"{name}.onnx"
    if Path(name).name == name and shipped.is_file():
        return shipped
    if Path(name).suffix == ".onnx":
        return Path(name)
    known = ", ".join(shipped_networks()) or "none"
    raise RecognitionError(f'no network "{name}": neither an .onnx file nor one of {known}')


def shipped_networks() -> list[str]:
    """Names of the networks that come with armsight."""
    return sorted(p.stem for p in WEIGHTS.glob("*.onnx"))


def read_network(file: Path) -> tuple[bytes, dict[str, str]]:
    """A file and what it says of itself; nothing of it is believed yet.

    Raises:
        RecognitionError: it is missing, too large, damaged, or names other files.
    """
    data = _read(file)
    return data, _words(file, data)


def _read(file: Path) -> bytes:
    try:
        if file.stat().st_size >= _LARGEST_FILE:
            raise RecognitionError(f"{file}: is larger than a network can be (2 GiB)")
        return file.read_bytes()
    except FileNotFoundError:
        raise RecognitionError(
            f"{file}: there is no such network; known: {', '.join(shipped_networks()) or 'none'}"
        ) from None
    except OSError as error:
        raise RecognitionError(f"{file}: cannot be read ({error.strerror or error})") from None


def _words(file: Path, data: bytes) -> dict[str, str]:
    """What the file says of itself; read before anything else in it is believed.

    A network of ours keeps its numbers in the file: one that names other files is refused, since
    those could be any files of this machine.
    """
    words: dict[str, str] = {}
    try:
        for number, start, end in _fields(data, 0, len(data)):
            if number == _METADATA:
                pair = [data[a:b].decode() for _, a, b in _fields(data, start, end)]
                words[pair[0]] = pair[1]
        if _names_files(data):
            raise RecognitionError(f"{file}: names other files; it is not ours")
    except (ValueError, IndexError):
        raise RecognitionError(
            f"{file}: is no ONNX file, or damaged; take the original, or export it anew"
        ) from None
    return words


def _names_files(data: bytes) -> bool:
    """Whether any tensor of a model, wherever it hides, says that its numbers are elsewhere."""
    ahead = [("model", 0, len(data), 0)]
    while ahead:
        kind, start, end, depth = ahead.pop()
        if depth > _DEEPEST:
            raise ValueError
        for number, a, b in _fields(data, start, end):
            if kind == "tensor":
                if number in _EXTERNAL:
                    return True
            elif number in _WITHIN[kind]:
                ahead.append((_WITHIN[kind][number], a, b, depth + 1))
    return False


def _fields(data: bytes, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Number, start and end of the fields of a protocol buffers message.

    Raises:
        ValueError: it is none.
    """
    while at < end:
        tag, at = _varint(data, at, end)
        if not 8 <= tag < 2**32:  # other readers would cut it, and see another field
            raise ValueError
        kind = tag & 7
        if kind == 0:
            start = at
            _, at = _varint(data, at, end)
        elif kind in (1, 5):
            start, at = at, at + (8 if kind == 1 else 4)
        elif kind == 2:
            length, start = _varint(data, at, end)
            at = start + length
        else:
            raise ValueError
        if at > end:
            raise ValueError
        yield tag >> 3, start, at


def _varint(data: bytes, at: int, end: int) -> tuple[int, int]:
    value = 0
    for k in range(10):
        if at >= end:
            raise ValueError
        value |= (data[at] & 0x7F) << (7 * k)
        at += 1
        if data[at - 1] < 0x80:
            return value, at
    raise ValueError


def _camera(file: Path, card: dict[str, Any]) -> Floats:
    try:
        K = np.array(card["camera"]["K"], np.float64)
        good = K.shape == (3, 3) and bool(np.isfinite(K).all()) and min(K[0, 0], K[1, 1]) > 0
    except (KeyError, ValueError, TypeError, OverflowError):
        good = False
    if not good:
        raise RecognitionError(f"{file}: its card names no camera; take the original")
    return K


def _no_robot_share(file: Path, card: dict[str, Any]) -> float:
    try:
        return share_of(card)
    except ValueError:
        raise RecognitionError(
            f"{file}: its card names no share of a picture below which none is found; "
            "take the original"
        ) from None


def open_session(file: Path, data: bytes, threads: int) -> Any:
    """A session of onnxruntime.

    Raises:
        RecognitionError: the graph is damaged.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 4
    # Its own format is recognised by four bytes, and nobody here has looked into such a file.
    options.add_session_config_entry("session.load_model_format", "ONNX")
    try:
        return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors share no other base
        words = str(error).splitlines()[0][:160]
        raise RecognitionError(f"{file}: is damaged ({words}); take the original") from None


def run_session(name: str, session: Any, wanted: list[str], image: ColorImage) -> list[Any]:
    """The wanted outputs for an (h, w, 3) image.

    Raises:
        RecognitionError: the graph cannot be worked out for it.
    """
    try:
        return list(session.run(wanted, {"image": image[None]}))
    except Exception as error:  # onnxruntime's errors share no other base
        words = str(error).splitlines()[0][:160]
        raise RecognitionError(f"{name}: does not run ({words}); take the original") from None


def _check_shapes(file: Path, session: Any, a: Architecture) -> None:
    """Inputs and outputs are those that the card promises."""
    inputs = {i.name: (i.type, list(i.shape)) for i in session.get_inputs()}
    outputs = {o.name: list(o.shape) for o in session.get_outputs()}
    wanted = {"mask": [1, a.height, a.width], "joints": [1, a.joints, 3], "base": [1, 3]}
    if a.kind == "multi-objective":
        wanted["type"] = [1, len(a.robots)]
    image = {"image": ("tensor(uint8)", [1, a.height, a.width, 3])}
    if inputs != image or outputs != wanted:
        raise RecognitionError(f"{file}: does not fit its own card; take the original")


def validation_figure(card: dict[str, Any], robot: str, name: str) -> float:
    """A figure of the card on validation frames of a robot; NaN where it has none."""
    try:
        return float(card["validation"][robot][name])
    except (KeyError, TypeError, ValueError, OverflowError):
        return math.nan
